"""What charts as SVG are made of: a frame with its axes, texts, and the picture around them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

from markerseek.show.words import with_minus

BLUE = "#2a88c8"
SKY = "#56b4e9"
ORANGE = "#d55e00"
GREEN = "#009e73"
GREY = "#8a8f98"
"""Colours that the colour-blind can tell apart, after Okabe and Ito: samples, density, answer, truth, the rest."""

PINK = "#cc79a7"
"""A probe that stays, as one of these colours."""

WIDTH = 460.0
"""Usual width of a picture."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A rectangle of the picture in pixels, with the values at its ends."""

    left: float
    top: float
    width: float
    height: float
    ends: tuple[float, float]
    limits: tuple[float, float]

    def inside(self, value: float) -> float:
        """Return the nearest value between the two ends of the x axis."""
        return min(max(value, self.ends[0]), self.ends[1])

    def x(self, value: float) -> float:
        """Return the pixel of a value of the x axis."""
        return self.left + (value - self.ends[0]) / (self.ends[1] - self.ends[0]) * self.width

    def y(self, value: float) -> float:
        """Return the pixel of a value of the y axis, at most at its ends."""
        share = (value - self.limits[0]) / (self.limits[1] - self.limits[0])
        return self.top + self.height * (1 - min(max(share, 0.0), 1.0))

    def line(self, value: float, colour: str, *, dashes: str = "") -> str:
        """Return an upright line; empty outside of the frame."""
        if self.inside(value) != value:
            return ""
        return (
            f'<path d="M{self.x(value):.1f} {self.top}v{self.height}" stroke="{colour}" stroke-width="2" '
            f'stroke-dasharray="{dashes}"/>'
        )

    def horizontal(self, value: float) -> str:
        """Return a dashed level line."""
        return f'<path d="M{self.left} {self.y(value):.1f}h{self.width}" stroke="{GREY}" stroke-dasharray="5 4"/>'

    def axes(self, x_name: str, y_name: str) -> list[str]:
        """Return both axes with their numbers; without the name of y, the x axis alone."""
        bottom = self.top + self.height
        parts = [f'<path d="M{self.left} {bottom}h{self.width}" stroke="{GREY}"/>']
        for at in ticks(self.ends, self.width / (42 if y_name else 28)):
            parts.append(f'<path d="M{self.x(at):.1f} {bottom}v4" stroke="{GREY}"/>')
            parts.append(svg_text(self.x(at), bottom + 16, f"{at:g}"))
        if not y_name:
            return parts
        for at in ticks(self.limits, self.height / 26):
            parts.append(f'<path d="M{self.left} {self.y(at):.1f}h{self.width}" stroke="{GREY}" opacity="0.25"/>')
            parts.append(svg_text(self.left - 5, self.y(at) + 4, f"{at:g}", anchor="end"))
        parts.append(svg_text(self.left + self.width / 2, bottom + 33, x_name))
        middle = self.top + self.height / 2
        parts.append(f'<g transform="rotate(-90 12 {middle:g})">{svg_text(12, middle, y_name)}</g>')
        return parts

    def right_axis(self, name: str, most: float) -> list[str]:
        """Return the numbers of a second y axis from 0 on."""
        right = self.left + self.width + 5
        scaled = Frame(self.left, self.top, self.width, self.height, self.ends, (0.0, most))
        places = ticks((0.0, most), self.height / 60)
        numbers = [svg_text(right, scaled.y(at) + 4, f"{at:g}", anchor="start") for at in places if at]
        return [*numbers, svg_text(WIDTH - 2, self.top + self.height + 33, name, anchor="end")]


def ticks(ends: tuple[float, float], most: float) -> list[float]:
    """Return round numbers between two ends, at most so many."""
    width = ends[1] - ends[0]
    exponent = math.floor(math.log10(width / max(most, 1.0)))
    for part in (1, 2, 5, 10, 20, 50):
        step = part * 10.0**exponent
        if width / step <= most:
            break
    return [round(n * step, 9) for n in range(math.ceil(ends[0] / step - 1e-9), math.floor(ends[1] / step + 1e-9) + 1)]


def svg_text(x: float, y: float, text: str, *, size: int = 12, anchor: str = "middle") -> str:
    """Return a text."""
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}"'
    return f'<text {place} fill="currentColor">{escape(with_minus(text))}</text>'


def svg_of(parts: Iterable[str], height: float, title: str, *, width: float = WIDTH) -> str:
    """Return the picture of its parts; ``title``: what it shows, for those who do not see it."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="100%" role="img" '
        f'fill="none" font-family="system-ui, sans-serif" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )
