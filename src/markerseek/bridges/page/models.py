"""What the browser is sent of a snapshot: plain values for the fan, the image and the numbers. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from markerseek.bridges.page.image_bytes import Picture
from markerseek.core import Ambiguous, Found, Interval, NotFound, Unsure
from markerseek.runs import Point, RunView, digits_of, with_minus

FACE_SHARE = 0.28
"""Radius of the probe over that of the fan, as drawn."""


def fan_model(
    snapshot: RunView,
    search: Interval,
    *,
    duration_s: float,
    known_deg: float | None,
    aim_deg: float | None = None,
) -> dict[str, Any]:
    """The fan: limits, density, acquisitions, needle, answer.

    ``duration_s``: real time that the present move is expected to take. ``known_deg``: true or reference angle in
    degrees where it may be shown; None hides it. ``aim_deg``: angle to which a person will turn the probe, which is
    where the needle is then drawn.
    """
    belief = snapshot.belief
    return {
        "low": search.low_deg,
        "high": search.high_deg,
        "face": FACE_SHARE,
        "probe": snapshot.probe_deg,
        "said": probe_text(snapshot) if aim_deg is None else with_minus(f"aimed at {aim_deg:.1f}°"),
        "aim": aim_deg,
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


def probe_text(snapshot: RunView) -> str:
    """Where the probe is, and whether that was measured."""
    if snapshot.probe_deg is None:
        return ""
    if snapshot.target_deg is not None:
        return with_minus(f"expected, on its way to {snapshot.target_deg:.2f}°")
    # A move that was cut short has ended anywhere.
    last = "last " if snapshot.phase in {"stopped", "fault", "cut off", "checking"} else ""
    return with_minus(f"{last}read back: {snapshot.probe_deg:.2f}°")


def mean_deg(snapshot: RunView) -> float | None:
    """Angle of the marker in degrees; None while it is unknown, or if nothing was detected."""
    belief = snapshot.belief
    return None if belief is None or isinstance(belief.estimate, NotFound) else belief.estimate.mean_deg


def other_angles_deg(snapshot: RunView) -> list[float]:
    """Angles in degrees of what else may be the marker: other sources, and the other modes of an ambiguous answer."""
    if snapshot.belief is None:
        return []
    estimate = snapshot.belief.estimate
    modes_deg = estimate.modes_deg if isinstance(estimate, Ambiguous) else ()
    others_deg = {round(each, 2) for each in (*modes_deg, *(other.angle_deg for other in estimate.others))}
    return sorted(each for each in others_deg if abs(each - estimate.mean_deg) > 0.01)


def _fan_points(snapshot: RunView) -> list[dict[str, Any]]:
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


def mark(point: Point, snapshot: RunView) -> str:
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
    }


def background_model(picture: Picture | None) -> dict[str, Any]:
    """The B-mode image of the same angle, which is behind the image; empty where the rig takes none."""
    return {} if picture is None or picture.b_mode is None else asdict(picture.b_mode)


def image_title(picture: Picture | None, *, elsewhere: bool) -> str:
    """Of which angle the image is, and whether the probe is elsewhere by now."""
    if picture is None:
        return "photoacoustic image"
    return with_minus(f"{'last image:' if elsewhere else 'image of'} {picture.angle_deg:.2f}°")


def image_note(picture: Picture | None, *, simulated: bool) -> str:
    """What is drawn in the image."""
    if picture is None:
        return ""
    b_mode = "" if picture.b_mode is None else "; grey: B-mode" + (" (simulated)" if simulated else "")
    return f"photoacoustic, {picture.range_db:g} dB; ring: its peak{b_mode}"


def number_rows(snapshot: RunView, *, name: str, unit: str, pulse_j: float | None) -> list[tuple[str, str]]:
    """Names and formatted values, besides the verdict.

    ``name`` and ``unit``: what is run, and the unit of its intensities, as of `RunHistory`. ``pulse_j``: energy of one
    pulse in joules where the rig file names it; None elsewhere.
    """
    belief = snapshot.belief
    virtual = " (virtual)" if snapshot.facts.kind == "simulated" else ""
    rows = [
        ("search", name),
        ("acquisitions", str(snapshot.acquisitions) + (f", {snapshot.refused} refused" if snapshot.refused else "")),
        ("rotation", "–" if snapshot.facts.kind == "replayed" else f"{snapshot.travel_deg:.1f}°"),
        ("time", "–" if snapshot.facts.kind == "replayed" else f"{snapshot.elapsed_s:.0f} s{virtual}"),
        ("peak SNR", snr_text(snapshot)),
        ("noise floor", "unknown" if snapshot.floor_level is None else f"{snapshot.floor_level:.4g} {unit}"),
        ("pulses", "–" if snapshot.facts.kind == "replayed" else str(snapshot.pulses)),
    ]
    if belief is not None:
        others = [with_minus(f"{each.relative_db:+.1f} dB at {each.angle_deg:.2f}°") for each in belief.estimate.others]
        none = "none seen" if belief.angles_deg else "not looked for"
        rows.append(("other sources", ", ".join(others[:2]) or none))
        surveyed = belief.estimate.surveyed
        rows.append(("surveyed", "–" if surveyed is None else f"{100 * surveyed:.1f} % of range"))
        if isinstance(belief.estimate, Found | Unsure) and belief.estimate.other_probability:
            rows.append(("wrong source", f"{100 * belief.estimate.other_probability:.2g} %"))
    expected_deg = _expected_sigma_deg(snapshot)
    if expected_deg is not None:
        rows.append(("expected next", f"± {expected_deg:.{digits_of(expected_deg)}f}°"))
    if pulse_j is not None:
        rows.append(("light", f"{snapshot.pulses * pulse_j * 1e3:.3g} mJ"))
    return rows


def snr_text(snapshot: RunView) -> str:
    """Largest intensity over the noise, or that it is below the floor."""
    strongest = max((point.intensity for point in snapshot.points), default=0.0)
    if snapshot.snr_db is None:
        return "–"
    floor_level = 0.0 if snapshot.floor_level is None else snapshot.floor_level
    return "below the floor" if strongest <= floor_level else f"{snapshot.snr_db:.1f} dB"


def _expected_sigma_deg(snapshot: RunView) -> float | None:
    """Standard deviation expected after the acquisition on its way, in degrees; None where none was weighed up."""
    belief = snapshot.belief
    if belief is None or snapshot.target_deg is None or not belief.choice_deg:
        return None
    return float(np.interp(snapshot.target_deg, belief.choice_deg, belief.choice_sigma_deg))
