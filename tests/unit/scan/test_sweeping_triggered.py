"""Position-triggered sweeps of the simulated rig: the stage triggers the laser, and the stamps must agree."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from markerseek.core import AcquisitionError, ConfigError, Measured, Sample, Sweep
from markerseek.guard import State
from markerseek.scan.sweeping_devices import SweepingDevices
from markerseek.sim import LaserSettings, SimulatedStage
from tests.unit.scan.stamp_offsets import stamp_offsets_deg
from tests.unit.scan.sweep_bench import TO_END, SweepBench, Sweeps


def with_stage(bench: SweepBench, kind: type[SimulatedStage]) -> SweepBench:
    """The same with another kind of stage, wired to the laser."""
    bench.stage.__class__ = kind
    bench.laser._triggered_s = bench.stage.triggered_s
    return bench


class Losing(SimulatedStage):
    """One of its triggers does not come."""

    given = 0
    at = 30
    times = 0

    def triggered_s(self, until_s: float) -> Sequence[float]:
        times_s: list[float] = []
        for each in super().triggered_s(until_s):
            self.given += 1
            times_s += [each] * (self.times if self.given == self.at else 1)
        return times_s


class Doubling(Losing):
    """One of its triggers comes twice."""

    times = 2


def triggered(*, delay_s: float = 0.0, rate_hz: float = 20.0) -> SweepBench:
    return SweepBench(sweep_mode="position-triggered", delay_s=delay_s, rate_hz=rate_hz)


def swept(bench: SweepBench, sweep: Sweep = TO_END) -> list[Sample]:
    policy = Sweeps(sweep)
    return [event.sample for event in bench.run(policy) if isinstance(event, Measured)]


@pytest.mark.parametrize("to_deg", [35.0, -35.0])
@pytest.mark.parametrize("delay_s", [0.0, 5e-3, 12e-3])
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_each_sample_is_where_the_encoder_was_whatever_the_stamps_are_off_by(
    to_deg: float, delay_s: float, rate_hz: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = triggered(delay_s=delay_s, rate_hz=rate_hz)
    bench.start_deg = -to_deg
    bench.__post_init__()
    offsets_deg = stamp_offsets_deg(monkeypatch)
    samples = swept(bench, Sweep(to_deg=to_deg, speed_deg_s=12.0))
    assert len(samples) > (80 if rate_hz == 20.0 else 140)
    truth_deg = np.array([flash.angle_deg for flash in bench.flashes()])
    angles_deg = np.array([sample.angle_deg for sample in samples])
    # Downwards the probe lags by the backlash, once it is taken up.
    settled = np.abs(angles_deg - bench.start_deg) > 0.5
    assert np.abs(angles_deg - truth_deg)[settled].max() < 1e-3
    assert len(offsets_deg) == len(samples)
    # At even speed: the encoder is read a millisecond from the middle of its answer. On the ramps a chord between two
    # readings is off by a·h²/8 more.
    ramp_deg = 12.0**2 / (2 * bench.motion.acceleration_deg_s2) + 0.6
    even = (np.abs(angles_deg - bench.start_deg) > ramp_deg) & (np.abs(angles_deg - to_deg) > ramp_deg)
    assert even.sum() > 0.8 * len(samples)
    late_deg = np.abs(np.array(offsets_deg)) - 12.0 * delay_s
    assert np.abs(late_deg[even]).max() <= 0.015
    assert late_deg.max() <= 0.015 + 25.0 * 0.054**2 / 8
    assert {sample.sweep.delay_sigma_s for sample in samples if sample.sweep is not None} == {1.2e-3}
    bench.require_permitted()
    apart_s = [after.at_s - before.at_s for before, after in pairwise(bench.flashes())]
    assert min(apart_s) >= 1 / rate_hz - 1e-9


@pytest.mark.parametrize("kind", [Losing, Doubling])
def test_a_trigger_lost_or_doubled_refuses_the_sweep_whole(kind: type[SimulatedStage]) -> None:
    bench = with_stage(SweepBench(sweep_mode="position-triggered", readout_s=1.0), kind)
    sweep = bench.scanner.take(TO_END, number=1, goes_on=lambda: True)
    with pytest.raises(AcquisitionError, match="a trigger was lost or doubled, or the stage is read too late, and the"):
        list(sweep)
    assert bench.scanner.guard.state is State.ARMED


def test_stamps_that_are_off_by_more_than_a_readout_can_be_refuse_the_sweep() -> None:
    bench = triggered(delay_s=40e-3)
    with pytest.raises(AcquisitionError, match="the stamp of its pulse differ by"):
        list(bench.scanner.take(TO_END, number=1, goes_on=lambda: True))


class Early(SimulatedStage):
    """Its triggers are half as far apart as they should be."""

    def set_triggers(self, **keys: float):  # type: ignore[no-untyped-def]
        return super().set_triggers(**keys | {"spacing_deg": keys["spacing_deg"] / 2})  # type: ignore[arg-type]


def test_triggers_that_come_too_early_give_no_light() -> None:
    bench = with_stage(triggered(), Early)
    samples = swept(bench)
    times_s = [flash.at_s for flash in bench.flashes()]
    assert min(after - before for before, after in pairwise(times_s)) >= 0.05 - 1e-9
    # Every second one is counted only, and the angles of the others stay right.
    truth_deg = np.array([flash.angle_deg for flash in bench.flashes()])
    assert np.abs(np.array([sample.angle_deg for sample in samples]) - truth_deg)[3:].max() < 1e-3
    bench.require_permitted()


def test_a_stage_without_triggers_and_a_mode_that_is_none_are_named() -> None:
    bench = triggered()
    names = [name for name in dir(SimulatedStage) if not name.startswith("_") and name != "set_triggers"]
    stage = type("Plain", (), dict.fromkeys(names))()
    with pytest.raises(ConfigError, match=r"cannot sweep position-triggered: its stage \(Plain\) gives no triggers"):
        SweepingDevices.of(stage, bench.laser, bench.receiver)
    with pytest.raises(ConfigError, match="sweep_mode is 'both'"):
        LaserSettings(sweep_mode="both")  # type: ignore[arg-type]
