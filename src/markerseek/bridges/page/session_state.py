"""State of a registration session after its steps, and how the page shows it: verdict, marks, table. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from typing import Literal, TypeAlias

import msgspec
import numpy as np

from markerseek.core import ConfigError, counted
from markerseek.records import errors_svg, with_minus
from markerseek.registration import (
    Begun,
    Ended,
    MovedMarker,
    RecordedStep,
    Registered,
    RegistrationReport,
    SpotRefused,
    SpotSeen,
    StereoSettings,
    TakenMarker,
    Waiting,
    target_pixels,
)
from markerseek.runs import Verdict, VerdictKind

Side: TypeAlias = Literal["left", "right"]

_CHI95 = 5.991
"""95 % quantile of chi squared with two degrees of freedom."""


# eq=False: states are compared often, and two states are equal only if they are the same object.
@dataclass(frozen=True, kw_only=True, eq=False)
class SessionState:
    """A session after its steps so far."""

    begun: Begun | None = None
    waiting: Waiting | None = None
    """What the person has to do now; None while a marker is searched, and at the end."""
    refused: str = ""
    """Why the last spot was not accepted; empty after an accepted spot."""
    seen: SpotSeen | None = None
    """The spot whose marker is searched."""
    taken: tuple[TakenMarker, ...] = ()
    last: Registered | None = None
    """The registration from all markers so far; None before the first marker."""
    errors_mm: tuple[tuple[int, float, float], ...] = ()
    """Number of markers, expected TRE and its 95 % limit, for each registration so far."""
    moved: str = ""
    """How far the first marker has moved when it was measured again, in words."""
    ended: Ended | None = None

    @property
    def goal_mm(self) -> float:
        """Expected TRE at which the session ends."""
        return 0.5 if self.begun is None else 1e3 * self.begun.goal_m

    @property
    def registered(self) -> bool:
        """Whether there is a valid registration."""
        return self.last is not None and self.last.decided and (self.ended is None or self.ended.registered)

    @property
    def report(self) -> RegistrationReport | None:
        """The registration from the markers so far; None if there are too few markers."""
        return None if self.last is None else self.last.report

    def add(self, step: RecordedStep) -> SessionState:
        """The state after one more step."""
        match step:
            case Begun():
                return replace(self, begun=step)
            case Waiting():
                return replace(self, waiting=step, seen=None)
            case SpotRefused():
                return replace(self, refused=step.reason, seen=None)
            case SpotSeen():
                return replace(self, seen=step, waiting=None, refused="")
            case TakenMarker():
                return replace(self, seen=None, taken=self.taken if step.again else (*self.taken, step))
            case Registered():
                report, errors_mm = step.report, self.errors_mm
                if report is not None and report.registered:
                    errors_mm += ((len(report.points), 1e3 * report.tre_m, 1e3 * report.tre95_m),)
                return replace(self, last=step, errors_mm=errors_mm)
            case MovedMarker():
                return replace(self, moved=step.said)
            case Ended():
                return replace(self, ended=step, waiting=None, seen=None)

    def verdict(self, *, next_step: str) -> Verdict:
        """The state in large letters: the expected error, and what the person has to do now."""
        shown = Verdict(kind="busy", reason="" if self.last is None else self.last.said)
        if self.errors_mm and self.report is not None and self.report.registered:
            _, mean_mm, high_mm = self.errors_mm[-1]
            shown = replace(shown, lead="expected error", angle=f"{mean_mm:.2f} mm", sigma=f"95 %: {high_mm:.2f} mm")
        if self.ended is not None:
            is_below = bool(self.errors_mm) and self.errors_mm[-1][1] <= self.goal_mm
            goal = f"the goal of {self.goal_mm:g} mm is {'' if is_below else 'not '}reached"
            turn = f"{counted(len(self.taken), 'marker')}; {goal}"
            reason = "; ".join(filter(None, (self.moved, self.ended.said)))
            shown = replace(shown, turn=turn, reason=reason, next_step=next_step)
            if self.registered:
                return replace(shown, word="REGISTERED", kind="found")
            return replace(shown, word="NOT REGISTERED", kind="unsure")
        if self.seen is not None:
            turn = f"marker {self.seen.name} is searched: hold laser, tissue and camera still"
            return replace(shown, word="SEARCHING", turn=turn)
        if self.waiting is None:
            # While the next place is computed.
            return replace(shown, word="COMPUTING", reason="")
        is_new = all(self.waiting.name != marker.name for marker in self.taken)
        turn = f"light marker {self.waiting.name} in the circle" if self.waiting.place and is_new else self.waiting.said
        kind: VerdictKind = "unsure" if self.refused else "busy"
        return replace(shown, word="LIGHT A SPOT", kind=kind, turn=turn, problem=self.refused)

    @cached_property
    def stereo(self) -> StereoSettings | None:
        """Calibration of the cameras."""
        return None if self.begun is None else msgspec.json.decode(self.begun.cameras, type=StereoSettings)

    def marks(self, side: Side) -> str:
        """What is drawn over the image of a camera, as SVG: target, markers, next place, spot."""
        if self.stereo is None:
            return ""
        width, height = (self.stereo.left if side == "left" else self.stereo.right).size_px
        parts = []
        for marker in self.taken:
            x, y = _pixel(marker.spot, side)
            parts.append(_circle("out" if self.use_of(marker) != "used" else "marker", x, y, width / 80))
            place = f'x="{x + width / 60:.1f}" y="{y - width / 60:.1f}" font-size="{width // 22}"'
            parts.append(f"<text {place}>{marker.name}</text>")
        parts.append(self._target(side))
        if self.waiting is not None and self.waiting.place is not None:
            parts.append(_circle("place", *_pixel(self.waiting.place, side), width / 18))
        if self.seen is not None:
            x, y = _pixel(self.seen.spot, side)
            near, far = width / 60, width / 22
            arms = "".join(
                f"M{x + near * dx:.1f} {y + near * dy:.1f}L{x + far * dx:.1f} {y + far * dy:.1f}"
                for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
            )
            parts.append(f'<path class="ms-mark-spot" d="{arms}"/>')
        label = f"marks over the {side} image"
        return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'

    def _target(self, side: Side) -> str:
        """The target and its 95 % ellipse; empty before a registration, or if the target is behind the camera."""
        if self.report is None or self.report.davinci_to_trus is None or self.stereo is None:
            return ""
        try:
            pixel, covariance_px2 = target_pixels(self.report, stereo=self.stereo)[side == "right"]
        except ConfigError:
            return ""
        squares, axes = np.linalg.eigh(covariance_px2)
        small, large = np.sqrt(_CHI95 * squares)
        turn_deg = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
        x, y = pixel
        width = self.stereo.left.size_px[0]
        # The ellipse of a millimetre is small in the image: from two metres away, its label is easier to find.
        label = f'x="{x:.1f}" y="{y + large + width / 20:.1f}" font-size="{width // 26}" text-anchor="middle"'
        return (
            f'<g transform="translate({x:.1f} {y:.1f}) rotate({turn_deg:.1f})">'
            f'<ellipse class="ms-mark-target" rx="{large:.1f}" ry="{small:.1f}"/></g>'
            f'<text class="ms-mark-name" {label}>target</text>'
        )

    def use_of(self, marker: TakenMarker) -> str:
        """How the registration uses a marker."""
        if not marker.candidates:
            return "not found"
        if self.last is not None and marker.name in self.last.left_out:
            return "left out"
        return "open" if self.last is not None and marker.name in self.last.open else "used"

    def table(self) -> str:
        """The markers as an HTML table."""
        points = () if self.report is None else self.report.points
        residuals = {point.name: f"{1e3 * point.residual_m:.2f}" for point in points}
        chosen = {} if self.last is None else self.last.chosen
        rows = ""
        for marker in self.taken:
            number = chosen.get(marker.name, 0)
            angle = f"{marker.candidates[number].angle_deg:.2f}" if marker.candidates else "–"
            use = self.use_of(marker)
            cells = (marker.name, marker.answer, angle, str(marker.acquisitions), residuals.get(marker.name, "–"), use)
            tip = escape(marker.reason or "")
            rows += f'<tr class="ms-use-{use.replace(" ", "-")}" title="{tip}">{_cells("td", cells)}</tr>'
        heads = ("marker", "answer", "angle [°]", "frames", "residual [mm]", "use")
        return f"<table><thead><tr>{_cells('th', heads)}</tr></thead><tbody>{rows}</tbody></table>"

    def chart(self) -> str:
        """The expected error after each marker, as SVG."""
        return errors_svg(self.errors_mm, goal_mm=self.goal_mm)


def _cells(tag: str, texts: tuple[str, ...]) -> str:
    return "".join(f"<{tag}>{escape(with_minus(text))}</{tag}>" for text in texts)


def _circle(name: str, x: float, y: float, radius: float) -> str:
    return f'<circle class="ms-mark-{name}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.0f}"/>'


def _pixel(seen: object, side: Side) -> tuple[float, float]:
    x, y = getattr(seen, f"{side}_px")
    return x, y
