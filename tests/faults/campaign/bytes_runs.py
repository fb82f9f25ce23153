"""Runs with frames: real drivers on emulated devices, byte by byte, in virtual time; judged by truth and journal."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import (
    ChannelFrame,
    Failed,
    Finished,
    Found,
    Int16,
    MarkerseekError,
    Measured,
    Refused,
    RigFacts,
    SearchPlan,
)
from markerseek.drivers import Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.emulators import DirectPort, EmulatedBench
from markerseek.emulators.bench import BenchClock
from markerseek.emulators.faults import FAULTS
from markerseek.emulators.laserbox import Pulse
from markerseek.guard import Admission, FiringLimits, Guard, State
from markerseek.records.journal import Journal, read_journal
from markerseek.rigs import Rig, image_reader
from markerseek.rigs.bench_devices import DARK_ALARM
from markerseek.runs import configuration_of, plan_on
from markerseek.runs.journalled import journalled
from markerseek.scan import RunLimits, Scanner
from markerseek.search import build
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings

from .checker import OFF_DEG, SETTLED_DEG, Verdict
from .runs import leaves_fault
from .tally import Tally

PULSES = 4
DARK_FRAMES = 2
CAPS = RunLimits(acquisitions=40, duration_s=3600.0)

Break = Callable[[EmulatedBench], object]


@dataclass(frozen=True, kw_only=True)
class ByteFault:
    """A fault of laser box or data acquisition that begins after a number of acquisitions."""

    name: str
    begin: Break
    harm: str = "none"


def _inject(device: str, name: str, amount: float | None = None) -> Break:
    return lambda bench: getattr(bench, device).faults.inject(name, amount)


LASER_AND_DAQ: tuple[ByteFault, ...] = (
    ByteFault(name="laser dead lamp", begin=_inject("laser_box", "dead lamp")),
    ByteFault(name="laser blind photodiode", begin=_inject("laser_box", "blind photodiode")),
    ByteFault(name="laser extra pulses", begin=_inject("laser_box", "extra pulses"), harm="pulses"),
    ByteFault(name="laser silent", begin=_inject("laser_box", "silent")),
    ByteFault(name="laser interlock", begin=lambda bench: bench.laser_box.open_interlock()),
    ByteFault(name="laser stray light", begin=lambda bench: bench.laser_box.stray_light(), harm="pulses"),
    ByteFault(name="laser late light", begin=_inject("laser_box", "late light")),
    ByteFault(name="laser power cycle", begin=lambda bench: bench.laser_box.power_up()),
    ByteFault(name="receiver off", begin=_inject("daq", "off")),
    ByteFault(name="receiver delayed", begin=_inject("daq", "late files")),
    ByteFault(name="receiver part of the files", begin=_inject("daq", "part of the files", 77)),
    ByteFault(name="receiver stuck", begin=_inject("daq", "repeats")),
    ByteFault(name="receiver one behind", begin=_inject("daq", "one behind"), harm="result"),
    ByteFault(name="receiver swapped channels", begin=_inject("daq", "swapped channels")),
    ByteFault(name="receiver garbled headers", begin=_inject("daq", "garbled headers")),
)

UNSEEN_STAGE = {name for name, fault in FAULTS["stage"].items() if not fault.observable}
BEYOND_DEG = {"overshoot": 0.5, "slip": 2.0, "scale": 0.75, "more play": 0.5, "ignores stop": 0.0}
"""How far a fault of the stage may bring the probe beyond its travel, in degrees: its amount, and no more."""


class Watched(list[Pulse]):
    """Pulses of light, and whether the motor turned at each."""

    def __init__(self, moving: Callable[[], bool]) -> None:
        super().__init__()
        self.while_moving = 0
        self._moving = moving

    def append(self, pulse: Pulse) -> None:
        self.while_moving += self._moving()
        super().append(pulse)


class ByteRun:
    """One run over emulated devices."""

    def __init__(self, folder: Path, *, seed: int, number: int) -> None:
        rng = np.random.default_rng([seed, number, 7])
        self.marker_deg = float(rng.uniform(-33, 33))
        settings = SimulatedSettings(
            marker=MarkerSettings(angle_deg=self.marker_deg),
            receiver=ReceiverSettings(readout_s=0.3, samples=2080),
            laser=LaserSettings(pulses=PULSES),
            noise=NoiseSettings(peak_snr_db=float(rng.uniform(32, 45))),
            start_deg=float(rng.uniform(-34, 34)),
        )
        stage_names, others = sorted(FAULTS["stage"]), LASER_AND_DAQ
        pick = int(rng.integers(len(stage_names) + len(others) + 2))
        self.stage_fault = FAULTS["stage"][stage_names[pick]] if pick < len(stage_names) else None
        if self.stage_fault is not None and self.stage_fault.name == "jump on its way":
            jump_deg = float(rng.choice((-1, 1)) * rng.uniform(0.2, 1.0))
            self.stage_fault = replace(self.stage_fault, amount=jump_deg)
        rest = pick - len(stage_names)
        self.byte_fault = others[rest] if 0 <= rest < len(others) else None
        self.after = int(rng.integers(0, 9))
        self.method, self.acquisitions = (("golden-section", 12), ("posterior", 8))[int(rng.integers(2))]
        self.bench = EmulatedBench(settings=settings, rng=rng, folder=folder / "daq")
        self.pulses = Watched(lambda: self.bench.stage.moving)
        self.bench.laser_box.pulses = self.pulses
        self.received: list[tuple[Int16[np.ndarray, "channels samples"], float]] = []
        self._write_down()
        self.clock = BenchClock()
        self.clock.lead(self.bench.stage.advance, self.bench.daq.advance)
        self.settings = settings
        self.folder = folder
        self.number = number

    @property
    def fault_name(self) -> str:
        if self.stage_fault is not None:
            return f"stage {self.stage_fault.name}"
        return "" if self.byte_fault is None else self.byte_fault.name

    def _write_down(self) -> None:
        """Keep the samples that were really received, and the angle, beside the emulated files."""
        daq: Any = self.bench.daq
        average, acquisition = daq._trains.average, daq._acquisition
        averages: list[tuple[Int16[np.ndarray, "channels samples"], int]] = []

        def keeping(part: Any) -> Any:
            averages.append((average(part), part.triggers))
            return averages[-1][0]

        def taking(parts: Any) -> Any:
            averages.clear()
            files = acquisition(parts)
            triggers = sum(count for _, count in averages)
            whole = sum(averaged.astype(np.float64) * count for averaged, count in averages) / triggers
            self.received.append((np.rint(whole).astype(np.int16), parts[-1].world.angle_deg))
            return files

        daq._trains.average, daq._acquisition = keeping, taking

    def rig(self) -> Rig:
        """The real drivers on the emulated devices, armed."""
        bench, clock = self.bench, self.clock
        stage = Kdc101Stage(port=DirectPort(device=bench.stage, clock=clock), clock=clock)
        laser = LaserBox(
            port=DirectPort(device=bench.laser_box, clock=clock), clock=clock, rate_hz=100.0, dark_triggers=PULSES
        )
        receiver = SonixDaqReceiver(
            settings=SonixDaqSettings(folder=str(self.folder / "daq"), timeout_s=3.0, readout_s=0.4),
            clock=clock,
            dark_triggers=PULSES,
        )
        guard = Guard(limits=self.settings.limits, firing=FiringLimits(), admission=Admission(dark_alarm=DARK_ALARM))
        guard.arm(by="the campaign")
        imaging = image_reader(self.settings.probe.array, sampling_hz=self.settings.receiver.sampling_hz)
        scanner = Scanner(
            stage=stage, laser=laser, receiver=receiver, reader=imaging, clock=clock, guard=guard, pulses=PULSES
        )
        return Rig(
            facts=RigFacts(
                kind="simulated",
                description="the campaign over bytes",
                fingerprint="",
                search=self.settings.limits.search,
                truth_deg=self.marker_deg,
            ),
            stage=stage,
            laser=laser,
            receiver=receiver,
            scanner=scanner,
            imaging=imaging,
            dark_frames=DARK_FRAMES,
            closing_dark=True,
        )

    def perform(self) -> tuple[Verdict, int, float]:
        """Search, and judge; the accepted frames are counted as well."""
        verdict = Verdict()
        path = self.folder / f"{self.number}.journal"
        accepted = 0
        guard: Guard | None = None
        if self.stage_fault is not None:
            self.bench.stage.faults.inject(replace(self.stage_fault, from_step=self.after + 1))
        with contextlib.suppress(MarkerseekError):
            rig = self.rig()
            guard = rig.scanner.guard
            policy = build(
                SearchPlan(method=self.method, acquisitions=self.acquisitions, start_deg=self.settings.start_deg),
                limits=rig.limits.search,
            )
            plan = plan_on(
                rig, SearchPlan(method=self.method, acquisitions=self.acquisitions, start_deg=self.settings.start_deg)
            )
            with Journal.create(path, configuration_of(rig, plan)) as journal:
                for event in journalled(policy, rig, journal, limits=CAPS):
                    if isinstance(event, Measured):
                        self._admitted(event, verdict)
                        accepted += 1
                        if self.byte_fault is not None and accepted == self.after + 1:
                            self.byte_fault.begin(self.bench)
        self._judge(verdict, path, guard)
        return verdict, accepted, self.clock.now_s()

    def _admitted(self, event: Measured, verdict: Verdict) -> None:
        """P6: what was accepted is what was received last, at the angle of the probe."""
        if self.byte_fault is not None and self.byte_fault.harm == "result":
            return
        frame = event.sample.frame
        samples, angle_deg = self.received[-1]
        if not isinstance(frame, ChannelFrame) or not np.array_equal(frame.samples, samples):
            verdict.broken.append(("P6", "a frame was accepted that is not what was received last"))
        unseen = self.stage_fault is not None and self.stage_fault.name in UNSEEN_STAGE
        if not unseen and not abs(event.sample.angle_deg - angle_deg) <= SETTLED_DEG:
            verdict.broken.append(("P6", f"accepted at {event.sample.angle_deg:.3f}, received at {angle_deg:.3f} deg"))

    def _judge(self, verdict: Verdict, path: Path, guard: Guard | None) -> None:
        low, high = self.bench.stage.truth_range_deg
        travel = self.settings.limits.travel
        beyond = BEYOND_DEG.get("" if self.stage_fault is None else self.stage_fault.name, 0.0)
        verdict.injected_deg = beyond
        verdict.excess_deg = max(0.0, travel.low_deg - low, high - travel.high_deg - self.settings.stage.backlash_deg)
        if not verdict.excess_deg <= beyond + 1e-3:
            verdict.broken.append(("P1", f"the probe was between {low:.3f} and {high:.3f} deg"))
        permitted = 0 if guard is None else guard.pulses_permitted
        verdict.excess_pulses = max(0, len(self.pulses) - permitted)
        verdict.moving_pulses = self.pulses.while_moving
        harmless = self.byte_fault is None or self.byte_fault.harm != "pulses"
        if (verdict.excess_pulses and harmless) or verdict.moving_pulses or self.bench.laser_box.permitted:
            verdict.broken.append(("P3", (f"{len(self.pulses)} pulses, {permitted} permitted, "
                                         f"{verdict.moving_pulses} while moving")))  # fmt: skip
        if guard is None or not path.exists():
            verdict.outcome, verdict.acted, verdict.reported = "not begun", True, True
            return
        events = [entry.event for entry in read_journal(path).entries]
        last = events[-1] if events else None
        verdict.reported = any(isinstance(event, Refused | Failed) for event in events)
        verdict.acted = verdict.reported
        verdict.outcome = "fault" if guard.state is State.FAULT else "ended" if isinstance(last, Failed) else "finished"
        if leaves_fault(guard):
            verdict.broken.append(("P7", "FAULT was left by something else than a person's reset"))
        if not isinstance(last, Finished | Failed):
            verdict.broken.append(("P8", f"the journal ends with {last!r}"))
        if isinstance(last, Finished) and isinstance(last.estimate, Found):
            verdict.found = True
            verdict.off = not abs(last.estimate.mean_deg - self.marker_deg) <= OFF_DEG


def with_frames(seed: int, first: int, count: int, *, folder: Path) -> Tally:
    """Counts of a chunk of runs with frames."""
    tally = Tally()
    for number in range(first, first + count):
        began_s = time.perf_counter()
        place = folder / f"run-{number}"
        place.mkdir()
        run = ByteRun(place, seed=seed, number=number)
        verdict, accepted, virtual_s = run.perform()
        shutil.rmtree(place)
        tally.count_run(
            verdict,
            number=number,
            faults=(run.fault_name,) if run.fault_name else (),
            accepted=accepted,
            real_s=time.perf_counter() - began_s,
            virtual_s=virtual_s,
        )
    return tally
