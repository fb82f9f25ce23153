"""A stage that stands where it was left is known; one that was turned, or not left in order, is not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from markerseek import rigs
from markerseek.cli.stage_track import SAME_DEG, tracked
from markerseek.core import DeviceError
from markerseek.guard import State

SETTINGS = rigs.read_rig_file(Path(__file__).parents[3] / "examples" / "rigs" / "bench.toml")


@dataclass
class Opened:
    """What is needed of a rig."""

    at_deg: float
    state: State = State.ARMED
    by_hand: object = None
    stage_since: str = ""

    @property
    def scanner(self) -> Any:
        return SimpleNamespace(angle_deg=self.at_deg, guard=SimpleNamespace(state=self.state))


@pytest.fixture(autouse=True)
def _data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


def since(at_deg: float, *, ends_deg: float | None = None, **facts: Any) -> str:
    """Since when the stage has stood where it was left, if it is opened at an angle; ``ends_deg``: where it is left."""
    made = Opened(at_deg, **facts)
    with tracked(made, SETTINGS) as rig:  # type: ignore[arg-type]  # what it reads of a rig is there
        made.at_deg = at_deg if ends_deg is None else ends_deg
        return rig.stage_since


def test_a_stage_that_stands_where_it_was_left_is_known() -> None:
    first = since(3.0, ends_deg=12.0)
    assert first
    assert since(12.0 + 0.9 * SAME_DEG, ends_deg=-4.0) == first
    assert since(-4.0) == first


def test_a_stage_that_stands_elsewhere_was_turned_or_homed() -> None:
    first = since(3.0, ends_deg=12.0)
    second = since(0.0)
    assert second > first
    assert since(0.0) == second


def test_where_a_stage_was_left_is_not_known_after_a_fault_or_a_kill() -> None:
    first = since(3.0)
    with pytest.raises(DeviceError), tracked(Opened(3.0), SETTINGS):  # type: ignore[arg-type]  # as above
        raise DeviceError("silent")
    second = since(3.0)
    assert second > first
    assert since(3.0, state=State.FAULT) == second
    third = since(3.0)
    assert third > second
    # Killed: nothing is written at the end.
    made = tracked(Opened(3.0), SETTINGS)  # type: ignore[arg-type]  # as above
    assert made.__enter__().stage_since == third
    assert since(3.0) > third


def test_a_person_who_turns_it_is_not_asked() -> None:
    made = Opened(3.0, by_hand="a person")
    with tracked(made, SETTINGS) as rig:  # type: ignore[arg-type]  # as above
        assert rig is made  # type: ignore[comparison-overlap]  # as above


def test_a_folder_that_cannot_be_written_makes_no_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    first = since(3.0)
    assert first
    assert since(3.0) > first
