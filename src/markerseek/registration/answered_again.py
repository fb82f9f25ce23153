"""A search that is answered again with what the cameras saw of the tissue meanwhile.

While a marker is searched, the rotation between cameras and probe may not be known yet, and where the tissue rests is
known less well than at the end. Its samples are kept, without their frames, and answered again once more is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

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
from markerseek.runs import rebuild_policy, tell_recorded
from markerseek.scan import mean_displacement

MIN_KNOWN = 0.5
"""Least share of the samples whose displacement is known: those of the others are taken for their mean."""


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
