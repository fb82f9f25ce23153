"""The emulated bench in virtual time, in one process: equal to the simulation count for count, and its faults."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import ConfigError, Found, LaserError, Measured, Policy, RunPlan, SearchPlan
from markerseek.drivers import Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings, SystemClock
from markerseek.drivers.clock import LONGEST_WAIT_S
from markerseek.emulators import EmulatedBench
from markerseek.emulators.bench import ServingClock
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings, VirtualClock
from markerseek.wire import apt
from tests.emulated_lines import BenchClock, DirectPort

SETTINGS = SimulatedSettings(marker=MarkerSettings(angle_deg=-8.0), receiver=ReceiverSettings(readout_s=0.3))


class VirtualBench:
    """Real drivers on emulated devices, in virtual time."""

    def __init__(self, folder: Path, *, seed: int) -> None:
        self.emulated = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(seed), folder=folder)
        clock = BenchClock()
        clock.lead(self.emulated.daq.advance)
        self.stage = Kdc101Stage(port=DirectPort(device=self.emulated.stage, clock=clock), clock=clock)
        self.guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission())
        self.scanner = Scanner(
            stage=self.stage,
            laser=LaserBox(port=DirectPort(device=self.emulated.laser_box, clock=clock), clock=clock),
            receiver=SonixDaqReceiver(settings=SonixDaqSettings(folder=str(folder), timeout_s=3.0), clock=clock),
            reader=image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz),
            clock=clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")


def golden() -> Policy:
    return build(SearchPlan(method="golden-section", acquisitions=10, as_published=True), limits=SETTINGS.limits.search)


def test_a_search_receives_count_for_count_what_the_simulation_receives(tmp_path: Path) -> None:
    bench = VirtualBench(tmp_path, seed=7)
    over_bytes = list(run(golden(), bench.scanner, RunPlan(dark_frames=2)))
    simulated = rigs.simulated(seed=7, settings=SETTINGS)
    direct = list(run(golden(), simulated.scanner, RunPlan(dark_frames=2)))
    assert len(over_bytes) == len(direct)
    for received, expected in zip(over_bytes, direct, strict=True):
        if isinstance(received, Measured) and isinstance(expected, Measured):
            assert received.sample.frame is not None
            assert expected.sample.frame is not None
            np.testing.assert_array_equal(received.sample.frame.samples, expected.sample.frame.samples)
            assert received.sample == expected.sample
    assert over_bytes[-1].estimate == direct[-1].estimate  # type: ignore[union-attr]
    assert isinstance(over_bytes[-1].estimate, Found)  # type: ignore[union-attr]
    lit = [event.sample for event in over_bytes if isinstance(event, Measured) and not event.sample.dark]
    truth_deg = [pulse.angle_deg for pulse in bench.emulated.laser_box.pulses]
    assert truth_deg == pytest.approx([sample.angle_deg for sample in lit for _ in range(16)], abs=1e-3)


def test_a_serving_clock_leaves_out_what_the_computer_held_up() -> None:
    real = VirtualClock()
    clock = ServingClock(real)
    for step_s in (0.002, 0.01, 5.0, 0.002):
        real.wait(step_s)
        clock.now_s()
    assert clock.now_s() == pytest.approx(0.002 + 0.01 + 0.02 + 0.002)


def test_the_clock_of_real_devices_beats_in_every_slice_and_a_late_beat_is_detected() -> None:
    beats: list[float] = []
    clock = SystemClock(beat=lambda: beats.append(clock.now_s()))
    began_s = clock.now_s()
    clock.wait(3.5 * LONGEST_WAIT_S)
    assert clock.now_s() - began_s >= 3.5 * LONGEST_WAIT_S
    assert 2 <= len(beats) <= 6
    clock.wait(0.0)
    with pytest.raises(ConfigError, match="a wait of -1"):
        clock.wait(-1)

    def lapsed() -> None:
        raise LaserError("the lease has lapsed")

    with pytest.raises(LaserError, match="lapsed"):
        SystemClock(beat=lapsed).wait(1.0)


def test_the_stage_of_a_bench_turns_on_while_the_computer_holds_up_its_emulator(tmp_path: Path) -> None:
    """A motor that stood still meanwhile, and had its speed again, is no motor that its driver believes."""
    bench = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(1), folder=tmp_path / "daq")
    clock = VirtualClock()
    with bench.line("stage", clock=clock, link=tmp_path / "stage") as line:
        end = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
        os.write(end, apt.set_target(apt.counts_of(5.0)) + apt.move())
        line.serve_once(wait_s=1.0)
        clock.wait(0.01)
        line.serve_once(wait_s=0.0)
        clock.wait(0.5)
        line.serve_once(wait_s=0.0)
        os.close(end)
    # half a second at 20 deg/s², since the parameters are those after power-up
    assert bench.stage._stage.motor.angle_deg == pytest.approx(2.5, abs=0.15)
