"""The charts of intensity and probability over the angle, and of a race over time, as options of ECharts. Pure.

They are drawn as SVG: the style sheet gives text and lines the colours of the page, dark or light.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markerseek.bridges.page.models import mark, mean_deg, other_angles_deg
from markerseek.core import AngleBelief, Interval
from markerseek.runs import Point, RunView, with_minus

BLUE, SKY, ORANGE, GREEN, GREY = "#2a88c8", "#56b4e9", "#d55e00", "#009e73", "#8a8f98"
"""Colours that the colour-blind can tell apart, after Okabe and Ito: samples, density, answer, truth, the rest."""

RACERS = (BLUE, "#a8559b")
"""Colours of the two in a race: orange is the answer's."""


_WITH_MINUS = "value => String(value).replace('-', '\u2212')"
"""Text of a number at an axis, as a function of the browser."""


def curve_options(snapshot: RunView, limits: Interval, *, unit: str, known: tuple[str, float] | None) -> dict[str, Any]:
    """Options of the chart: intensity and probability density over the angle.

    ``unit``: of the intensities. ``known``: name and angle in degrees of the true or reference angle; None hides it.
    """
    belief = snapshot.belief
    return {
        "animation": False,
        "grid": {"left": 64, "right": 54, "top": 62, "bottom": 38},
        "tooltip": {"trigger": "item"},
        # Two long lists: a list for each of 400 pairs would take twice as long to be sent.
        "dataset": {"source": _density(belief)},
        "textStyle": {"fontFamily": "system-ui, sans-serif"},
        "xAxis": {
            "type": "value",
            "name": "probe angle [deg]",
            "nameLocation": "middle",
            "nameGap": 24,
            "nameTextStyle": {"fontSize": 13},
            "min": limits.low_deg,
            "max": limits.high_deg,
            "axisLabel": {"fontSize": 13, ":formatter": _WITH_MINUS, "showMinLabel": False, "showMaxLabel": False},
            "axisLine": {"onZero": False, "lineStyle": {"color": GREY}},
            "splitLine": {"show": False},
        },
        "yAxis": [
            # Room above the largest for its number, below the angles.
            _axis(f"intensity [{unit}]", gap_px=46) | {"boundaryGap": ["0%", "12%"]},
            # Only the posterior has one.
            _axis("probability [1/deg]", gap_px=36)
            | {"splitLine": {"show": False}, "show": bool(belief and belief.angles_deg)},
        ],
        "series": [
            {
                "name": "probability",
                "type": "line",
                "yAxisIndex": 1,
                "symbol": "none",
                "silent": True,
                "lineStyle": {"color": BLUE, "width": 1},
                "areaStyle": {"color": SKY, "opacity": 0.35},
                "encode": {"x": "angle", "y": "density"},
                "markArea": _areas(snapshot),
                "markLine": _lines(snapshot, known),
            },
            {
                "name": "acquisitions",
                "type": "scatter",
                "symbolSize": 9,
                # Else of ECharts, also for their numbers: 0.8.
                "itemStyle": {"color": BLUE, "opacity": 1},
                "label": {"show": True, "position": "top", "fontSize": 12, "formatter": "{@[2]}"},
                "labelLayout": {"hideOverlap": True},
                "data": [_dot(point, snapshot) for point in snapshot.points],
                "markLine": _floor_line(snapshot),
            },
        ],
    }


def _density(belief: AngleBelief | None) -> dict[str, tuple[float, ...]]:
    """Angles in degrees, and the probability density there in 1/deg."""
    if belief is None:
        return {"angle": (), "density": ()}
    return {"angle": belief.angles_deg, "density": belief.density_per_deg}


def _axis(name: str, *, gap_px: int) -> dict[str, Any]:
    return {
        "type": "value",
        "name": name,
        # Beside the axis: above it the name would cover the angle of a marker near an end of the range.
        "nameLocation": "middle",
        "nameGap": gap_px,
        "nameTextStyle": {"fontSize": 13},
        "min": 0,
        "axisLabel": {"fontSize": 13, "hideOverlap": True},
        "axisLine": {"show": False, "onZero": False},
        "splitLine": {"lineStyle": {"color": "rgba(128,128,128,0.2)"}},
    }


def _dot(point: Point, snapshot: RunView) -> dict[str, Any]:
    """One acquisition; in a weighted average its size is its weight."""
    confirms = point.role == "confirmation"
    weights = snapshot.belief.weights if snapshot.belief else ()
    # An acquisition that has just been made has no weight until the policy has received it.
    weighed = not confirms and point.number <= len(weights)
    size = 4 + 10 * weights[point.number - 1] if weighed else 13 if confirms else 9
    return {
        "value": [round(point.angle_deg, 3), float(f"{point.intensity:.5g}"), mark(point, snapshot)],
        "symbol": "rect" if confirms else "circle",
        "symbolSize": size,
    }


def _areas(snapshot: RunView) -> dict[str, Any]:
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


def _lines(snapshot: RunView, known: tuple[str, float] | None) -> dict[str, Any]:
    lines = []
    angle_deg = mean_deg(snapshot)
    if angle_deg is not None:
        lines.append(_line(angle_deg, f"{angle_deg:.2f}°", ORANGE, "solid"))
    lines += [
        _line(other_deg, f"{other_deg:.2f}°?", GREY, "dashed", above_px=26) for other_deg in other_angles_deg(snapshot)
    ]
    if known is not None:
        # Each kind has a row of its own: the angles are near to one another.
        lines.append(_line(known[1], f"{known[0]} {known[1]:.2f}°", GREEN, "dotted", above_px=41))
    return {"silent": True, "symbol": "none", "data": lines}


def _line(angle_deg: float, text: str, colour: str, kind: str, *, above_px: int = 12) -> dict[str, Any]:
    return {
        "xAxis": angle_deg,
        "lineStyle": {"color": colour, "type": kind, "width": 2},
        "label": {"formatter": with_minus(text), "fontSize": 13, "position": "end", "distance": above_px},
    }


def _floor_line(snapshot: RunView) -> dict[str, Any]:
    level = snapshot.floor_level
    # Its name is in the title of the panel: beside the line it would cover numbers of acquisitions.
    data = [] if level is None else [{"yAxis": level, "label": {"show": False}}]
    return {"silent": True, "symbol": "none", "lineStyle": {"color": GREY, "type": "dashed"}, "data": data}


def race_options(runs: Mapping[str, Sequence[RunView]], limits: Interval) -> dict[str, Any]:
    """Options of the chart of a race: where each probe was read back, over the time on the clocks of the rigs.

    ``runs``: the snapshots of each racer, by its name.
    """
    return {
        "animation": False,
        "grid": {"left": 64, "right": 24, "top": 34, "bottom": 42},
        "legend": {"top": 2, "textStyle": {"fontSize": 13}},
        "tooltip": {"trigger": "item"},
        "textStyle": {"fontFamily": "system-ui, sans-serif"},
        "xAxis": _axis("time on the clocks of the rigs [s]", gap_px=26),
        "yAxis": _axis("probe angle [deg]", gap_px=40)
        # The chart is low: few numbers have room.
        | {"min": limits.low_deg, "max": limits.high_deg, "splitNumber": 3}
        | {"axisLabel": {"fontSize": 13, ":formatter": _WITH_MINUS}},
        "series": [
            {
                "name": name,
                "type": "line",
                "symbolSize": 7,
                "itemStyle": {"color": colour},
                "lineStyle": {"color": colour, "width": 2},
                "data": [
                    [round(each.elapsed_s, 2), round(each.probe_deg, 3)]
                    for each in snapshots
                    if each.probe_deg is not None and each.target_deg is None
                ],
            }
            for (name, snapshots), colour in zip(runs.items(), RACERS, strict=False)
        ],
    }
