"""One run of the campaign: drawn from a seed, then searched with real guard, scan, journal and supervisor."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import (
    AnyPolicy,
    Asked,
    Estimate,
    FollowPermit,
    Interval,
    MarkerseekError,
    NotFound,
    Permit,
    RigFacts,
    Sample,
    SearchPlan,
    Sweep,
    SweepPermit,
)
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from markerseek.records.journal import Configuration, Journal, RecordedRun, read_journal
from markerseek.rigs import Rig
from markerseek.rigs.bench_rig import DARK_ALARM
from markerseek.runs import configuration_of
from markerseek.runs.journalled import journalled
from markerseek.scan import RunLimits, Scanner
from markerseek.search import build, build_sweeping
from markerseek.signals import IntensityReader
from markerseek.sim import (
    CurveWorld,
    GaussianCurve,
    IntensityCurve,
    LaserSettings,
    NoiseSettings,
    PowerCurve,
    ReceiverSettings,
    SechCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    VirtualClock,
)

from .faulty import Host, HostKilled
from .faulty_laser import FaultyLaser
from .faulty_receiver import FaultyReceiver
from .faulty_stage import FaultyStage
from .held_lines import HeldLines
from .vocabulary import FAULTS, IN_SWEEPS, DeviceName, Fault, drawn
from .world import WatchedWorld

CELLS = 460_000
CAPS = RunLimits(acquisitions=60, duration_s=3600.0)
LEASE_S = 0.3
"""Lease of the laser box, in seconds."""

AFTER = 10
ALONE = 400
"""Tenths of a second for which a rig is watched after a run, and after the death of its host."""

SWEEPS = "sweeps"
SWEPT_POSTERIOR = "posterior, by sweeps"
"""Methods that ask for sweeps: the first judges nothing, the second answers."""

METHODS = (
    ("weighted-average", (15, 29, 57), 0.34),
    ("golden-section", (16, 28), 0.34),
    ("posterior", (6, 8), 0.17),
    (SWEEPS, (0,), 0.1),
    (SWEPT_POSTERIOR, (0,), 0.02),
    ("endless", (0,), 0.015),
    ("wild", (0,), 0.015),
)
"""Each method, its acquisitions, and its share of the runs."""

FAULTS_IN_A_RUN = (0.08, 0.84, 0.08)
"""Shares of the runs without a fault, with one, and with two."""

FAULTS_IN_AN_ANSWER_BY_SWEEPS = (0.4, 0.55, 0.05)
"""The same where the posterior sweeps: it takes few steps, most faults end it, and its answer is what is tried."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All random parameters of a run."""

    number: int
    seed: int
    limits: Limits
    start_deg: float
    marker_deg: float | None
    curve: IntensityCurve
    peak_snr_db: float
    pulses: int
    readout_s: float
    method: str
    acquisitions: int
    faults: tuple[Fault, ...]
    dies_at: int | None = None
    """Reading of a stage that sweeps at which the host dies; None: it does not."""

    @property
    def sweeps(self) -> bool:
        """Whether its method asks for sweeps."""
        return self.method in (SWEEPS, SWEPT_POSTERIOR)


def draw_plan(seed: int, number: int) -> Plan:
    """The plan of a run."""
    rng = np.random.default_rng([seed, number])
    low, high = (-35.0, 35.0) if rng.random() < 0.7 else (rng.uniform(-35, -10), rng.uniform(10, 35))
    search = Interval(low_deg=float(low), high_deg=float(high))
    limits = Limits(search=search, travel=Interval(low_deg=float(low) - 1.5, high_deg=float(high) + 1.5))
    fwhm_deg = float(np.exp(rng.uniform(np.log(5), np.log(30))))
    curve = (
        GaussianCurve(fwhm_deg=fwhm_deg),
        SechCurve(fwhm_deg=fwhm_deg),
        PowerCurve(fwhm_deg=fwhm_deg, power=float(rng.uniform(1, 3))),
    )[int(rng.integers(3))]
    name, counts, _ = METHODS[int(rng.choice(len(METHODS), p=[share for *_, share in METHODS]))]
    acquisitions = int(rng.choice(counts))
    answers_by_sweeps = name == SWEPT_POSTERIOR
    sweeps = answers_by_sweeps or name == SWEEPS
    steps = 4 if sweeps else 3 + (acquisitions or 20)
    how_many = int(rng.choice(3, p=FAULTS_IN_AN_ANSWER_BY_SWEEPS if answers_by_sweeps else FAULTS_IN_A_RUN))
    share = np.array(
        [(1.0 if each.harm == "none" else 0.3) * (sweeps or each.name not in IN_SWEEPS) for each in FAULTS.values()]
    )
    dies = np.random.default_rng([seed, number, 3])
    chosen = rng.choice(len(FAULTS), size=how_many, replace=False, p=share / share.sum())
    return Plan(
        number=number,
        seed=seed,
        limits=limits,
        start_deg=float(rng.uniform(low, high)),
        marker_deg=None if rng.random() < 0.1 else float(rng.uniform(low, high)),
        curve=curve,
        peak_snr_db=float(rng.uniform(30, 50)),
        pulses=int(rng.integers(4, 33)),
        # A receiver that streams, or one that is read at the end of a sweep.
        readout_s=0.05 if sweeps and rng.random() < 0.6 else float(np.exp(rng.uniform(np.log(0.1), np.log(10)))),
        method=name,
        acquisitions=acquisitions,
        faults=tuple(drawn(rng, list(FAULTS.values())[index], steps=steps) for index in chosen),
        dies_at=int(dies.integers(1, 90)) if name == SWEEPS and dies.random() < 0.3 else None,
    )


@dataclass(frozen=True, kw_only=True)
class Trace:
    """The record of a run for the checker: truth, journal, and the guard after it."""

    plan: Plan
    world: WatchedWorld
    acted: tuple[Fault, ...]
    journal: RecordedRun
    raised: BaseException | None
    guard: Guard
    left_fault: bool
    sent_permits: tuple[tuple[str, int], ...]
    sweeps: tuple[tuple[SweepPermit, float], ...]
    """Permit of each sweep, and when its light was permitted to begin."""
    asked: tuple[tuple[Sweep | None, float], ...]
    """Each step that was asked for, a sweep or None, and when."""
    ended_s: float
    """When the run ended, or its host died."""
    fault_s: float
    """When the guard entered FAULT; infinite if it did not."""
    virtual_s: float
    real_s: float
    left_deg: tuple[float, ...] = ()
    """Where the probe really was, and the stage's shaft, after the death of the host in mid-sweep."""


class Campaign:
    """Runs one plan after another, with one supervisor for all of them."""

    def __init__(self, folder: Path, lines: HeldLines) -> None:
        self._folder = folder
        self._lines = lines

    def perform(self, plan: Plan) -> Trace:
        """Run a plan to its end."""
        began_s = time.perf_counter()
        rig, world, clock, devices = self._rig(plan)
        guard = rig.scanner.guard
        path = self._folder / f"{plan.number}.journal"
        raised: BaseException | None = None
        left_fault = False
        faulty = False
        asked: list[tuple[Sweep | None, float]] = []
        fault_s = _first_fault_s(guard, clock)
        with Journal.create(path, _configuration(rig, plan)) as journal:
            self._lines.begin()
            guard.arm(by="the campaign")
            try:
                policy = _policy(plan, rig)
                for event in journalled(policy, rig, journal, limits=CAPS):
                    if isinstance(event, Asked):
                        asked.append((event.sweep, clock.now_s()))
                    left_fault = left_fault or (faulty and guard.state is not State.FAULT)
                    faulty = faulty or guard.state is State.FAULT
            except (MarkerseekError, OSError, HostKilled) as error:
                raised = error
        virtual_s = clock.now_s()
        killed = isinstance(raised, HostKilled)
        left_deg = _left_alone(world, clock, devices[1], tenths=ALONE if killed else AFTER)
        left_fault = left_fault or (faulty and guard.state is not State.FAULT) or leaves_fault(guard)
        held = read_journal(path)
        path.unlink()
        return Trace(
            plan=plan,
            world=world,
            acted=tuple(fault for device in devices for fault in device.acted),
            journal=held,
            raised=raised,
            guard=guard,
            left_fault=left_fault,
            sent_permits=self._lines.end(),
            sweeps=tuple(devices[1].sweeps),
            asked=tuple(asked),
            ended_s=virtual_s,
            fault_s=min(fault_s, default=math.inf),
            virtual_s=clock.now_s() if killed else virtual_s,
            real_s=time.perf_counter() - began_s,
            left_deg=left_deg if killed else (),
        )

    def _rig(
        self, plan: Plan
    ) -> tuple[Rig, WatchedWorld, VirtualClock, tuple[FaultyStage, FaultyLaser, FaultyReceiver]]:
        settings = SimulatedSettings(
            limits=plan.limits,
            start_deg=plan.start_deg,
            laser=LaserSettings(pulses=plan.pulses),
            noise=NoiseSettings(peak_snr_db=plan.peak_snr_db),
            receiver=ReceiverSettings(single_pulses=plan.sweeps),
        )
        clock = VirtualClock()
        rng = np.random.default_rng([plan.seed, plan.number, 1])
        mischief = rng.spawn(3)
        world = WatchedWorld(
            CurveWorld(
                settings,
                curve=None if plan.marker_deg is None else plan.curve,
                marker_deg=plan.marker_deg or 0.0,
                cells=CELLS,
                rng=rng,
            ),
            clock,
        )
        of = {name: tuple(fault for fault in plan.faults if fault.device == name) for name in _DEVICES}
        turned = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=plan.limits.travel)
        world.shaft_at = turned.probe_deg
        stage = FaultyStage(
            turned,
            world,
            clock,
            of["stage"],
            mischief[0],
            turning=lambda: laser.stage_moves(),  # noqa: PLW0108  it is made below
        )
        laser = FaultyLaser(
            SimulatedLaser(world=world, clock=clock, probe_deg=turned.probe_deg),
            world,
            clock,
            of["laser"],
            mischief[1],
            send=self._lines.send_permit,
            stage_rests=stage.rest,
            readout_s=plan.readout_s,
        )
        receiver = FaultyReceiver(
            SimulatedReceiver(world=world, clock=clock, readout_s=plan.readout_s),
            IntensityReader(),
            clock,
            of["receiver"],
            mischief[2],
            while_reading=laser.due_light,
            readout_s=plan.readout_s,
            sweeps=plan.sweeps,
        )
        guard = Guard(limits=plan.limits, firing=FiringLimits(), admission=Admission(dark_alarm=DARK_ALARM))
        scanner = Scanner(
            stage=stage,
            laser=laser,
            receiver=receiver,
            reader=receiver,
            clock=clock,
            guard=guard,
            pulses=plan.pulses,
            watchdog=self._lines,
        )
        stage.host = Host(dies_at=plan.dies_at)
        laser.host = stage.host
        receiver.host = stage.host
        rig = Rig(
            facts=RigFacts(
                kind="simulated",
                description="the campaign",
                fingerprint="",
                search=guard.limits.search,
                truth_deg=plan.marker_deg,
            ),
            stage=stage,
            laser=laser,
            receiver=receiver,
            scanner=scanner,
            imaging=None,
            dark_frames=0 if plan.sweeps else 3,
            closing_dark=True,
        )
        return rig, world, clock, (stage, laser, receiver)


FOLLOW = FollowPermit(
    angles=Interval(low_deg=-5.0, high_deg=5.0), speed_deg_s=5.0, duration_s=60.0, pulses=4, pulses_per_second=8
)
"""What a program may ask for in vain where the guard is in FAULT."""

_DEVICES: tuple[DeviceName, ...] = ("stage", "laser", "receiver")


def _first_fault_s(guard: Guard, clock: VirtualClock) -> list[float]:
    """When the guard enters FAULT: the times of all calls, none yet."""
    times_s: list[float] = []
    fail = guard.fail

    def noted(reason: str) -> None:
        times_s.append(clock.now_s())
        fail(reason)

    guard.fail = noted  # type: ignore[method-assign]
    return times_s


def _left_alone(world: WatchedWorld, clock: VirtualClock, laser: FaultyLaser, *, tenths: int) -> tuple[float, ...]:
    """Where the probe is while stage and laser go on without a host, every tenth of a second."""
    ends_s = clock.now_s() + LEASE_S
    left_deg: list[float] = []
    for _ in range(tenths):
        clock.wait(0.1)
        left_deg.append(world.true_at(clock.now_s()))
        if clock.now_s() - 0.1 < ends_s <= clock.now_s():
            laser.lapse(ends_s)
    return tuple(left_deg)


def leaves_fault(guard: Guard) -> bool:
    """Whether any verb but a person's reset leaves FAULT, or reset fails to."""
    if guard.state is not State.FAULT:
        return False
    permit = Permit(token="permit-1", angle_deg=0.0, pulses=1, expires_s=math.inf)
    for step in (
        lambda: guard.arm(by="a program"),
        guard.disarm,
        lambda: guard.begin_move(0.0),
        lambda: guard.end_move(0.0),
        lambda: guard.issue(angle_deg=0.0, pulses=1, now_s=0.0),
        lambda: guard.redeem(permit, angle_deg=0.0, now_s=0.0),
        lambda: guard.end_fire(0),
        lambda: guard.begin_following(FOLLOW, by="a program", now_s=0.0),
        lambda: guard.begin_turn(1.0, from_deg=0.0, now_s=0.0),
        guard.end_following,
        lambda: guard.fail("once more"),
        lambda: guard.reset(by=" "),
    ):
        with contextlib.suppress(MarkerseekError):
            step()
        if guard.state is not State.FAULT or not guard.fault:
            return True
    guard.reset(by="a person")
    out = guard.state is State.DISARMED
    guard.fail("a fault again")
    return not out


def _configuration(rig: Rig, plan: Plan) -> Configuration:
    return configuration_of(
        rig,
        SearchPlan(
            method=plan.method,
            acquisitions=plan.acquisitions or None,
            as_published=False,
            start_deg=plan.start_deg,
            dark_frames=rig.dark_frames,
            stay=False,
            closing_dark=rig.closing_dark,
        ),
    )


def _policy(plan: Plan, rig: Rig) -> AnyPolicy:
    limits = rig.limits.search
    if plan.method in ("endless", "wild"):
        return Unruly(plan)
    if plan.method == SWEPT_POSTERIOR:
        devices = rig.scanner.sweeping
        return build_sweeping(
            SearchPlan(
                method="posterior",
                start_deg=plan.start_deg,
                sweep_speed_deg_s=devices.stage.fastest_sweep_deg_s,
                sweep_from_end=devices.in_bursts,
            ),
            limits=limits,
        )
    if plan.method == SWEEPS:
        return Sweeps(plan, fastest_deg_s=rig.scanner.sweeping.stage.fastest_sweep_deg_s)
    return build(
        SearchPlan(method=plan.method, acquisitions=plan.acquisitions, start_deg=plan.start_deg), limits=limits
    )


class Sweeps:
    """A policy that asks for some sweeps and angles, and ends a sweep when it likes."""

    def __init__(self, plan: Plan, *, fastest_deg_s: float) -> None:
        self._rng = np.random.default_rng([plan.seed, plan.number, 2])
        self._limits = plan.limits.search
        self._fastest_deg_s = fastest_deg_s
        self._left = int(self._rng.integers(1, 5))
        self._ended = False
        self._next = self._drawn(plan.start_deg)

    def ask(self) -> float | Sweep | None:
        return self._next if self._left else None

    def tell(self, sample: Sample) -> None:
        if sample.dark:
            return
        if sample.sweep is None:
            self._go_on(sample.angle_deg)
        elif not self._ended:
            self._pulses -= 1
            if self._pulses <= 0:
                self._ended = True
                self._go_on(sample.angle_deg)

    def end_sweep(self) -> None:
        if not self._ended and isinstance(self._next, Sweep):
            self._go_on(self._next.end_deg)
        self._ended = False

    def estimate(self) -> Estimate:
        return NotFound(mean_deg=0.0, reason="it judges nothing")

    def _go_on(self, from_deg: float) -> None:
        self._left -= 1
        self._next = self._drawn(from_deg)

    def _drawn(self, from_deg: float) -> float | Sweep:
        """The next angle, or the next sweep, at least 5 degrees long."""
        rng = self._rng
        low_deg = self._limits.low_deg
        high_deg = self._limits.high_deg
        self._pulses = int(rng.integers(1, 200))
        to_deg = float(rng.uniform(low_deg, high_deg))
        if rng.random() < 0.25 or abs(to_deg - from_deg) < 5.0:
            return to_deg
        speed_deg_s = (1.0 if rng.random() < 0.5 else rng.uniform(0.3, 1.0)) * self._fastest_deg_s
        wait_deg = float(rng.uniform(low_deg, high_deg)) if rng.random() < 0.5 else None
        # Back at least as far as it needs to be lit on its way.
        back_deg = to_deg + rng.uniform(0.1, 1.0) * (from_deg - to_deg)
        turns_back = rng.random() < 0.5
        return Sweep(
            to_deg=to_deg,
            speed_deg_s=speed_deg_s,
            back_deg=float(back_deg) if turns_back else None,
            wait_deg=wait_deg,
        )


class Unruly:
    """A policy that never ends; a wild one asks for angles that are none after a while."""

    def __init__(self, plan: Plan) -> None:
        self._asks = self._angles(plan)
        self._next = next(self._asks)

    def ask(self) -> float:
        return self._next

    def tell(self, sample: Sample) -> None:
        if not sample.dark:
            self._next = next(self._asks)

    def estimate(self) -> Estimate:
        return NotFound(mean_deg=0.0, reason="it never ends")

    @staticmethod
    def _angles(plan: Plan) -> Iterator[float]:
        rng = np.random.default_rng([plan.seed, plan.number, 2])
        low = plan.limits.search.low_deg
        high = plan.limits.search.high_deg
        wild = (math.nan, math.inf, -math.inf, math.nextafter(high, math.inf), low - 0.5, 1e9, -400.0)
        while True:
            if plan.method == "wild" and rng.random() < 0.2:
                yield float(rng.choice(wild))
            yield float(rng.uniform(low, high))
