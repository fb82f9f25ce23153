"""The paper's offline analysis (section 2.5): the searches on a recording, through the same loop as on a rig.

The recordings are those of `recordings`; a user's own takes the place of a simulated one and nothing else changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markerseek import rigs
from markerseek.records.banks import read_bank
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.methods import (
    AVERAGE_ACQUISITIONS,
    BRACKET_ACQUISITIONS,
    BRACKETS,
    Name,
    OnCounts,
    published,
    searched,
    shorter,
)
from markerseek.studies.paper.recordings import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One search on one bank.

    Attributes
    ----------
    recording
        The bank.
    method, acquisitions
        What searched.
    angle_deg
        Angle answered, in degrees.
    reference_deg, maximum_deg
        Angle that counts as true, and that of the bank's largest intensity, in degrees.
    """

    recording: Recording
    method: Name
    acquisitions: int
    angle_deg: float
    reference_deg: float
    maximum_deg: float

    @property
    def error_deg(self) -> float:
        """Absolute difference from the reference, in degrees."""
        return abs(self.angle_deg - self.reference_deg)

    @property
    def from_maximum_deg(self) -> float:
        """Absolute difference from the bank's own maximum, in degrees."""
        return abs(self.angle_deg - self.maximum_deg)


def answers(recordings: Sequence[Recording], effort: Effort) -> list[Answer]:
    """Answers of every method at every number of acquisitions of Fig. 6, on each bank.

    Parameters
    ----------
    recordings
        Banks on disk.
    effort
        What may be used.

    Raises
    ------
    RecordError
        If a bank cannot be read.
    """
    return [answer for found in effort.each(_answers, recordings, what="offline searches") for answer in found]


def _answers(recording: Recording) -> list[Answer]:
    rig = rigs.replayed(recording.path, reference_deg=recording.reference_deg, between="interpolated")
    limits = rig.limits.search
    maximum_deg = _maximum_deg(rig, read_bank(recording.path).angles_deg)
    reference_deg = maximum_deg if recording.reference_deg is None else recording.reference_deg

    def answer(method: Name, acquisitions: int, angle_deg: float) -> Answer:
        return Answer(
            recording=recording,
            method=method,
            acquisitions=acquisitions,
            angle_deg=angle_deg,
            reference_deg=reference_deg,
            maximum_deg=maximum_deg,
        )

    found = []
    for name in BRACKETS:
        policy = published(name, acquisitions=max(BRACKET_ACQUISITIONS), limits=limits)
        samples, _ = searched(OnCounts(policy, limits=limits), rig.scanner)
        found += [answer(name, count, angle_deg) for count, angle_deg in shorter(name, samples, limits=limits)]
    for acquisitions in AVERAGE_ACQUISITIONS:
        policy = published("WA", acquisitions=acquisitions, limits=limits)
        _, finished = searched(OnCounts(policy, limits=limits), rig.scanner)
        found.append(answer("WA", acquisitions, finished.estimate.mean_deg))
    return found


def _maximum_deg(rig: rigs.Rig, angles_deg: Sequence[float]) -> float:
    """Recorded angle of the largest intensity, in degrees."""
    heard = [rig.scanner.measure(angle_deg) for angle_deg in angles_deg]
    return max(heard, key=lambda sample: sample.reading.intensity).angle_deg
