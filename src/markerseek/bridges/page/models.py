"""What the browser is sent of a run: plain values for the fan, the image and the curve. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from markerseek.bridges.page.image_bytes import Picture
from markerseek.core import Ambiguous, Found, NotFound
from markerseek.records import DrawnCurve, Mark, with_minus
from markerseek.runs import Point, RunView


def fan_model(view: RunView, *, duration_s: float, reveal: bool) -> dict[str, Any]:
    """The fan: limits, density, acquisitions, needle, answer.

    ``duration_s``: real time that the present move is expected to take. ``reveal``: whether the true or reference angle
    may be shown.
    """
    belief, most = view.belief, view.strongest
    return {
        "low": view.facts.search.low_deg,
        "high": view.facts.search.high_deg,
        "probe": view.probe_deg,
        "said": probe_text(view),
        "target": view.target_deg,
        # A new number begins a new movement of the needle.
        "move": view.number,
        "duration": round(duration_s, 3),
        "angles": belief.angles_deg if belief else (),
        "density": belief.density_per_deg if belief else (),
        "points": [
            {
                "deg": round(point.angle_deg, 3),
                "share": round(point.intensity / most, 4) if most > 0 else 0.0,
                "text": mark(point, view),
                "role": point.role,
            }
            for point in view.points
        ],
        "mean": mean_deg(view),
        "others": others_deg(view),
        "interval": belief.interval95_deg if belief else None,
        "bracket": belief.bracket_deg if belief else None,
        "truth": view.facts.known_deg if reveal else None,
        "choice_deg": belief.choice_deg if belief else (),
        "choice_sigma": belief.choice_sigma_deg if belief else (),
    }


def probe_text(view: RunView) -> str:
    """Where the probe is, and whether that was measured."""
    if view.probe_deg is None:
        return ""
    if view.target_deg is not None:
        return with_minus(f"expected, on its way to {view.target_deg:.2f}°")
    # A move that was cut short has ended anywhere.
    last = "last " if view.phase in {"stopped", "fault", "cut off", "checking"} else ""
    return with_minus(f"{last}read back: {view.probe_deg:.2f}°")


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


def mark(point: Point, view: RunView) -> str:
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
                text=mark(point, view),
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


def image_model(picture: Picture | None, *, floor: float | None, imaged: bool = True) -> dict[str, Any]:
    """The image, or why there is none; its peak is marked only above the detection threshold, if that is known."""
    if picture is None:
        return {"pixels": "", "why": "no image yet" if imaged else "these data hold no photoacoustic images"}
    peak = picture.peak_mm if floor is None or picture.intensity > floor else None
    return asdict(picture.image) | {"deg": picture.angle_deg, "peak": peak}


def image_texts(picture: Picture | None, *, elsewhere: bool, simulated: bool) -> tuple[str, str]:
    """Title and note of the image: the angle of the probe, and what is drawn."""
    if picture is None:
        return "photoacoustic image", ""
    b_mode = "; grey: B-mode" + (" (simulated)" if simulated else "") if picture.b_mode else ""
    title = with_minus(f"{'last image:' if elsewhere else 'image of'} {picture.angle_deg:.2f}°")
    return title, f"photoacoustic, {picture.range_db:g} dB; ring: its peak{b_mode}"
