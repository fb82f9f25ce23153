"""Charts over time as SVG, for the page: a probe that follows its target, and tissue that moves in a search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from markerseek.show.follow_picture import FollowedMoment
from markerseek.show.svg import BLUE, GREEN, GREY, ORANGE, PINK, SKY, Frame, svg_of, svg_text

_WIDTH = 900.0
_HEIGHT = 215.0
_LOW = 140.0
"""Height of the chart of displacements, which lies under the images."""

LEAST_DEG = 4.0
"""Least height of the chart of angles."""

SIGMAS = 1.96
"""Standard deviations of a band that holds 95 %."""

LEAST_MM = 1.2
"""Least height of the chart of displacements."""

_WORD_PX = 7.0
"""Width of a letter of a word."""


def follow_svg(moments: Sequence[FollowedMoment], *, span_s: float) -> str:
    """Return the angles of target and probe over the last seconds, with their bands, and the words of the states."""
    last_s = max(span_s, moments[-1].at_s if moments else 0.0)
    shown = [each for each in moments if each.at_s >= last_s - span_s]
    seen = [each for each in shown if each.target_deg is not None]
    values = [each.probe_deg for each in shown] + [each.target_deg or 0.0 for each in seen]
    limits = _limits(values, least=LEAST_DEG)
    frame = Frame(58, 30, _WIDTH - 76, _HEIGHT - 74, (last_s - span_s, last_s), limits)
    parts = frame.axes("time [s]", "angle [°]")
    parts.append(_band(frame, shown, lambda each: (each.probe_deg, each.within_deg), BLUE, 0.16))
    parts.append(
        _band(frame, seen, lambda each: (each.target_deg or 0.0, SIGMAS * (each.sigma_deg or 0.0)), ORANGE, 0.22)
    )
    parts.append(_line(frame, [(each.at_s, each.target_deg or 0.0) for each in seen], ORANGE, 2.0))
    parts.append(_line(frame, [(each.at_s, each.probe_deg) for each in shown], BLUE, 3.0))
    free_px = frame.left
    for word, run in groupby(shown, lambda each: each.word):
        these = list(run)
        left = frame.x(these[0].at_s)
        width = max(frame.x(these[-1].at_s) - left, 2.0)
        colour = PINK if these[0].stays else GREEN if word == "there" else GREY
        parts.append(f'<rect x="{left:.1f}" y="16" width="{width:.1f}" height="5" rx="2" fill="{colour}"/>')
        if left >= free_px and width > _WORD_PX * len(word):
            parts.append(svg_text(left, 12, word, size=13, anchor="start"))
            free_px = left + _WORD_PX * len(word) + 6
    return svg_of(parts, _HEIGHT, _follow_text(shown), width=_WIDTH)


def _follow_text(shown: Sequence[FollowedMoment]) -> str:
    """Return the newest moment for those who do not see the chart."""
    if not shown:
        return "angles of target and probe over time: nothing is followed yet"
    last = shown[-1]
    target = "not seen" if last.target_deg is None else f"at {last.target_deg:.1f}°"
    return f"angles over time: the probe is at {last.probe_deg:.1f}°, the target {target}; {last.word}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnMotion:
    """What cameras saw move, as it is drawn: displacements in millimetres along one direction."""

    tissue: Sequence[tuple[float, float]]
    """Times in seconds, and displacements of the tissue."""
    spot: Sequence[tuple[float, float]]
    """The same of the spot."""
    pauses: Sequence[tuple[float, float]]
    """Begins and ends of the pauses of the breath."""
    unknown: Sequence[float] = ()
    """Times of image pairs that do not show it."""


def motion_svg(motion: DrawnMotion, *, said: str) -> str:
    """Return the displacement of tissue and spot over time, with the pauses of the breath.

    ``said``: the same in a sentence, for those who do not see it.
    """
    times_s = [at_s for at_s, _ in (*motion.tissue, *motion.spot)] + list(motion.unknown)
    first_s = min(times_s, default=0.0)
    ends = (0.0, max(max(times_s, default=0.0) - first_s, 10.0))
    limits = _limits([value for _, value in (*motion.tissue, *motion.spot)], least=LEAST_MM)
    frame = Frame(58, 12, _WIDTH - 76, _LOW - 56, ends, limits)
    parts = frame.axes("time [s]", "moved [mm]")
    for begin_s, end_s in motion.pauses:
        left = frame.x(frame.inside(begin_s - first_s))
        right = frame.x(frame.inside(end_s - first_s))
        if right > left:
            parts.append(
                f'<rect class="ms-pause" x="{left:.1f}" y="{frame.top}" width="{right - left:.1f}" '
                f'height="{frame.height}" fill="{GREEN}" opacity="0.16"/>'
            )
    for at_s in motion.unknown:
        parts.append(f'<path d="M{frame.x(at_s - first_s):.1f} {frame.top}v6" stroke="{GREY}"/>')
    parts.append(_line(frame, [(at_s - first_s, value) for at_s, value in motion.tissue], SKY, 2.5))
    parts += [
        f'<circle cx="{frame.x(at_s - first_s):.1f}" cy="{frame.y(value):.1f}" r="3" fill="{ORANGE}"/>'
        for at_s, value in motion.spot
    ]
    return svg_of(parts, _LOW, said, width=_WIDTH)


def _limits(values: Sequence[float], *, least: float) -> tuple[float, float]:
    """Return the ends of an axis that holds values, with some room around them."""
    low = min(values, default=0.0)
    high = max(values, default=0.0)
    room = max(0.1 * (high - low), (least - (high - low)) / 2, 0.0)
    return low - room, high + room


def _line(frame: Frame, points: Sequence[tuple[float, float]], colour: str, width: float) -> str:
    places = " ".join(f"{frame.x(at):.1f},{frame.y(value):.1f}" for at, value in points)
    return f'<polyline points="{places}" stroke="{colour}" stroke-width="{width:g}"/>'


def _band(
    frame: Frame,
    moments: Sequence[FollowedMoment],
    middle: Callable[[FollowedMoment], tuple[float, float]],
    colour: str,
    opacity: float,
) -> str:
    """Return the area within so much of a value, whose ends are cut at the frame."""
    over = []
    under = []
    for each in moments:
        value, half = middle(each)
        x = frame.x(each.at_s)
        over.append(f"{x:.1f},{frame.y(value + half):.1f}")
        under.append(f"{x:.1f},{frame.y(value - half):.1f}")
    return f'<polygon points="{" ".join([*over, *reversed(under)])}" fill="{colour}" opacity="{opacity:g}"/>'
