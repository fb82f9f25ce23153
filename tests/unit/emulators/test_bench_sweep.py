"""Sweeps of the real drivers over the emulated bench, byte by byte in virtual time, judged by the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import (
    MAX_AHEAD_DEG,
    AcquisitionError,
    ConfigError,
    DeviceError,
    Event,
    Found,
    Measured,
    Sample,
    SearchPlan,
    Sweep,
    Swept,
    is_finite,
)
from markerseek.drivers import Kdc101Settings, Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.emulators import DirectPort, EmulatedBench
from markerseek.emulators.bench import BenchClock
from markerseek.emulators.sonixdaq import SonixDaqFaults
from markerseek.emulators.stage_faults import STAGE_FAULTS
from markerseek.guard import Admission, FiringLimits, Guard, State
from markerseek.rigs import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build_sweeping
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings, StageMotion
from markerseek.wire import apt

SETTINGS = SimulatedSettings(
    marker=MarkerSettings(angle_deg=-24.0),
    start_deg=-35.0,
    stage=StageMotion(speed_deg_s=20.0, acceleration_deg_s2=25.0),
    receiver=ReceiverSettings(readout_s=0.3, single_pulses=True),
)


class Bench:
    """Real drivers on emulated devices; the laser box's lease is renewed in each wait, as on a bench."""

    def __init__(self, folder: Path, *, frames: str = "triggered") -> None:
        self.emulated = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(3), folder=folder)
        self.clock = clock = BenchClock(tick_s=2e-3)
        self.stage_port = DirectPort(device=self.emulated.stage, clock=clock)
        port = DirectPort(device=self.emulated.laser_box, clock=clock)
        self.stage = self.connect()
        self.laser = LaserBox(port=port, clock=clock)
        clock.lead(lambda _: self.laser.beat(), lambda _: port.read(0, timeout_s=0.0), self.emulated.daq.advance)
        daq = SonixDaqSettings(
            folder=str(folder),
            timeout_s=10.0,
            readout_s=0.5,
            frames=frames,  # type: ignore[arg-type]
        )
        self.guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission())
        self.scanner = Scanner(
            stage=self.stage,
            laser=self.laser,
            receiver=SonixDaqReceiver(settings=daq, clock=clock),
            reader=image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz),
            clock=clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")

    def connect(self) -> Kdc101Stage:
        settings = Kdc101Settings(port="", zero_deg=0.0, speed_deg_s=20.0, acceleration_deg_s2=25.0)
        return Kdc101Stage(port=self.stage_port, clock=self.clock, settings=settings)

    def search(self) -> Iterator[Event]:
        return run(sweeping(self.scanner.sweeping.stage.fastest_sweep_deg_s), self.scanner)

    @property
    def speed_deg_s(self) -> float:
        """The speed that the controller holds."""
        return int.from_bytes(self.emulated.stage.velocity[10:14], "little") / apt.SPEED_WORD

    @property
    def probe_deg(self) -> float:
        self.emulated.stage.turn(self.clock.now_s())
        return self.emulated.world.angle_deg


def sweeping(speed_deg_s: float):  # type: ignore[no-untyped-def]
    plan = SearchPlan(method="posterior", start_deg=-35.0, sweep_speed_deg_s=speed_deg_s)
    return build_sweeping(plan, limits=SETTINGS.limits.search)


def test_a_search_over_the_bytes_answers_as_the_simulated_rig_does(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    events = list(bench.search())
    simulated = rigs.simulated(seed=3, settings=SETTINGS)
    *_, direct = run(sweeping(simulated.scanner.sweeping.stage.fastest_sweep_deg_s), simulated.scanner)
    answer, expected = events[-1].estimate, direct.estimate  # type: ignore[union-attr]
    assert isinstance(answer, Found)
    assert isinstance(expected, Found)
    assert answer.mean_deg == pytest.approx(expected.mean_deg, abs=0.15)
    assert answer.mean_deg == pytest.approx(-24.0, abs=0.3)
    swept = next(event for event in events if isinstance(event, Swept))
    samples = [event.sample for event in events if isinstance(event, Measured) and event.sample.sweep is not None]
    truth_deg = [flash.angle_deg for flash in bench.emulated.world.flashes if flash.angle_deg is not None]
    assert len(samples) == swept.pulses == len(truth_deg) > 100
    # Each sample is at the angle where its pulse was fired: a millisecond at 12.5 deg/s, and the encoder's count.
    off_deg = [sample.angle_deg - (true or 0.0) for sample, true in zip(samples, truth_deg, strict=True)]
    assert max(map(abs, off_deg)) < 0.03
    assert all(is_finite(sample.angle_sigma_deg) and sample.angle_sigma_deg < 0.03 for sample in samples)
    assert swept.angle_deg == pytest.approx(35.0, abs=0.02)
    assert bench.speed_deg_s == pytest.approx(20.0, rel=1e-4)
    assert bench.emulated.stage.largest_lead_deg <= MAX_AHEAD_DEG


def lost(bench: Bench) -> None:
    bench.emulated.daq.faults.lost_at = 10  # type: ignore[union-attr]


def doubled(bench: Bench) -> None:
    bench.emulated.daq.faults.doubled_at = 10  # type: ignore[union-attr]


@pytest.mark.parametrize("break_it", [lost, doubled])
def test_a_trigger_lost_or_doubled_refuses_the_sweep_whole_and_it_can_be_made_anew(
    tmp_path: Path, break_it: Callable[[Bench], None]
) -> None:
    bench = Bench(tmp_path)
    sweep = Sweep(to_deg=-20.0, speed_deg_s=12.0, from_deg=-35.0)
    break_it(bench)
    with pytest.raises(AcquisitionError, match="a trigger was lost or doubled"):
        list(bench.scanner.sweep(sweep, number=1, goes_on=lambda: True))
    assert bench.guard.state is State.ARMED
    assert bench.speed_deg_s == pytest.approx(20.0, rel=1e-4)
    bench.emulated.daq.faults = SonixDaqFaults()  # type: ignore[union-attr]
    outcomes = list(bench.scanner.sweep(sweep, number=2, goes_on=lambda: True))
    assert isinstance(outcomes[-1], Swept)
    assert sum(isinstance(outcome, Sample) for outcome in outcomes) == outcomes[-1].pulses > 20


def stalled(bench: Bench) -> None:
    bench.emulated.stage.inject(STAGE_FAULTS["stall"])


def frozen(bench: Bench) -> None:
    bench.emulated.stage.inject(STAGE_FAULTS["frozen motor"])


def without_stage(bench: Bench) -> None:
    bench.emulated.stage.inject(STAGE_FAULTS["silent"])


def without_box(bench: Bench) -> None:
    bench.emulated.laser_box.faults.silent = True


def interlocked(bench: Bench) -> None:
    bench.emulated.laser_box.open_interlock()


def dark(bench: Bench) -> None:
    bench.emulated.laser_box.faults.laser_dead = True


def interrupted(_: Bench) -> None:
    raise KeyboardInterrupt


class InMidSweep:
    """Does something once, when the probe has come by an angle."""

    def __init__(self, bench: Bench, action: Callable[[Bench], None], *, at_deg: float = -10.0) -> None:
        self._bench, self._action, self._at_deg = bench, action, at_deg
        self.began_s: float | None = None
        self.at_deg = 0.0
        bench.clock.lead(self._look)

    def _look(self, now_s: float) -> None:
        if self.began_s is None and self._bench.guard.state is State.SWEEPING:
            self.at_deg = self._bench.probe_deg
            if self.at_deg > self._at_deg:
                self.began_s = now_s
                self._action(self._bench)


@pytest.mark.parametrize("break_it", [stalled, frozen, without_stage, without_box, interlocked, dark, interrupted])
def test_whatever_fails_in_mid_sweep_ends_light_and_motion_and_the_speed_is_restored(
    tmp_path: Path, break_it: Callable[[Bench], None]
) -> None:
    bench = Bench(tmp_path)
    fault = InMidSweep(bench, break_it)
    expected = KeyboardInterrupt if break_it is interrupted else DeviceError
    measured = []
    with pytest.raises(expected):
        measured += [event for event in bench.search() if isinstance(event, Measured)]
    assert not measured
    assert fault.began_s is not None
    assert bench.guard.state is (State.DISARMED if break_it is interrupted else State.FAULT)
    bench.clock.wait(20.0)
    assert not bench.emulated.laser_box.permitted
    light = [pulse for pulse in bench.emulated.laser_box.pulses if pulse.at_s > fault.began_s]
    assert all(pulse.at_s <= fault.began_s + 0.5 for pulse in light)
    # A box that falls silent is noticed a little later, and the last target is then 5 deg ahead.
    assert -0.01 <= bench.probe_deg - fault.at_deg <= MAX_AHEAD_DEG + 0.2 * 12.5
    # Restored at once where the stage can be reached, else by the next start.
    if break_it is without_stage:
        bench.emulated.stage.heal()
        bench.connect()
    assert bench.speed_deg_s == pytest.approx(20.0, rel=1e-4)


def test_a_rig_that_cannot_sweep_says_so_before_anything_moves(tmp_path: Path) -> None:
    bench = Bench(tmp_path, frames="fixed")
    with pytest.raises(ConfigError, match="its SonixDAQ records a fixed number of pulses"):
        _ = bench.scanner.sweeping
    assert bench.emulated.stage.moves == 0
