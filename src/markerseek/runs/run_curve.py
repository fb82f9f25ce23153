"""What is drawn of a run over the angle: its acquisitions, its answer, and what else may be the marker."""

from __future__ import annotations

from markerseek.core import Ambiguous, Found, NotFound
from markerseek.records import DrawnCurve, Mark
from markerseek.runs.run_view import Point, RunView


def mean_deg(view: RunView) -> float | None:
    """Angle of the marker in degrees; None while it is unknown, or if nothing was detected."""
    belief = view.belief
    return None if belief is None or isinstance(belief.estimate, NotFound) else belief.estimate.mean_deg


def others_deg(view: RunView) -> list[float]:
    """Angles in degrees of what else may be the marker: other sources, and other modes of an ambiguous answer."""
    if view.belief is None:
        return []
    estimate = view.belief.estimate
    modes_deg = estimate.modes_deg if isinstance(estimate, Ambiguous) else ()
    others = {round(each, 2) for each in (*modes_deg, *(other.angle_deg for other in estimate.others))}
    return sorted(each for each in others if abs(each - estimate.mean_deg) > 0.01)


def mark_of(point: Point, view: RunView) -> str:
    """Number of an acquisition; for a confirmation a tick if it has confirmed a marker, else empty."""
    if point.role != "confirmation":
        return str(point.number)
    belief = view.belief
    claimed = belief is not None and belief.claims and isinstance(belief.estimate, Found)
    return "✓" if view.phase == "finished" and claimed else ""


def curve_of(view: RunView, *, reveal: bool) -> DrawnCurve:
    """Intensity and probability over the angle; in a weighted average the size of a dot is its weight."""
    belief, facts = view.belief, view.facts
    weights = belief.weights if belief else ()
    marks = []
    for point in view.points:
        square = point.role == "confirmation"
        # An acquisition that has just been made has no weight until the policy has received it.
        weighed = not square and point.number <= len(weights)
        radius = 2 + 5 * weights[point.number - 1] if weighed else 6 if square else 4.5
        marks.append(
            Mark(
                angle_deg=point.angle_deg,
                intensity=point.intensity,
                text=mark_of(point, view),
                radius=radius,
                square=square,
            )
        )
    known = "reference" if facts.truth_deg is None else "truth"
    return DrawnCurve(
        marks=marks,
        range_deg=(facts.search.low_deg, facts.search.high_deg),
        unit=view.unit,
        density=(belief.angles_deg, belief.density_per_deg) if belief else ((), ()),
        answer_deg=mean_deg(view),
        others_deg=others_deg(view),
        interval_deg=belief.interval95_deg if belief else None,
        bracket_deg=belief.bracket_deg if belief else None,
        known=(known, facts.known_deg) if reveal and facts.known_deg is not None else None,
        threshold=view.floor_level,
    )
