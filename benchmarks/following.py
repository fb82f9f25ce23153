"""How well the probe follows, by the truth of the simulation: ``python -m benchmarks.following [--confirmations 100]``.

Targets are tips whose place is known to 0.2 mm along each axis; registrations are off by 0.5 mm, drawn anew for each
seed. The stage is a PRM1Z8 at its limits (25 deg/s, 25 deg/s²), or one that speeds up four times as fast.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from msgspec import structs

from markerseek.core import AcquisitionError
from markerseek.following import (
    BY_A_PERSON,
    FollowedRoom,
    Follower,
    FollowPlan,
    FollowStep,
    HeldRegistration,
    Look,
    Target,
    TargetPath,
    probe_reach,
)
from markerseek.registration import SimulatedRoomSettings
from markerseek.sim import STREAMING, TissueMotion

SEEDS = 10
SECONDS = 40.0
STEP_AT_S = 8.0
"""When the second step of a target begins: by then the first is over."""


def room(path: TargetPath, seed: int, *, acceleration_deg_s2: float = 25.0, breathing_mm: float = 0.0) -> FollowedRoom:
    """Return a simulated room."""
    rig = structs.replace(
        STREAMING,
        stage=structs.replace(STREAMING.stage, acceleration_deg_s2=acceleration_deg_s2),
        motion=TissueMotion(breathing_mm=breathing_mm),
    )
    return FollowedRoom(SimulatedRoomSettings(rig=rig), path, seed=seed)


def follow(made: FollowedRoom, plan: FollowPlan, *, seconds: float = SECONDS) -> list[tuple[FollowStep, float]]:
    """Follow a tip, and return each step with its true distance from the image plane."""
    held = HeldRegistration(made.registration(), confirmed=True)
    follower = Follower(made.rig, held, made.tip(), plan=plan, by="a benchmark", reach=probe_reach(made.rig))
    steps: list[tuple[FollowStep, float]] = []
    for step in follower.steps():
        true_deg = made.angle_deg(step.at_s)
        assert true_deg is not None
        steps.append((step, step.probe_deg - true_deg))
        if step.at_s >= seconds:
            break
    return steps


def step_time_s(acceleration_deg_s2: float) -> Iterator[tuple[float, float]]:
    """Times from a step of 10 mm until the probe rests, and how far it then is from the target."""
    for seed in range(SEEDS):
        made = room(TargetPath(motion="steps"), seed, acceleration_deg_s2=acceleration_deg_s2)
        steps = follow(made, FollowPlan(speed_deg_s=25.0), seconds=STEP_AT_S - 0.1)
        after = [(step, off) for step, off in steps if step.at_s > STEP_AT_S / 2 + 0.1]
        first, off_deg = next((step, off) for step, off in after if step.word == "there")
        yield first.at_s - STEP_AT_S / 2, abs(off_deg)


def moving(speed_mm_s: float, limit_deg_s: float, acceleration_deg_s2: float) -> tuple[float, float]:
    """Share of the time inside the range, and mean distance, of a target that moves to and fro."""
    offs = []
    for seed in range(SEEDS):
        path = TargetPath(motion="sine", speed_m_s=speed_mm_s / 1e3)
        steps = follow(room(path, seed, acceleration_deg_s2=acceleration_deg_s2), FollowPlan(speed_deg_s=limit_deg_s))
        offs += [abs(off) for step, off in steps if step.at_s > 3.0]
    return float(np.mean(np.array(offs) <= FollowPlan().within_deg)), float(np.mean(offs))


def still(breathing_mm: float) -> float:
    """Mean distance from the plane of a target that only the tissue moves, after 20 mm of approach."""
    offs = []
    for seed in range(SEEDS):
        made = room(TargetPath(motion="jump"), seed, breathing_mm=breathing_mm)
        steps = follow(made, FollowPlan())
        offs += [abs(off) for step, off in steps if step.at_s > 15.0]
    return float(np.mean(offs))


class HeardSpot:
    """A spot that the probe hears in simulated frames; the cameras' place of it is drawn, without images."""

    name = "a spot"

    def __init__(self, made: FollowedRoom, rng: np.random.Generator) -> None:
        self._room = made
        self._rng = rng

    def look(self, pulses: int) -> Look:
        """As of `LitSource`."""
        made = self._room
        made.shine()
        at_s = made.rig.scanner.clock.now_s()
        try:
            sample = made.rig.scanner.look(pulses)
        except AcquisitionError:
            sample = None
        place_m = made.target_m(at_s)
        assert place_m is not None
        sigma_m = np.array([0.05e-3, 0.05e-3, 0.3e-3])
        seen_m = place_m + sigma_m * self._rng.standard_normal(3)
        return Look(target=Target(at_s=at_s, camera_m=seen_m, covariance_m2=np.diag(sigma_m**2)), sample=sample)


def confirmed(seed: int, *, beside_m: float) -> bool:
    """Whether a spot confirms a registration; its source is so far beside, in a direction that is drawn."""
    rng = np.random.default_rng((seed, 7))
    direction = rng.standard_normal(3)
    x, y, z = beside_m * direction / np.linalg.norm(direction)
    made = room(TargetPath(motion="still", beside_m=(float(x), float(y), float(z))), seed)
    held = HeldRegistration(made.registration(), confirmed=False)
    plan = FollowPlan(light_while_waiting=True)
    follower = Follower(made.rig, held, HeardSpot(made, rng), plan=plan, by="a benchmark", reach=probe_reach(made.rig))
    for step in follower.steps():
        if held.confirmed or step.word in BY_A_PERSON or step.at_s > 30.0:
            break
    return held.confirmed


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description="how well the probe follows, in simulation")
    parser.add_argument("--confirmations", type=int, default=0, help="spots beside, and half as many right ones")
    words = parser.parse_args()
    for acceleration in (25.0, 100.0):
        times_s, offs_deg = zip(*step_time_s(acceleration), strict=True)
        print(
            f"step of 10 mm, 25 deg/s, {acceleration:g} deg/s²: {np.median(times_s):.2f} s (longest {max(times_s):.2f} "
            f"s), off by {np.mean(offs_deg):.2f} deg then"
        )
    for speed, limit in ((2.0, 5.0), (5.0, 25.0)):
        for acceleration in (25.0, 100.0):
            inside, mean_deg = moving(speed, limit, acceleration)
            print(
                f"{speed:g} mm/s, at most {limit:g} deg/s, {acceleration:g} deg/s²: inside {inside:.1%}, mean "
                f"{mean_deg:.2f} deg"
            )
    print(f"still tissue: mean {still(0.0):.2f} deg; breathing ± 1 mm: mean {still(1.0):.2f} deg")
    if words.confirmations:
        wrong = sum(confirmed(seed, beside_m=3e-3) for seed in range(words.confirmations))
        right = sum(confirmed(seed, beside_m=0.0) for seed in range(words.confirmations // 2))
        print(f"3 mm beside: {wrong} of {words.confirmations} confirmed; right: {right} of {words.confirmations // 2}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
