"""Runs that follow a target in virtual time while something is injected, and what of P19 they broke, by the truth.

``python -m tests.faults.followed_runs --runs 10000`` prints how many of each cause were injected and named.
"""

# ruff: noqa: T201 - a program, which prints

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from typing import Literal

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import DeviceError, Float64, Interval, RigFacts, Sample
from markerseek.following import (
    BY_A_PERSON,
    BY_ITSELF,
    Follower,
    FollowPlan,
    FollowStep,
    HeldRegistration,
    Look,
    ProbeReach,
    Target,
    Word,
)
from markerseek.geometry import RigidTransform
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from markerseek.registration import EndoscopeNotKnown, KnownRegistration, PointPair, register_pairs
from markerseek.rigs import Rig
from markerseek.scan import Scanner
from markerseek.signals import IntensityReader
from markerseek.sim import (
    CurveWorld,
    GaussianCurve,
    ReceiverSettings,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    StageMotion,
    VirtualClock,
    camera_above,
)

from .campaign.faulty_stage import FaultyStage
from .campaign.tally import upper95
from .campaign.vocabulary import FAULTS, Fault
from .campaign.world import WatchedWorld

RADIUS_M = 60e-3
FACE_M = 10e-3
LIMITS = Limits(search=Interval(low_deg=-30.0, high_deg=30.0), travel=Interval(low_deg=-31.5, high_deg=31.5))
SPEED_DEG_S = 5.0

STOPS_S = 1.0
"""P19: time within which the probe is at rest and dark after a cause is named."""

BACK_S = 0.45
"""Time for which a target must be back, less a reading of the stage."""

SETTLED_DEG = 0.2
"""Backlash, counts, and what two readings may differ by."""

Kind = Literal[
    "nothing",
    "lost",
    "jumped",
    "out of reach",
    "stale",
    "endoscope",
    "tissue",
    "heartbeat",
    "stopped",
    "expired",
    "fault",
]

TIP_KINDS: tuple[Kind, ...] = (
    "nothing", "lost", "jumped", "out of reach", "stale", "endoscope", "heartbeat", "stopped", "expired", "fault",
)  # fmt: skip
SPOT_KINDS: tuple[Kind, ...] = (
    "nothing", "lost", "out of reach", "endoscope", "tissue", "heartbeat", "stopped", "expired", "fault",
)  # fmt: skip

STAGE_FAULTS = (
    "silent", "unplugged", "frozen motor", "NaN readback", "wild readback", "obstacle", "overshoot", "fast",
    "late readings", "readback jump", "jump on its way", "stall", "drop-outs", "runaway",
)  # fmt: skip

NAMED_S: dict[Kind, float] = {
    "lost": 1.0 + 0.2,
    "jumped": 0.2,
    "out of reach": 0.5,
    "stale": 0.2 + 0.2,
    "endoscope": 2 * 0.5 + 0.2,
    "heartbeat": 0.2,
    "stopped": 0.2,
    "expired": 0.2,
}
"""Longest time from a cause to its name, for a source without light; one with light is blind while the probe turns."""

TURN_S = 2.0
"""Longest turn with rest and look."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All that is drawn of a run."""

    seed: int
    lit: bool
    kind: Kind
    begins_s: float
    lasts_s: float
    amplitude_deg: float
    period_s: float
    middle_deg: float
    start_deg: float
    person_comes: bool
    fault: Fault | None

    def holds(self, at_s: float) -> bool:
        """Whether the cause holds at a time."""
        return self.begins_s <= at_s < self.begins_s + self.lasts_s


def draw_plan(seed: int) -> Plan:
    """Draw a run."""
    rng = np.random.default_rng(seed)
    lit = bool(rng.random() < 0.4)
    kinds = SPOT_KINDS if lit else TIP_KINDS
    kind = kinds[int(rng.integers(len(kinds)))]
    fault = None
    if kind == "fault":
        name = STAGE_FAULTS[int(rng.integers(len(STAGE_FAULTS)))]
        of = FAULTS["stage", name]
        low, high = of.amounts
        fault = replace(of, amount=float(rng.uniform(low, high)), from_step=int(rng.integers(1, 4)))
    middle_deg = float(rng.uniform(-15.0, 15.0))
    # A frame so far from the plane says nothing of tissue: that of a spot is injected where the probe is there.
    away_deg = float(rng.uniform(-4.0, 4.0) if lit else rng.uniform(-20.0, 20.0))
    return Plan(
        seed=seed,
        lit=lit,
        kind=kind,
        begins_s=float(rng.uniform(2.0, 5.0)),
        lasts_s=float(rng.uniform(2.8, 4.5)),
        amplitude_deg=float(rng.uniform(0.0, 8.0)),
        period_s=float(rng.uniform(12.0, 30.0)),
        middle_deg=middle_deg,
        start_deg=min(max(middle_deg + away_deg, -29.0), 29.0),
        person_comes=bool(rng.random() < 0.5),
        fault=fault,
    )


class TracingClock(VirtualClock):
    """Writes down where the probe is at each wait."""

    def __init__(self) -> None:
        super().__init__()
        self.stage: SimulatedStage | None = None
        self.trace: list[tuple[float, float]] = []

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s)
        if self.stage is not None:
            self.trace.append((self.now_s(), self.stage.probe_deg(self.now_s())))


@dataclass(kw_only=True)
class Room:
    """Where a run takes place: the devices, the truth, and a target that moves."""

    plan: Plan
    clock: TracingClock
    world: WatchedWorld
    stage: FaultyStage
    rig: Rig
    camera_to_trus: RigidTransform
    heard_s: float = 0.0
    name: str = "a target of a test"
    found: list[float] = field(default_factory=list)
    """When a target was there, in truth."""

    def angle_deg(self, at_s: float) -> float:
        """True angle of the target."""
        plan = self.plan
        if plan.kind == "out of reach" and plan.holds(at_s):
            # Out and back, at 126 mm/s at most.
            gone_s = min(at_s - plan.begins_s, plan.begins_s + plan.lasts_s - at_s)
            return math.copysign(min(38.0, abs(plan.middle_deg) + 120 * gone_s), plan.middle_deg)
        if plan.kind == "jumped" and at_s >= plan.begins_s:
            return plan.middle_deg - math.copysign(28.0, plan.middle_deg)
        still = plan.kind in ("out of reach", "jumped")
        swing = 0.0 if still else math.sin(2 * math.pi * at_s / plan.period_s)
        return plan.middle_deg + plan.amplitude_deg * swing

    def place_m(self, at_s: float) -> Float64[np.ndarray, " 3"]:
        """True place of the target in the camera's frame."""
        angle = math.radians(self.angle_deg(at_s))
        return TRUS_TO_CAMERA.apply(np.array([RADIUS_M * math.sin(angle), 0.0, RADIUS_M * math.cos(angle)]))

    def seen(self) -> Target | None:
        """The target, unless it is lost."""
        now_s = self.clock.now_s()
        if self.plan.kind == "lost" and self.plan.holds(now_s):
            return None
        self.found.append(now_s)
        return Target(at_s=now_s, camera_m=self.place_m(now_s), covariance_m2=np.eye(3) * 1e-8)


class Tip:
    """A tip that a robot reports."""

    name = "a tip"

    def __init__(self, room: Room) -> None:
        self._room = room
        self._heard_s = 0.0

    def _silent(self) -> bool:
        return self._room.plan.kind == "stale" and self._room.plan.holds(self._room.clock.now_s())

    def newest(self) -> Target | None:
        return None if self._silent() else self._room.seen()

    @property
    def heard_s(self) -> float:
        if not self._silent():
            self._heard_s = self._room.clock.now_s()
        return self._heard_s


class Spot:
    """A laser spot, and a frame of the probe from the same pulses."""

    name = "a spot"

    def __init__(self, room: Room) -> None:
        self._room = room

    def look(self, pulses: int) -> Look:
        room = self._room
        sample = room.rig.scanner.look(pulses)
        target = room.seen()
        return Look(target=target, sample=self._heard(sample))

    def _heard(self, sample: Sample) -> Sample:
        """The sample, with the place of the source in its image; the tissue may have moved by 6 mm."""
        room = self._room
        now_s = room.clock.now_s()
        moved_m = 6e-3 if room.plan.kind == "tissue" and now_s >= room.plan.begins_s else 0.0
        turn = math.radians(room.angle_deg(now_s) - sample.angle_deg)
        slant_m = math.sqrt(FACE_M**2 + RADIUS_M**2 - 2 * FACE_M * RADIUS_M * math.cos(turn))
        reading = structs.replace(
            sample.reading, lateral_m=0.0, depth_m=slant_m + moved_m, coherence=0.9, intensity=100.0, noise_sigma=1.0
        )
        return structs.replace(sample, reading=reading)


CAMERA_TO_TRUS = camera_above(np.array([0.0, 0.0, RADIUS_M]), distance_m=0.1, roll_deg=20.0, tilt_deg=30.0)
TRUS_TO_CAMERA = CAMERA_TO_TRUS.inverse()


@cache
def registration(camera_to_trus: RigidTransform) -> KnownRegistration:
    """A registration that is right, with an error of 0.3 mm expected."""
    places_m = np.array([[0.02, 0.015, 0.05], [-0.02, 0.015, 0.055], [0.02, -0.015, 0.06], [-0.02, -0.015, 0.05]])
    pairs = [
        PointPair(
            name=str(number),
            trus_m=place_m,
            camera_m=camera_to_trus.inverse().apply(place_m),
            trus_covariance_m2=np.eye(3) * (0.2e-3) ** 2,
            camera_covariance_m2=np.eye(3) * (0.2e-3) ** 2,
        )
        for number, place_m in enumerate(places_m, start=1)
    ]
    return KnownRegistration.of(register_pairs(pairs), source=None, simulated=True)


def open_room(plan: Plan) -> Room:
    """Devices and truth of a run."""
    settings = SimulatedSettings(
        limits=LIMITS,
        start_deg=plan.start_deg,
        # As fast as a PRM1Z8 can be: one that turns too fast gets there within a turn.
        stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
        receiver=ReceiverSettings(readout_s=0.02, single_pulses=True),
    )
    clock = TracingClock()
    rng = np.random.default_rng([plan.seed, 1])
    world = WatchedWorld(
        CurveWorld(settings, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=0.0, cells=1000, rng=rng), clock
    )
    turned = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=LIMITS.travel)
    world.shaft_at = turned.probe_deg
    faults = () if plan.fault is None else (plan.fault,)
    stage = FaultyStage(turned, world, clock, faults, np.random.default_rng([plan.seed, 2]), turning=lambda: None)
    laser = SimulatedLaser(world=world, clock=clock, probe_deg=turned.probe_deg)
    receiver = SimulatedReceiver(world=world, clock=clock, readout_s=0.02)
    guard = Guard(limits=LIMITS, firing=FiringLimits(), admission=Admission())
    scanner = Scanner(
        stage=stage, laser=laser, receiver=receiver, reader=IntensityReader(), clock=clock, guard=guard, pulses=4
    )
    rig = Rig(
        facts=RigFacts(
            kind="simulated", description="a test", fingerprint="", search=LIMITS.search, face_radius_m=FACE_M
        ),
        stage=stage, laser=laser, receiver=receiver, scanner=scanner, imaging=None,
        dark_frames=0,
    )  # fmt: skip
    clock.stage = turned
    return Room(plan=plan, clock=clock, world=world, stage=stage, rig=rig, camera_to_trus=CAMERA_TO_TRUS)


@dataclass(kw_only=True)
class Run:
    """What happened in a run, and what of P19 it broke."""

    plan: Plan
    steps: list[FollowStep]
    room: Room
    raised: Exception | None
    acted: bool
    went_on_s: float
    """When a person let it go on; infinite if nobody did."""
    broken: list[str] = field(default_factory=list)

    @property
    def words(self) -> set[Word]:
        """Words that were said."""
        return {step.word for step in self.steps}


def perform(seed: int) -> Run:
    """Follow for some seconds, and judge it."""
    plan = draw_plan(seed)
    room = open_room(plan)
    clock = room.clock
    room.rig.scanner.guard.arm(by="a test")
    minutes = plan.begins_s / 60 if plan.kind == "expired" else 10.0

    def endoscope() -> EndoscopeNotKnown | None:
        if plan.kind == "endoscope" and plan.holds(clock.now_s()):
            return EndoscopeNotKnown(after="4", reason="the scene is hidden")
        return None

    follower = Follower(
        room.rig,
        HeldRegistration(registration(room.camera_to_trus), confirmed=True),
        Spot(room) if plan.lit else Tip(room),
        plan=FollowPlan(minutes=minutes, speed_deg_s=SPEED_DEG_S),
        by="a test",
        reach=ProbeReach(angles=LIMITS.search, lateral_m=20e-3, radius_m=(10e-3, 90e-3)),
        endoscope=endoscope,
        alive=lambda: not (plan.kind == "heartbeat" and plan.holds(clock.now_s())),
    )
    run = Run(plan=plan, steps=[], room=room, raised=None, acted=False, went_on_s=math.inf)
    try:
        _follow(follower, run)
    except (DeviceError, OSError) as problem:
        run.raised = problem
    run.acted = bool(room.stage.acted) or run.raised is not None
    clock.wait(0.5)
    clock.wait(1.0)
    _judge(run)
    return run


def _follow(follower: Follower, run: Run) -> None:
    plan = run.plan
    clock = run.room.clock
    stopped = False
    was_acted = False
    steps: Generator[FollowStep, None, None] = follower.steps()
    for step in steps:
        run.steps.append(step)
        now_s = clock.now_s()
        if plan.kind == "stopped" and not stopped and now_s >= plan.begins_s:
            follower.stop("a test")
            stopped = True
        held = step.word in BY_A_PERSON and now_s >= plan.begins_s + plan.lasts_s
        if held and plan.person_comes and run.went_on_s == math.inf and plan.kind != "tissue":
            run.went_on_s = now_s
            follower.go_on("a person")
        if now_s > plan.begins_s + plan.lasts_s + 3.0:
            # What acted during the last turn alone is reported after it.
            if was_acted or not run.room.stage.acted:
                steps.close()
            was_acted = bool(run.room.stage.acted)


def _judge(run: Run) -> None:
    """Say what of P19 the run broke; only the truth of the simulation and the words are used."""
    plan = run.plan
    broken = run.broken
    trace = run.room.clock.trace
    beyond_deg = 0.0 if plan.fault is None or plan.fault.name not in ("overshoot", "runaway") else plan.fault.amount
    lowest_deg = min(angle_deg for _, angle_deg in trace)
    highest_deg = max(angle_deg for _, angle_deg in trace)
    search = LIMITS.search
    if not (
        search.low_deg - SETTLED_DEG <= lowest_deg + beyond_deg
        and highest_deg - beyond_deg <= search.high_deg + SETTLED_DEG
    ):
        broken.append(f"the probe was between {lowest_deg:.2f} and {highest_deg:.2f} deg")
    _judge_turns(run, beyond_deg)
    lit_moving = [light for light in run.room.world.lights if light.moving or light.sweeping]
    if lit_moving:
        broken.append(f"{len(lit_moving)} pulses while it turned")
    if not plan.lit and run.room.world.lights:
        broken.append("light for a target that needs none")
    _judge_stays(run)
    _judge_name(run)


def _judge_turns(run: Run, beyond_deg: float) -> None:
    """No way from rest to rest is longer than 5 deg, nor faster than permitted."""
    trace = run.room.clock.trace
    fast = 4.0 if run.plan.fault is not None and run.plan.fault.name == "fast" else 1.0
    start_deg = trace[0][1]
    for (before_s, before_deg), (now_s, now_deg) in pairwise(trace):
        elapsed_s = now_s - before_s
        moved_deg = abs(now_deg - before_deg)
        if moved_deg > 1.02 * fast * SPEED_DEG_S * elapsed_s + 0.02:
            run.broken.append(f"{moved_deg / elapsed_s:.1f} deg/s at {now_s:.2f} s")
            return
        if moved_deg < 1e-3 and elapsed_s > 0.01:
            start_deg = now_deg
        elif abs(now_deg - start_deg) > 5.0 + beyond_deg + SETTLED_DEG:
            run.broken.append(f"a turn from {start_deg:.2f} to {now_deg:.2f} deg")
            return


def _judge_stays(run: Run) -> None:
    """Nothing moves, and nothing fires, from `STOPS_S` after a cause is named until what ends it."""
    plan = run.plan
    steps = run.steps
    motions_s = _motions_s(run)
    since_s: float | None = None
    for step in steps:
        stays = step.word in BY_A_PERSON or step.word in BY_ITSELF or step.word == "waiting"
        if not stays:
            if since_s is not None and not _may_go_on(run, since_s, step.at_s):
                run.broken.append(f"it went on at {step.at_s:.2f} s by itself ({step.word}) after {since_s:.2f} s")
            since_s = None
            continue
        since_s = step.at_s if since_s is None else since_s
        moved = [at_s for at_s in motions_s if since_s + STOPS_S < at_s <= step.at_s]
        if moved:
            run.broken.append(f"it moved at {moved[0]:.2f} s, {step.word} since {since_s:.2f} s")
            return
    for before, after in pairwise(steps):
        fired = [light.at_s for light in run.room.world.lights if before.at_s < light.at_s <= after.at_s]
        allowed = before.at_s <= run.went_on_s <= after.at_s
        if fired and not allowed and (before.word in BY_A_PERSON or before.word in BY_ITSELF):
            run.broken.append(f"it fired at {fired[0]:.2f} s, {before.word}")
            return
    end_s = steps[-1].at_s
    if run.raised is not None:
        late = [at_s for at_s in motions_s if at_s > end_s + STOPS_S]
        if late and plan.fault is not None and plan.fault.name not in ("unplugged",):
            run.broken.append(f"it moved at {late[0]:.2f} s after the fault at {end_s:.2f} s")
        if run.room.rig.scanner.guard.state is not State.FAULT:
            run.broken.append("a fault was left")


def _motions_s(run: Run) -> list[float]:
    """When the probe was seen to have moved."""
    return [
        now_s
        for (_, before_deg), (now_s, now_deg) in pairwise(run.room.clock.trace)
        if abs(now_deg - before_deg) > 2e-3
    ]


def _may_go_on(run: Run, since_s: float, at_s: float) -> bool:
    """Whether it may turn again: a person said so where one must, and the target was there for half a second."""
    words = {step.word for step in run.steps if since_s <= step.at_s < at_s}
    if words & BY_A_PERSON and not since_s <= run.went_on_s <= at_s:
        return False
    there = [each for each in run.room.found if each <= at_s]
    return bool(there) and there[-1] - max([since_s - 1.0, *(_gaps(there))]) >= BACK_S


def _gaps(times_s: list[float]) -> list[float]:
    """Ends of gaps of more than a second in which the target was not there."""
    return [after for before, after in pairwise(times_s) if after - before > 1.5]


def _judge_name(run: Run) -> None:
    """The cause is said by its name, and in time."""
    plan = run.plan
    others = (run.words & (BY_A_PERSON | BY_ITSELF)) - {plan.kind}
    if others and plan.kind != "fault":
        run.broken.append(f"{plan.kind}: it also said {sorted(others)}")
    if plan.kind == "nothing":
        return
    if plan.kind == "fault":
        if run.acted and "fault" not in run.words:
            run.broken.append(f"{plan.fault.name if plan.fault else ''} was not reported")
        return
    if plan.kind == "tissue":
        if "tissue" not in run.words:
            run.broken.append("tissue that moved was not reported")
        return
    named_s = next((step.at_s for step in run.steps if step.word == plan.kind), math.inf)
    allowed_s = NAMED_S[plan.kind] + (TURN_S if plan.lit else 0.0) + (1.5 if plan.kind == "endoscope" else 0.0)
    if not named_s <= plan.begins_s + allowed_s:
        run.broken.append(f"{plan.kind} at {plan.begins_s:.2f} s was named at {named_s:.2f} s")


class Counts(msgspec.Struct, kw_only=True):
    """Counts over runs."""

    runs: int = 0
    injected: Counter[str] = msgspec.field(default_factory=Counter)
    named: Counter[str] = msgspec.field(default_factory=Counter)
    """``injected``, ``named``: runs by their cause, and those in which it was said by its name."""
    broken: list[str] = msgspec.field(default_factory=list)
    """What of P19 was broken, with the run."""

    def add(self, other: Counts) -> None:
        """Add another's counts."""
        self.runs += other.runs
        self.injected.update(other.injected)
        self.named.update(other.named)
        self.broken.extend(other.broken)

    def lines(self) -> list[str]:
        """Return the table of causes, a line on all runs, and what was broken."""
        table = [f"| {kind} | {count:,} | {self.named[kind]:,} |" for kind, count in sorted(self.injected.items())]
        missed = sum(self.injected.values()) - sum(self.named.values())
        said = (
            f"{self.runs:,} runs that follow, {len(self.broken)} exceptions, upper 95 % limit "
            f"{upper95(len(self.broken), self.runs):.2g}; {missed} causes without their name."
        )
        return [
            "| cause | injected | named |",
            "|---|---|---|",
            *table,
            "",
            said,
            *(["", *(f"- {each}" for each in self.broken)] if self.broken else []),
        ]


def counts(first: int, count: int) -> Counts:
    """Perform so many runs from one on, and count them."""
    made = Counts(runs=count)
    for seed in range(first, first + count):
        run = perform(seed)
        plan = run.plan
        kind = plan.kind if plan.fault is None else f"fault: stage {plan.fault.name}"
        if plan.kind != "fault" or run.acted:
            made.injected[kind] += 1
            made.named[kind] += plan.kind == "nothing" or plan.kind in run.words
        made.broken += [f"run {seed} ({'spot' if plan.lit else 'tip'}, {kind}): {said}" for said in run.broken]
    return made


def main() -> int:
    """Perform runs, and print what was injected, named and broken; 1 if anything was broken."""
    parser = argparse.ArgumentParser(description="runs of following in virtual time")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="end early; the last line says how many were run"
    )
    words = parser.parse_args()
    ends_s = time.monotonic() + 60 * words.minutes
    whole = Counts()
    for first in range(words.first, words.first + words.runs, CHUNK):
        whole.add(counts(first, min(CHUNK, words.first + words.runs - first)))
        if time.monotonic() > ends_s:
            break
    print(*whole.lines(), sep="\n")
    return int(bool(whole.broken))


CHUNK = 25
"""Runs that a worker process counts at once."""


if __name__ == "__main__":
    sys.exit(main())
