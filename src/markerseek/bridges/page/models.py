"""What the browser is sent of a run: plain values for the fan, the image and the curve. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from markerseek.bridges.page.image_bytes import RANGE_DB, Picture
from markerseek.records import with_minus
from markerseek.runs import RunView, mark_of, mean_deg, others_deg


def fan_model(view: RunView) -> dict[str, Any]:
    """The fan: limits, density, acquisitions, needle, answer, and at the end the true or reference angle."""
    belief, most = view.belief, view.strongest
    return {
        "low": view.facts.search.low_deg,
        "high": view.facts.search.high_deg,
        "probe": view.probe_deg,
        "said": probe_text(view),
        "target": view.target_deg,
        "angles": belief.angles_deg if belief else (),
        "density": belief.density_per_deg if belief else (),
        "points": [
            {
                "deg": round(point.angle_deg, 3),
                "share": round(point.intensity / most, 4) if most > 0 else 0.0,
                "text": mark_of(point, view),
                "role": point.role,
            }
            for point in view.points
        ],
        "mean": mean_deg(view),
        "others": others_deg(view),
        "interval": belief.interval95_deg if belief else None,
        "bracket": belief.bracket_deg if belief else None,
        "truth": view.facts.known_deg if view.phase == "finished" else None,
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


def image_model(picture: Picture | None, *, floor: float | None) -> dict[str, Any]:
    """The image, if there is one; its peak is marked only above the detection threshold, if that is known."""
    if picture is None:
        return {"pixels": ""}
    peak = picture.peak_mm if floor is None or picture.intensity > floor else None
    return asdict(picture.image) | {"deg": picture.angle_deg, "peak": peak}


def image_texts(picture: Picture | None, *, elsewhere: bool) -> tuple[str, str]:
    """Title and note of the image: the angle of the probe, and what is drawn."""
    if picture is None:
        return "photoacoustic image", ""
    title = with_minus(f"{'last image:' if elsewhere else 'image of'} {picture.angle_deg:.2f}°")
    return title, f"photoacoustic, {RANGE_DB} dB; ring: its peak"
