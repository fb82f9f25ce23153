"""The sense of rotation: a probe mounted in reverse turns to the right angles, inside its limits."""

from __future__ import annotations

from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import Interval, LimitError
from markerseek.wire import apt
from tests.unit.drivers.kdc101_bench import bench

UNEVEN = Interval(low_deg=-20.0, high_deg=36.5)
"""A range that shows whether its ends were swapped."""

PLAY_DEG = 0.4


@settings(max_examples=35, deadline=None)
@given(
    targets=st.lists(st.floats(-20.0, 36.5), min_size=1, max_size=4),
    start=st.floats(-19.5, 36.0),
    zero_deg=st.sampled_from([0.0, 12.5, 340.0, -350.0]),
    turns=st.sampled_from([-1, 0, 1]),
    mirrored=st.booleans(),
)
def test_a_stage_turns_its_probe_where_it_should_be_by_the_short_way(
    targets: list[float], start: float, zero_deg: float, turns: int, mirrored: bool
) -> None:
    rig = bench(start_deg=start, play_deg=0.0, mirrored=mirrored, zero_deg=zero_deg, turns=turns)
    stage = rig.stage(travel=UNEVEN, direction="reverse" if mirrored else "forward", zero_deg=zero_deg)
    assert stage.angle_deg == pytest.approx(start, abs=1e-3)
    for target in targets:
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)
        assert rig.probe.angle_deg == pytest.approx(target, abs=1e-3)
    low, high = rig.emulator.truth_range_deg
    assert low >= UNEVEN.low_deg
    assert high <= UNEVEN.high_deg
    assert rig.emulator.largest_lead_deg <= 5.0


def test_the_limits_in_the_controller_are_those_of_the_probe() -> None:
    rig = bench(play_deg=0.0, mirrored=True)
    rig.stage(travel=UNEVEN, direction="reverse")
    # A program that ignores us is held by the controller itself, at the probe's own ends.
    for counts, end_deg in ((apt.counts_of(90.0), UNEVEN.low_deg), (apt.counts_of(-90.0), UNEVEN.high_deg)):
        rig.port.write(apt.set_target(counts) + apt.move())
        rig.let_be(30.0)
        assert rig.probe.angle_deg == pytest.approx(end_deg, abs=1e-3)
        assert rig.probe.angle_deg in UNEVEN


def test_a_target_outside_the_probe_s_range_is_refused_although_the_stage_s_own_range_holds_it() -> None:
    rig = bench(play_deg=0.0, mirrored=True)
    stage = rig.stage(travel=UNEVEN, direction="reverse")
    with pytest.raises(LimitError, match="outside its travel"):
        stage.move_to(-30.0)
    assert rig.emulator.moves == 0


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", ["below", "above"])
def test_the_play_falls_on_the_same_side_always(mirrored: bool, side: Literal["below", "above"]) -> None:
    rig = bench(play_deg=PLAY_DEG, mirrored=mirrored)
    stage = rig.stage(direction="reverse" if mirrored else "forward", approach_from=side)
    off_deg = []
    for target in (10.0, -20.0, 5.0, 4.8, 5.2, 30.0):
        reached = stage.move_to(target)
        assert not stage.approach_reversed
        off_deg.append(rig.probe.angle_deg - reached)
    assert max(off_deg) - min(off_deg) < 1e-6
    # Driven by the motor's rising reading the probe stands at the encoder's angle, else by the play behind it.
    rising = (side == "below") != mirrored
    assert off_deg[0] == pytest.approx(0.0 if rising else PLAY_DEG * (-1 if mirrored else 1), abs=1e-6)


def test_a_mirrored_probe_under_the_default_goes_to_the_mirrored_angle() -> None:
    """Nothing in the stage's answers shows it: this is what `doctor --source-deg` is for."""
    rig = bench(play_deg=0.0, mirrored=True)
    stage = rig.stage()
    assert stage.move_to(12.0) == pytest.approx(12.0, abs=1e-3)
    assert rig.probe.angle_deg == pytest.approx(-12.0, abs=1e-3)
