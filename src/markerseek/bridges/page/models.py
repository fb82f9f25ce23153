"""What the browser is sent of a snapshot: plain values for the fan, the curve and the numbers. Pure."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from markerseek.bridges.page.belief import angles_text
from markerseek.bridges.page.picture import Picture, drawn_background
from markerseek.bridges.page.state import Point, Snapshot
from markerseek.core import Ambiguous, Interval, NotFound, RigFacts

BLUE, SKY, ORANGE, GREEN, GREY = "#2a88c8", "#56b4e9", "#d55e00", "#009e73", "#8a8f98"
"""Colours that the colour-blind can tell apart, after Okabe and Ito: samples, density, answer, truth, the rest."""

FACE_SHARE = 0.28
"""Radius of the probe over that of the fan, as drawn."""


def fan_model(snapshot: Snapshot, facts: RigFacts, *, duration_s: float, known_deg: float | None) -> dict[str, Any]:
    """The fan: limits, density, acquisitions, needle, answer.

    Parameters
    ----------
    snapshot
        The state to show.
    facts
        The rig, for its limits.
    duration_s
        Real time that the present move is expected to take, in seconds.
    known_deg
        True or reference angle in degrees where it may be shown; None hides it.
    """
    belief = snapshot.belief
    return {
        "low": facts.search.low_deg,
        "high": facts.search.high_deg,
        "face": FACE_SHARE,
        "probe": snapshot.probe_deg,
        "said": probe_text(snapshot),
        "target": snapshot.target_deg,
        # A new number begins a new movement of the needle.
        "move": snapshot.number,
        "duration": round(duration_s, 3),
        "angles": _rounded(belief.angles_deg, 3) if belief else [],
        "density": _rounded(belief.density_per_deg, 5) if belief else [],
        "points": _fan_points(snapshot),
        "mean": mean_deg(snapshot),
        "others": other_angles_deg(snapshot),
        "interval": belief.interval95_deg if belief else None,
        "bracket": belief.bracket_deg if belief else None,
        "truth": known_deg,
        "choice_deg": _rounded(belief.choice_deg, 3) if belief else [],
        "choice_sigma": _rounded(belief.choice_sigma_deg, 4) if belief else [],
    }


def probe_text(snapshot: Snapshot) -> str:
    """Where the probe is, and whether that was measured."""
    if snapshot.probe_deg is None:
        return ""
    if snapshot.target_deg is not None:
        return f"expected, on its way to {snapshot.target_deg:.2f}°"
    # A move that was cut short has ended anywhere.
    last = "last " if snapshot.phase in {"stopped", "fault"} else ""
    return f"{last}read back: {snapshot.probe_deg:.2f}°"


def mean_deg(snapshot: Snapshot) -> float | None:
    """Angle of the marker in degrees as far as one is known; None where nothing is, or nothing was detected."""
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
            "text": _mark(point, snapshot),
            "role": point.role,
        }
        for point in snapshot.points
    ]


def _mark(point: Point, snapshot: Snapshot) -> str:
    """Number of an acquisition; of a confirmation a tick once it has confirmed a marker, and nothing before."""
    if point.role != "confirmation":
        return str(point.number)
    found = snapshot.phase == "finished" and snapshot.belief is not None and snapshot.belief.is_found
    return "✓" if found else ""


def curve_options(snapshot: Snapshot, limits: Interval, *, known: tuple[str, float] | None) -> dict[str, Any]:
    """Options of the chart: intensity and probability density over the angle.

    Parameters
    ----------
    snapshot
        The state to show.
    limits
        Range of the search.
    known
        Name and angle in degrees of the true or reference angle; None hides it.
    """
    belief = snapshot.belief
    return {
        "animation": False,
        "grid": {"left": 64, "right": 54, "top": 22, "bottom": 38},
        "tooltip": {"trigger": "item"},
        "textStyle": {"fontFamily": "system-ui, sans-serif"},
        "xAxis": {
            "type": "value",
            "name": "probe angle [deg]",
            "nameLocation": "middle",
            "nameGap": 24,
            "nameTextStyle": {"color": GREY},
            "min": limits.low_deg,
            "max": limits.high_deg,
            "axisLabel": {"color": GREY, "showMinLabel": False, "showMaxLabel": False},
            "axisLine": {"onZero": False, "lineStyle": {"color": GREY}},
            "splitLine": {"show": False},
        },
        "yAxis": [
            _axis("intensity [a.u.]", gap_px=46),
            # Only the posterior has one.
            _axis("probability [1/deg]", gap_px=36)
            | {"splitLine": {"show": False}, "show": bool(belief and belief.angles_deg.size)},
        ],
        "series": [
            {
                "name": "probability",
                "type": "line",
                "yAxisIndex": 1,
                "symbol": "none",
                "silent": True,
                "lineStyle": {"color": SKY, "width": 1},
                "areaStyle": {"color": SKY, "opacity": 0.35},
                "data": _pairs(belief.angles_deg, belief.density_per_deg) if belief else [],
                "markArea": _areas(snapshot),
                "markLine": _lines(snapshot, known),
            },
            {
                "name": "acquisitions",
                "type": "scatter",
                "symbolSize": 9,
                "itemStyle": {"color": BLUE},
                "label": {"show": True, "position": "top", "color": GREY, "fontSize": 10, "formatter": "{@[2]}"},
                "labelLayout": {"hideOverlap": True},
                "data": [_dot(point, snapshot) for point in snapshot.points],
                "markLine": _floor_line(snapshot),
            },
        ],
    }


def _axis(name: str, *, gap_px: int) -> dict[str, Any]:
    return {
        "type": "value",
        "name": name,
        # Beside the axis: above it the name would cover the angle of a marker near an end of the range.
        "nameLocation": "middle",
        "nameGap": gap_px,
        "nameTextStyle": {"color": GREY},
        "min": 0,
        "axisLabel": {"color": GREY, "hideOverlap": True},
        "axisLine": {"show": False, "onZero": False},
        "splitLine": {"lineStyle": {"color": "rgba(128,128,128,0.2)"}},
    }


def _dot(point: Point, snapshot: Snapshot) -> dict[str, Any]:
    """One acquisition; in a weighted average its size is its weight."""
    confirms = point.role == "confirmation"
    weights = snapshot.belief.weights if snapshot.belief else ()
    size = 4 + 10 * weights[point.number - 1] if weights and not confirms else 13 if confirms else 9
    return {
        "value": [round(point.angle_deg, 3), float(f"{point.intensity:.5g}"), _mark(point, snapshot)],
        "symbol": "rect" if confirms else "circle",
        "symbolSize": size,
    }


def _areas(snapshot: Snapshot) -> dict[str, Any]:
    belief = snapshot.belief
    interval, bracket = (belief.interval95_deg, belief.bracket_deg) if belief else (None, None)
    spans = [(interval, ORANGE, 0.18), (bracket, GREY, 0.15)]
    return {
        "silent": True,
        "data": [
            [{"xAxis": ends[0], "itemStyle": {"color": colour, "opacity": opacity}}, {"xAxis": ends[1]}]
            for ends, colour, opacity in spans
            if ends is not None
        ],
    }


def _lines(snapshot: Snapshot, known: tuple[str, float] | None) -> dict[str, Any]:
    lines = []
    angle_deg = mean_deg(snapshot)
    if angle_deg is not None:
        lines.append(_line(angle_deg, f"{angle_deg:.2f}°", ORANGE, "solid", "end"))
    lines += [_line(other_deg, f"{other_deg:.2f}°?", GREY, "dashed", "end") for other_deg in other_angles_deg(snapshot)]
    if known is not None:
        lines.append(_line(known[1], f"{known[0]} {known[1]:.2f}°", GREEN, "dotted", "insideMiddleBottom"))
    return {"silent": True, "symbol": "none", "data": lines}


def _line(angle_deg: float, text: str, colour: str, kind: str, position: str) -> dict[str, Any]:
    return {
        "xAxis": angle_deg,
        "lineStyle": {"color": colour, "type": kind, "width": 2},
        "label": {"formatter": text, "color": colour, "position": position},
    }


def _floor_line(snapshot: Snapshot) -> dict[str, Any]:
    floor = snapshot.belief.estimate.floor if snapshot.belief else None
    level = None if floor is None else floor.level
    label = {"formatter": "floor", "color": GREY, "position": "insideEndTop"}
    data = [] if level is None else [{"yAxis": level, "label": label}]
    return {"silent": True, "symbol": "none", "lineStyle": {"color": GREY, "type": "dashed"}, "data": data}


def image_model(picture: Picture | None, *, floor: float | None) -> dict[str, Any]:
    """The image, or why there is none; its peak is marked only above the noise floor, where that is known."""
    if picture is None:
        return {"pixels": "", "why": "no image yet"}
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


def number_rows(snapshot: Snapshot, *, pulse_j: float | None) -> list[tuple[str, str]]:
    """Names and formatted values, besides the angle.

    Parameters
    ----------
    snapshot
        The state to show.
    pulse_j
        Energy of one pulse in joules where the rig file names it; None elsewhere.
    """
    belief = snapshot.belief
    floor = belief.estimate.floor if belief else None
    virtual = " (virtual)" if snapshot.rig == "simulated" else ""
    rows = [
        ("acquisitions", str(snapshot.acquisitions) + (f", {snapshot.refused} refused" if snapshot.refused else "")),
        ("rotation", f"{snapshot.travel_deg:.1f}°"),
        ("time", "–" if snapshot.rig == "replayed" else f"{snapshot.elapsed_s:.0f} s{virtual}"),
        ("peak SNR", "–" if snapshot.snr_db is None else f"{snapshot.snr_db:.1f} dB"),
        ("noise floor", "unknown" if floor is None or floor.level is None else f"{floor.level:.4g} a.u."),
        ("pulses", str(snapshot.pulses)),
    ]
    if belief is not None:
        others = [f"{each.relative_db:+.1f} dB at {each.angle_deg:.2f}°" for each in belief.estimate.others]
        none = "none seen" if belief.angles_deg.size else "not looked for"
        rows.append(("other sources", ", ".join(others[:2]) or none))
        surveyed = belief.estimate.surveyed
        rows.append(("surveyed", "–" if surveyed is None else f"{100 * surveyed:.1f} % of range"))
    expected_deg = _expected_sigma_deg(snapshot)
    if expected_deg is not None:
        rows.append(("expected next", f"± {expected_deg:.3f}°"))
    if pulse_j is not None:
        rows.append(("light", f"{snapshot.pulses * pulse_j * 1e3:.3g} mJ"))
    return rows


def _expected_sigma_deg(snapshot: Snapshot) -> float | None:
    """Standard deviation expected after the acquisition on its way, in degrees; None where none was weighed up."""
    belief = snapshot.belief
    if belief is None or snapshot.target_deg is None or not belief.choice_deg.size:
        return None
    return float(np.interp(snapshot.target_deg, belief.choice_deg, belief.choice_sigma_deg))


def angle_text(snapshot: Snapshot) -> str:
    """The angle with its standard deviation, as far as it is known."""
    belief = snapshot.belief
    if belief is None:
        return "–"
    sigma = "" if belief.sigma_deg is None else f" ± {belief.sigma_deg:.3f}°"
    return f"{angles_text(belief.estimate) or '–'}{sigma}"


def answer_text(snapshot: Snapshot) -> str:
    """What is claimed: an angle counts as found only once the search is over and says so."""
    if snapshot.belief is None:
        return "" if snapshot.points else "nothing measured yet"
    if not snapshot.belief.claims:
        return "claim: none: the paper's form of a method always answers, also where there is no marker"
    reason = getattr(snapshot.belief.estimate, "reason", None)
    text = snapshot.belief.answer + (f": {reason}" if reason else "")
    return text if snapshot.phase == "finished" else f"so far {text}"


def _pairs(x: Any, y: Any) -> list[list[float]]:
    return [list(pair) for pair in zip(_rounded(x, 3), _rounded(y, 5), strict=True)]


def _rounded(values: Any, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
