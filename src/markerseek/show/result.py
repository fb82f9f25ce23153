"""Result of a search as one JSON object, with the units in the names of its keys."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import msgspec

from markerseek._version import __version__
from markerseek.core import (
    FALSE_FOUND,
    AnglePrior,
    Doubt,
    Estimate,
    Floor,
    Found,
    IntervalKind,
    MarkerCandidate,
    MarkerCurve,
    NotFound,
    OtherSource,
    PriorEvidence,
    RigKind,
    Sample,
    Searched,
    SearchError,
    Unsure,
    counted,
    listed,
    marker_candidates,
    marker_position,
    needs_package,
    rig_in_words,
)
from markerseek.records.journal import RunView
from markerseek.show.curve_svg import DrawnCurve, Mark, as_html
from markerseek.show.words import (
    NO_CLAIM,
    AnswerName,
    acquisitions_text,
    answer_line,
    answer_name,
    answer_reason,
    others_rows,
    outliers_rows,
    time_text,
)

if TYPE_CHECKING:
    import pandas as pd


NAME_WITHOUT_CLAIM = "acquisition at that angle"
"""Name of the acquisition at the answer of a method that claims nothing; of others it is the confirmation."""


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
        known = {name: getattr(sample.reading, name) for name in cls.__struct_fields__ if name != "angle_deg"}
        return cls(angle_deg=sample.angle_deg, **known)


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """An answer and its angle; the fields are as in `SearchResult`."""

    answer: AnswerName
    reason: str | None
    angle_deg: float
    sigma_deg: float | None
    interval95_deg: tuple[float, float] | None
    interval_kind: IntervalKind | None

    @classmethod
    def of(cls, estimate: Estimate, *, as_published: bool = False) -> Answer:
        """The answer of a search, or of all angles of a recording.

        ``as_published``: whether it is that of the paper's form of a method, which answers also where there is no
        marker, so that its uncertainty means nothing.
        """
        # A search that detected nothing has the uncertainty of noise.
        known = None if isinstance(estimate, NotFound) or as_published else estimate
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
        """The answer, its angle and its reason, in a line."""
        return answer_line(
            self.answer,
            self.angle_deg,
            sigma_deg=self.sigma_deg,
            interval95_deg=self.interval95_deg,
            reason=self.reason,
        )


class ReplayedSearch(Answer, frozen=True, kw_only=True):
    """What a search of a recording would have taken and said; the fields are as in `SearchResult`."""

    method: str
    error_deg: float | None
    acquisitions: int
    travel_deg: float
    samples: list[SampleRow]


class SearchResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a search found and how; for a recording, what all its angles say.

    The fields of a recording are those of all its angles, and each angle is one of the ``samples``.
    """

    found: bool
    """Whether a marker was found."""
    answer: AnswerName
    """Name of the answer."""
    reason: str | None
    """Why the answer is so, in one sentence; None if a marker was found."""
    doubt: Doubt | None
    """What an unsure answer is unsure of: the source, or the width of the interval; None for other answers."""
    method: str
    """Name of the method."""
    as_published: bool
    """Whether the method was used in the form of the paper."""
    rig: RigKind
    """Kind of the rig."""
    emulated: tuple[str, ...]
    """Devices of a bench that are emulators."""
    angle_deg: float
    """Best angle of the method in degrees, also if no marker is claimed there."""
    sigma_deg: float | None
    """Standard deviation of the angle, in degrees; None if nothing was detected, and in the paper's form."""
    interval95_deg: tuple[float, float] | None
    """95 % interval of the angle, in degrees; None if nothing was detected, and in the paper's form."""
    interval_kind: IntervalKind | None
    """How the interval was computed."""
    half_width_m: float | None
    """How far the interval reaches from the angle, as a length at the marker."""
    marker_trus_m: tuple[float, float, float] | None
    """The marker in the TRUS frame; also known if an answer is unsure for its width only."""
    marker_sigma_m: tuple[float, float, float] | None
    """Standard deviations along the turn, along the axis and in depth (`markerseek.core.MarkerPosition`)."""
    candidates: list[MarkerCandidate] = []
    """Sources that may be the marker, the likeliest first, with their places in the TRUS frame; none where no frame
    says them."""
    acquisitions: int
    """Acquisitions with light that the search received."""
    refused: int
    """Acquisitions that were refused."""
    travel_deg: float | None
    """Sum of all rotations, in degrees; None for a recording."""
    elapsed_s: float | None
    """Time on the clock of the rig, in seconds; None for a recording."""
    known_s: float | None
    """The same to the answer, before the probe turned to the marker; None if none was found."""
    confirmation: SampleRow | None
    """The acquisition at the answer; one after which the search went on is one of the ``samples``."""
    confirmed: bool | None
    """Whether the confirmation confirms the marker (`markerseek.scan.confirmation`); None without a test."""
    floor: Floor | None
    """Detection threshold."""
    others: list[OtherSource]
    """Further sources."""
    surveyed: float | None
    """Share of the range in which a source as strong would have been detected."""
    other_probability: float | None
    """Probability that another source is the marker."""
    curve: MarkerCurve | None
    """Intensity curve of the marker, a prior for the next search on the rig."""
    samples: list[SampleRow]
    """The acquisitions, without the confirmation."""
    truth_deg: float | None
    """Angle of a simulated marker, in degrees."""
    reference_deg: float | None
    """Angle of the marker that the user or the bank gives, in degrees."""
    error_deg: float | None
    """Distance of the angle from truth or reference, in degrees."""
    seed: int | None
    """Seed of a simulated rig."""
    configuration: str
    """Fingerprint of the rig."""
    notes: tuple[str, ...] = ()
    """What its user must know of how the recording was read, or the rig was found, in sentences."""
    outliers_deg: tuple[float, ...] = ()
    """Angles of acquisitions that were left out, because they are far stronger than those beside them."""
    near: AnglePrior | None = None
    """Where the marker was expected; None without such a prior."""
    near_evidence: PriorEvidence | None = None
    """What the search has seen of that."""
    search: ReplayedSearch | None = None
    """What a search of a recording would have taken and said; None for other rigs."""
    version: str = __version__
    """Version of the program."""

    @classmethod
    def of(cls, view: RunView) -> SearchResult:
        """Return the result of a run.

        Raises
        ------
        SearchError
            If the run is not over, or ended with a fault.
        """
        finished = view.finished
        if finished is None:
            raise SearchError("the run is not over, or it failed: there is no result")
        plan = view.plan
        facts = view.facts
        samples = view.samples
        confirmation = view.confirmation
        estimate, searched = finished.estimate, finished.searched
        # The marker's position follows from all frames with light.
        lit = [*samples, *([] if confirmation is None else [confirmation])]
        placed = None if isinstance(estimate, Unsure) and estimate.doubt != "width" else estimate
        marker = marker_position(placed, lit, facts) if isinstance(placed, Found | Unsure) else None
        half_width_m = estimate.half_width_m if isinstance(estimate, Found | Unsure) else None
        kept = samples if searched is None else _all_angles(samples)
        return cls(
            found=isinstance(estimate, Found),
            **msgspec.structs.asdict(Answer.of(estimate, as_published=plan.as_published)),
            doubt=estimate.doubt if isinstance(estimate, Unsure) else None,
            # The method of a search says nothing of the answer from all angles.
            method=plan.method if searched is None else "posterior",
            as_published=plan.as_published,
            rig=facts.kind,
            emulated=facts.emulated,
            half_width_m=None if plan.as_published else half_width_m,
            marker_trus_m=None if marker is None else marker.position_m,
            marker_sigma_m=None if marker is None or plan.as_published else marker.sigma_m,
            candidates=[] if plan.as_published else list(marker_candidates(estimate, lit, facts)),
            acquisitions=finished.acquisitions if searched is None else len(kept),
            refused=view.refused,
            travel_deg=finished.travel_deg if searched is None else None,
            # A replay takes no time, and the durations of the original scan say nothing of this search.
            elapsed_s=None if facts.kind == "replayed" else finished.elapsed_s,
            known_s=None if facts.kind == "replayed" else finished.known_s,
            confirmation=None if confirmation is None else SampleRow.of(confirmation),
            confirmed=None if confirmation is None or estimate.floor is None else isinstance(estimate, Found),
            floor=estimate.floor,
            others=list(estimate.others),
            surveyed=estimate.surveyed,
            outliers_deg=estimate.outliers_deg,
            other_probability=estimate.other_probability if isinstance(estimate, Found | Unsure) else None,
            curve=estimate.curve if isinstance(estimate, Found) else None,
            samples=[SampleRow.of(sample) for sample in kept],
            truth_deg=facts.truth_deg,
            reference_deg=facts.reference_deg,
            error_deg=None if facts.known_deg is None else abs(estimate.mean_deg - facts.known_deg),
            seed=facts.seed,
            configuration=facts.fingerprint,
            near=None if finished.near is None else plan.near,
            near_evidence=finished.near,
            search=None if searched is None else _replayed_search(searched, view),
        )

    @property
    def stand_in(self) -> str | None:
        """What replaced hardware, as "simulated rig" or "emulated stage and laser"; None if nothing did."""
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

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Names and values of the result, as terminal, report and notebook show them."""
        # An angle that another source may explain: the user may know that there is no other source.
        cure = "; --single states that there is none" if self.doubt == "source" and self.surveyed is not None else ""
        rows = [*_answer_rows(self), *others_rows(self.others, self.surveyed, self.other_probability, cure=cure)]
        rows += outliers_rows(self.outliers_deg)
        if self.near is not None and self.near_evidence is not None:
            rows.append(("prior", self.near_evidence.said(self.near)))
        if self.marker_trus_m is not None:
            rows.append(("in the TRUS frame", "x {:.2f}, y {:.2f}, z {:.2f} mm".format(*_mm(self.marker_trus_m))))
        if self.marker_sigma_m is not None:
            sigmas = "± {:.2f} mm in angle, ± {:.2f} mm along the axis, ± {:.2f} mm in depth"
            rows.append(("its standard deviations", sigmas.format(*_mm(self.marker_sigma_m))))
        rows += _effort_rows(self)
        if self.confirmation is not None:
            there = f"intensity {self.confirmation.intensity:.4g} at {self.confirmation.angle_deg:.3f}°"
            if self.as_published:
                rows.append((NAME_WITHOUT_CLAIM, there))
            else:
                rows.append(("confirmation", f"{there}, {'confirmed' if self.confirmed else 'NOT confirmed'}"))
        if self.floor is not None:
            rows.append(("detection threshold", _threshold(self.floor, acquisitions=self.acquisitions)))
        if self.truth_deg is not None and self.error_deg is not None:
            rows.append(("truth (simulated)", f"{self.truth_deg:.3f}°, error {self.error_deg:.3f}°"))
        elif self.reference_deg is not None and self.error_deg is not None:
            rows.append(("reference", f"{self.reference_deg:.3f}°, difference {self.error_deg:.3f}°"))
        if self.comparison is not None:
            rows.append(("a search would have said", self.comparison))
        return rows

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
        """The result in lines, as the terminal shows it; `repr` has every field and every acquisition."""
        return "\n".join([self._heading(), *(f"{name}: {value}" for name, value in self.rows)])

    def _repr_html_(self) -> str:
        """The answer and the intensities, for a notebook."""
        lit = self.samples if self.confirmation is None else [*self.samples, self.confirmation]
        # Where nothing was detected, the angle is that of the noise.
        answer_deg = None if self.answer == "not found" else self.angle_deg
        marks = [Mark(angle_deg=each.angle_deg, intensity=each.intensity, radius=2.5) for each in lit]
        curve = DrawnCurve(marks=marks, answer_deg=answer_deg, interval_deg=self.interval95_deg)
        return as_html(self._heading(), self.rows, curve.svg())

    def _heading(self) -> str:
        if self.search is not None:
            return f"recording of {counted(self.acquisitions, 'angle')}"
        return f"{self.method} on a {rig_in_words(self.rig, self.emulated)}"


def _all_angles(samples: Sequence[Sample]) -> list[Sample]:
    """One sample of each angle of a recording, by angle; a method of the paper may return to an angle."""
    return [each for _, each in sorted({each.angle_deg: each for each in samples}.items())]


def _replayed_search(searched: Searched, view: RunView) -> ReplayedSearch:
    estimate = searched.estimate
    known_deg = view.facts.known_deg
    taken = view.search_samples
    way_deg = [view.start_deg, *(each.angle_deg for each in taken)]
    return ReplayedSearch(
        method=view.plan.method,
        **msgspec.structs.asdict(Answer.of(estimate)),
        error_deg=None if known_deg is None else abs(estimate.mean_deg - known_deg),
        acquisitions=searched.acquisitions,
        travel_deg=sum(abs(to - at) for at, to in pairwise(way_deg)),
        samples=[SampleRow.of(each) for each in taken],
    )


def _answer_rows(result: SearchResult) -> list[tuple[str, str]]:
    """The answer and its angle."""
    if result.as_published:
        return [("angle", f"{result.angle_deg:.3f}°"), ("claim", f"none: {NO_CLAIM}")]
    rows = [("answer", result.answer if result.reason is None else f"{result.answer}: {result.reason}")]
    if result.answer == "not found":
        # The angle of a search that detected nothing is that of the noise, and is for programs only.
        return rows
    sigma = "" if result.sigma_deg is None else f" ± {result.sigma_deg:.3f}°"
    name, unclaimed = ("marker angle", "") if result.found else ("best guess", ", not claimed")
    rows.append((name, f"{result.angle_deg:.3f}°{sigma}{unclaimed}"))
    if result.interval95_deg is not None:
        low, high = result.interval95_deg
        name, kind = _KINDS[result.interval_kind or "propagated"]
        # Without "±", which is a standard deviation on every line.
        at_marker = "" if result.half_width_m is None else f", within {1e3 * result.half_width_m:.2g} mm at the marker"
        rows.append((name, f"[{low:.3f}°, {high:.3f}°]{at_marker}, {kind}"))
    return rows


_KINDS = {
    "posterior": ("95 % interval", "a posterior probability"),
    "bracket": ("last bracket", "where the method stopped, not a probability"),
    "propagated": ("95 % interval", "noise propagated through the average, not a posterior"),
}


def _effort_rows(result: SearchResult) -> list[tuple[str, str]]:
    """What the answer took; for a recording, what the answer is from."""
    if result.search is not None:
        return [("answered from", f"all {counted(result.acquisitions, 'angle')} of the recording")]
    rows = [("acquisitions", acquisitions_text(result.acquisitions, result.refused))]
    if result.travel_deg is not None:
        rows.append(("rotation", f"{result.travel_deg:.1f}°"))
    if result.elapsed_s is not None:
        known_s = None if result.confirmation is None else result.known_s
        time = time_text(result.elapsed_s, known_s=known_s, simulated=result.rig == "simulated")
        rows.append(("time", time))
    return rows


def _threshold(floor: Floor, *, acquisitions: int) -> str:
    if floor.level is None:
        return "unknown"
    background = "" if floor.background is None else f", above a background of {floor.background:.4g}"
    return (
        f"{floor.level:.4g} from {floor.source}{background}; noise alone exceeds it in at most one of "
        f"{1 / FALSE_FOUND:g} searches of {acquisitions} acquisitions"
    )


def _mm(point_m: tuple[float, float, float]) -> list[float]:
    return [1e3 * value for value in point_m]
