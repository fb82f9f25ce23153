"""A stage whose channel is disabled since power-up."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import MoveError
from markerseek.drivers import (
    Kdc101Settings,
)
from markerseek.drivers.kdc101 import ENTRY
from markerseek.rigs import read_rig_file
from markerseek.rigs.bench_rig import bench
from tests.emulated import emulation
from tests.unit.drivers.kdc101_bench import bench as kdc101_bench


@pytest.mark.parametrize("model", ["KDC101", "TDC001"])
def test_a_channel_that_is_disabled_since_power_up_is_said_and_enabled_at_a_persons_word(model: str) -> None:
    stage_bench = kdc101_bench(enabled=False, model=model)
    stage = stage_bench.stage()
    assert "channel is disabled" in ENTRY.describe(Kdc101Settings(port="/dev/x", zero_deg=0.0), stage)
    with pytest.raises(MoveError, match=r"did not begin to move .*channel is disabled, .*: arming the rig enables it"):
        stage.move_to(5.0)
    assert stage_bench.probe.angle_deg == 0.0
    # Some controllers do not say whether it is enabled.
    stage_bench.port.swallowed = 0x0211
    stage.logic.enable()
    assert stage.move_to(5.0) == pytest.approx(5.0, abs=0.02)
    assert "disabled" not in ENTRY.describe(Kdc101Settings(port="/dev/x", zero_deg=0.0), stage)


def test_a_channel_that_stays_disabled_is_said() -> None:
    stage_bench = kdc101_bench(enabled=False)
    stage = stage_bench.stage()
    stage_bench.port.swallowed = 0x0210
    with pytest.raises(MoveError, match="does not keep its channel enabled"):
        stage.logic.enable()


def test_an_obstacle_is_still_an_obstacle() -> None:
    stage_bench = kdc101_bench()
    stage_bench.emulator.faults.inject("frozen motor")
    with pytest.raises(MoveError, match="look for an obstacle"):
        stage_bench.stage().move_to(5.0)


@pytest.mark.real_time
def test_a_disabled_channel_is_named_by_the_rig_and_enabled_when_it_is_armed(tmp_path: Path) -> None:
    made = "from markerseek.emulators import EmulatedKdc101 as made; made.__init__.__kwdefaults__['enabled'] = False"
    with emulation(tmp_path, before=made) as devices, bench(read_rig_file(devices.rig)) as rig:
        assert "its channel is disabled" in rig.facts.description
        with pytest.raises(MoveError, match="its channel is disabled"):
            rig.stage.move_to(2.0)
        rig.arm(by="a person")
        assert rig.stage.move_to(2.0) == pytest.approx(2.0, abs=0.02)
