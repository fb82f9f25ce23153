"""Draws a clip of ten seconds: the probe follows the tip of an instrument that is gone for a while; follow.gif.

Run by ``make figures``. Everything is simulated, and shown as fast as it is.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from PIL import Image

from markerseek.following import (
    BY_A_PERSON,
    BY_ITSELF,
    FollowedRoom,
    Follower,
    FollowPlan,
    FollowStep,
    HeldRegistration,
    TargetPath,
    probe_reach,
)
from markerseek.registration import SimulatedRoomSettings
from markerseek.sim import STREAMING

HERE = Path(__file__).parent
BEGINS_S = 2.0
"""When the clip begins: the probe is at the target by then."""

LASTS_S = 10.0
FRAME_S = 0.125
GONE_S = (7.5, 9.2)
SEED = 2

PROBE, TARGET, STAYS, QUIET = "#2a88c8", "#d55e00", "#d55e00", "#8a8f98"


@dataclass(frozen=True, slots=True, kw_only=True)
class GoneForAWhile(TargetPath):
    """A target that moves to and fro, and is gone for a while."""

    def way_m(self, at_s: float) -> float | None:
        """Way from the middle; None while it is gone."""
        if GONE_S[0] <= at_s < GONE_S[1]:
            return None
        return self.amplitude_m * math.sin(at_s * self.speed_m_s / self.amplitude_m)


def followed() -> list[tuple[FollowStep, float | None]]:
    """Steps of a run, each with the true angle of the target."""
    room = FollowedRoom(SimulatedRoomSettings(rig=STREAMING), GoneForAWhile(speed_m_s=6e-3), seed=SEED)
    held = HeldRegistration(room.registration(), confirmed=True)
    plan = FollowPlan(speed_deg_s=12.0)
    follower = Follower(room.rig, held, room.tip(), plan=plan, by="a figure", reach=probe_reach(room.rig))
    steps: list[tuple[FollowStep, float | None]] = []
    for step in follower.steps():
        steps.append((step, room.angle_deg(step.at_s)))
        if step.at_s >= BEGINS_S + LASTS_S:
            break
    return steps


def frame(steps: list[tuple[FollowStep, float | None]], radius_m: float) -> Image.Image:
    """One picture, of the last of the steps: from the end of the probe, and the angles until then."""
    step, true_deg = steps[-1]
    stays = step.word in BY_ITSELF or step.word in BY_A_PERSON
    figure, (place, course) = plt.subplots(1, 2, figsize=(7.2, 3.1), width_ratios=(2, 3), dpi=100, layout="constrained")
    colour = STAYS if stays else PROBE
    for off_deg in (-step.within_deg, step.within_deg):
        angle = math.radians(step.probe_deg + off_deg)
        place.plot([0, 75 * math.sin(angle)], [0, 75 * math.cos(angle)], color=colour, linewidth=0.8)
    angle = math.radians(step.probe_deg)
    place.plot([0, 75 * math.sin(angle)], [0, 75 * math.cos(angle)], color=colour, linewidth=2.5)
    place.add_patch(plt.Circle((0, 0), 10, facecolor="white", edgecolor=QUIET, linewidth=1.5))
    arc = np.radians(np.linspace(-30, 30, 60))
    place.plot(1e3 * radius_m * np.sin(arc), 1e3 * radius_m * np.cos(arc), color=QUIET, linewidth=0.8)
    if true_deg is not None:
        at = math.radians(true_deg)
        place.plot(1e3 * radius_m * math.sin(at), 1e3 * radius_m * math.cos(at), "o", color=TARGET, markersize=8)
    place.set(xlim=(-45, 45), ylim=(-14, 80), aspect="equal", xticks=[], yticks=[])
    place.set_title("probe from its end, and the tip", fontsize=9)
    place.axis("off")
    at_s = [each.at_s - BEGINS_S for each, _ in steps]
    course.plot(at_s, [math.nan if deg is None else deg for _, deg in steps], color=TARGET, linewidth=1.2, label="tip")
    course.plot(at_s, [each.probe_deg for each, _ in steps], color=PROBE, linewidth=1.8, label="probe")
    course.set(xlim=(0, LASTS_S), ylim=(-17, 17), xlabel="time [s]", ylabel="angle [deg]")
    course.legend(loc="lower left", fontsize=8, frameon=False)
    said = "stays in the dark" if stays else "follows"
    course.set_title(f"{step.word}: the probe {said}", fontsize=11, color=colour, fontweight="bold")
    course.spines[["top", "right"]].set_visible(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    plt.close(figure)
    return Image.open(buffer).convert("RGB")


def main() -> None:
    """Draw the clip."""
    mpl.use("Agg")
    steps = followed()
    room_m = FollowedRoom(SimulatedRoomSettings(rig=STREAMING), TargetPath(), seed=SEED)
    x, _, z = room_m.true.apply(room_m.target_m(0.0)).tolist()
    radius_m = math.hypot(x, z)
    pictures = []
    for number in range(1, round(LASTS_S / FRAME_S) + 1):
        until_s = BEGINS_S + number * FRAME_S
        pictures.append(frame([each for each in steps if BEGINS_S <= each[0].at_s <= until_s], radius_m))
    palette = pictures[len(pictures) // 2].quantize(48)
    flat = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    flat[0].save(
        HERE / "follow.gif", save_all=True, append_images=flat[1:], duration=round(1e3 * FRAME_S), loop=0, optimize=True
    )


if __name__ == "__main__":
    main()
