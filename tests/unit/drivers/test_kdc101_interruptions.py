"""A move interrupted by a crash, a cut line, a hand or a wrong reading goes no further than allowed."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from markerseek.core import DeviceTimeoutError, MoveError, NotConnectedError
from markerseek.wire import apt
from tests.unit.drivers.kdc101_bench import Killed, bench


def test_a_stage_that_was_stopped_on_its_way_takes_up_its_play_again() -> None:
    rig = bench(play_deg=0.4)
    stage = rig.stage()
    stage.move_to(0.0)
    rig.clock.killed_at_s = rig.clock.now_s() + 1.0
    with pytest.raises(Killed):
        stage.move_to(-30.0)
    rig.clock.killed_at_s = np.inf
    here = stage.angle_deg
    assert rig.probe.angle_deg > here + 0.3
    assert stage.move_to(here) == here
    assert rig.probe.angle_deg == pytest.approx(here, abs=1e-9)


def test_all_waiting_is_short_so_that_the_loop_can_show_that_it_lives() -> None:
    rig = bench()
    stage = rig.stage()
    stage.move_to(-35.0)
    stage.stop()
    assert rig.clock.longest_s <= 0.05


@pytest.mark.parametrize("after_s", np.linspace(0.02, 5.4, 12).tolist())
def test_a_computer_that_dies_leaves_the_stage_five_degrees_on_at_most(after_s: float) -> None:
    rig = bench()
    stage = rig.stage()
    rig.port.dead_from_s = after_s  # not even the stop of a dying program arrives
    with pytest.raises(DeviceTimeoutError):
        stage.move_to(-35.0)
    assert rig.port.angle_at_death_deg is not None
    rig.let_be(20.0)
    assert not rig.emulator.moving
    assert 0.0 <= abs(rig.probe.angle_deg - rig.port.angle_at_death_deg) <= 5.0
    assert rig.emulator.largest_lead_deg <= 5.0


@pytest.mark.parametrize("number", range(20, 44))
def test_one_reading_that_is_a_little_wrong_carries_no_target_further(number: int) -> None:
    rig = bench()
    stage = rig.stage()
    read, count = rig.port.read, 0

    def read_wrongly(size: int, *, timeout_s: float) -> bytes:
        nonlocal count
        data = read(size, timeout_s=timeout_s)
        if data[:2] == b"\x91\x04":
            count += 1
            if count == number:
                position = int.from_bytes(data[8:12], "little", signed=True) - 192  # 0.1 deg further on its way
                data = data[:8] + position.to_bytes(4, "little", signed=True) + data[12:]
        return data

    rig.port.read = read_wrongly  # type: ignore[method-assign]
    # It is either outvoted or refused.
    with contextlib.suppress(MoveError):
        assert stage.move_to(-35.0) == pytest.approx(-35.0, abs=1e-3)
    assert count >= number
    assert rig.emulator.largest_lead_deg <= 5.0


def test_an_interrupted_move_is_stopped_at_once() -> None:
    rig = bench()
    stage = rig.stage()
    rig.clock.killed_at_s = 2.0
    with pytest.raises(Killed):
        stage.move_to(-35.0)
    there = rig.probe.angle_deg
    rig.let_be(20.0)
    assert rig.probe.angle_deg == there
    assert -15 < there < -5


def test_a_line_that_is_cut_is_an_error_and_not_a_wait() -> None:
    rig = bench()
    stage = rig.stage()
    rig.port.cut = True
    for act in (lambda: stage.move_to(1.0), lambda: stage.angle_deg, stage.stop):
        with pytest.raises(NotConnectedError):
            act()


def test_a_stage_turned_by_hand_at_rest_is_noticed() -> None:
    rig = bench()
    stage = rig.stage()
    stage.move_to(3.0)
    rig.port.write(apt.set_target(0) + apt.move())
    rig.let_be(5.0)
    with pytest.raises(MoveError, match="wheel"):
        _ = stage.angle_deg
