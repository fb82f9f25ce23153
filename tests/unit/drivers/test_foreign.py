"""Drivers that a rig file names as ``module:Class``: what is found, what is refused, what the supervisor can do."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from markerseek.contract import check_laser, check_receiver
from markerseek.core import ConfigError, DeviceError, Interval, LaserError, NotConnectedError
from markerseek.drivers import BenchSettings, StandardStage, bench_settings_from
from markerseek.drivers.entry import Opening
from markerseek.drivers.foreign import ForeignLaser, ForeignStage, OwnLaser, OwnStage
from markerseek.rigs import BenchRecipe, bench, bench_fingerprint, read_rig_file
from markerseek.runs.recorded_rig import differences_of_benches
from markerseek.sim import VirtualClock

STAGE = """
from pathlib import Path
import numpy as np
from markerseek.drivers import StageStatus
from markerseek.sim import SimulatedStage
from helper_of_this_lab import SPEED

class Stage:
    def __init__(self, *, travel, clock, zero_deg: float, speed_deg_s: float = SPEED, wheel: int | None = None):
        self.at_deg, self.zero_deg, self.wheel, self.speed_deg_s = 0.0, zero_deg, wheel, speed_deg_s
    def read(self):
        return StageStatus(angle_deg=self.at_deg)
    def go(self, angle_deg):
        self.at_deg = angle_deg
    def stop(self):
        pass

class Held(Stage):
    safe_command = b"STOP\\n"
    baud = 9600
    def __init__(self, *, line, zero_deg: float = 0.0, **more):
        super().__init__(zero_deg=zero_deg, **more)

class Bare(Stage):
    def __init__(self, *, line, travel): ...

class Anything(Stage):
    speed_deg_s = 20.0
    def __init__(self, travel, **keys):
        self.at_deg, self.keys = 0.0, keys

class Filed(Stage):
    speed_deg_s = 20.0
    def __init__(self, *, file: Path | str, axes: list[int] = []):
        self.at_deg, self.file = 0.0, file

class Nowhere(Stage):
    def read(self):
        return StageStatus(angle_deg=float("nan"))

class Numpy(Stage):
    resolution_deg, begin_s = np.float32(0.005), np.int64(2)
    def read(self):
        return StageStatus(angle_deg=np.float32(self.at_deg), moving=np.False_, since_s=np.float32(1.5))

class Number(Stage):
    def read(self):
        return 0.0

class Coarse(Stage):
    resolution_deg = 0.2

class Unknown(Stage):
    speed_deg_s = property(lambda self: -1.0, lambda self, value: None)

class Radians(Stage):
    def go(self, angle_deg):
        self.at_deg = angle_deg * 3.14159265 / 180

class Broken(Stage):
    def __init__(self, **keys):
        raise ZeroDivisionError("a mistake\\nin two lines")

class NoStage:
    def read(self): ...
    def go(self, angle_deg): ...

class Text(Stage):
    safe_command = "STOP"

class Parity(Stage):
    safe_command, parity = b"STOP\\n", "even"

class Derived(Stage, SimulatedStage):
    emulated = False
    def __init__(self):
        self.__dict__.update(at_deg=0.0, speed_deg_s=20.0)

class Leaves(Stage):
    def __init__(self):
        raise SystemExit(3)

def made(): ...
"""

RIG = """kind = "bench"
[stage]
driver = "{driver}"
{keys}
[laser]
driver = "simulated"
[receiver]
driver = "simulated"
"""


@pytest.fixture
def rig(tmp_path: Path) -> Callable[..., Path]:
    """Writes a rig file that names a class of `STAGE`, which lies beside it."""
    (tmp_path / "lab_stage.py").write_text(STAGE)
    (tmp_path / "helper_of_this_lab.py").write_text("SPEED = 20.0\n")
    (tmp_path / "broken_stage.py").write_text("1 / 0\n")
    (tmp_path / "leaving_stage.py").write_text("import sys\nsys.exit(3)\n")
    (tmp_path / "needs_stage.py").write_text("import no_such_library_at_all\n")

    def written(driver: str = "lab_stage:Stage", keys: str = "zero_deg = 1") -> Path:
        path = tmp_path / "rig.toml"
        path.write_text(RIG.format(driver=driver, keys=keys))
        return path

    return written


def read(path: Path) -> BenchSettings:
    settings = read_rig_file(path)
    assert isinstance(settings, BenchSettings)
    return settings


@pytest.mark.parametrize(
    ("driver", "keys", "message"),
    [
        (":Stage", "", 'it must be "module:Class", as in "my_stage:Stage": the name of the file without its folder'),
        ("lab_stage:", "", 'it must be "module:Class"'),
        ("../lab_stage:Stage", "", 'it must be "module:Class"'),
        ("leaving_stage:Stage", "", "importing leaving_stage failed: SystemExit: 3; correct it"),
        (
            "lab_stage:Parity",
            'port = "a"\nzero_deg = 0.0',
            "'stage': parity is 'even', it must be 'N' or 'E' or 'O'",
        ),
        ("no_stage:Stage", "", "there is no file .*/no_stage.py, and no module no_stage is installed"),
        ("lab_stage:Stag", "", "lab_stage has no class Stag; its classes are: .*Stage"),
        ("lab_stage.py:Stage", "", "the name of the file without its folder and .py, a colon"),
        ("lab_stage:made", "", "lab_stage has no class made"),
        ("lab_stage:NoStage", "", "NoStage has no stop; a stage has read, go, stop"),
        ("broken_stage:Stage", "", "importing broken_stage failed: ZeroDivisionError: division by zero"),
        ("needs_stage:Stage", "", "importing needs_stage failed: .*no_such_library_at_all.*; install what it needs"),
        ("lab_stage:Stage", "", "the key stage.zero_deg is missing; add it: lab_stage:Stage needs it"),
        (
            "lab_stage:Stage",
            "zero_deg = 0.0\nsped_deg_s = 1.0",
            "key stage.sped_deg_s is unknown; did you mean stage.speed",
        ),
        ("lab_stage:Stage", "zero_deg = 0.0\nclock = 1.0", "key stage.clock is unknown"),
        ("lab_stage:Stage", 'zero_deg = "left"', "stage.zero_deg is text, it must be a number"),
        (
            "lab_stage:Stage",
            "zero_deg = 0.0\nwheel = 1.5",
            'wheel is a number, it must be a whole number or "none"',
        ),
        ("lab_stage:Filed", 'file = "a"\naxes = [1, "b"]', r"stage.axes\[1\] is text, it must be a whole number"),
        ("lab_stage:Held", "", "the key stage.port is missing; add it: the serial port on which b'STOP"),
        ("lab_stage:Bare", "", "it asks for a line, and has no safe_command; give the class the bytes"),
        ("lab_stage:Bare", 'port = "/dev/a"', "it asks for a line, and has no safe_command; give the class the bytes"),
        ("lab_stage:Text", 'port = "a"\nzero_deg = 0.0', "safe_command is 'STOP', it must be bytes"),
        ("kdc102", "", 'one of: kdc101, guided, ros2, simulated, ximc, or a class of your own as "module:Class"'),
    ],
)
def test_what_is_not_found_or_does_not_fit_is_said(
    rig: Callable[..., Path], driver: str, keys: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read(rig(driver, keys))
    assert "rig.toml: " in str(caught.value)


def test_a_file_beside_the_rig_file_is_found_and_replaces_nothing_installed(
    rig: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / "json.py").write_text(STAGE)
    (tmp_path / "of_this_lab").mkdir()
    (tmp_path / "of_this_lab" / "stages.py").write_text(STAGE)
    with bench(read(rig("of_this_lab.stages:Stage"))) as opened:
        assert isinstance(opened.stage, StandardStage)
    with bench(read(rig("json:Stage"))) as opened:
        assert isinstance(opened.stage, StandardStage)
        assert opened.scanner.angle_deg == 0.0
    import json

    assert json.loads("1") == 1
    assert sys.modules["json"] is json
    with bench(read(rig("lab_stage:Anything", "some = 1\nother = [2]"))) as opened:
        assert opened.stage.logic.device.keys == {"some": 1, "other": [2]}  # type: ignore[attr-defined]


def test_an_annotation_that_msgspec_does_not_know_leaves_the_value_to_the_class(rig: Callable[..., Path]) -> None:
    with bench(read(rig("lab_stage:Filed", 'file = "a"'))) as opened:
        assert opened.stage.logic.device.file == "a"  # type: ignore[attr-defined]


def test_an_error_of_the_class_names_it(rig: Callable[..., Path]) -> None:
    with pytest.raises(
        NotConnectedError, match=r"lab_stage:Broken: ZeroDivisionError: a mistake in two lines; this is"
    ):
        bench(read(rig("lab_stage:Broken")))


def test_numbers_of_numpy_become_numbers_of_python(rig: Callable[..., Path]) -> None:
    """Only these can be written into a journal."""
    settings = read(rig("lab_stage:Numpy")).stage
    assert isinstance(settings, ForeignStage)
    stage = OwnStage(settings, opening())
    status = stage.read()
    rules = stage.rules()
    assert [type(each) for each in (status.angle_deg, status.moving, status.since_s)] == [float, bool, float]
    assert [type(each) for each in (rules.speed_deg_s, rules.resolution_deg, rules.begin_s)] == [float] * 3
    with bench(read(rig("lab_stage:Numpy"))) as opened:
        opened.arm(by="a test")
        msgspec.json.encode(opened.scanner.measure(0.0).angle_deg)


@pytest.mark.parametrize("fired", [3, np.int64(3), np.uint8(3), None, 3.0, True])
def test_a_count_of_pulses_is_a_whole_number_of_python_or_numpy(tmp_path: Path, fired: object) -> None:
    (tmp_path / "lab_laser.py").write_text(
        "class Laser:\n    def __init__(self): self.says = None\n    def fire(self, pulses): ...\n"
        "    def fired(self): return self.says\n    def off(self): ...\n"
    )
    laser = OwnLaser(ForeignLaser(driver="lab_laser:Laser", beside=str(tmp_path)), opening())
    laser.device.says = fired
    if isinstance(fired, float | bool):
        with pytest.raises(LaserError, match=r"fired\(\) returned .*, it must be the number of pulses"):
            laser.fired()
    else:
        assert type(laser.fired()) is (type(None) if fired is None else int)


def opening() -> Opening:
    return SimpleNamespace(  # type: ignore[return-value]
        clock=VirtualClock(),
        limits=SimpleNamespace(travel=Interval(low_deg=-40, high_deg=40)),
        pulses=3,
        stack=ExitStack(),
        line=None,
    )


def test_a_driver_of_another_unit_is_refused_at_its_first_move(rig: Callable[..., Path]) -> None:
    """At rest at 0 nothing shows it; light is only permitted at an angle that was reached."""
    with bench(read(rig("lab_stage:Radians"))) as opened:
        opened.arm(by="a test")
        with pytest.raises(
            DeviceError,
            match=r"the stage did not begin to move at .* obstacle; the reading is 1/57.3 x what was",
        ):
            opened.scanner.measure(20.0)
        assert opened.facts.emulated == ("laser", "receiver")


def test_a_stage_of_ones_own_that_cannot_sweep_is_named_as_in_the_rig_file(rig: Callable[..., Path]) -> None:
    with (
        bench(read(rig("lab_stage:Radians"))) as opened,
        pytest.raises(ConfigError, match=r"its stage \(lab_stage:Radians\) only works with the probe at rest"),
    ):
        _ = opened.scanner.sweeping


def test_a_simulated_device_that_says_it_is_real_is_named_as_emulated(rig: Callable[..., Path]) -> None:
    with bench(read(rig("lab_stage:Derived", ""))) as opened:
        assert opened.facts.emulated == ("stage", "laser", "receiver")


def test_what_the_supervisor_can_do_is_said(rig: Callable[..., Path]) -> None:
    alone = read(rig())
    assert alone.lines == []
    assert "when the search dies, nothing stops it (Stage names no safe_command): stand by" in alone.foreign_lines[0]
    held = read(rig("lab_stage:Held", 'port = "/dev/a"'))
    assert [(line.path, line.safe_command, line.baud) for line in held.lines] == [("/dev/a", b"STOP\n", 9600)]
    assert held.foreign_lines[0].endswith(r"the supervisor sends b'STOP\n' to /dev/a")
    path = rig("lab_stage:Held", 'port = "/dev/a"')
    path.write_text(path.read_text() + "[supervisor]\nenabled = false\n")
    assert "nothing stops it (supervisor.enabled is false)" in read(path).foreign_lines[0]


def test_a_laser_of_ones_own_needs_the_supervisor(tmp_path: Path) -> None:
    (tmp_path / "lab_laser.py").write_text(
        "class Laser:\n    def fire(self, pulses): ...\n    def fired(self): ...\n    def off(self): ...\n"
    )
    tables = {
        "stage": {"driver": "simulated"},
        "laser": {"driver": "lab_laser:Laser", "pulses": 8},
        "receiver": {"driver": "plus", "device": "RF"},
    }
    assert bench_settings_from(tables, beside=str(tmp_path)).laser.pulses == 8
    with pytest.raises(ConfigError, match="enabled is false, and a foreign driver's laser may have no lease"):
        bench_settings_from(tables | {"supervisor": {"enabled": False}}, beside=str(tmp_path))


def test_a_journal_imports_nothing_and_is_compared_by_all_keys_but_the_port(rig: Callable[..., Path]) -> None:
    was = read(rig("lab_stage:Held", 'port = "/dev/a"\nzero_deg = 1.0'))
    now = read(rig("lab_stage:Held", 'port = "/dev/b"\nzero_deg = 2.0'))
    recorded = BenchRecipe.of(was).settings
    assert recorded.stage.beside == ""  # type: ignore[attr-defined]
    assert recorded.table() == was.table()
    assert bench_fingerprint(recorded) == bench_fingerprint(was) != bench_fingerprint(now)
    differences = differences_of_benches(recorded, now)
    assert set(differences) == {"stage.port", "stage.zero_deg"}
    assert [key.startswith(now.comparable) and not key.endswith(".port") for key in sorted(differences)] == [
        False,
        True,
    ]
    with pytest.raises(ConfigError, match="only imported for a rig file"):
        bench(recorded)


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("Nowhere", r"read\(\) says nan deg, which is no angle"),
        ("Number", r"lab_stage:Number: read\(\) returned 0.0, it must be a markerseek.drivers.StageStatus"),
        ("Coarse", r"resolution_deg is 0.2, it must be above 0 and at most 0.1 deg"),
        ("Unknown", r"speed_deg_s is -1.0, it must be a number above 0"),
    ],
)
def test_what_a_stage_lacks_is_said(rig: Callable[..., Path], driver: str, said: str) -> None:
    with pytest.raises(DeviceError, match=said):
        bench(read(rig(f"lab_stage:{driver}")))


def test_laser_and_receiver_are_tried_without_light() -> None:
    from markerseek.sim import SimulatedLaser, SimulatedReceiver

    clock = VirtualClock()
    world = SimpleNamespace(flashes=[], flash=None)
    laser = SimulatedLaser(world=world, clock=clock)  # type: ignore[arg-type]
    assert [each.problem for each in check_laser(laser)] == [None, None]
    receiver = SimulatedReceiver(world=world, clock=clock, readout_s=0.0)  # type: ignore[arg-type]
    assert [each.problem for each in check_receiver(receiver)] == [None, None]
    assert "one of them is missing" in str(check_receiver(laser)[0].problem)  # type: ignore[arg-type]


def test_simulated_parts_are_simulated_together() -> None:
    tables = {"stage": {"driver": "simulated"}, "laser": {"driver": "simulated"}, "receiver": {"driver": "simulated"}}
    with pytest.raises(ConfigError, match="simulated is laser and receiver: name simulated in both, or in neither"):
        bench_settings_from(tables | {"receiver": {"driver": "sonixdaq", "folder": "daq"}})
    with bench(bench_settings_from(tables)) as rig:
        assert rig.facts.emulated == ("stage", "laser", "receiver")
        rig.arm(by="a test")
        sample = rig.scanner.measure(0.5)
        assert sample.frame is not None
        assert sample.angle_deg == pytest.approx(0.5, abs=1e-3)
        with pytest.raises(DeviceError):
            rig.scanner.measure(40.0)
