"""Result of a search as one JSON object, with the units in the names of its keys."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, TypeGuard

import msgspec

from markerseek._version import __version__
from markerseek.core import (
    Doubt,
    Estimate,
    Finished,
    Floor,
    Found,
    IntervalKind,
    MarkerCurve,
    NotFound,
    OtherSource,
    RigFacts,
    RigKind,
    Sample,
    Searched,
    SearchError,
    SearchPlan,
    Unsure,
    counted,
    listed,
    marker_position,
    needs_package,
    rig_in_words,
)
from markerseek.records.curve_svg import DrawnCurve, Mark, as_html
from markerseek.records.words import AnswerName, answer_name, answer_reason

if TYPE_CHECKING:
    import pandas as pd


class SampleRow(msgspec.Struct, frozen=True, kw_only=True):
    """One acquisition of a result; values that the frame does not give are None."""

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


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """An answer and its angle; the fields are as in `SearchResult`."""

    answer: AnswerName
    reason: str | None
    angle_deg: float
    sigma_deg: float | None
    interval95_deg: tuple[float, float] | None
    interval_kind: IntervalKind | None

    @classmethod
    def of(cls, estimate: Estimate) -> Answer:
        """The answer of a search, or of all angles of a recording."""
        known = None if isinstance(estimate, NotFound) else estimate
        interval = None if known is None else known.interval95_deg
        return cls(
            answer=answer_name(estimate),
            reason=answer_reason(estimate),
            angle_deg=estimate.mean_deg,
            sigma_deg=None if known is None else known.sigma_deg,
            interval95_deg=None if interval is None else (interval.low_deg, interval.high_deg),
            interval_kind=None if known is None else known.interval_kind,
        )

    def __str__(self) -> str:
        """The answer, its angle with interval, and its reason, in a line."""
        reason = "" if self.reason is None else f": {self.reason}"
        # Where nothing was detected, the angle is that of the noise; of several angles the reason has all.
        if self.answer in {"not found", "ambiguous"}:
            return f"{self.answer}{reason}"
        sigma = "" if self.sigma_deg is None else f" ± {self.sigma_deg:.3f}°"
        interval = "" if self.interval95_deg is None else " [{:.3f}°, {:.3f}°]".format(*self.interval95_deg)
        return f"{self.answer}, {self.angle_deg:.3f}°{sigma}{interval}{reason}"


class ReplayedSearch(Answer, frozen=True, kw_only=True):
    """What a search of a recording would have taken and said; the fields are as in `SearchResult`."""

    method: str
    error_deg: float | None
    acquisitions: int
    travel_deg: float
    samples: list[SampleRow]


class SearchResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a search found and how, or what all angles of a recording say.

    Of a recording, all fields are those of all its angles, each of which is one of the ``samples``; ``travel_deg`` is
    None, and ``search`` is what a search would have taken and said, for comparison; None elsewhere.
    ``doubt`` says of what an answer that is unsure is so: of the source, or of the width of its angle's interval.
    ``sigma_deg`` and ``interval95_deg`` are those of the angle, whatever the answer; None where nothing was detected.
    ``half_width_m`` is how far that interval reaches from the angle, as a length at the marker.
    ``angle_deg`` is the method's best angle, even when it does not claim a marker there. ``rig`` is the kind of rig,
    and ``emulated`` names the devices of a bench that are emulators.
    ``truth_deg`` is known for simulated markers only, ``reference_deg`` was given by the user or the bank, and
    ``error_deg`` is the distance to either. ``confirmed`` says whether the acquisition at the angle found confirms it
    (`markerseek.scan.confirmation`); None where there is none, and in the paper's form of a method, which does not
    test it; its standard deviation and interval are None too, because it answers where there is no marker as well. A
    confirmation after which the search went on is one of the ``samples``. ``marker_trus_m`` is the marker in the TRUS
    frame and ``marker_sigma_m`` its standard deviations along the turn, along the axis and in depth
    (`markerseek.core.MarkerPosition`), also of an answer that is unsure for its width only. ``others`` are further
    sources, and ``surveyed`` is the share of the range in which a source as loud would have been detected.
    ``other_probability`` is the probability that another source is the marker. ``curve`` is the marker's intensity
    curve, a prior for the next search on the rig. ``configuration`` is the fingerprint of the rig.
    """

    found: bool
    answer: AnswerName
    reason: str | None
    doubt: Doubt | None
    method: str
    as_published: bool
    rig: RigKind
    emulated: tuple[str, ...]
    angle_deg: float
    sigma_deg: float | None
    interval95_deg: tuple[float, float] | None
    interval_kind: IntervalKind | None
    half_width_m: float | None
    marker_trus_m: tuple[float, float, float] | None
    marker_sigma_m: tuple[float, float, float] | None
    acquisitions: int
    refused: int
    travel_deg: float | None
    elapsed_s: float | None
    confirmation: SampleRow | None
    confirmed: bool | None
    floor: Floor | None
    others: list[OtherSource]
    surveyed: float | None
    other_probability: float | None
    curve: MarkerCurve | None
    samples: list[SampleRow]
    truth_deg: float | None
    reference_deg: float | None
    error_deg: float | None
    seed: int | None
    configuration: str
    search: ReplayedSearch | None = None
    version: str = __version__

    @classmethod
    def of(
        cls,
        finished: Finished | None,
        *,
        plan: SearchPlan,
        facts: RigFacts,
        samples: Sequence[Sample],
        confirmation: Sample | None,
        start_deg: float,
        refused: int,
    ) -> SearchResult:
        """The result of a run.

        Parameters
        ----------
        finished
            The end of the run; None if the run is not over, or failed.
        plan, facts
            What was asked of the search, and what is known of the rig.
        samples, confirmation
            Acquisitions with light, and the one at the answer; None if there was none.
        start_deg
            Angle of the probe when the run began, in degrees.
        refused
            Acquisitions that were refused.

        Raises
        ------
        SearchError
            If there is no end.
        """
        if finished is None:
            raise SearchError("the run is not over, or it failed: there is no result")
        estimate, searched = finished.estimate, finished.searched
        # The paper's form answers where there is no marker as well, and a search that detected nothing has noise only.
        known = None if isinstance(estimate, NotFound) or plan.as_published else estimate
        interval = None if known is None else known.interval95_deg
        # The marker's position follows from all frames with light.
        lit = [*samples, *([] if confirmation is None else [confirmation])]
        placed = estimate if isinstance(estimate, Found) or _unsure_of_width(estimate) else None
        marker = None if placed is None else marker_position(placed, lit, facts)
        kept = samples if searched is None else _all_angles(samples)
        return cls(
            found=isinstance(estimate, Found),
            answer=answer_name(estimate),
            reason=answer_reason(estimate),
            doubt=estimate.doubt if isinstance(estimate, Unsure) else None,
            # The method of a search says nothing of the answer from all angles.
            method=plan.method if searched is None else "posterior",
            as_published=plan.as_published,
            rig=facts.kind,
            emulated=facts.emulated,
            angle_deg=estimate.mean_deg,
            sigma_deg=None if known is None else known.sigma_deg,
            interval95_deg=None if interval is None else (interval.low_deg, interval.high_deg),
            interval_kind=None if known is None else known.interval_kind,
            half_width_m=known.half_width_m if isinstance(known, Found | Unsure) else None,
            marker_trus_m=None if marker is None else marker.position_m,
            marker_sigma_m=None if marker is None or known is None else marker.sigma_m,
            acquisitions=finished.acquisitions if searched is None else len(kept),
            refused=refused,
            travel_deg=finished.travel_deg if searched is None else None,
            # A replay takes no time, and the durations of the original scan say nothing of this search.
            elapsed_s=None if facts.kind == "replayed" else finished.elapsed_s,
            confirmation=None if confirmation is None else SampleRow.of(confirmation),
            confirmed=None if confirmation is None or estimate.floor is None else isinstance(estimate, Found),
            floor=estimate.floor,
            others=list(estimate.others),
            surveyed=estimate.surveyed,
            other_probability=estimate.other_probability if isinstance(estimate, Found | Unsure) else None,
            curve=estimate.curve if isinstance(estimate, Found) else None,
            samples=[SampleRow.of(sample) for sample in kept],
            truth_deg=facts.truth_deg,
            reference_deg=facts.reference_deg,
            error_deg=None if facts.known_deg is None else abs(estimate.mean_deg - facts.known_deg),
            seed=facts.seed,
            configuration=facts.fingerprint,
            search=None if searched is None else _replayed_search(searched, samples, start_deg, plan, facts),
        )

    @property
    def stand_in(self) -> str | None:
        """What stood in for hardware, as "simulated rig" or "emulated stage and laser"; None where nothing did."""
        if self.emulated:
            return f"emulated {listed(self.emulated)}"
        return "simulated rig" if self.rig == "simulated" else None

    @property
    def comparison(self) -> str | None:
        """What a search would have said instead of all angles of a recording, in a line; None of any other rig."""
        search = self.search
        if search is None:
            return None
        took = f"{counted(search.acquisitions, 'acquisition')} and {search.travel_deg:.1f}° of rotation"
        low_deg, high_deg = self.interval95_deg or (self.angle_deg, self.angle_deg)
        agrees = search.answer == self.answer and (not self.found or low_deg <= search.angle_deg <= high_deg)
        where = f" at {self.angle_deg:.3f}°" if self.found else ""
        more = "" if agrees else f"; all angles together say {self.answer}{where}"
        return f"{search.method}, after {took}: {search}{more}"

    def to_dataframe(self) -> pd.DataFrame:
        """The acquisitions as a table of pandas: a row for each, numbered from 1, with the fields of `SampleRow`.

        The column ``role`` tells the confirmation, the last row where there is one, from the search; the answer is in
        ``attrs``.
        """
        with needs_package("pandas", extra="notebook", purpose="a DataFrame"):
            import pandas as pd
        rows = [{"role": "search"} | msgspec.structs.asdict(each) for each in self.samples]
        if self.confirmation is not None:
            rows.append({"role": "confirmation"} | msgspec.structs.asdict(self.confirmation))
        table = pd.DataFrame(rows, columns=["role", *SampleRow.__struct_fields__])
        table.index = pd.RangeIndex(1, len(rows) + 1, name="acquisition")
        named = ("answer", "method", "rig", "angle_deg", "sigma_deg", "interval95_deg", "seed", "version")
        table.attrs = {name: getattr(self, name) for name in named}
        return table

    def __str__(self) -> str:
        """The answer in a few lines; `repr` has every field and every acquisition."""
        lines = [f"{name}: {value}" for name, value in self._rows() if value is not None]
        return "\n".join([self._heading(), *lines])

    def _repr_html_(self) -> str:
        """The answer and the intensities, for a notebook."""
        lit = self.samples if self.confirmation is None else [*self.samples, self.confirmation]
        # Where nothing was detected, the angle is that of the noise.
        answer_deg = None if self.answer == "not found" else self.angle_deg
        marks = [Mark(angle_deg=each.angle_deg, intensity=each.intensity, radius=2.5) for each in lit]
        curve = DrawnCurve(marks=marks, answer_deg=answer_deg, interval_deg=self.interval95_deg)
        return as_html(self._heading(), self._rows(), curve.svg())

    def _heading(self) -> str:
        if self.search is not None:
            return f"recording of {counted(self.acquisitions, 'angle')}"
        return f"{self.method} on a {rig_in_words(self.rig, self.emulated)}"

    def _rows(self) -> list[tuple[str, str | None]]:
        """The answer for people; None where a value is not known."""
        interval = self.interval95_deg
        sigma = "" if self.sigma_deg is None else f" ± {self.sigma_deg:.3f}°"
        return [
            ("answer", self.answer if self.reason is None else f"{self.answer}: {self.reason}"),
            # Where nothing was detected, the angle is that of the noise.
            ("angle", None if self.answer == "not found" else f"{self.angle_deg:.3f}°{sigma}"),
            ("95 % interval", None if interval is None else f"{interval[0]:.3f}° to {interval[1]:.3f}°"),
            ("acquisitions", str(self.acquisitions) if self.search is None else None),
            ("truth (simulated)", None if self.truth_deg is None else f"{self.truth_deg:.3f}°"),
            ("reference", None if self.reference_deg is None else f"{self.reference_deg:.3f}°"),
            ("a search would have said", self.comparison),
        ]


def _all_angles(samples: Sequence[Sample]) -> list[Sample]:
    """One sample of each angle of a recording, by angle; a method of the paper may return to an angle."""
    return [each for _, each in sorted({each.angle_deg: each for each in samples}.items())]


def _replayed_search(
    searched: Searched, samples: Sequence[Sample], start_deg: float, plan: SearchPlan, facts: RigFacts
) -> ReplayedSearch:
    estimate, taken = searched.estimate, samples[: searched.acquisitions]
    way_deg = [start_deg, *(each.angle_deg for each in taken)]
    return ReplayedSearch(
        method=plan.method,
        **msgspec.structs.asdict(Answer.of(estimate)),
        error_deg=None if facts.known_deg is None else abs(estimate.mean_deg - facts.known_deg),
        acquisitions=searched.acquisitions,
        travel_deg=sum(abs(to - at) for at, to in pairwise(way_deg)),
        samples=[SampleRow.of(each) for each in taken],
    )


def _unsure_of_width(estimate: Estimate) -> TypeGuard[Unsure]:
    return isinstance(estimate, Unsure) and estimate.doubt == "width"
