"""Draws docs/figures/situation.svg, what stands where when a marker is searched: ``make figures``.

Its ground is white, so that it looks the same on dark and on light pages.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

PICTURE = Path(__file__).with_name("situation.svg")

WIDTH, HEIGHT, ABOVE = 900, 430, 14
INK, QUIET, SOUND, LIGHT, TISSUE, PLANE = "#1b2430", "#6a7480", "#1f5fa8", "#138a4b", "#f3d9d0", "#2a88c8"
MARKER = "#c8501e"

AXIS, ARRAY, TOP = (704.0, 354.0), 46.0, 250.0
"""Of the view from the probe's end: place of the axis, radius of the array, length of the image plane."""

PLANE_DEG, MARKER_DEG, RANGE_DEG = -13.0, 9.0, 35.0
"""Angles in that view: of the image plane now, of the marker, half of the range."""


def text(
    x: float, y: float, words: str, *, colour: str = INK, anchor: str = "start", size: int = 14, bold: bool = False
) -> str:
    """Return a line of text."""
    weight = ' font-weight="600"' if bold else ""
    place = f'x="{x:g}" y="{y:g}" text-anchor="{anchor}" font-size="{size}" fill="{colour}"{weight}'
    return f"<text {place}>{words}</text>"


def line(points: Iterable[tuple[float, float]], colour: str, *, width: float = 2, dashes: str = "") -> str:
    """Return a line through points."""
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    drawn = f'stroke="{colour}" stroke-width="{width:g}" stroke-dasharray="{dashes}"'
    return f'<polyline points="{path}" fill="none" {drawn}/>'


def area(points: Iterable[tuple[float, float]], colour: str, *, opacity: float = 1, edge: str = "none") -> str:
    """Return a filled polygon."""
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{path}" fill="{colour}" fill-opacity="{opacity:g}" stroke="{edge}"/>'


def dot(x: float, y: float, radius: float, colour: str, *, edge: str = "white") -> str:
    """Return a disc."""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{colour}" stroke="{edge}" stroke-width="1.5"/>'


def polar(angle_deg: float, away: float) -> tuple[float, float]:
    """Return a place in the view from the probe's end: 0 is up, positive angles are on the right."""
    angle = math.radians(angle_deg)
    return AXIS[0] + away * math.sin(angle), AXIS[1] - away * math.cos(angle)


def wave(x: float, y: float, radius: float) -> str:
    """Return a wave of sound that has come so far from a place."""
    path = f"M{x - radius:g} {y + 0.55 * radius:g}A{radius} {radius} 0 0 0 {x + radius:g} {y + 0.55 * radius:g}"
    return f'<path d="{path}" fill="none" stroke="{SOUND}" stroke-width="2" opacity="{1 - radius / 130:.2f}"/>'


def arc(low_deg: float, high_deg: float, away: float) -> list[tuple[float, float]]:
    """Return points of an arc about the axis."""
    return [polar(low_deg + (high_deg - low_deg) * n / 40, away) for n in range(41)]


def from_the_side() -> list[str]:
    """Return the left half: probe, tissue, laser and endoscope."""
    spot = (262.0, 138.0)
    surface = [(96 + 4 * n, 140 + 5 * math.sin(n / 9)) for n in range(83)]
    waves = [wave(*spot, radius) for radius in (22, 44, 66, 88)]
    endoscope = f'<rect x="366" y="30" width="120" height="44" rx="8" fill="#dfe4ea" stroke="{QUIET}"'
    return [
        text(24, 30, "from the side", colour=QUIET, size=13),
        area([*surface, (424, 290), (96, 290)], TISSUE),
        text(112, 278, "tissue", colour="#8a5a48"),
        # The image plane stands on the array.
        area([(190, 312), (350, 312), (350, 118), (190, 118)], PLANE, opacity=0.14, edge=PLANE),
        text(344, 286, "image", colour=PLANE, anchor="end"),
        text(344, 302, "plane", colour=PLANE, anchor="end"),
        # Probe, array, stage and axis.
        f'<rect x="96" y="306" width="330" height="60" rx="28" fill="#dfe4ea" stroke="{QUIET}"/>',
        f'<rect x="190" y="305" width="160" height="9" fill="{INK}"/>',
        f'<rect x="30" y="296" width="58" height="80" rx="6" fill="#c3cbd5" stroke="{QUIET}"/>',
        line([(14, 336), (452, 336)], INK, width=1.5, dashes="12 4 2 4"),
        f'<path d="M98 318a10 20 0 1 1 -2 34" fill="none" stroke="{INK}" stroke-width="2.5"/>',
        f'<path d="M89 344l7 10 5 -11z" fill="{INK}"/>',
        text(59, 394, "motor", anchor="middle"),
        text(270, 358, "ultrasound probe, receives only", anchor="middle", size=13),
        text(436, 328, "axis"),
        text(270, 330, "array of 128 elements", anchor="middle", size=12),
        # Laser, spot, sound.
        line([(150, 34), (spot[0] - 5, spot[1] - 7)], LIGHT, width=4),
        f'<rect x="118" y="12" width="46" height="26" rx="4" fill="{LIGHT}" transform="rotate(43 141 25)"/>',
        text(120, 64, "pulsed laser", colour=LIGHT, anchor="end"),
        *waves,
        text(246, 232, "sound", colour=SOUND, anchor="end"),
        dot(*spot, 7, MARKER),
        text(spot[0] - 14, spot[1] + 4, "marker", colour=MARKER, anchor="end", bold=True),
        # Both cameras of the endoscope.
        line([(372, 58), spot], QUIET, width=1.5, dashes="5 4"),
        line([(396, 72), spot], QUIET, width=1.5, dashes="5 4"),
        f'{endoscope} transform="rotate(-22 384 65)"/>',
        dot(375, 60, 8, INK),
        dot(393, 78, 8, INK),
        text(388, 104, "both cameras of", size=13),
        text(388, 120, "the endoscope", size=13),
    ]


def from_the_end() -> list[str]:
    """Return the right half: the angles that are meant, and the intensity over them."""
    curve = []
    for n in range(141):
        angle_deg = -RANGE_DEG + n * 0.5
        height = 1 / (1 + ((angle_deg - MARKER_DEG) / 4.5) ** 2)
        curve.append((AXIS[0] + 5.4 * angle_deg, 86 - 46 * height))
    marker = polar(MARKER_DEG, 205)
    named = polar(PLANE_DEG - 11, 150)
    return [
        line([(504, 20), (504, 410)], "#d5dae0", width=1),
        text(524, 30, "from the end of the probe", colour=QUIET, size=13),
        area([AXIS, *arc(-RANGE_DEG, RANGE_DEG, TOP)], "#eef2f6", edge="#c3cbd5"),
        f'<circle cx="{AXIS[0]}" cy="{AXIS[1]}" r="{ARRAY}" fill="#dfe4ea" stroke="{QUIET}"/>',
        line([AXIS, polar(0, TOP)], QUIET, width=1, dashes="3 4"),
        line([polar(PLANE_DEG, ARRAY), polar(PLANE_DEG, TOP)], PLANE, width=5),
        line(arc(PLANE_DEG - 17, PLANE_DEG + 17, ARRAY), INK, width=7),
        line(arc(0, PLANE_DEG, 130), PLANE, width=2),
        text(*named, "angle of the", colour=PLANE, anchor="end"),
        text(named[0], named[1] + 17, "image plane", colour=PLANE, anchor="end"),
        line([polar(MARKER_DEG, ARRAY), polar(MARKER_DEG, TOP)], MARKER, width=1.5, dashes="6 4"),
        dot(*marker, 7, MARKER),
        text(marker[0] + 14, marker[1] + 4, "marker", colour=MARKER, bold=True),
        line(arc(0, MARKER_DEG, 100), MARKER, width=2),
        text(*polar(MARKER_DEG + 5, 96), "its angle: searched", colour=MARKER),
        dot(*AXIS, 4, INK),
        text(AXIS[0], AXIS[1] + 25, "axis", anchor="middle"),
        text(*polar(-RANGE_DEG - 1, TOP - 14), "−35°", colour=QUIET, anchor="end", size=13),
        text(*polar(RANGE_DEG + 1, TOP - 14), "35°", colour=QUIET, size=13),
        line(curve, SOUND, width=2.5),
        line([(AXIS[0] - 189, 88), (AXIS[0] + 189, 88)], QUIET, width=1),
        text(AXIS[0] - 150, 62, "intensity over", colour=SOUND, size=13),
        text(AXIS[0] - 150, 78, "the angle", colour=SOUND, size=13),
    ]


def main() -> None:
    """Write the picture."""
    title = "A probe turns about its axis below tissue; a laser lights a marker, which both cameras of an endoscope see"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 {-ABOVE} {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{title}" font-family="system-ui, Helvetica, Arial, sans-serif">'
    )
    ground = f'<rect y="{-ABOVE}" width="{WIDTH}" height="{HEIGHT}" rx="10" fill="white"/>'
    parts = [head, ground, *from_the_side(), *from_the_end(), "</svg>"]
    PICTURE.write_text("\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
