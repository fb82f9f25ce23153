"""The result of a search: its run at the end, and what people and programs read of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Self

from msgspec import structs

from markerseek._version import __version__
from markerseek.core import (
    FALSE_FOUND,
    AngleBelief,
    Estimate,
    Finished,
    Floor,
    Found,
    MarkerCandidate,
    MarkerPosition,
    NotFound,
    PriorEvidence,
    Sample,
    SearchError,
    Unsure,
    counted,
    marker_candidates,
    marker_position,
    needs_package,
    rig_in_words,
)
from markerseek.records.journal import RunView
from markerseek.show.curve import NAME_WITHOUT_CLAIM, drawn_curve
from markerseek.show.curve_svg import as_html, curve_svg
from markerseek.show.words import (
    NO_CLAIM,
    AnswerName,
    acquisitions_text,
    answer_name,
    answer_reason,
    estimate_line,
    motion_rows,
    others_rows,
    outliers_rows,
    time_text,
)

if TYPE_CHECKING:
    import pandas as pd


SAMPLE_KEYS = ("angle_deg", "intensity", "lateral_m", "depth_m", "arrival_s", "noise_sigma")
"""What tables and the JSON output have of an acquisition."""


def sample_row(sample: Sample) -> dict[str, float | None]:
    """Return an acquisition by `SAMPLE_KEYS`; what its frame does not give is None."""
    reading = sample.reading
    return {"angle_deg": sample.angle_deg} | {name: getattr(reading, name) for name in SAMPLE_KEYS[1:]}


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchResult:
    """What a search found and how; for a recording, what all its angles say.

    The answer is in ``estimate``, what was asked of which rig in ``run.plan`` and ``run.facts``. The paper's form of a
    method answers also where there is no marker, so that its uncertainty means nothing: there it is None.
    """

    run: RunView
    """The run at its end, without the receiver's frames."""
    notes: tuple[str, ...] = ()
    """What its user must know of how the recording was read, or the rig was found, in sentences."""

    def __post_init__(self) -> None:
        if self.run.finished is None:
            raise SearchError("the run is not over, or it failed: there is no result")

    @classmethod
    def of(cls, run: RunView, *, notes: tuple[str, ...] = ()) -> Self:
        """Return the result of a run.

        Raises
        ------
        SearchError
            If the run is not over, or ended with a fault.
        """
        # A frame has half a megabyte, and a user may keep many results.
        return cls(run=run.without_frames(), notes=notes)

    @property
    def _end(self) -> Finished:
        assert self.run.finished is not None  # noqa: S101  tested when it was made
        return self.run.finished

    @property
    def estimate(self) -> Estimate:
        """The answer."""
        return self._end.estimate

    @property
    def found(self) -> bool:
        """Whether a marker was found."""
        return isinstance(self.estimate, Found)

    @property
    def answer(self) -> AnswerName:
        """Name of the answer."""
        return answer_name(self.estimate)

    @property
    def reason(self) -> str | None:
        """Why the answer is so, in one sentence; None if a marker was found."""
        return answer_reason(self.estimate)

    @property
    def angle_deg(self) -> float:
        """Best angle of the method in degrees, also if no marker is claimed there."""
        return self.estimate.mean_deg

    @property
    def sigma_deg(self) -> float | None:
        """Standard deviation of the angle, in degrees; None if nothing was detected."""
        return None if self.run.plan.as_published else self.estimate.sigma_deg

    @property
    def interval95_deg(self) -> tuple[float, float] | None:
        """95 % interval of the angle, in degrees; None if nothing was detected."""
        interval = None if self.run.plan.as_published else self.estimate.interval95_deg
        return None if interval is None else (interval.low_deg, interval.high_deg)

    @property
    def marker(self) -> MarkerPosition | None:
        """Position of the marker in the TRUS frame; None if it is not known which source the marker is, or where."""
        estimate = self.estimate
        is_known = isinstance(estimate, Found) or (isinstance(estimate, Unsure) and estimate.doubt == "width")
        return marker_position(estimate, self._lit, self.run.facts) if is_known else None

    @property
    def candidates(self) -> tuple[MarkerCandidate, ...]:
        """Sources that may be the marker, the likeliest first; none where no frame says their places."""
        return () if self.run.plan.as_published else marker_candidates(self.estimate, self._lit, self.run.facts)

    @property
    def _lit(self) -> list[Sample]:
        """All acquisitions with light: positions follow from all their frames."""
        return [point.sample for point in self.run.points]

    @property
    def samples(self) -> list[Sample]:
        """The acquisitions without the confirmation; of a recording one for each angle, in ascending order."""
        if self._end.searched is None:
            return self.run.samples
        # A method of the paper may return to an angle.
        by_angle = {each.angle_deg: each for each in self.run.samples}
        return [each for _, each in sorted(by_angle.items())]

    @property
    def confirmation(self) -> Sample | None:
        """The acquisition at the answer; one after which the search went on is one of the ``samples``."""
        return self.run.confirmation

    @property
    def confirmed(self) -> bool | None:
        """Whether the confirmation confirms the marker (`markerseek.scan.confirmation`); None without a test."""
        return None if self.confirmation is None or self.estimate.floor is None else self.found

    @property
    def method(self) -> str:
        """Name of the method: of a search it says nothing of the answer from all angles of a recording."""
        return self.run.plan.method if self._end.searched is None else "posterior"

    @property
    def acquisitions(self) -> int:
        """Acquisitions with light that the search received; of a recording its angles."""
        return self._end.acquisitions if self._end.searched is None else len(self.samples)

    @property
    def travel_deg(self) -> float | None:
        """Sum of all rotations, in degrees; None for a recording."""
        return self._end.travel_deg if self._end.searched is None else None

    @property
    def elapsed_s(self) -> float | None:
        """Time on the clock of the rig, in seconds; None for a recording."""
        # A replay takes no time, and the durations of the original scan say nothing of this search.
        return None if self.run.facts.kind == "replayed" else self._end.elapsed_s

    @property
    def known_s(self) -> float | None:
        """The same to the answer, before the probe turned to the marker; None if none was found."""
        return None if self.run.facts.kind == "replayed" else self._end.known_s

    @property
    def error_deg(self) -> float | None:
        """Distance of the angle from truth or reference, in degrees; None if neither is known."""
        known_deg = self.run.facts.known_deg
        return None if known_deg is None else abs(self.angle_deg - known_deg)

    @property
    def near_evidence(self) -> PriorEvidence | None:
        """What the search has seen of a prior over the angle; None without one."""
        return self._end.near

    @property
    def search(self) -> SearchResult | None:
        """What a search of a recording would have taken and said; None for other rigs."""
        searched = self._end.searched
        if searched is None:
            return None
        points = self.run.points[: searched.acquisitions]
        way_deg = [self.run.start_deg, *(point.angle_deg for point in points)]
        end = structs.replace(
            self._end,
            estimate=searched.estimate,
            acquisitions=searched.acquisitions,
            travel_deg=sum(abs(to - at) for at, to in pairwise(way_deg)),
            searched=None,
        )
        # What was believed at the end is that of all angles.
        belief = AngleBelief(estimate=searched.estimate)
        return SearchResult(run=replace(self.run, points=points, event=end, belief=belief, finished=end))

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
        return f"{search.method}, after {took}: {estimate_line(search.estimate)}{more}"

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Names and values of the result, as terminal, report and notebook show them."""
        estimate = self.estimate
        return [
            *_answer_rows(self),
            *others_rows(estimate.others, estimate.surveyed, estimate.other_probability),
            *outliers_rows(estimate.outliers_deg),
            *motion_rows(estimate.motion),
            *_prior_rows(self),
            *_marker_rows(self),
            *_effort_rows(self),
            *_confirmation_rows(self),
            *_truth_rows(self),
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the acquisitions as a table of pandas: a row for each, numbered from 1, with the keys of the JSON.

        The column ``role`` tells the confirmation, the last row where there is one, from the search; the answer is in
        ``attrs``.
        """
        with needs_package("pandas", extra="notebook", purpose="a DataFrame"):
            import pandas as pd
        rows = [{"role": "search"} | sample_row(each) for each in self.samples]
        if self.confirmation is not None:
            rows.append({"role": "confirmation"} | sample_row(self.confirmation))
        table = pd.DataFrame(rows, columns=["role", *SAMPLE_KEYS])
        table.index = pd.RangeIndex(1, len(rows) + 1, name="acquisition")
        named = ("answer", "method", "angle_deg", "sigma_deg", "interval95_deg")
        facts = self.run.facts
        table.attrs = {name: getattr(self, name) for name in named}
        table.attrs |= {"rig": facts.kind, "seed": facts.seed, "version": __version__}
        return table

    def __str__(self) -> str:
        """Return the result in lines, as the terminal shows it; `repr` has every field and every acquisition."""
        return "\n".join([self._heading(), *(f"{name}: {value}" for name, value in self.rows)])

    def _repr_html_(self) -> str:
        """Return the answer and the intensities, for a notebook."""
        return as_html(self._heading(), self.rows, curve_svg(drawn_curve(self.run, reveal=True)))

    def _heading(self) -> str:
        if self._end.searched is not None:
            return f"recording of {counted(self.acquisitions, 'angle')}"
        return f"{self.method} on a {rig_in_words(self.run.facts.kind, self.run.facts.emulated)}"


def _answer_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return the answer and its angle."""
    estimate = result.estimate
    if result.run.plan.as_published:
        return [("angle", f"{result.angle_deg:.3f}°"), ("claim", f"none: {NO_CLAIM}")]
    rows = [("answer", result.answer if result.reason is None else f"{result.answer}: {result.reason}")]
    if result.answer == "not found":
        # The angle of a search that detected nothing is that of the noise, and is for programs only.
        return rows
    sigma = "" if estimate.sigma_deg is None else f" ± {estimate.sigma_deg:.3f}°"
    name, unclaimed = ("marker angle", "") if result.found else ("best guess", ", not claimed")
    rows.append((name, f"{result.angle_deg:.3f}°{sigma}{unclaimed}"))
    interval = estimate.interval95_deg
    if interval is not None:
        name, kind = _KINDS[estimate.interval_kind or "propagated"]
        half_width_m = estimate.half_width_m
        # Without "±", which is a standard deviation on every line.
        at_marker = "" if half_width_m is None else f", within {1e3 * half_width_m:.2g} mm at the marker"
        rows.append((name, f"[{interval.low_deg:.3f}°, {interval.high_deg:.3f}°]{at_marker}, {kind}"))
    return rows


_KINDS = {
    "posterior": ("95 % interval", "a posterior probability"),
    "bracket": ("last bracket", "where the method stopped, not a probability"),
    "propagated": ("95 % interval", "noise propagated through the average, not a posterior"),
}


def _prior_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return what became of the prior over the angle."""
    evidence = result.near_evidence
    near = result.run.plan.near
    return [] if evidence is None or near is None else [("prior", evidence.said(near))]


def _marker_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return where the marker is."""
    marker = result.marker
    if marker is None:
        return []
    rows = [("in the TRUS frame", "x {:.2f}, y {:.2f}, z {:.2f} mm".format(*_mm(marker.position_m)))]
    if not result.run.plan.as_published:
        sigmas = "± {:.2f} mm in angle, ± {:.2f} mm along the axis, ± {:.2f} mm in depth"
        rows.append(("its standard deviations", sigmas.format(*_mm(marker.sigma_m))))
    return rows


def _effort_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return what the answer took; for a recording, what the answer is from."""
    if result.search is not None:
        return [("answered from", f"all {counted(result.acquisitions, 'angle')} of the recording")]
    rows = [("acquisitions", acquisitions_text(result.acquisitions, result.run.refused))]
    if result.travel_deg is not None:
        rows.append(("rotation", f"{result.travel_deg:.1f}°"))
    if result.elapsed_s is not None:
        known_s = None if result.confirmation is None else result.known_s
        is_simulated = result.run.facts.kind == "simulated"
        rows.append(("time", time_text(result.elapsed_s, known_s=known_s, simulated=is_simulated)))
    return rows


def _confirmation_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return the confirmation, and the threshold of all evidence."""
    rows = []
    confirmation = result.confirmation
    floor = result.estimate.floor
    if confirmation is not None:
        there = f"intensity {confirmation.reading.intensity:.4g} at {confirmation.angle_deg:.3f}°"
        if result.run.plan.as_published:
            rows.append((NAME_WITHOUT_CLAIM, there))
        else:
            rows.append(("confirmation", f"{there}, {'confirmed' if result.confirmed else 'NOT confirmed'}"))
    if floor is not None:
        rows.append(("detection threshold", _threshold(floor, acquisitions=result.acquisitions)))
    return rows


def _truth_rows(result: SearchResult) -> list[tuple[str, str]]:
    """Return how far the angle is from what is known of it, and for a recording what a search would have said."""
    rows = []
    facts = result.run.facts
    if facts.known_deg is not None:
        name, away = ("reference", "difference") if facts.truth_deg is None else ("truth (simulated)", "error")
        # An answer without an angle has no error.
        missed = isinstance(result.estimate, NotFound)
        how_far = "not found" if missed else f"{away} {result.error_deg:.3f}°"
        rows.append((name, f"{facts.known_deg:.3f}°, {how_far}"))
    if result.comparison is not None:
        rows.append(("a search would have said", result.comparison))
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
