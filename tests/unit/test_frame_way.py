"""The way of a frame through the package, as `benchmarks.frame_way` traces it."""

from __future__ import annotations

from collections import Counter

import pytest

from benchmarks.frame_way import Return, rows_of, traced


@pytest.fixture(scope="module")
def way() -> list[Return]:
    return traced()


def test_the_guard_sees_each_step_of_an_acquisition_and_the_reader_only_what_it_admits(way: list[Return]) -> None:
    to_scan = [each.function for each in way if each.to_room == "scan" and each.room in {"guard", "signals", "sim"}]
    steps = [name for name in to_scan if name not in {"VirtualClock.now_s", "Guard.state"}]
    angle = ["SimulatedStage.angle_deg", "Guard.readback"]
    assert steps == [
        *("Guard.begin_move", "SimulatedStage.move_to", "Guard.end_move", "Guard.issue", "SimulatedReceiver.arm"),
        *(*angle, "Guard.redeem", "SimulatedLaser.fire", "Guard.end_fire", "SimulatedReceiver.acquire", *angle),
        *("Guard.admit_frame", "ImageReader.read", "Guard.admit_reading"),
    ]


def test_a_frame_takes_no_detour_on_its_way_to_its_reading(way: list[Return]) -> None:
    rows = rows_of(way)
    # The goal of the house is 8.
    assert rows["of the frame, without core"] <= 8
    assert rows["returns between rooms"] == len(way)
    assert all(each.room != each.to_room for each in way)


def test_what_all_frames_of_a_probe_share_is_not_asked_for_again(way: list[Return]) -> None:
    asked = Counter(each.to_room for each in way if each.function == "LinearArray.lateral_m")
    assert asked["signals"] == 0
