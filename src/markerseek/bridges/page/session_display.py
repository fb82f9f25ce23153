"""How the page shows the view of a registration session: verdict, marks over the images, table, chart. No I/O."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from html import escape

import msgspec
import numpy as np

from markerseek.core import ConfigError, Float64, Side, counted
from markerseek.registration import (
    RegistrationReport,
    SessionView,
    SpotCheck,
    StereoSettings,
    TakenMarker,
    WatchedMotion,
    station_names,
    target_pixels,
)
from markerseek.show import DrawnMotion, Verdict, VerdictKind, errors_svg, motion_svg, with_minus

_AT_REST_MM = 0.1
"""Half of the way below which tissue is called at rest: what one image pair shows of it is off by some 0.05 mm."""

_DEPTH_MM = 0.6
"""Standard deviation of depths below which they are taken for noise: one image pair is off by some 0.3 mm."""

_CHI95 = 5.991
"""95 % quantile of chi squared with two degrees of freedom."""


def session_verdict(view: SessionView, *, next_step: str) -> Verdict:
    """Return the state in large letters: the expected error, and what the person has to do now."""
    shown = Verdict(kind="busy", reason="" if view.last is None else view.said)
    report = _report(view)
    if view.errors and report is not None and report.registered:
        error = view.errors[-1]
        high = f"95 %: {1e3 * error.tre95_m:.2f} mm"
        shown = replace(shown, lead="expected error", angle=f"{1e3 * error.tre_m:.2f} mm", sigma=high)
    if view.ended is not None or view.moved:
        return _end_verdict(view, shown, next_step=next_step)
    if view.searched is not None:
        turn = f"marker {view.searched.name} is searched: hold laser, tissue and camera still"
        return replace(shown, word="SEARCHING", turn=turn)
    if view.waiting is None:
        # While the next place is computed.
        return replace(shown, word="COMPUTING", reason="")
    is_new = view.waiting.name == view.next_name
    turn = f"light marker {view.waiting.name} in the circle" if view.waiting.place and is_new else view.waiting.said
    if view.waiting.dark:
        turn += "; the laser is dark: press Spot is set once it is there"
    if view.refused is None:
        return replace(shown, word="LIGHT A SPOT", turn=turn)
    return replace(shown, word="LIGHT A SPOT", kind="unsure", turn=turn, problem=view.refused.reason)


def _end_verdict(view: SessionView, shown: Verdict, *, next_step: str) -> Verdict:
    """Return the verdict at the end, or once a marker has moved."""
    goal = f"the goal of {1e3 * view.goal_m:g} mm is {'' if view.goal_reached else 'not '}reached"
    turn = f"{counted(len(view.markers), 'marker')}; {goal}"
    ended = "" if view.ended is None else view.ended.said
    again = [each.said for each in view.measured_again]
    checks = [each.said for each in view.checks]
    sentences = dict.fromkeys((*again, *checks, ended))
    reason = "; ".join(filter(None, sentences))
    word, kind = _end_word(view)
    return replace(shown, word=word, kind=kind, turn=turn, reason=reason, next_step=next_step)


def _end_word(view: SessionView) -> tuple[str, VerdictKind]:
    """Return word and kind of the verdict at the end: green is a registration that reaches the goal only."""
    if view.registration is None:
        return "NOT REGISTERED", "unsure"
    return ("REGISTERED", "found") if view.goal_reached else ("REGISTERED ABOVE GOAL", "unsure")


def session_marks(view: SessionView, side: Side) -> str:
    """Return what is drawn over the image of a camera, as SVG: target, markers, next place, spot."""
    if view.begun is None:
        return ""
    stereo = calibration_of(view.begun.cameras)
    width, height = (stereo.left if side == "left" else stereo.right).size_px
    parts = []
    markers = _in_view(view)
    places = [_pixel(marker.spot, side) for marker in markers]
    for marker, (x, y) in zip(markers, places, strict=True):
        parts.append(_circle("out" if view.use_of(marker) != "used" else "marker", x, y, width / 80))
        place = f'x="{x + width / 60:.1f}" y="{y - width / 60:.1f}" font-size="{width // 22}"'
        parts.append(f"<text {place}>{marker.name}</text>")
    report = _report(view)
    parts += [_check(each, stereo, side, width) for each in (() if report is None else report.checks)]
    parts.append(_target(report, stereo, side, places))
    if view.waiting is not None and view.waiting.place is not None:
        parts.append(_circle("place", *_pixel(view.waiting.place, side), width / 18))
    if view.searched is not None:
        x, y = _pixel(view.searched.spot, side)
        near = width / 60
        far = width / 22
        arms = "".join(
            f"M{x + near * dx:.1f} {y + near * dy:.1f}L{x + far * dx:.1f} {y + far * dy:.1f}"
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
        )
        parts.append(f'<path class="ms-mark-spot" d="{arms}"/>')
    parts.append(_refusal(view, side, width))
    label = f"marks over the {side} image"
    return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _report(view: SessionView) -> RegistrationReport | None:
    """Return the registration of the markers so far, also before it is certain; None once marker or endoscope moved."""
    return None if view.last is None or view.moved or view.displaced is not None else view.last.report


def _in_view(view: SessionView) -> list[TakenMarker]:
    """Return the markers that were taken where the endoscope stands now; others lie elsewhere in its images."""
    if view.displaced is not None or not view.markers:
        return []
    stations = station_names(view.markers)
    return [each for each in view.markers if stations[each.name] == stations[view.markers[-1].name]]


@lru_cache(maxsize=4)
def calibration_of(text: str) -> StereoSettings:
    """Return a calibration from the text in which a session holds it."""
    return msgspec.json.decode(text, type=StereoSettings)


def _refusal(view: SessionView, side: Side, width: int) -> str:
    """Draw where the images show why the last spot was not accepted, with the reason below the first of the places."""
    places = [] if view.refused is None else getattr(view.refused, f"{side}_px")
    if view.refused is None or not places:
        return ""
    rings = [_circle("refused", x, y, width / 32) for x, y in places]
    # Up to its cure: the whole of it stands in the verdict.
    reason = re.split("[;:] ", view.refused.reason.removeprefix(f"{side} camera: "))[0]
    x, y = places[0]
    at = min(max(x, 0.3 * width), 0.7 * width)
    lines = [
        f'<text class="ms-mark-why" text-anchor="middle" x="{at:.1f}" y="{y + width / 32 + number * width / 28:.1f}" '
        f'font-size="{width // 32}">{escape(line)}</text>'
        for number, line in enumerate(textwrap.wrap(reason, _REASON_LETTERS), start=1)
    ]
    return "".join([*rings, *lines])


_REASON_LETTERS = 28
"""Letters of a line of a reason in the image: half of its width."""


def _check(check: SpotCheck, stereo: StereoSettings, side: Side, width: int) -> str:
    """Draw a spot that checked the registration; empty if the record puts it behind the camera."""
    try:
        x, y = stereo.cameras.project(np.array(check.camera_m)[None])[side == "right"][0].tolist()
    except ConfigError:
        return ""
    half = width / 100
    place = f'x="{x - half:.1f}" y="{y - half:.1f}" width="{2 * half:.1f}" height="{2 * half:.1f}"'
    return f'<rect class="ms-mark-check" {place}><title>{escape(check.name)}</title></rect>'


def _target(
    report: RegistrationReport | None, stereo: StereoSettings, side: Side, markers: Sequence[tuple[float, float]]
) -> str:
    """Draw the target and its 95 % ellipse; empty before a registration, or if the target is behind the camera.

    ``markers``: their places in the image. The label stands on the side that is farthest from them and their names.
    """
    if report is None or report.davinci_to_trus is None:
        return ""
    try:
        pixel, covariance_px2 = target_pixels(report, stereo=stereo)[side == "right"]
    except ConfigError:
        return ""
    squares, axes = np.linalg.eigh(covariance_px2)
    small, large = np.sqrt(_CHI95 * squares)
    turn_deg = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    x, y = pixel
    width = stereo.left.size_px[0]
    # The ellipse of a millimetre is small in the image: from two metres away, its label is easier to find.
    letters = width // 26
    away = (large + letters, large + 2 * letters)
    places = ((x, y + away[0]), (x, y - away[0]), (x + away[1], y), (x - away[1], y))
    named = [*markers, *((u + width / 40, v - width / 40) for u, v in markers)]
    across, down = max(places, key=lambda place: min((math.dist(place, each) for each in named), default=0.0))
    label = f'x="{across:.1f}" y="{down + letters / 3:.1f}" font-size="{letters}" text-anchor="middle"'
    return (
        f'<g transform="translate({x:.1f} {y:.1f}) rotate({turn_deg:.1f})">'
        f'<ellipse class="ms-mark-target" rx="{large:.1f}" ry="{small:.1f}"/></g>'
        f'<text class="ms-mark-name" {label}>target</text>'
    )


def session_table(view: SessionView) -> str:
    """Return the markers as an HTML table."""
    report = _report(view)
    points = () if report is None else report.points
    residuals = {point.name: f"{1e3 * point.residual_m:.2f}" for point in points}
    chosen = {} if view.last is None else view.last.chosen
    rows = ""
    for marker in view.markers:
        number = chosen.get(marker.name, 0)
        angle = f"{marker.candidates[number].angle_deg:.2f}" if marker.candidates else "–"
        use = view.use_of(marker)
        cells = (marker.name, marker.answer, angle, str(marker.acquisitions), residuals.get(marker.name, "–"), use)
        scene = None if marker.scene is None else marker.scene.said
        tip = escape("; ".join(filter(None, (marker.reason, scene))))
        rows += f'<tr class="ms-use-{use.replace(" ", "-")}" title="{tip}">{_cells("td", cells)}</tr>'
    heads = ("marker", "answer", "angle [°]", "frames", "residual [mm]", "use")
    return f"<table><thead><tr>{_cells('th', heads)}</tr></thead><tbody>{rows}</tbody></table>"


def session_chart(view: SessionView) -> str:
    """Return the expected error after each marker, as SVG."""
    errors = [(each.markers, 1e3 * each.tre_m, 1e3 * each.tre95_m) for each in view.errors]
    return errors_svg(errors, goal_mm=1e3 * view.goal_m)


def session_motion(motion: WatchedMotion) -> tuple[str, str]:
    """Return what the cameras see move during a search: in a sentence, and as SVG over time.

    Displacements are drawn along the breath if it is known, else along the direction in which they differ most.
    """
    tissue_mm = np.array(motion.tissue_mm).reshape(-1, 3)
    spot_mm = np.array(motion.spot_mm).reshape(-1, 3)
    breath = motion.breath
    if breath is not None:
        direction = np.array(breath.direction)
        rest_mm = np.array(breath.rest_mm)
    else:
        direction = _main_direction(tissue_mm)
        rest_mm = np.zeros(3)
    drawn = DrawnMotion(
        tissue=list(zip(motion.tissue_s, ((tissue_mm - rest_mm) @ direction).tolist(), strict=True)),
        spot=list(zip(motion.spot_s, ((spot_mm - rest_mm) @ direction).tolist(), strict=True)),
        pauses=motion.pauses,
        unknown=motion.unknown_s,
    )
    said = _motion_text(motion, tissue_mm, direction)
    return said, motion_svg(drawn, said=said)


def _main_direction(moved_mm: Float64[np.ndarray, "times 3"]) -> Float64[np.ndarray, " 3"]:
    """Return the direction in which displacements differ most, across the view unless depths differ beyond noise."""
    if len(moved_mm) < 3:
        return np.array([1.0, 0.0, 0.0])
    differ_mm = moved_mm - moved_mm.mean(axis=0)
    if differ_mm[:, 2].std() < _DEPTH_MM:
        differ_mm[:, 2] = 0.0
    return np.asarray(np.linalg.svd(differ_mm, full_matrices=False)[2][0])


def _motion_text(
    motion: WatchedMotion, tissue_mm: Float64[np.ndarray, "times 3"], direction: Float64[np.ndarray, " 3"]
) -> str:
    """Return what moves, in a sentence."""
    seen = len(tissue_mm)
    pairs = seen + len(motion.unknown_s)
    if not seen:
        return f"marker {motion.name}: none of {counted(pairs, 'image pair')} shows how the tissue moves"
    along_mm = tissue_mm @ direction
    half_mm = float(along_mm.max() - along_mm.min()) / 2
    x, y, z = direction.tolist()
    breath = motion.breath
    if breath is None and half_mm < _AT_REST_MM:
        said = f"marker {motion.name}: the tissue is at rest, within ± {half_mm:.2f} mm"
    else:
        said = f"marker {motion.name}: the tissue is seen to move by ± {half_mm:.2f} mm"
    if breath is not None and breath.period_s is not None:
        said = f"{said} along ({x:.1f}, {y:.1f}, {z:.1f}) of the left camera, every {breath.period_s:.1f} s"
    return with_minus(said if seen == pairs else f"{said}; {pairs - seen} of {pairs} image pairs do not show it")


def _cells(tag: str, texts: tuple[str, ...]) -> str:
    return "".join(f"<{tag}>{escape(with_minus(text))}</{tag}>" for text in texts)


def _circle(name: str, x: float, y: float, radius: float) -> str:
    return f'<circle class="ms-mark-{name}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.0f}"/>'


def _pixel(seen: object, side: Side) -> tuple[float, float]:
    x, y = getattr(seen, f"{side}_px")
    return x, y
