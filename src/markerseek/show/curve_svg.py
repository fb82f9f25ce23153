"""Curves as SVG, for the page, notebooks and reports: they need no package, and follow dark and light pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from markerseek.show.curve import ANGLE_TEXT, DENSITY_TEXT, DrawnCurve, Mark
from markerseek.show.svg import BLUE, GREEN, GREY, ORANGE, SKY, WIDTH, Frame, svg_of, svg_text

_HEIGHT = 320.0

_CROWDED = 40
"""Most acquisitions that are drawn as large dots."""


def curve_svg(curve: DrawnCurve) -> str:
    """Return a curve as SVG, with an inset about an answer that is one line in the whole range."""
    top = 1.14 * curve.top
    most_per_deg = curve.most_per_deg
    ends = (curve.low_deg, curve.high_deg)
    frame = Frame(58, 34, WIDTH - (96 if most_per_deg else 70), _HEIGHT - 72, ends, (0.0, top))
    parts = [*frame.axes(ANGLE_TEXT, curve.intensity_text)]
    if most_per_deg:
        parts += frame.right_axis(DENSITY_TEXT, 1.05 * most_per_deg)
    parts += _drawn(curve, frame)
    parts += _numbers(curve, frame)
    parts += _labels(curve, frame)
    if curve.inset_deg is not None:
        parts += _inset(curve, frame, curve.inset_deg)
    return svg_of(parts, _HEIGHT, curve.text)


def _inset(curve: DrawnCurve, frame: Frame, ends: tuple[float, float]) -> list[str]:
    # Beside the answer, where there is more room.
    is_left = frame.x(sum(ends) / 2) > frame.left + frame.width / 2
    place = frame.left + 12 if is_left else frame.left + frame.width - 152
    inset = Frame(place, 44, 140, 92, ends, frame.limits)
    ground = (
        f'<rect x="{place - 6}" y="38" width="152" height="118" rx="4" fill="var(--ms-ground, none)" '
        f'stroke="{GREY}" opacity="0.9"/>'
    )
    drawn = "".join([*inset.axes("", ""), *_drawn(curve, inset)])
    return [ground, f'<g class="ms-inset">{drawn}</g>']


def _drawn(curve: DrawnCurve, frame: Frame) -> list[str]:
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


def _marks_in(curve: DrawnCurve, frame: Frame) -> list[Mark]:
    return [each for each in curve.marks if frame.inside(each.angle_deg) == each.angle_deg]


def _radius(mark: Mark, curve: DrawnCurve) -> float:
    """Return the radius in pixels; in a weighted average the size of a dot is its weight."""
    if mark.role == "confirmation":
        return 6.0
    if mark.weight is not None:
        return 2 + 5 * mark.weight
    return 4.5 if len(curve.marks) <= _CROWDED else 2.5


def _dot(mark: Mark, frame: Frame, *, radius: float) -> str:
    x = frame.x(mark.angle_deg)
    y = frame.y(mark.intensity)
    if mark.role == "confirmation":
        size = f'width="{2 * radius:.1f}" height="{2 * radius:.1f}"'
        return f'<rect x="{x - radius:.1f}" y="{y - radius:.1f}" {size} fill="{BLUE}"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{BLUE}"/>'


def _numbers(curve: DrawnCurve, frame: Frame) -> list[str]:
    """Return the numbers of the acquisitions, the newest first; one that would cover another one is left out."""
    parts: list[str] = []
    taken: list[tuple[float, float]] = []
    for each in reversed(_marks_in(curve, frame)):
        x = frame.x(each.angle_deg)
        y = frame.y(each.intensity)
        if each.text and all(abs(x - u) > 13 or abs(y - v) > 11 for u, v in taken):
            taken.append((x, y))
            parts.append(svg_text(x, y - _radius(each, curve) - 3, each.text, size=11))
    return parts


def _area(curve: DrawnCurve, frame: Frame) -> str:
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


def _recorded(curve: DrawnCurve, frame: Frame) -> str:
    """Return the recording that a search replays, as a line."""
    low, high = frame.ends
    recorded = zip(curve.recorded_deg, curve.recorded, strict=True)
    points = " ".join(f"{frame.x(at):.1f},{frame.y(each):.1f}" for at, each in recorded if low <= at <= high)
    return f'<polyline class="ms-recorded" points="{points}" stroke="{GREY}"/>'


def _labels(curve: DrawnCurve, frame: Frame) -> list[str]:
    """Return the angles above the frame; one that would cover another one is left out."""
    # That which is known otherwise has a row of its own, because it is near to the answer.
    said = [(each, 28) for each in curve.answers]
    said += [(each, 14) for each in (curve.known,) if each is not None]
    said += [(each, 28) for each in curve.others]
    room = 8 + 4 * max((len(each.text) for each, _ in said), default=0)
    parts: list[str] = []
    taken: list[tuple[float, float]] = []
    for each, y in said:
        x = min(max(frame.x(frame.inside(each.angle_deg)), room), WIDTH - room)
        if all(abs(x - u) > 2 * room - 8 or y != v for u, v in taken):
            taken.append((x, y))
            parts.append(svg_text(x, y, each.text, size=13))
    return parts


def errors_svg(errors: Sequence[tuple[int, float, float]], *, goal_mm: float) -> str:
    """Return the expected error of a registration after each marker, with its goal, as SVG.

    ``errors``: number of markers, expected error, and the error below which 95 % are, both in millimetres.
    """
    width = 420.0
    height = 270.0
    last = max([7, *(count for count, _, _ in errors)])
    most = 1.1 * max([2 * goal_mm, *(high for _, _, high in errors)])
    frame = Frame(54, 14, width - 66, height - 58, (2.5, last + 0.5), (0.0, most))
    parts = [*frame.axes("markers", "expected error at the target [mm]"), frame.horizontal(goal_mm)]
    parts.append(svg_text(width - 14, frame.y(goal_mm) - 6, f"goal {goal_mm:g} mm", size=14, anchor="end"))
    line = " ".join(f"{frame.x(count):.1f},{frame.y(mean):.1f}" for count, mean, _ in errors)
    parts.append(f'<polyline points="{line}" stroke="{BLUE}" stroke-width="3"/>')
    for count, mean, high in errors:
        x = frame.x(count)
        y = frame.y(mean)
        top = frame.y(high)
        parts.append(f'<path d="M{x:.1f} {y:.1f}V{top:.1f}m-5 0h10" stroke="{BLUE}" stroke-width="2"/>')
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{BLUE}"/>')
        parts.append(svg_text(x + 9, y - 7, f"{mean:.2f}", size=15, anchor="start"))
    return svg_of(parts, height, "expected error at the target after each marker", width=width)


def as_html(title: str, rows: Iterable[tuple[str, str | None]], picture: str) -> str:
    """Return HTML of a title, names with values (those of None are left out), and a picture, which is SVG already."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
        if value is not None
    )
    return f'<div style="max-width:640px"><strong>{escape(title)}</strong><table>{cells}</table>{picture}</div>'
