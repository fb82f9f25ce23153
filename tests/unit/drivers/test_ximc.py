"""The driver of a Standa stage on the virtual device of Standa's own library, and on one that fails."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from markerseek import rigs
from markerseek.contract import StageContract
from markerseek.core import ConfigError, Interval, LimitError, MoveError, NotConnectedError, SearchPlan
from markerseek.drivers import BenchSettings, SystemClock, XimcSettings, XimcStage
from markerseek.drivers.ximc import ENTRY
from markerseek.runs import find_marker
from markerseek.sim import VirtualClock

try:
    import libximc.highlevel as highlevel
except (ImportError, RuntimeError) as problem:
    pytest.skip(f"libximc: {problem}", allow_module_level=True)

STEPS_PER_DEG = 100.0
SPAN = Interval(low_deg=-4.0, high_deg=4.0)


def settings(folder: Path, **keys: Any) -> XimcSettings:
    given = {"steps_per_deg": STEPS_PER_DEG, "zero_deg": 0.0, "speed_deg_s": 25.0, "acceleration_deg_s2": 25.0}
    return XimcSettings(uri=f"xi-emu://{folder}/stage.bin", **(given | keys))


@pytest.mark.real_time
class TestVirtualStage(StageContract):
    resolution_deg = 0.01

    @pytest.fixture(autouse=True)
    def _virtual(self, tmp_path: Path) -> Iterator[None]:
        self.stage = XimcStage(settings=settings(tmp_path), clock=SystemClock(), travel=SPAN)
        yield
        self.stage.logic.close()

    def make(self) -> XimcStage:
        return self.stage


@pytest.mark.real_time
def test_its_angle_is_that_of_the_probe(tmp_path: Path) -> None:
    stage = XimcStage(settings=settings(tmp_path, zero_deg=3.0, direction="reverse"), clock=SystemClock(), travel=SPAN)
    # A virtual device begins at 0 steps.
    assert stage.angle_deg == 3.0
    stage.logic.close()


@pytest.mark.long
@pytest.mark.real_time
def test_a_whole_search_with_a_virtual_stage_finds_the_marker(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(
        f"""kind = "bench"
[stage]
driver = "ximc"
uri = "xi-emu://{tmp_path}/stage.bin"
steps_per_deg = {STEPS_PER_DEG}
zero_deg = 0.0
speed_deg_s = 25.0
acceleration_deg_s2 = 25.0
[laser]
driver = "simulated"
[receiver]
driver = "simulated"
readout_s = 0.0
[limits.search]
low_deg = -12.0
high_deg = 12.0
""",
        encoding="utf-8",
    )
    read = rigs.read_rig_file(file)
    assert isinstance(read, BenchSettings)
    with rigs.bench(read) as rig:
        assert rig.facts.emulated == ("stage", "laser", "receiver")
        assert "VIRTUAL 8SMC5" in rig.facts.description
        rig.arm(by="a person")
        result = find_marker(rig, SearchPlan(method="posterior", others=0.0))
    assert result.found
    # Of the world with seed 1.
    assert result.angle_deg == pytest.approx(0.93, abs=0.3)


class Axis:
    """A controller that goes where it is sent at once, unless it fails."""

    def __init__(self, _uri: str) -> None:
        self.steps = 0.0
        self.flags = highlevel.StateFlags.STATE_IS_HOMED
        self.commands = highlevel.MvcmdStatus(0)
        self.stuck = False
        self.stops = 0
        self.microstep_mode = 9
        self.moves = SimpleNamespace(Speed=0, uSpeed=0, Accel=0, Decel=0)
        self.borders = SimpleNamespace(BorderFlags=0, LeftBorder=0, uLeftBorder=0, RightBorder=0, uRightBorder=0)

    def __getattr__(self, name: str) -> Any:
        held = {
            "get_serial_number": 7,
            "get_engine_settings": SimpleNamespace(
                MicrostepMode=self.microstep_mode, EngineFlags=highlevel.EngineFlags(8)
            ),
            "get_move_settings": self.moves,
            "get_edges_settings": self.borders,
        }
        return lambda *_values: held.get(name)

    def get_status(self) -> Any:
        return SimpleNamespace(CurPosition=self.steps, uCurPosition=0, Flags=self.flags, MvCmdSts=self.commands)

    def command_move(self, steps: int, microsteps: int) -> None:
        if not self.stuck:
            wanted = steps + microsteps / 256
            # As far as it turns in the time between two targets.
            reach = 25.0 * 0.05 * STEPS_PER_DEG
            self.steps += max(-reach, min(reach, wanted - self.steps))

    def command_sstp(self) -> None:
        self.stops += 1


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Axis:
    axis = Axis("")
    monkeypatch.setattr(highlevel, "Axis", lambda _uri: axis)
    return axis


def real(**keys: Any) -> XimcStage:
    given = {"uri": "xi-com:/dev/none", "steps_per_deg": STEPS_PER_DEG, "zero_deg": 0.0, "speed_deg_s": 25.0}
    travel = Interval(low_deg=-36.5, high_deg=36.5)
    return XimcStage(settings=XimcSettings(**(given | keys)), clock=VirtualClock(), travel=travel)


def test_speed_and_travel_are_written_to_the_controller(made: Axis) -> None:
    stage = real()
    assert not stage.emulated
    assert stage.move_to(30.0) == 30.0
    # Written to the controller, in whole steps: speed and travel.
    assert (made.moves.Speed, made.borders.LeftBorder, made.borders.RightBorder) == (2500, -3650, 3650)


@pytest.mark.parametrize(
    ("fail", "says"),
    [
        (lambda axis: setattr(axis, "flags", highlevel.StateFlags.STATE_ALARM), "controller reports"),
        (lambda axis: setattr(axis, "commands", highlevel.MvcmdStatus.MVCMD_ERROR), "controller reports"),
    ],
    ids=["alarm", "error"],
)
def test_a_stage_that_fails_is_stopped_and_named(made: Axis, fail: Any, says: str) -> None:
    stage = real()
    fail(made)
    with pytest.raises(MoveError, match=says):
        stage.move_to(10.0)


def test_a_stage_that_is_stuck_is_told_to_stop(made: Axis) -> None:
    stage = real()
    made.stuck = True
    with pytest.raises(MoveError):
        stage.move_to(10.0)
    assert made.stops == 2
    with pytest.raises(LimitError):
        stage.move_to(math.nan)


@pytest.mark.parametrize(
    ("fail", "error", "says"),
    [
        (lambda axis: setattr(axis, "flags", highlevel.StateFlags(0)), MoveError, "not homed"),
        (lambda axis: setattr(axis, "commands", highlevel.MvcmdStatus.MVCMD_RUNNING), MoveError, "it moves"),
        (
            lambda axis: setattr(axis, "get_edges_settings", lambda: SimpleNamespace(**vars(Axis("").borders))),
            MoveError,
            "of the",
        ),
    ],
    ids=["not homed", "moves", "keeps nothing"],
)
def test_a_stage_that_is_not_ready_is_refused(made: Axis, fail: Any, error: type[Exception], says: str) -> None:
    fail(made)
    with pytest.raises(error, match=says):
        real()


@pytest.mark.parametrize(
    ("mode", "steps_per_deg", "said"),
    [
        (
            1,
            20.0,
            r"turns in full steps of 0\.05 deg, too coarse for an arrival_deg of 0\.02 deg; set 1/256 as",
        ),
        (3, 5.0, r"turns in 1/4 steps of 0\.05 deg, too coarse"),
    ],
)
def test_a_controller_that_turns_in_steps_too_coarse_is_refused_by_name(
    made: Axis, mode: int, steps_per_deg: float, said: str
) -> None:
    """And not as an obstacle, once it stands between two steps."""
    made.microstep_mode = mode
    with pytest.raises(ConfigError, match=said):
        real(steps_per_deg=steps_per_deg)
    made.microstep_mode = 9
    stage = real(steps_per_deg=steps_per_deg)
    assert f"in 1/256 steps of {1 / 256 / steps_per_deg:.4g} deg" in ENTRY.describe(settings(Path("x")), stage)


def test_another_controller_is_refused(made: Axis) -> None:
    assert real(serial_number=7).logic.serial_number == 7
    with pytest.raises(NotConnectedError, match="has the serial number 7, not 8"):
        real(serial_number=8)


def test_an_address_at_which_nothing_is_cannot_be_connected() -> None:
    with pytest.raises(NotConnectedError, match="connecting failed"):
        real()


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"steps_per_deg": 1.0, "arrival_deg": 0.001}, "less than a microstep"),
        ({"uri": "xi-emu:///home/me/rig.toml"}, "must end in .bin, because the library overwrites"),
    ],
)
def test_keys_that_cannot_be_used_are_refused(keys: dict[str, Any], says: str) -> None:
    given = {"uri": "xi-com:/dev/none", "steps_per_deg": STEPS_PER_DEG, "zero_deg": 0.0}
    with pytest.raises(ConfigError, match=says):
        XimcSettings(**(given | keys))


def test_an_address_of_another_form_is_refused(made: Axis) -> None:
    made.command_move = lambda *_steps: pytest.fail("it moved")  # type: ignore[method-assign]
    with pytest.raises(ConfigError, match="must begin with xi-com:"):
        real(uri="/dev/ttyACM0")
