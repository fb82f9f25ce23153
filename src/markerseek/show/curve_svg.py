"""Curves as SVG, for the page, notebooks and reports: they need no package, and follow dark and light pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from markerseek.show.curve import ANGLE_TEXT, DENSITY_TEXT, DrawnCurve, Mark
from markerseek.show.words import with_minus

BLUE = "#2a88c8"
SKY = "#56b4e9"
ORANGE = "#d55e00"
GREEN = "#009e73"
GREY = "#8a8f98"
"""Colours that the colour-blind can tell apart, after Okabe and Ito: samples, density, answer, truth, the rest."""

_WIDTH = 460.0
_HEIGHT = 320.0

_CROWDED = 40
"""Most acquisitions that are drawn as large dots."""


def curve_svg(curve: DrawnCurve) -> str:
    """Return a curve as SVG, with an inset about an answer that is one line in the whole range."""
    top = 1.14 * curve.top
    most_per_deg = curve.most_per_deg
    ends = (curve.low_deg, curve.high_deg)
    frame = _Frame(58, 34, _WIDTH - (96 if most_per_deg else 70), _HEIGHT - 72, ends, (0.0, top))
    parts = [*frame.axes(ANGLE_TEXT, curve.intensity_text)]
    if most_per_deg:
        parts += frame.right_axis(DENSITY_TEXT, 1.05 * most_per_deg)
    parts += _drawn(curve, frame)
    parts += _numbers(curve, frame)
    parts += _labels(curve, frame)
    if curve.inset_deg is not None:
        parts += _inset(curve, frame, curve.inset_deg)
    return _svg(parts, _HEIGHT, curve.text)


def _inset(curve: DrawnCurve, frame: _Frame, ends: tuple[float, float]) -> list[str]:
    # Beside the answer, where there is more room.
    is_left = frame.x(sum(ends) / 2) > frame.left + frame.width / 2
    place = frame.left + 12 if is_left else frame.left + frame.width - 152
    inset = _Frame(place, 44, 140, 92, ends, frame.limits)
    ground = (
        f'<rect x="{place - 6}" y="38" width="152" height="118" rx="4" fill="var(--ms-ground, none)" '
        f'stroke="{GREY}" opacity="0.9"/>'
    )
    drawn = "".join([*inset.axes("", ""), *_drawn(curve, inset)])
    return [ground, f'<g class="ms-inset">{drawn}</g>']


def _drawn(curve: DrawnCurve, frame: _Frame) -> list[str]:
    parts = []
    for band, colour, opacity in ((curve.bracket, GREY, 0.18), (curve.interval, ORANGE, 0.25)):
        if band is not None:
            left = frame.x(frame.inside(band.low_deg))
            right = frame.x(frame.inside(band.high_deg))
            parts.append(
                f'<rect x="{left:.1f}" y="{frame.top}" width="{max(right - left, 1):.1f}" '
                f'height="{frame.height}" fill="{colour}" opacity="{opacity}"/>'
            )
    if curve.most_per_deg:
        parts.append(_area(curve, frame))
    if curve.recorded:
        parts.append(_recorded(curve, frame))
    if curve.threshold is not None:
        parts.append(frame.horizontal(curve.threshold.level))
    parts += [frame.line(each.angle_deg, GREY, dashes="5 4") for each in curve.others]
    dashes = "" if curve.is_claimed else "8 4"
    parts += [frame.line(each.angle_deg, ORANGE, dashes=dashes) for each in curve.answers]
    if curve.known is not None:
        parts.append(frame.line(curve.known.angle_deg, GREEN, dashes="2 4"))
    return [*parts, *(_dot(each, frame, radius=_radius(each, curve)) for each in _marks_in(curve, frame))]


def _marks_in(curve: DrawnCurve, frame: _Frame) -> list[Mark]:
    return [each for each in curve.marks if frame.inside(each.angle_deg) == each.angle_deg]


def _radius(mark: Mark, curve: DrawnCurve) -> float:
    """Return the radius in pixels; in a weighted average the size of a dot is its weight."""
    if mark.role == "confirmation":
        return 6.0
    if mark.weight is not None:
        return 2 + 5 * mark.weight
    return 4.5 if len(curve.marks) <= _CROWDED else 2.5


def _dot(mark: Mark, frame: _Frame, *, radius: float) -> str:
    x = frame.x(mark.angle_deg)
    y = frame.y(mark.intensity)
    if mark.role == "confirmation":
        size = f'width="{2 * radius:.1f}" height="{2 * radius:.1f}"'
        return f'<rect x="{x - radius:.1f}" y="{y - radius:.1f}" {size} fill="{BLUE}"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{BLUE}"/>'


def _numbers(curve: DrawnCurve, frame: _Frame) -> list[str]:
    """Return the numbers of the acquisitions, the newest first; one that would cover another one is left out."""
    parts: list[str] = []
    taken: list[tuple[float, float]] = []
    for each in reversed(_marks_in(curve, frame)):
        x = frame.x(each.angle_deg)
        y = frame.y(each.intensity)
        if each.text and all(abs(x - u) > 13 or abs(y - v) > 11 for u, v in taken):
            taken.append((x, y))
            parts.append(_text(x, y - _radius(each, curve) - 3, each.text, size=11))
    return parts


def _area(curve: DrawnCurve, frame: _Frame) -> str:
    scale = frame.limits[1] / (1.05 * curve.most_per_deg)
    low, high = frame.ends
    density = zip(curve.density_deg, curve.density_per_deg, strict=True)
    inside = [(at, each) for at, each in density if low <= at <= high]
    if not inside:
        return ""
    line = "L".join(f"{frame.x(at):.1f} {frame.y(each * scale):.1f}" for at, each in inside)
    first = frame.x(inside[0][0])
    last = frame.x(inside[-1][0])
    bottom = frame.top + frame.height
    return (
        f'<path class="ms-density" d="M{first:.1f} {bottom}L{line}L{last:.1f} {bottom}Z" fill="{SKY}" '
        f'fill-opacity="0.35" stroke="{BLUE}"/>'
    )


def _recorded(curve: DrawnCurve, frame: _Frame) -> str:
    """Return the recording that a search replays, as a line."""
    low, high = frame.ends
    recorded = zip(curve.recorded_deg, curve.recorded, strict=True)
    points = " ".join(f"{frame.x(at):.1f},{frame.y(each):.1f}" for at, each in recorded if low <= at <= high)
    return f'<polyline class="ms-recorded" points="{points}" stroke="{GREY}"/>'


def _labels(curve: DrawnCurve, frame: _Frame) -> list[str]:
    """Return the angles above the frame; one that would cover another one is left out."""
    # That which is known otherwise has a row of its own, because it is near to the answer.
    said = [(each, 28) for each in curve.answers]
    said += [(each, 14) for each in (curve.known,) if each is not None]
    said += [(each, 28) for each in curve.others]
    room = 8 + 4 * max((len(each.text) for each, _ in said), default=0)
    parts: list[str] = []
    taken: list[tuple[float, float]] = []
    for each, y in said:
        x = min(max(frame.x(frame.inside(each.angle_deg)), room), _WIDTH - room)
        if all(abs(x - u) > 2 * room - 8 or y != v for u, v in taken):
            taken.append((x, y))
            parts.append(_text(x, y, each.text, size=13))
    return parts


def errors_svg(errors: Sequence[tuple[int, float, float]], *, goal_mm: float) -> str:
    """Return the expected error of a registration after each marker, with its goal, as SVG.

    ``errors``: number of markers, expected error, and the error below which 95 % are, both in millimetres.
    """
    width = 420.0
    height = 270.0
    last = max([7, *(count for count, _, _ in errors)])
    most = 1.1 * max([2 * goal_mm, *(high for _, _, high in errors)])
    frame = _Frame(54, 14, width - 66, height - 58, (2.5, last + 0.5), (0.0, most))
    parts = [*frame.axes("markers", "expected error at the target [mm]"), frame.horizontal(goal_mm)]
    parts.append(_text(width - 14, frame.y(goal_mm) - 6, f"goal {goal_mm:g} mm", size=14, anchor="end"))
    line = " ".join(f"{frame.x(count):.1f},{frame.y(mean):.1f}" for count, mean, _ in errors)
    parts.append(f'<polyline points="{line}" stroke="{BLUE}" stroke-width="3"/>')
    for count, mean, high in errors:
        x = frame.x(count)
        y = frame.y(mean)
        top = frame.y(high)
        parts.append(f'<path d="M{x:.1f} {y:.1f}V{top:.1f}m-5 0h10" stroke="{BLUE}" stroke-width="2"/>')
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{BLUE}"/>')
        parts.append(_text(x + 9, y - 7, f"{mean:.2f}", size=15, anchor="start"))
    return _svg(parts, height, "expected error at the target after each marker", width=width)


def as_html(title: str, rows: Iterable[tuple[str, str | None]], picture: str) -> str:
    """Return HTML of a title, names with values (those of None are left out), and a picture, which is SVG already."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
        if value is not None
    )
    return f'<div style="max-width:640px"><strong>{escape(title)}</strong><table>{cells}</table>{picture}</div>'


@dataclass(frozen=True, slots=True)
class _Frame:
    """A rectangle of the picture in pixels, with the values at its ends."""

    left: float
    top: float
    width: float
    height: float
    ends: tuple[float, float]
    limits: tuple[float, float]

    def inside(self, value: float) -> float:
        return min(max(value, self.ends[0]), self.ends[1])

    def x(self, value: float) -> float:
        return self.left + (value - self.ends[0]) / (self.ends[1] - self.ends[0]) * self.width

    def y(self, value: float) -> float:
        share = (value - self.limits[0]) / (self.limits[1] - self.limits[0])
        return self.top + self.height * (1 - min(max(share, 0.0), 1.0))

    def line(self, value: float, colour: str, *, dashes: str = "") -> str:
        if self.inside(value) != value:
            return ""
        return (
            f'<path d="M{self.x(value):.1f} {self.top}v{self.height}" stroke="{colour}" stroke-width="2" '
            f'stroke-dasharray="{dashes}"/>'
        )

    def horizontal(self, value: float) -> str:
        return f'<path d="M{self.left} {self.y(value):.1f}h{self.width}" stroke="{GREY}" stroke-dasharray="5 4"/>'

    def axes(self, x_name: str, y_name: str) -> list[str]:
        bottom = self.top + self.height
        parts = [f'<path d="M{self.left} {bottom}h{self.width}" stroke="{GREY}"/>']
        for at in _ticks(self.ends, self.width / (42 if y_name else 28)):
            parts.append(f'<path d="M{self.x(at):.1f} {bottom}v4" stroke="{GREY}"/>')
            parts.append(_text(self.x(at), bottom + 16, f"{at:g}"))
        if not y_name:
            return parts
        for at in _ticks(self.limits, self.height / 26):
            parts.append(f'<path d="M{self.left} {self.y(at):.1f}h{self.width}" stroke="{GREY}" opacity="0.25"/>')
            parts.append(_text(self.left - 5, self.y(at) + 4, f"{at:g}", anchor="end"))
        parts.append(_text(self.left + self.width / 2, bottom + 33, x_name))
        middle = self.top + self.height / 2
        parts.append(f'<g transform="rotate(-90 12 {middle:g})">{_text(12, middle, y_name)}</g>')
        return parts

    def right_axis(self, name: str, most: float) -> list[str]:
        right = self.left + self.width + 5
        scaled = _Frame(self.left, self.top, self.width, self.height, self.ends, (0.0, most))
        ticks = _ticks((0.0, most), self.height / 60)
        numbers = [_text(right, scaled.y(at) + 4, f"{at:g}", anchor="start") for at in ticks if at]
        return [*numbers, _text(_WIDTH - 2, self.top + self.height + 33, name, anchor="end")]


def _ticks(ends: tuple[float, float], most: float) -> list[float]:
    """Return round numbers between two ends, at most so many."""
    width = ends[1] - ends[0]
    exponent = math.floor(math.log10(width / max(most, 1.0)))
    for part in (1, 2, 5, 10, 20, 50):
        step = part * 10.0**exponent
        if width / step <= most:
            break
    return [round(n * step, 9) for n in range(math.ceil(ends[0] / step - 1e-9), math.floor(ends[1] / step + 1e-9) + 1)]


def _text(x: float, y: float, text: str, *, size: int = 12, anchor: str = "middle") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}"'
    return f'<text {place} fill="currentColor">{escape(with_minus(text))}</text>'


def _svg(parts: Iterable[str], height: float, title: str, *, width: float = _WIDTH) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="100%" role="img" '
        f'fill="none" font-family="system-ui, sans-serif" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )
