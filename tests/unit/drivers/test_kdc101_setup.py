"""Connection of the stage's driver: its queries and settings, and the devices it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from markerseek.core import ConfigError, DeviceTimeoutError, Interval, LimitError, MoveError, NotConnectedError
from markerseek.wire import apt
from tests.unit.drivers.kdc101_bench import bench


def test_it_identifies_itself_and_writes_the_settings_that_power_up_lost() -> None:
    rig = bench()
    stage = rig.stage(speed_deg_s=12.0, acceleration_deg_s2=15.0)
    assert (stage.logic.identity.model, stage.logic.identity.serial_number) == ("KDC101", 27000001)
    rig.port.write(apt.ask(apt.VELOCITY) + apt.ask(apt.BACKLASH) + apt.ask(apt.LIMITS))
    answers = [apt.decode(message) for message in apt.AptFramer().feed(rig.port.read(4096, timeout_s=0.0))]
    assert answers == [
        apt.Velocity(acceleration=220, speed=515300),  # 15 x 14.6574 = 219.9; 12 x 42941.66 = 515299.9
        apt.Counts(counts=0),
        apt.SoftLimits(low=-70066, high=70066, mode=2, switches=4),
    ]
    assert rig.clock.now_s() == 0.0
    assert rig.emulator.moves == 0


@pytest.mark.parametrize(
    ("stands", "wanted", "error", "words"),
    [
        ({"homed": False}, {}, MoveError, "outside the patient|out of the patient.*home it"),
        ({"model": "KST101"}, {}, NotConnectedError, "KST101"),
        ({}, {"serial_number": 1}, NotConnectedError, "27000001"),
        ({"start_deg": 40.0}, {}, LimitError, "40.00 deg"),
        ({"start_deg": 10.0, "zero_deg": 50.0}, {}, LimitError, "60.00 deg"),
    ],
)
def test_what_cannot_be_used_is_refused_at_connect(
    stands: dict[str, Any], wanted: dict[str, Any], error: type[Exception], words: str
) -> None:
    rig = bench(**stands)
    with pytest.raises(error, match=words):
        rig.stage(**wanted)
    assert rig.emulator.moves == 0


@pytest.mark.parametrize("swallowed", [0x0413, 0x043A, 0x0423, 0x0523])
def test_parameters_that_are_not_kept_are_refused(swallowed: int) -> None:
    rig = bench()
    rig.port.write(apt.set_trigger_ports(apt.TriggerPorts(first=0x0D)))
    rig.port.swallowed = swallowed
    with pytest.raises(MoveError, match="does not keep its"):
        rig.stage()


def test_a_stage_that_moves_is_not_taken_over() -> None:
    rig = bench()
    rig.port.write(apt.set_target(5000) + apt.move())
    rig.let_be(0.2)
    with pytest.raises(MoveError, match="is moving"):
        rig.stage()


def test_nobody_there() -> None:
    rig = bench()
    rig.port.swallowed = 0x0005
    with pytest.raises(DeviceTimeoutError, match="no answer"):
        rig.stage()


@pytest.mark.parametrize(
    "wrong",
    [
        {"travel": Interval(low_deg=-0.5, high_deg=0.5)},
        {"travel": Interval(low_deg=-180.0, high_deg=180.0)},
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        bench().stage(**wrong)
