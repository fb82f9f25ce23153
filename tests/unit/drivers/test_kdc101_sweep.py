"""Sweeps by the stage's driver against its emulator in virtual time: targets, readings, and its speed afterwards."""

from __future__ import annotations

import struct
from itertools import pairwise

import numpy as np
import pytest

from markerseek.core import (
    DeviceError,
    Interval,
    LimitError,
    StageReading,
    SweepingStage,
)
from markerseek.drivers import Kdc101Stage
from markerseek.wire import apt
from tests.emulated_lines import FaultyLine
from tests.unit.drivers.kdc101_bench import Bench, Killed, bench

KEYS = {"speed_deg_s": 20.0, "acceleration_deg_s2": 25.0}


def speed_of(it: Bench) -> float:
    """The speed that the controller holds, in degrees per second."""
    return float(struct.unpack("<H3i", it.emulator.velocity)[3]) / apt.SPEED_WORD


def readings(it: Bench, stage: Kdc101Stage, duration_s: float) -> list[tuple[StageReading, float]]:
    """Readings every 50 ms, each with the true angle when it was asked for."""
    made: list[tuple[StageReading, float]] = []
    ends_s = it.clock.now_s() + duration_s
    while it.clock.now_s() < ends_s:
        it.clock.wait(0.05)
        it.emulator.turn(it.clock.now_s())
        truth_deg = it.probe.angle_deg
        made.append((stage.read_sweep(), truth_deg))
    return made


def swept(it: Bench, stage: Kdc101Stage, to_deg: float) -> list[StageReading]:
    stage.prepare_sweep(speed_deg_s=12.0)
    stage.begin_sweep(to_deg)
    return [reading for reading, _ in readings(it, stage, 0.5)]


def test_it_turns_evenly_to_the_end_and_has_its_own_speed_again() -> None:
    it = bench(start_deg=-35.0)
    stage = it.stage(**KEYS)
    assert isinstance(stage, SweepingStage)
    stage.prepare_sweep(speed_deg_s=12.0)
    assert speed_of(it) == pytest.approx(12.0, rel=1e-5)
    stage.begin_sweep(35.0)
    made = readings(it, stage, 7.0)
    for reading, truth_deg in made:
        assert reading.asked_s <= reading.answered_s <= reading.asked_s + 0.01
        assert abs(reading.angle_deg - truth_deg) <= 12.0 * 0.01 + 0.001
    even = [reading for reading, _ in made[20:100]]
    speeds = [(after.angle_deg - before.angle_deg) / (after.at_s - before.at_s) for before, after in pairwise(even)]
    assert min(speeds) > 11.9
    assert max(speeds) < 12.1
    stage.brake()
    stage.end_sweep()
    assert stage.angle_deg == pytest.approx(35.0, abs=0.001)
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)
    # It knows from which side its gears were pushed: the approach from below needs no way round.
    before = it.emulator.moves
    assert stage.move_to(35.5) == pytest.approx(35.5, abs=0.01)
    assert it.emulator.moves == before + 1


@pytest.mark.parametrize("direction", ["forward", "reverse"])
def test_it_sweeps_down_too_and_brakes_smoothly_where_it_is_told(direction: str) -> None:
    it = bench(start_deg=20.0, mirrored=direction == "reverse")
    stage = it.stage(**KEYS, direction=direction)
    swept(it, stage, -35.0)
    at_deg = readings(it, stage, 1.0)[-1][0].angle_deg
    stage.brake()
    last = readings(it, stage, 1.5)
    rest_deg = last[-1][0].angle_deg
    # v²/2a is 2.9 deg, and what it turned since the reading.
    assert at_deg - rest_deg == pytest.approx(12.0**2 / 50, abs=0.15)
    assert last[0][0].angle_deg < at_deg - 0.3
    stage.end_sweep()
    assert stage.angle_deg == rest_deg
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)


def test_a_host_that_dies_leaves_the_probe_at_the_end_and_the_next_start_restores_its_speed() -> None:
    it = bench(start_deg=-35.0)
    stage = it.stage(**KEYS)
    stage.prepare_sweep(speed_deg_s=12.0)
    stage.begin_sweep(35.0)
    it.clock.killed_at_s = it.clock.now_s() + 3.0
    with pytest.raises(Killed):
        readings(it, stage, 10.0)
    it.let_be(30.0)
    assert it.probe.angle_deg == pytest.approx(35.0, abs=0.01)
    assert speed_of(it) == pytest.approx(12.0, rel=1e-5)
    it.stage(**KEYS)
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "amount"),
    [
        ("silent", None),
        ("stall", None),
        ("obstacle", -25.0),
        ("frozen motor", None),
        ("readback jump", 2.0),
        ("jump on its way", -0.5),
        ("power cycle", None),
        ("says it is there", None),
    ],
)
def test_a_stage_that_fails_in_mid_sweep_is_stopped_and_has_its_speed_again(name: str, amount: float | None) -> None:
    it = bench(start_deg=-35.0)
    stage = it.stage(**KEYS)
    swept(it, stage, 35.0)
    it.emulator.faults.inject(name, amount)
    failed_s = it.clock.now_s()
    last_deg: list[float] = []
    try:
        last_deg += [readings(it, stage, 0.05)[-1][0].angle_deg for _ in range(60)]
    except DeviceError:
        assert it.clock.now_s() - failed_s < 1.5
    else:
        # What the driver cannot tell from a stage that stands, the guard does: it is too slow to be lit.
        assert name == "frozen motor"
        assert last_deg[-1] == pytest.approx(last_deg[-2], abs=0.001)
    it.emulator.faults.heal()
    it.clock.wait(1.0)
    stage.stop()
    assert not it.emulator.moving
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)


def test_a_stage_that_is_twice_as_fast_as_it_was_set_is_found() -> None:
    it = bench(start_deg=-35.0)
    stage = it.stage(**KEYS)
    it.emulator.faults.inject("too fast")
    stage.prepare_sweep(speed_deg_s=8.0)
    stage.begin_sweep(35.0)
    with pytest.raises(DeviceError, match=r"faster than it was set to|where its acceleration allows"):
        readings(it, stage, 5.0)


def test_no_target_is_beyond_the_end_though_bytes_are_garbled_or_lost() -> None:
    for bad in (FaultyLine(answers=0.003), FaultyLine(commands=0.003), FaultyLine(lost=0.003)):
        it = bench(start_deg=-35.0)
        stage = it.stage(**KEYS)
        stage.prepare_sweep(speed_deg_s=12.0)
        it.port.line = bad
        try:
            stage.begin_sweep(35.0)
            readings(it, stage, 7.0)
        except DeviceError:
            it.port.line = FaultyLine()
            stage.stop()
        it.let_be(10.0)
        assert it.probe.angle_deg < 35.1


def test_a_target_that_the_line_has_lost_is_given_again() -> None:
    it = bench(start_deg=-35.0)
    stage = it.stage(**KEYS)
    stage.prepare_sweep(speed_deg_s=20.0)
    it.port.swallowed = 0x0453
    stage.begin_sweep(35.0)
    it.port.swallowed = None
    assert readings(it, stage, 6.0)[-1][0].angle_deg == pytest.approx(35.0, abs=0.01)


def test_stop_and_a_move_restore_the_speed_at_any_time() -> None:
    it = bench(start_deg=-20.0)
    stage = it.stage(**KEYS)
    stage.prepare_sweep(speed_deg_s=5.0)
    stage.stop()
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)
    stage.prepare_sweep(speed_deg_s=5.0)
    assert stage.move_to(-10.0) == pytest.approx(-10.0, abs=0.01)
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)
    swept(it, stage, 35.0)
    stage.stop()
    assert not it.emulator.moving
    assert speed_of(it) == pytest.approx(20.0, rel=1e-5)
    with pytest.raises(DeviceError, match="it was stopped"):
        stage.read_sweep()


def test_a_sweep_out_of_the_travel_range_does_not_begin() -> None:
    it = bench()
    stage = it.stage(travel=Interval(low_deg=-10.0, high_deg=10.0))
    stage.prepare_sweep(speed_deg_s=5.0)
    for to_deg in (10.1, np.nan):
        with pytest.raises(LimitError, match="outside its travel"):
            stage.begin_sweep(to_deg)
    it.clock.wait(1.0)
    assert it.probe.angle_deg == 0.0


def test_what_a_sweep_may_be_follows_from_its_keys() -> None:
    stage = bench().stage(acceleration_deg_s2=25.0, speed_deg_s=20.0, play_deg=0.3)
    assert stage.fastest_sweep_deg_s == pytest.approx(20.0, rel=1e-6)
    assert (stage.play_deg(1.0), stage.play_deg(-1.0)) == (0.0, 0.3)
    above = bench().stage(approach_from="above", play_deg=0.3)
    assert (above.play_deg(1.0), above.play_deg(-1.0)) == (0.3, 0.0)
