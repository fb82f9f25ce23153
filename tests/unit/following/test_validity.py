"""What is seen of devices that were exchanged or off since the registration."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs

from markerseek.following import DevicesSeen, read_confirmed, write_confirmed
from tests.registration_sessions import BEGUN

THEN = DevicesSeen(rig="r", description="a rig", cameras="{}", stage_since="2026-01-01T10:00:00")


@pytest.mark.parametrize(
    ("now", "said"),
    [
        ({}, []),
        # No cameras are named now: there is nothing to compare.
        ({"cameras": None}, []),
        ({"rig": "s"}, ["the rig file is another one"]),
        ({"rig": "s", "description": "another rig"}, ["the rig is another rig, it was a rig"]),
        ({"cameras": '{"focal": 2}'}, ["the calibration of the cameras is another one"]),
        ({"stage_since": "2026-01-02T08:00:00"}, ["was left at 2026-01-02T08:00:00: it was switched off and on"]),
        ({"stage_since": ""}, ["was left at an unknown time"]),
        ({"rig": "s", "cameras": "", "stage_since": "x"}, ["rig file", "calibration", "stage"]),
    ],
)
def test_each_change_is_named(now: dict[str, object], said: list[str]) -> None:
    found = structs.replace(THEN, **now).changes_since(THEN)
    assert len(found) == len(said)
    for sentence, part in zip(found, said, strict=True):
        assert part in sentence


def test_a_stage_that_nobody_kept_is_not_compared() -> None:
    then = DevicesSeen.of_session(BEGUN)
    assert then.stage_since == ""
    assert structs.replace(THEN, rig=then.rig).changes_since(then) == ()


def test_the_devices_of_a_spot_that_confirmed_are_kept(tmp_path: Path) -> None:
    assert read_confirmed(tmp_path) is None
    write_confirmed(tmp_path, THEN)
    assert read_confirmed(tmp_path) == THEN
    (tmp_path / "confirmed.json").write_text("{")
    assert read_confirmed(tmp_path) is None
