"""HTML of results and banks for notebooks: their numbers, and their intensities as SVG, which needs no package."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

_WIDTH, _HEIGHT, _LEFT, _BELOW, _ABOVE = 520, 190, 12, 34, 10
"""Size of the picture in pixels, and what its axes leave free."""

_STEPS_DEG = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 45, 90)
_MAX_TICKS = 9

_SIGNAL, _ACCENT = "#1f5fa8", "#c8501e"


def as_html(title: str, rows: Iterable[tuple[str, str | None]], picture: str) -> str:
    """A title, names with values (those of None are left out), and a picture, which is SVG already."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
        if value is not None
    )
    return f"<div><strong>{escape(title)}</strong><table>{cells}</table>{picture}</div>"


def curve_svg(
    angles_deg: Sequence[float],
    intensities: Sequence[float],
    *,
    mark_deg: float,
    interval_deg: tuple[float, float] | None = None,
) -> str:
    """Intensities over angles as dots, with a line at the angle ``mark_deg`` and a band for the interval around it."""
    ends_deg = (*angles_deg, mark_deg)
    low_deg, high_deg = min(ends_deg), max(ends_deg)
    margin_deg = 0.03 * (high_deg - low_deg) or 1.0
    low_deg, high_deg = low_deg - margin_deg, high_deg + margin_deg
    top, bottom = max(*intensities, 0.0) or 1.0, _HEIGHT - _BELOW

    def x(angle_deg: float) -> float:
        inside_deg = min(max(angle_deg, low_deg), high_deg)
        return _LEFT + (inside_deg - low_deg) / (high_deg - low_deg) * (_WIDTH - 2 * _LEFT)

    def y(intensity: float) -> float:
        return bottom - intensity / top * (bottom - _ABOVE)

    parts = []
    if interval_deg is not None:
        left, right = map(x, interval_deg)
        parts.append(
            f'<rect x="{left:.1f}" y="{_ABOVE}" width="{max(right - left, 1):.1f}" height="{bottom - _ABOVE}" '
            f'fill="{_ACCENT}" opacity="0.2"/>'
        )
    parts.append(f'<path d="M{x(mark_deg):.1f} {_ABOVE}V{bottom}" stroke="{_ACCENT}"/>')
    parts.append(f'<path d="M{_LEFT} {bottom}H{_WIDTH - _LEFT}" stroke="currentColor"/>')
    for tick_deg in _ticks(low_deg, high_deg):
        parts.append(f'<path d="M{x(tick_deg):.1f} {bottom}v4" stroke="currentColor"/>')
        parts.append(f'<text x="{x(tick_deg):.1f}" y="{bottom + 15}" text-anchor="middle">{tick_deg:g}</text>')
    parts += [
        f'<circle cx="{x(angle):.1f}" cy="{y(intensity):.1f}" r="2.5" fill="{_SIGNAL}"/>'
        for angle, intensity in zip(angles_deg, intensities, strict=True)
    ]
    label = f"intensity over the probe's angle [deg]; the largest is {top:.4g}"
    parts.append(f'<text x="{_WIDTH / 2:.0f}" y="{_HEIGHT - 4}" text-anchor="middle">{escape(label)}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{_HEIGHT}" fill="none" font-size="11" '
        f'font-family="sans-serif"><g><title>{escape(label)}</title>'
        + "".join(part.replace("<text ", '<text fill="currentColor" ') for part in parts)
        + "</g></svg>"
    )


def _ticks(low_deg: float, high_deg: float) -> list[float]:
    step_deg = next((each for each in _STEPS_DEG if (high_deg - low_deg) / each <= _MAX_TICKS), _STEPS_DEG[-1])
    return [number * step_deg for number in range(math.ceil(low_deg / step_deg), math.floor(high_deg / step_deg) + 1)]
