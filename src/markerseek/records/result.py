"""The result of a search as programs read it: one object, units in the names of its keys."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from markerseek._version import __version__
from markerseek.core import (
    Ambiguous,
    AtBound,
    Event,
    Failed,
    Finished,
    Floor,
    Found,
    Interval,
    IntervalKind,
    Measured,
    NotFound,
    Refused,
    Sample,
    SearchError,
    Started,
    Unsure,
)
from markerseek.records.configuration import Configuration

CONFIRMED_SHARE = 0.8
"""The acquisition at the angle found must reach this share of the strongest of the search to confirm it."""


class SampleRow(msgspec.Struct, frozen=True, kw_only=True):
    """One acquisition of a result; what the frame did not contain is None."""

    angle_deg: float
    intensity: float
    lateral_m: float | None
    depth_m: float | None
    arrival_s: float | None
    noise_sigma: float | None

    @classmethod
    def of(cls, sample: Sample) -> SampleRow:
        """Row of a sample."""
        reading = sample.reading
        return cls(
            angle_deg=sample.angle_deg,
            intensity=reading.intensity,
            lateral_m=reading.lateral_m,
            depth_m=reading.depth_m,
            arrival_s=reading.arrival_s,
            noise_sigma=reading.noise_sigma,
        )


class SearchResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a search found and how.

    ``angle_deg`` is where the method points, also when it does not claim a marker there. ``rig`` says whether any
    hardware was involved. ``truth_deg`` is known of simulated markers only, ``reference_deg`` is what the user compares
    with, and ``error_deg`` the distance to either. ``confirmed`` tells whether the acquisition at the angle found was
    as strong as it should be, see `CONFIRMED_SHARE`. ``configuration`` is the same for runs on equal rigs.
    """

    found: bool
    answer: Literal["found", "not found", "ambiguous", "at bound", "unsure"]
    reason: str | None
    method: str
    as_published: bool
    rig: Literal["simulated", "replayed", "bench"]
    angle_deg: float
    sigma_deg: float | None
    interval95_deg: tuple[float, float] | None
    interval_kind: IntervalKind | None
    marker_trus_m: tuple[float, float, float] | None
    acquisitions: int
    refused: int
    travel_deg: float
    elapsed_s: float | None
    confirmation: SampleRow | None
    confirmed: bool | None
    floor: Floor | None
    samples: list[SampleRow]
    truth_deg: float | None
    reference_deg: float | None
    error_deg: float | None
    seed: int | None
    configuration: str
    version: str = __version__


class Recorder:
    """Collects from the events of a run what the result needs."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []
        self.confirmation: Sample | None = None
        self.finished: Finished | None = None
        self.start_deg: float = math.nan
        self._refused = 0

    def hear(self, event: Event) -> None:
        """Take in one event of `markerseek.scan.run`."""
        match event:
            case Started(start_deg=start_deg):
                self.start_deg = start_deg
            case Measured(role="search", sample=sample):
                self.samples.append(sample)
            case Measured(role="confirmation", sample=sample):
                self.confirmation = sample
            case Refused():
                self._refused += 1
            case Finished():
                self.finished = event
            case Failed():
                self.finished = None

    def result(self, configuration: Configuration) -> SearchResult:
        """Result of the run.

        Parameters
        ----------
        configuration
            What the run was begun with.

        Raises
        ------
        SearchError
            If the run is not over, or ended with an error.
        """
        if self.finished is None:
            raise SearchError("the run is not over, or it failed: there is no result")
        finished = self.finished
        estimate = finished.estimate
        sigma_deg = estimate.sigma_deg if isinstance(estimate, Found | Unsure) else None
        interval = estimate.interval95_deg if isinstance(estimate, Found | Unsure) else None
        truth_deg, reference_deg = configuration.truth_deg, configuration.reference_deg
        known_deg = reference_deg if truth_deg is None else truth_deg
        return SearchResult(
            found=isinstance(estimate, Found),
            answer=answer_name(estimate),
            reason=_reason(estimate),
            method=configuration.method,
            as_published=configuration.as_published,
            rig=configuration.rig,
            angle_deg=estimate.mean_deg,
            sigma_deg=sigma_deg,
            interval95_deg=_ends(interval),
            interval_kind=estimate.interval_kind if isinstance(estimate, Found | Unsure) else None,
            marker_trus_m=self._marker(estimate, configuration.face_radius_m) if isinstance(estimate, Found) else None,
            acquisitions=finished.acquisitions,
            refused=self._refused,
            travel_deg=finished.travel_deg,
            elapsed_s=None if configuration.rig == "replayed" else finished.elapsed_s,
            confirmation=None if self.confirmation is None else SampleRow.of(self.confirmation),
            confirmed=self._confirmed(estimate.floor),
            floor=estimate.floor,
            samples=[SampleRow.of(sample) for sample in self.samples],
            truth_deg=truth_deg,
            reference_deg=reference_deg,
            error_deg=None if known_deg is None else abs(estimate.mean_deg - known_deg),
            seed=configuration.seed,
            configuration=configuration.fingerprint,
        )

    def _confirmed(self, floor: Floor | None) -> bool | None:
        """Whether the confirmation is nearly the strongest of all, and above the floor; None without one."""
        if self.confirmation is None:
            return None
        intensity = self.confirmation.reading.intensity
        largest = max(sample.reading.intensity for sample in self.samples)
        level = 0.0 if floor is None or floor.level is None else floor.level
        return intensity > level and intensity >= CONFIRMED_SHARE * largest

    def _marker(self, found: Found, face_radius_m: float | None) -> tuple[float, float, float] | None:
        """The marker in the TRUS frame: (ρ sin θp, y, ρ cos θp) in metres, from the strongest frame."""
        measured = [*self.samples, *([self.confirmation] if self.confirmation else [])]
        strongest = max(measured, key=lambda sample: sample.reading.intensity).reading
        if face_radius_m is None or strongest.depth_m is None or strongest.lateral_m is None:
            return None
        radius_m = face_radius_m + strongest.depth_m
        angle = math.radians(found.mean_deg)
        return radius_m * math.sin(angle), strongest.lateral_m, radius_m * math.cos(angle)


def answer_name(
    estimate: Found | NotFound | Ambiguous | AtBound | Unsure,
) -> Literal["found", "not found", "ambiguous", "at bound", "unsure"]:
    """Kind of an answer in words."""
    match estimate:
        case Found():
            return "found"
        case NotFound():
            return "not found"
        case Ambiguous():
            return "ambiguous"
        case AtBound():
            return "at bound"
        case Unsure():
            return "unsure"


def _reason(estimate: Found | NotFound | Ambiguous | AtBound | Unsure) -> str | None:
    match estimate:
        case Found():
            return None
        case NotFound(reason=reason) | Unsure(reason=reason):
            return reason
        case Ambiguous(modes_deg=modes):
            return f"markers at {', '.join(f'{mode:.2f}' for mode in modes)} deg explain what was seen equally well"
        case AtBound(side=side):
            return f"the intensity still rises at the {side} end of the range; shift the range towards it"


def _ends(interval: Interval | None) -> tuple[float, float] | None:
    return None if interval is None else (interval.low_deg, interval.high_deg)
