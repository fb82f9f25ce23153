"""What the browser is sent of a snapshot: plain values for the fan, the image and the numbers. Pure."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from markerseek.bridges.page.picture import Picture, drawn_background
from markerseek.bridges.page.state import Phase, Point, Snapshot, angles_text
from markerseek.core import Ambiguous, AngleBelief, Found, Interval, NotFound, Unsure
from markerseek.records import answer_name

FACE_SHARE = 0.28
"""Radius of the probe over that of the fan, as drawn."""


def fan_model(snapshot: Snapshot, search: Interval, *, duration_s: float, known_deg: float | None) -> dict[str, Any]:
    """The fan: limits, density, acquisitions, needle, answer.

    ``duration_s``: real time that the present move is expected to take. ``known_deg``: True or reference angle in
    degrees where it may be shown; None hides it.
    """
    belief = snapshot.belief
    return {
        "low": search.low_deg,
        "high": search.high_deg,
        "face": FACE_SHARE,
        "probe": snapshot.probe_deg,
        "said": probe_text(snapshot),
        "target": snapshot.target_deg,
        # A new number begins a new movement of the needle.
        "move": snapshot.number,
        "duration": round(duration_s, 3),
        "angles": belief.angles_deg if belief else (),
        "density": belief.density_per_deg if belief else (),
        "points": _fan_points(snapshot),
        "mean": mean_deg(snapshot),
        "others": other_angles_deg(snapshot),
        "interval": belief.interval95_deg if belief else None,
        "bracket": belief.bracket_deg if belief else None,
        "truth": known_deg,
        "choice_deg": belief.choice_deg if belief else (),
        "choice_sigma": belief.choice_sigma_deg if belief else (),
    }


def probe_text(snapshot: Snapshot) -> str:
    """Where the probe is, and whether that was measured."""
    if snapshot.probe_deg is None:
        return ""
    if snapshot.target_deg is not None:
        return f"expected, on its way to {snapshot.target_deg:.2f}°"
    # A move that was cut short has ended anywhere.
    last = "last " if snapshot.phase in {"stopped", "fault", "checking"} else ""
    return f"{last}read back: {snapshot.probe_deg:.2f}°"


def mean_deg(snapshot: Snapshot) -> float | None:
    """Angle of the marker in degrees; None while it is unknown, or if nothing was detected."""
    belief = snapshot.belief
    return None if belief is None or isinstance(belief.estimate, NotFound) else belief.estimate.mean_deg


def other_angles_deg(snapshot: Snapshot) -> list[float]:
    """Angles in degrees of what else may be the marker: other sources, and the other modes of an ambiguous answer."""
    if snapshot.belief is None:
        return []
    estimate = snapshot.belief.estimate
    modes_deg = estimate.modes_deg if isinstance(estimate, Ambiguous) else ()
    others_deg = {round(each, 2) for each in (*modes_deg, *(other.angle_deg for other in estimate.others))}
    return sorted(each for each in others_deg if abs(each - estimate.mean_deg) > 0.01)


def _fan_points(snapshot: Snapshot) -> list[dict[str, Any]]:
    most = max((point.intensity for point in snapshot.points), default=0.0)
    return [
        {
            "deg": round(point.angle_deg, 3),
            "share": round(point.intensity / most, 4) if most > 0 else 0.0,
            "text": mark(point, snapshot),
            "role": point.role,
        }
        for point in snapshot.points
    ]


def mark(point: Point, snapshot: Snapshot) -> str:
    """Number of an acquisition; for a confirmation a tick if it has confirmed a marker, else empty."""
    if point.role != "confirmation":
        return str(point.number)
    belief = snapshot.belief
    claimed = belief is not None and belief.claims and isinstance(belief.estimate, Found)
    return "✓" if snapshot.phase == "finished" and claimed else ""


def image_model(picture: Picture | None, *, floor: float | None, imaged: bool = True) -> dict[str, Any]:
    """The image, or why there is none; its peak is marked only above the noise floor, where that is known."""
    if picture is None:
        return {"pixels": "", "why": "no image yet" if imaged else "these data hold no photoacoustic images"}
    return asdict(picture.image) | {
        "deg": picture.angle_deg,
        "peak": picture.peak_mm if floor is None or picture.intensity > floor else None,
        "range": picture.range_db,
    }


def background_model(picture: Picture | None, *, simulated: bool) -> tuple[dict[str, Any], str]:
    """What is behind the image, and what it is: B-mode of the same angle, else a drawing where all is simulated."""
    if picture is None:
        return {}, ""
    if picture.b_mode is not None:
        return asdict(picture.b_mode), "grey background: B-mode" + (" (simulated)" if simulated else "")
    if not simulated:
        return {}, ""
    drawn = replace(picture.image, pixels=drawn_background(picture.image.rows, picture.image.columns))
    return asdict(drawn), "grey background: drawn, not simulated"


def number_rows(snapshot: Snapshot, *, name: str, pulse_j: float | None) -> list[tuple[str, str]]:
    """Names and formatted values, besides the angle.

    ``name``: what is run, as `RunHistory.name`. ``pulse_j``: energy of one pulse in joules where the rig file names it;
    None elsewhere.
    """
    belief = snapshot.belief
    virtual = " (virtual)" if snapshot.rig == "simulated" else ""
    rows = [
        ("search", name),
        ("acquisitions", str(snapshot.acquisitions) + (f", {snapshot.refused} refused" if snapshot.refused else "")),
        ("rotation", f"{snapshot.travel_deg:.1f}°"),
        ("time", "–" if snapshot.rig == "replayed" else f"{snapshot.elapsed_s:.0f} s{virtual}"),
        ("peak SNR", snr_text(snapshot)),
        ("noise floor", "unknown" if snapshot.floor_level is None else f"{snapshot.floor_level:.4g} a.u."),
        ("pulses", "–" if snapshot.rig == "replayed" else str(snapshot.pulses)),
    ]
    if belief is not None:
        others = [f"{each.relative_db:+.1f} dB at {each.angle_deg:.2f}°" for each in belief.estimate.others]
        none = "none seen" if belief.angles_deg else "not looked for"
        rows.append(("other sources", ", ".join(others[:2]) or none))
        surveyed = belief.estimate.surveyed
        rows.append(("surveyed", "–" if surveyed is None else f"{100 * surveyed:.1f} % of range"))
        if isinstance(belief.estimate, Found | Unsure) and belief.estimate.other_probability:
            rows.append(("wrong source", f"{100 * belief.estimate.other_probability:.2g} %"))
        if belief.interval95_deg is not None:
            rows.append(("95 % interval", interval_text(belief)))
    expected_deg = _expected_sigma_deg(snapshot)
    if expected_deg is not None:
        rows.append(("expected next", f"± {expected_deg:.3f}°"))
    if pulse_j is not None:
        rows.append(("light", f"{snapshot.pulses * pulse_j * 1e3:.3g} mJ"))
    return rows


def interval_text(belief: AngleBelief) -> str:
    """The 95 % interval of an angle, and how far it reaches from it at the marker, where that is known."""
    low_deg, high_deg = belief.interval95_deg or (math.nan, math.nan)
    half_width_m = belief.estimate.half_width_m if isinstance(belief.estimate, Found | Unsure) else None
    at_marker = "" if half_width_m is None else f", ± {1e3 * half_width_m:.2g} mm"
    return f"{low_deg:.2f}° to {high_deg:.2f}°{at_marker}"


def snr_text(snapshot: Snapshot) -> str:
    """Largest intensity over the noise, or that it is below the floor."""
    strongest = max((point.intensity for point in snapshot.points), default=0.0)
    if snapshot.snr_db is None:
        return "–"
    floor_level = 0.0 if snapshot.floor_level is None else snapshot.floor_level
    return "below the floor" if strongest <= floor_level else f"{snapshot.snr_db:.1f} dB"


def _expected_sigma_deg(snapshot: Snapshot) -> float | None:
    """Standard deviation expected after the acquisition on its way, in degrees; None where none was weighed up."""
    belief = snapshot.belief
    if belief is None or snapshot.target_deg is None or not belief.choice_deg:
        return None
    return float(np.interp(snapshot.target_deg, belief.choice_deg, belief.choice_sigma_deg))


def angle_text(snapshot: Snapshot) -> str:
    """The angle with its standard deviation, as far as it is known."""
    belief = snapshot.belief
    if belief is None:
        return "–"
    sigma = "" if belief.sigma_deg is None else f" ± {belief.sigma_deg:.3f}°"
    return f"{angles_text(belief.estimate) or '–'}{sigma}"


_ENDED: dict[Phase, str] = {"fault": "ended by a fault", "stopped": "stopped"}
"""How a run ended that gave no answer."""


def answer_text(snapshot: Snapshot) -> str:
    """What is claimed: an angle counts as found only once the search is over and says so."""
    if snapshot.belief is None:
        return "" if snapshot.points else "nothing measured yet"
    if not snapshot.belief.claims:
        return "claim: none: the paper's form of a method always answers, also where there is no marker"
    if snapshot.phase in _ENDED:
        return f"{_ENDED[snapshot.phase]}; until then {answer_name(snapshot.belief.estimate)}"
    reason = getattr(snapshot.belief.estimate, "reason", None)
    text = answer_name(snapshot.belief.estimate) + (f": {reason}" if reason else "")
    return text if snapshot.phase == "finished" else f"so far {text}"
