"""How the page shows a run that follows: verdict, marks over the images, what holds, and the chart. No I/O."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from markerseek.bridges.page.children import SPAN_S, ChildFollowing
from markerseek.bridges.page.session_display import calibration_of
from markerseek.core import ConfigError, Side
from markerseek.following import BY_A_PERSON, BY_ITSELF, FollowStep, Word
from markerseek.registration import SessionView
from markerseek.show import Verdict, VerdictKind, follow_svg, with_minus

AGAIN = "look at rig and patient; Follow goes on, with a new permit"
"""What a person does after the end."""


def follow_verdict(live: ChildFollowing) -> Verdict:
    """Return the state in large letters, with the angles of probe and target."""
    step = live.last
    if step is None:
        return _before_first(live)
    word = "STOPPING" if live.is_stopping else step.word.upper()
    kind = _kind(step.word)
    stays = step.word in BY_ITSELF or step.word in BY_A_PERSON
    said = with_minus(step.said.removeprefix(f"{step.word}: ").replace(" deg", "°"))
    sigma = ""
    if step.target_deg is not None and step.sigma_deg is not None:
        sigma = with_minus(f"target {step.target_deg:.1f}° ± {step.sigma_deg:.1f}°")
    shown = Verdict(
        word=word,
        kind="busy" if live.is_stopping else kind,
        lead="probe",
        angle=with_minus(f"{step.probe_deg:.1f}°"),
        sigma=sigma,
        # Read aloud where the probe stays; a number that changes all the time is not.
        turn=said if stays else "",
        interval="" if stays else said,
        problem=step.refused,
        next_step=_next_step(live, step),
    )
    outcome = live.outcome
    if outcome is None or step.word in BY_A_PERSON:
        return shown
    if outcome.failed:
        return Verdict(word="FAULT", kind="fault", problem=live.message, next_step=AGAIN)
    return Verdict(
        word="STOPPED" if outcome.stopped else "ENDED",
        kind="stopped",
        lead="probe",
        angle=shown.angle,
        sigma=sigma,
        turn=live.message.partition(": ")[2] if outcome.stopped else "the time is over, and the laser is disarmed",
        next_step=AGAIN,
    )


def _before_first(live: ChildFollowing) -> Verdict:
    """Return the verdict before the first step, or where there was none."""
    outcome = live.outcome
    if outcome is None or not outcome.failed:
        verdict = live.verdict(None)
        begins = verdict.word == "STARTING" and not verdict.next_step
        return replace(verdict, turn="the registration is read, the cameras are opened") if begins else verdict
    if outcome.error is not None and outcome.error.kind == "ConfigError":
        return Verdict(word="NOT FOLLOWED", kind="unsure", problem=live.message)
    return Verdict(word="FAULT", kind="fault", problem=live.message, next_step=AGAIN)


def _kind(word: Word) -> VerdictKind:
    if word == "there":
        return "found"
    if word in {"fault", "heartbeat"}:
        return "fault"
    if word == "stopped":
        return "stopped"
    return "unsure" if word in BY_ITSELF or word in BY_A_PERSON else "busy"


def _next_step(live: ChildFollowing, step: FollowStep) -> str:
    """Return what a person can do now."""
    if step.word in BY_A_PERSON:
        return AGAIN
    if live.asks_whether_set:
        return "the laser is dark: press Spot is set once it is there"
    return "goes on by itself, once the target is back for 0.5 s" if step.word in BY_ITSELF else ""


def follow_marks(live: ChildFollowing, view: SessionView, side: Side) -> str:
    """Return what is drawn over the image of a camera, as SVG: the target, with its depth in the left one."""
    if view.begun is None:
        return ""
    stereo = calibration_of(view.begun.cameras)
    width, height = (stereo.left if side == "left" else stereo.right).size_px
    step = live.last
    place: list[float] | None = None
    depth = ""
    if step is not None and step.target_camera_m is not None:
        camera_m = np.array(step.target_camera_m)
        try:
            place = stereo.cameras.project(camera_m[None])[side == "right"][0].tolist()
        except ConfigError:
            # Behind the camera: nothing is drawn.
            place = None
        depth = f"{1e3 * camera_m[2]:.1f} mm deep"
    elif side == "left" and live.request.pixel is not None:
        place = list(live.request.pixel)
    parts = []
    if place is not None:
        x, y = place
        parts = _aim(x, y, depth if side == "left" else "", width)
    label = f"the target over the {side} image" + (f", {depth}" if depth else "")
    return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _aim(x: float, y: float, text: str, width: int) -> list[str]:
    """Return a ring with four arms, and a text below it."""
    near = width / 60
    far = width / 22
    arms = "".join(
        f"M{x + near * dx:.1f} {y + near * dy:.1f}L{x + far * dx:.1f} {y + far * dy:.1f}"
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    ring = f'<circle class="ms-mark-aim" cx="{x:.1f}" cy="{y:.1f}" r="{near:.0f}"/>'
    at = f'x="{min(max(x, 0.14 * width), 0.86 * width):.1f}" y="{y + far + width / 26:.1f}"'
    words = f'<text class="ms-mark-depth" {at} font-size="{width // 26}" text-anchor="middle">{text}</text>'
    return [f'<path class="ms-mark-aim" d="{arms}"/>', ring, words]


def follow_chart(live: ChildFollowing) -> str:
    """Return the angles of the last seconds as SVG."""
    return follow_svg(live.moments, span_s=SPAN_S)


def follow_rows(live: ChildFollowing) -> list[tuple[str, str]]:
    """Return what holds: target, transform, the last comparison with the probe's image, and the permit."""
    plan = live.request.plan
    permit = f"{plan.speed_deg_s:g}°/s, at most 5° at once, {plan.minutes:g} min"
    step = live.last
    if step is None:
        return [("permit", permit)]
    passed_s = live.moments[-1].at_s if live.moments else 0.0
    left_min = max(plan.minutes - passed_s / 60, 0.0)
    rows = [("follows", _followed_text(live, step))]
    if step.target_deg is not None and step.sigma_deg is not None:
        off_deg = abs(step.target_deg - step.probe_deg)
        rows.append(("target", f"{step.target_deg:.2f}° ± {step.sigma_deg:.2f}°, {off_deg:.2f}° from the image plane"))
    rows.append(("sensitive range", f"± {step.within_deg:g}°: outside of it the probe turns"))
    rows.append(("transform", _transform_text(step)))
    if step.not_counted:
        rows.append(("not counted", "; ".join(step.not_counted)))
    rows.append(("probe's image", step.confirmed or "not compared yet" if live.request.pixel is None else "no light"))
    rows.append(("permit", f"{permit}, {left_min:.1f} min left"))
    if live.begun is not None:
        rows.append(("permitted by", live.begun.by))
    return [(name, with_minus(value)) for name, value in rows]


def _followed_text(live: ChildFollowing, step: FollowStep) -> str:
    """Return what is followed, in words; of a place, as it was named last."""
    if live.request.pixel is not None and step.target_camera_m is not None:
        return f"a place of the left image, {1e3 * step.target_camera_m[2]:.1f} mm deep"
    return "" if live.begun is None else live.begun.what


def _transform_text(step: FollowStep) -> str:
    """Return whether the transform of the camera holds, and its error."""
    if step.davinci_to_trus is None or step.tre_m is None:
        return "does not hold: no spot has confirmed it, or something speaks against it"
    return f"holds, expected error {1e3 * step.tre_m:.2f} mm"
