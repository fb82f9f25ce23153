"""Curves as SVG, for the page, notebooks and reports: they need no package, and follow dark and light pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from markerseek.show.words import with_minus

INSET_DEG = 2.0
"""Half of the range of the inset about the answer, in degrees."""

BLUE, SKY, ORANGE, GREEN, GREY = "#2a88c8", "#56b4e9", "#d55e00", "#009e73", "#8a8f98"
"""Colours that the colour-blind can tell apart, after Okabe and Ito: samples, density, answer, truth, the rest."""

_WIDTH, _HEIGHT = 460.0, 320.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One acquisition of a curve.

    Attributes
    ----------
    angle_deg
        Angle of the probe, in degrees.
    intensity
        Intensity, in the unit of the curve.
    text
        Number of the acquisition; empty for none.
    radius
        Radius of the dot in pixels.
    square
        Whether the mark is a square: a confirmation.
    """

    angle_deg: float
    intensity: float
    text: str = ""
    radius: float = 4.0
    square: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnCurve:
    """What is known of the intensity over the angle.

    Attributes
    ----------
    marks
        The acquisitions.
    range_deg
        Both ends of the range that is drawn, in degrees; None for that of the marks and the answer.
    unit
        Unit of the intensities.
    density
        Angles in degrees, and the probability density of the marker there per degree; empty for none.
    answer_deg
        Angle of the answer, in degrees; None for none.
    others_deg
        Angles of what else may be the marker, in degrees.
    interval_deg, bracket_deg
        Both ends of the 95 % interval, and of a bracket, in degrees; None for none.
    known
        Name and angle in degrees of the angle that is known otherwise; None for none.
    threshold
        Detection threshold, in the unit of the intensities; None for none.
    """

    marks: Sequence[Mark]
    range_deg: tuple[float, float] | None = None
    unit: str = ""
    density: tuple[Sequence[float], Sequence[float]] = ((), ())
    answer_deg: float | None = None
    others_deg: Sequence[float] = ()
    interval_deg: tuple[float, float] | None = None
    bracket_deg: tuple[float, float] | None = None
    known: tuple[str, float] | None = None
    threshold: float | None = None

    def svg(self) -> str:
        """The curve, with an inset about the answer if the answer is one line in the whole range."""
        top = 1.14 * max([each.intensity for each in self.marks] + [self.threshold or 0.0, 0.0]) or 1.0
        most = max(self.density[1], default=0.0)
        range_deg = self.range_deg or self._own_range_deg()
        frame = _Frame(58, 34, _WIDTH - (96 if most else 70), _HEIGHT - 72, range_deg, (0.0, top))
        parts = [*frame.axes("probe angle [deg]", f"intensity [{self.unit}]" if self.unit else "intensity")]
        if most:
            parts += frame.right_axis("probability [1/deg]", 1.05 * most)
        parts += self._drawn(frame, most, numbered=True)
        parts += self._labels(frame)
        low_deg, high_deg = self.interval_deg or (0.0, math.inf)
        if self.answer_deg is not None and high_deg - low_deg < 0.06 * (range_deg[1] - range_deg[0]):
            middle_deg = self.answer_deg
            # Beside the answer, where there is more room.
            left = frame.x(middle_deg) > frame.left + frame.width / 2
            place = frame.left + 12 if left else frame.left + frame.width - 152
            ends_deg = (middle_deg - INSET_DEG, middle_deg + INSET_DEG)
            inset = _Frame(place, 44, 140, 92, ends_deg, (0.0, top))
            parts.append(
                f'<rect x="{place - 6}" y="38" width="152" height="118" rx="4" fill="var(--ms-ground, none)" '
                f'stroke="{GREY}" opacity="0.9"/>'
            )
            drawn = "".join([*inset.axes("", ""), *self._drawn(inset, most, numbered=False)])
            parts.append(f'<g class="ms-inset">{drawn}</g>')
        return _svg(parts, _HEIGHT, f"intensity over the angle of the probe, measured {len(self.marks)} times")

    def _own_range_deg(self) -> tuple[float, float]:
        angles_deg = [*(each.angle_deg for each in self.marks), *([] if self.answer_deg is None else [self.answer_deg])]
        low_deg, high_deg = min(angles_deg), max(angles_deg)
        margin_deg = 0.03 * (high_deg - low_deg) or 1.0
        return low_deg - margin_deg, high_deg + margin_deg

    def _drawn(self, frame: _Frame, most: float, *, numbered: bool) -> list[str]:
        parts = []
        for ends, colour, opacity in ((self.bracket_deg, GREY, 0.18), (self.interval_deg, ORANGE, 0.25)):
            if ends is not None:
                left, right = (frame.x(frame.inside(each)) for each in ends)
                parts.append(
                    f'<rect x="{left:.1f}" y="{frame.top}" width="{max(right - left, 1):.1f}" '
                    f'height="{frame.height}" fill="{colour}" opacity="{opacity}"/>'
                )
        if most:
            parts.append(self._area(frame, most))
        if self.threshold is not None:
            parts.append(frame.horizontal(self.threshold))
        parts += [frame.line(each, GREY, dashes="5 4") for each in self.others_deg]
        if self.answer_deg is not None:
            parts.append(frame.line(self.answer_deg, ORANGE))
        if self.known is not None:
            parts.append(frame.line(self.known[1], GREEN, dashes="2 4"))
        shown = [each for each in self.marks if frame.inside(each.angle_deg) == each.angle_deg]
        for each in shown:
            x, y = frame.x(each.angle_deg), frame.y(each.intensity)
            r = each.radius
            parts.append(
                f'<rect x="{x - r:.1f}" y="{y - r:.1f}" width="{2 * r:.1f}" height="{2 * r:.1f}" fill="{BLUE}"/>'
                if each.square
                else f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}" fill="{BLUE}"/>'
            )
        # A number that would cover another one is left out; the newest comes first.
        taken: list[tuple[float, float]] = []
        for each in reversed([each for each in shown if numbered and each.text]):
            x, y = frame.x(each.angle_deg), frame.y(each.intensity)
            if all(abs(x - u) > 13 or abs(y - w) > 11 for u, w in taken):
                taken.append((x, y))
                parts.append(_text(x, y - each.radius - 3, each.text, size=11))
        return parts

    def _area(self, frame: _Frame, most: float) -> str:
        scale = frame.limits[1] / (1.05 * most)
        ends = frame.ends
        inside = [(at, each) for at, each in zip(*self.density, strict=True) if ends[0] <= at <= ends[1]]
        if not inside:
            return ""
        line = "L".join(f"{frame.x(at):.1f} {frame.y(each * scale):.1f}" for at, each in inside)
        first, last = frame.x(inside[0][0]), frame.x(inside[-1][0])
        bottom = frame.top + frame.height
        return (
            f'<path class="ms-density" d="M{first:.1f} {bottom}L{line}L{last:.1f} {bottom}Z" fill="{SKY}" '
            f'fill-opacity="0.35" stroke="{BLUE}"/>'
        )

    def _labels(self, frame: _Frame) -> list[str]:
        """Angles above the frame; each kind has a row of its own, because they are near to one another."""
        said = [(each, f"{each:.2f}°?", 28) for each in self.others_deg]
        if self.answer_deg is not None:
            said.append((self.answer_deg, f"{self.answer_deg:.2f}°", 28))
        if self.known is not None:
            said.append((self.known[1], f"{self.known[0]} {self.known[1]:.2f}°", 14))
        room = 8 + 4 * max((len(text) for _, text, _ in said), default=0)
        return [
            _text(min(max(frame.x(frame.inside(at)), room), _WIDTH - room), y, text, size=13) for at, text, y in said
        ]


def errors_svg(errors: Sequence[tuple[int, float, float]], *, goal_mm: float) -> str:
    """The expected error of a registration after each marker, with its goal.

    ``errors``: number of markers, expected error, and the error below which 95 % are, both in millimetres.
    """
    width, height = 420.0, 270.0
    last = max([7, *(count for count, _, _ in errors)])
    most = 1.1 * max([2 * goal_mm, *(high for _, _, high in errors)])
    frame = _Frame(54, 14, width - 66, height - 58, (2.5, last + 0.5), (0.0, most))
    parts = [*frame.axes("markers", "expected error at the target [mm]"), frame.horizontal(goal_mm)]
    parts.append(_text(width - 14, frame.y(goal_mm) - 6, f"goal {goal_mm:g} mm", size=14, anchor="end"))
    line = " ".join(f"{frame.x(count):.1f},{frame.y(mean):.1f}" for count, mean, _ in errors)
    parts.append(f'<polyline points="{line}" stroke="{BLUE}" stroke-width="3"/>')
    for count, mean, high in errors:
        x, y, top = frame.x(count), frame.y(mean), frame.y(high)
        parts.append(f'<path d="M{x:.1f} {y:.1f}V{top:.1f}m-5 0h10" stroke="{BLUE}" stroke-width="2"/>')
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{BLUE}"/>')
        parts.append(_text(x + 9, y - 7, f"{mean:.2f}", size=15, anchor="start"))
    return _svg(parts, height, "expected error at the target after each marker", width=width)


def as_html(title: str, rows: Iterable[tuple[str, str | None]], picture: str) -> str:
    """A title, names with values (those of None are left out), and a picture, which is SVG already."""
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
    """Round numbers between two ends, at most so many."""
    width = ends[1] - ends[0]
    exponent = math.floor(math.log10(width / max(most, 1.0)))
    step = next(each for n in (0, 1) for part in (1, 2, 5) if width / (each := part * 10.0 ** (exponent + n)) <= most)
    return [round(n * step, 9) for n in range(math.ceil(ends[0] / step - 1e-9), math.floor(ends[1] / step + 1e-9) + 1)]


def _text(x: float, y: float, text: str, *, size: int = 12, anchor: str = "middle") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}"'
    return f'<text {place} fill="currentColor">{escape(with_minus(text))}</text>'


def _svg(parts: Iterable[str], height: float, title: str, *, width: float = _WIDTH) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="100%" role="img" '
        f'fill="none" font-family="system-ui, sans-serif" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )
