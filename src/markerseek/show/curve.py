"""The model of a curve: what every picture of a search shows, drawn by `curve_svg`, by `curve_figure` and on the page.

An angle is drawn solid once the search is over and claims a marker there, else dashed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from markerseek.core import Ambiguous, AtBound, Estimate, Found, NotFound, Role, Unsure, counted, listed
from markerseek.records.journal import LitAcquisition, RunView
from markerseek.show.words import with_minus

ANGLE_TEXT = "probe angle [deg]"
DENSITY_TEXT = "probability [1/deg]"
"""Names of the axes of the angle and of the density, with their units."""

INSET_DEG = 2.0
"""Half of the range of the inset about the answer, in degrees."""

NAME_WITHOUT_CLAIM = "acquisition at that angle"
"""Name of the acquisition at the answer of a method that claims nothing; of others it is the confirmation."""

_ONE_LINE = 0.06
"""Share of the range below which an interval looks like a line, and an inset shows it."""


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """One acquisition of a curve."""

    angle_deg: float
    intensity: float
    role: Role = "search"
    text: str = ""
    """Number of the acquisition, none in a sweep; of a confirmation a tick if it has confirmed a marker, else empty."""
    weight: float | None = None
    """Weight in a weighted average, 0 to 1; None for other methods, and before the method has received it."""


class DrawnAngle(msgspec.Struct, frozen=True, kw_only=True):
    """An angle that is drawn as a line."""

    angle_deg: float
    text: str
    """The angle in words."""


class DrawnInterval(msgspec.Struct, frozen=True, kw_only=True):
    """An interval that is drawn as a band."""

    low_deg: float
    high_deg: float
    text: str
    """What the interval is."""


class Threshold(msgspec.Struct, frozen=True, kw_only=True):
    """Detection threshold."""

    level: float
    """In the unit of the intensities."""
    text: str
    """What it is computed from."""


class DrawnCurve(msgspec.Struct, frozen=True, kw_only=True):
    """Intensity and probability over the angle of the probe."""

    marks: tuple[Mark, ...] = ()
    """The acquisitions in order, a confirmation last."""
    low_deg: float
    high_deg: float
    """``low_deg`` and ``high_deg``: ends of the range that is drawn."""
    unit: str = ""
    """Unit of the intensities."""
    start_deg: float | None = None
    """Where the probe was at the start; None before it."""
    density_deg: tuple[float, ...] = ()
    density_per_deg: tuple[float, ...] = ()
    """``density_deg`` and ``density_per_deg``: angles, and the probability density of the marker there; empty for a
    method without one."""
    answers: tuple[DrawnAngle, ...] = ()
    """The angle of the answer; the angles of an ambiguous one; empty if nothing is known or was detected."""
    answer_text: str = ""
    """What is claimed of these angles; empty while nothing is known."""
    is_claimed: bool = False
    """Whether the search is over, and claims a marker at the angle."""
    others: tuple[DrawnAngle, ...] = ()
    """Other sources."""
    interval: DrawnInterval | None = None
    """Where the marker is with 95 %."""
    bracket: DrawnInterval | None = None
    """The part of the range that a bracket search has left."""
    known: DrawnAngle | None = None
    """The angle of the marker that is known otherwise."""
    threshold: Threshold | None = None
    recorded_deg: tuple[float, ...] = ()
    recorded: tuple[float, ...] = ()
    """``recorded_deg`` and ``recorded``: angles and intensities of the recording that a search replays."""
    confirmation_text: str = "confirmation"
    """Name of the acquisition at the answer."""
    stand_in: str | None = None
    """What replaced hardware; None if nothing did."""

    @property
    def intensity_text(self) -> str:
        """Name of the intensities, with their unit."""
        return f"intensity [{self.unit}]" if self.unit else "intensity"

    @property
    def text(self) -> str:
        """What the curve is, for those who do not see it."""
        answer = f"; {self.answer_text}" if self.answer_text else ""
        return f"intensity over the angle of the probe, measured {counted(len(self.marks), 'time')}{answer}"

    @property
    def top(self) -> float:
        """The largest intensity that is drawn; at least 1e-12, so that an axis has a length."""
        threshold = 0.0 if self.threshold is None else self.threshold.level
        return max(1e-12, threshold, *(each.intensity for each in self.marks), *self.recorded)

    @property
    def most_per_deg(self) -> float:
        """The largest density; 0 for none."""
        return max(self.density_per_deg, default=0.0)

    @property
    def inset_deg(self) -> tuple[float, float] | None:
        """Range of an inset about an answer that is one line in the whole range; None for another."""
        interval = self.interval or self.bracket
        if len(self.answers) != 1 or interval is None:
            return None
        if interval.high_deg - interval.low_deg > _ONE_LINE * (self.high_deg - self.low_deg):
            return None
        middle_deg = self.answers[0].angle_deg
        return middle_deg - INSET_DEG, middle_deg + INSET_DEG


def drawn_curve(view: RunView, *, reveal: bool) -> DrawnCurve:
    """Return the curve of a run after one of its events.

    ``reveal``: whether the angle of the marker that is known otherwise is shown.
    """
    belief = view.belief
    facts = view.facts
    estimate = None if belief is None else belief.estimate
    interval = None if belief is None else belief.interval95_deg
    # That of an ambiguous answer is of one of its sources.
    interval = None if isinstance(estimate, Ambiguous) else interval
    bracket = None if belief is None else belief.bracket_deg
    if estimate is not None and estimate.interval_kind == "bracket":
        bracket = bracket or interval
        interval = None
    floor = None if estimate is None else estimate.floor
    recorded = _recorded(view)
    return DrawnCurve(
        marks=tuple(_mark(point, view) for point in _points(view)),
        low_deg=facts.search.low_deg,
        high_deg=facts.search.high_deg,
        unit=view.unit,
        start_deg=None if math.isnan(view.start_deg) else view.start_deg,
        density_deg=() if belief is None else belief.angles_deg,
        density_per_deg=() if belief is None else belief.density_per_deg,
        answers=_answers(estimate),
        answer_text=with_minus(_answer_text(view)),
        is_claimed=_is_claimed(view),
        others=_others(estimate),
        interval=_drawn(interval, f"95 % interval ({estimate.interval_kind})" if estimate else ""),
        bracket=_drawn(bracket, "last bracket" if view.over else "bracket"),
        known=_known(view) if reveal else None,
        threshold=None
        if floor is None or floor.level is None
        else Threshold(level=floor.level, text=f"detection threshold ({floor.source})"),
        recorded_deg=tuple(each.angle_deg for each in recorded),
        recorded=tuple(each.intensity for each in recorded),
        confirmation_text=NAME_WITHOUT_CLAIM if view.plan.as_published else "confirmation",
        stand_in=stand_in(view),
    )


def stand_in(view: RunView) -> str | None:
    """Return what replaced hardware, as "simulated rig" or "emulated stage and laser"; None if nothing did."""
    if view.facts.emulated:
        return f"emulated {listed(view.facts.emulated)}"
    return "simulated rig" if view.facts.kind == "simulated" else None


def mean_deg(view: RunView) -> float | None:
    """Return the angle of the marker in degrees; None while it is unknown, or if nothing was detected."""
    belief = view.belief
    return None if belief is None or isinstance(belief.estimate, NotFound) else belief.estimate.mean_deg


def _points(view: RunView) -> Sequence[LitAcquisition]:
    """Return the acquisitions; at the end of a recording only those that its search took."""
    searched = None if view.finished is None else view.finished.searched
    return view.points if searched is None else view.points[: searched.acquisitions]


def _recorded(view: RunView) -> Sequence[LitAcquisition]:
    """Return a point for each angle of a recording in ascending order, once it was measured to its end."""
    if view.finished is None or view.finished.searched is None:
        return ()
    by_angle = {point.angle_deg: point for point in view.points}
    return [point for _, point in sorted(by_angle.items())]


def _mark(point: LitAcquisition, view: RunView) -> Mark:
    is_search = point.role == "search"
    weights = () if view.belief is None else view.belief.weights
    # An acquisition that has just been made has no weight until the policy has received it.
    is_weighed = is_search and point.number <= len(weights)
    return Mark(
        angle_deg=point.angle_deg,
        intensity=point.intensity,
        role=point.role,
        text=_number(point, view) if is_search else "✓" if _is_claimed(view) else "",
        weight=weights[point.number - 1] if is_weighed else None,
    )


def _number(point: LitAcquisition, view: RunView) -> str:
    """Return the number of an acquisition at rest; the pulses of a sweep are too many to be read."""
    return "" if view.plan.sweep else str(point.number)


def _is_claimed(view: RunView) -> bool:
    belief = view.belief
    return view.phase == "finished" and belief is not None and belief.claims and isinstance(belief.estimate, Found)


def _answers(estimate: Estimate | None) -> tuple[DrawnAngle, ...]:
    # The angle of a search that detected nothing is that of the noise.
    if estimate is None or isinstance(estimate, NotFound):
        return ()
    if isinstance(estimate, Ambiguous):
        return tuple(_angle(each, f"{each:.2f}°?") for each in estimate.modes_deg)
    return (_angle(estimate.mean_deg, f"{estimate.mean_deg:.2f}°"),)


def _answer_text(view: RunView) -> str:
    """Return what is claimed, for a legend."""
    if view.belief is None:
        return ""
    estimate = view.belief.estimate
    if isinstance(estimate, NotFound):
        return "no marker was detected"
    if _is_claimed(view):
        return f"marker at {estimate.mean_deg:.2f}°"
    if isinstance(estimate, Ambiguous):
        where = f"it may be at {' or '.join(f'{each:.2f}°' for each in estimate.modes_deg)}"
    elif not view.belief.claims:
        where = f"angle of the method {estimate.mean_deg:.2f}°"
    elif isinstance(estimate, AtBound | Unsure):
        where = f"best guess {estimate.mean_deg:.2f}°"
    else:
        where = f"so far {estimate.mean_deg:.2f}°"
    return f"no marker is claimed; {where}"


def _others(estimate: Estimate | None) -> tuple[DrawnAngle, ...]:
    if estimate is None:
        return ()
    answers_deg = estimate.modes_deg if isinstance(estimate, Ambiguous) else (estimate.mean_deg,)
    angles_deg = sorted({round(each.angle_deg, 2) for each in estimate.others})
    apart = [each for each in angles_deg if all(abs(each - answer_deg) > 0.01 for answer_deg in answers_deg)]
    return tuple(_angle(each, f"{each:.2f}°?") for each in apart)


def _known(view: RunView) -> DrawnAngle | None:
    known_deg = view.facts.known_deg
    if known_deg is None:
        return None
    name = "reference" if view.facts.truth_deg is None else "truth"
    return _angle(known_deg, f"{name} {known_deg:.2f}°")


def _angle(angle_deg: float, text: str) -> DrawnAngle:
    return DrawnAngle(angle_deg=angle_deg, text=with_minus(text))


def _drawn(ends_deg: tuple[float, float] | None, text: str) -> DrawnInterval | None:
    return None if ends_deg is None else DrawnInterval(low_deg=ends_deg[0], high_deg=ends_deg[1], text=text)
