"""A search that is answered again with what the cameras saw of the tissue meanwhile.

While a marker is searched, the rotation between cameras and probe may not be known yet, and where the tissue rests is
known less well than at the end. Its samples are kept, without their frames, and answered again once more is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import (
    Displacement,
    Estimate,
    MarkerCandidate,
    Measured,
    ReadingFrame,
    Sample,
    displacement_sigmas,
    marker_candidates,
)
from markerseek.records.journal import Configuration, JournalEntry, JournalEvent
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue
from markerseek.registration.stations import station_names
from markerseek.registration.steps import CorrectedMarker, TakenMarker
from markerseek.runs import rebuild_policy, tell_recorded
from markerseek.scan import mean_displacement
from markerseek.show import answer_name, answer_reason

MIN_KNOWN = 0.5
"""Least share of the samples whose displacement is known: those of the others are taken for their mean."""

_BETTER = 0.7
_TURNED_RAD = 0.01
"""Standard deviation of a rotation over that of the former one, and angle from it, with which a search is answered
again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """An answer from the samples of a search with the motion of the tissue taken out."""

    estimate: Estimate
    candidates: tuple[MarkerCandidate, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeptSearch:
    """The events of a search, and the tissue as the cameras followed it."""

    configuration: Configuration
    events: Sequence[JournalEvent]
    """With samples whose frames are their headers alone."""
    tissue: CameraTissue

    def answered(self, rotation: CameraRotation | None) -> Answered | None:
        """Return the answer again; None if the displacement at most samples is not known.

        ``rotation``: from the cameras to the probe; None: of a displacement its size alone is known.
        """
        tissue = replace(self.tissue, rotation=rotation)
        events = [_displaced(event, tissue) if isinstance(event, Measured) else event for event in self.events]
        lit = [event.sample for event in events if isinstance(event, Measured) and not event.sample.dark]
        known = sum(sample.displacement is not None for sample in lit)
        if not lit or known < MIN_KNOWN * len(lit):
            return None
        policy = rebuild_policy(self.configuration)
        tell_recorded(
            policy,
            [JournalEntry(number=n, written="", clock_s=0.0, event=each) for n, each in enumerate(events, start=1)],
        )
        estimate = policy.estimate()
        candidates = marker_candidates(estimate, lit, self.configuration.facts)
        if rotation is None:
            candidates = tuple(_widened(each, lit) for each in candidates)
        return Answered(estimate=estimate, candidates=candidates)


def _widened(candidate: MarkerCandidate, lit: Sequence[Sample]) -> MarkerCandidate:
    """Return a candidate with room along the turn for displacements of unknown direction.

    Breath displaces all ways of the sweeps to the same side, and no mean of them lessens that.
    """
    strongest = max(sample.reading.intensity for sample in lit)
    strong = [sample for sample in lit if sample.reading.intensity >= 0.5 * strongest]
    room_m = float(np.sqrt(np.mean([displacement_sigmas(sample).turn_m ** 2 for sample in strong])))
    along_m, lateral_m, depth_m = candidate.position.sigma_m
    position = structs.replace(candidate.position, sigma_m=(math.hypot(along_m, room_m), lateral_m, depth_m))
    return structs.replace(candidate, position=position)


def with_header(event: JournalEvent) -> JournalEvent:
    """Return an event whose sample has the header of its frame alone."""
    if not isinstance(event, Measured) or event.sample.frame is None:
        return event
    frame = ReadingFrame(header=event.sample.frame.header, intensity=event.sample.reading.intensity)
    return structs.replace(event, sample=structs.replace(event.sample, frame=frame))


def _displaced(event: Measured, tissue: CameraTissue) -> Measured:
    """Return an event whose sample states the displacement of the tissue."""
    sample = event.sample
    if sample.dark or sample.frame is None:
        return event
    return structs.replace(event, sample=structs.replace(sample, displacement=_displacement(sample, tissue)))


def _displacement(sample: Sample, tissue: CameraTissue) -> Displacement | None:
    if sample.frame is None:
        return None
    header = sample.frame.header
    if header.pulses == 1:
        return tissue.displacement((header.started_s + header.ended_s) / 2)
    return mean_displacement(tissue, began_s=header.started_s, ended_s=header.ended_s)


class KeptSearches:
    """The searches of a session during which the tissue moved, and what was known when each was answered last."""

    def __init__(self) -> None:
        self._searches: dict[str, KeptSearch] = {}
        self._rotations: dict[str, CameraRotation | None] = {}
        """The rotation with which each of them was answered last."""

    @property
    def is_empty(self) -> bool:
        """Whether the tissue moved during none."""
        return not self._searches

    def keep(self, name: str, search: KeptSearch) -> None:
        """Keep the search of a marker."""
        self._searches[name] = search

    def corrected(self, markers: Sequence[TakenMarker], rotation: CameraRotation | None) -> Iterator[CorrectedMarker]:
        """Answer the searches again, with the rotation that the markers so far tell; None: they tell none."""
        stations = station_names(markers)
        here = stations[markers[-1].name]
        for marker in markers:
            search = self._searches.get(marker.name)
            # Where the endoscope stood elsewhere, its rotation was another one.
            if search is None or stations[marker.name] != here or not self._is_news(marker.name, rotation):
                continue
            answered = search.answered(rotation)
            if answered is not None and (answered.candidates or not marker.candidates):
                yield _correction(marker, answered)
            self._rotations[marker.name] = rotation

    def _is_news(self, name: str, rotation: CameraRotation | None) -> bool:
        """Whether a search was not answered again yet, or less was known of the rotation then."""
        return name not in self._rotations or _is_better(rotation, self._rotations[name])


def _is_better(rotation: CameraRotation | None, former: CameraRotation | None) -> bool:
    """Whether more is known of a rotation than when a search was answered last."""
    if rotation is None or former is None:
        return rotation is not former
    turned = Rotation.from_matrix(rotation.matrix @ former.matrix.T).magnitude()
    return rotation.sigma_rad < _BETTER * former.sigma_rad or float(turned) > _TURNED_RAD


def _correction(marker: TakenMarker, answered: Answered) -> CorrectedMarker:
    """Return the step by which a marker gets another answer."""
    name = answer_name(answered.estimate)
    candidates = list(answered.candidates)
    moved = ""
    if candidates and marker.candidates:
        way_m = np.subtract(candidates[0].position.position_m, marker.candidates[0].position.position_m)
        moved = f", {1e3 * float(np.linalg.norm(way_m)):.2f} mm from before"
    where = f" at {candidates[0].angle_deg:.2f} deg" if candidates else ""
    return CorrectedMarker(
        name=marker.name,
        answer=name,
        reason=answer_reason(answered.estimate),
        candidates=candidates,
        said=f"marker {marker.name} again, with the tissue's motion taken out: {name}{where}{moved}",
    )
