"""A sweep as one acquisition of a SonixDAQ: a frame for each pulse, or none at all."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import AcquisitionError, ChannelFrame, ConfigError, Permit, SweepPermit
from markerseek.drivers import SonixDaqReceiver, SonixDaqSettings
from tests.unit.drivers.test_sonixdaq import Bench as RestBench

SWEEP = SweepPermit(
    token="s",
    angle_deg=-35.0,
    pulses=9,
    expires_s=math.inf,
    to_deg=35.0,
    slowest_deg_s=2.0,
    fastest_deg_s=12.0,
    period_s=0.05,
)


class Bench(RestBench):
    """A folder of bursts: each pulse has a frame of its own."""

    def __init__(self, folder: Path, *, frames: str = "triggered") -> None:
        super().__init__(folder, white_sigma=30.0, start_deg=-35.0, averaged=16)
        settings = SonixDaqSettings(folder=str(folder), timeout_s=3.0, frames=frames)  # type: ignore[arg-type]
        self.receiver = SonixDaqReceiver(settings=settings, clock=self.clock, dark_triggers=2)

    def sweep(self, *, lit: int = 7, triggers: int = 9) -> list[ChannelFrame]:
        self.receiver.begin_sweep(SWEEP)
        for number in range(lit):
            self.world.flash(pulses=1, at_s=0.05 * number)
            self.world.flashes[-1] = replace(self.world.flashes[-1], angle_deg=-35.0 + number)
        assert self.receiver.frames() == ()
        self.daq.trigger(triggers)
        frames = self.receiver.end_sweep(pulses=lit)
        return [frame for frame in frames if isinstance(frame, ChannelFrame)]


def test_each_pulse_is_a_frame_and_the_last_dark_triggers_are_one(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    *frames, dark = bench.sweep()
    assert bench.angles_deg[:7] == [-35.0 + number for number in range(7)]
    for frame, samples in zip(frames, bench.received[:7], strict=True):
        np.testing.assert_array_equal(frame.samples, samples)
        assert (frame.header.pulses, frame.header.token, frame.header.commanded_deg) == (1, "s", 35.0)
    assert [frame.header.sequence for frame in frames] == list(range(1, 8))
    # A single pulse has four times the noise of the mean of sixteen, with light and without.
    assert np.std(bench.received) == pytest.approx(120.0, rel=0.05)
    assert (dark.header.pulses, dark.header.token, dark.header.sequence) == (0, "s", 8)
    np.testing.assert_array_equal(dark.samples, np.rint(np.mean(bench.received[-2:], 0)))
    # and an acquisition at rest goes on from there
    permit = Permit(token="p", angle_deg=0.0, pulses=16, expires_s=math.inf)
    bench.receiver.arm(permit)
    bench.world.flash(pulses=16, at_s=5.0)
    bench.daq.trigger(16)
    assert bench.receiver.acquire(permit).header.sequence == 9


def test_light_in_the_triggers_that_must_be_dark_refuses_the_sweep_whole(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    with pytest.raises(AcquisitionError, match="8 of 9 triggers had light, and the last 2 must be dark"):
        bench.sweep(lit=8)


def test_files_that_have_come_since_it_was_connected_are_not_the_answer(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.daq.trigger(9)
    bench.clock.wait(0.3)
    with pytest.raises(AcquisitionError, match=r"files have arrived in .* although nothing was triggered"):
        bench.receiver.begin_sweep(SWEEP)
    with pytest.raises(AcquisitionError, match="stale files"):
        bench.receiver.settle()
    bench.receiver.settle()
    assert len(bench.sweep()) == 8


@pytest.mark.parametrize(
    ("fault", "said"),
    [("lost trigger", "hold 8 pulses, 9 were triggered"), ("double trigger", "hold 10 pulses, 9 were triggered")],
)
def test_a_trigger_that_is_lost_or_doubled_refuses_the_sweep_whole(tmp_path: Path, fault: str, said: str) -> None:
    bench = Bench(tmp_path)
    bench.daq.faults.inject(fault, 4)
    with pytest.raises(AcquisitionError, match=f"{said}: a trigger was lost or doubled"):
        bench.sweep()
    # and no part of it can be asked for again
    with pytest.raises(AcquisitionError, match="was not armed for a sweep"):
        bench.receiver.end_sweep(pulses=7)


def test_a_device_that_records_a_fixed_number_says_why_it_cannot_sweep(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="this rig cannot sweep: its SonixDAQ records a fixed number of pulses"):
        _ = Bench(tmp_path, frames="fixed").receiver.frame_period_s
    receiver = Bench(tmp_path).receiver
    assert (receiver.frame_period_s, receiver.sweep_readout_s) == (0.05, 12.0)
    with pytest.raises(ConfigError, match="sweep_period_s is 0"):
        SonixDaqSettings(folder="daq", sweep_period_s=0.0)
