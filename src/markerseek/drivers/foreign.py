"""A foreign driver: ``driver = "module:Class"`` in a rig file names a lab's own stage, laser or receiver.

The class is made with keyword arguments: the keys of its table, and what a rig has for it and it asks for by name
(`_offered`). It is found in the folder of the rig file or as Python finds any module, and never from a journal. What
the supervisor can do for it stands in the class: with ``safe_command`` it gets a serial line that the supervisor holds.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
import typing
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
    DeviceTimeoutError,
    Frame,
    Interval,
    Laser,
    LaserError,
    MarkerseekError,
    MoveError,
    NotConnectedError,
    Permit,
    Receiver,
    Stage,
)
from markerseek.drivers._time_limit import time_limit
from markerseek.drivers.entry import (
    DeviceSettings,
    Entry,
    LaserSettings,
    Opening,
    Part,
    ReceiverSettings,
    StageSettings,
)
from markerseek.files import Line, nearest_key, setting_from
from markerseek.wire import Port

_NOT_REAL = ("markerseek.sim.", "markerseek.emulators.")
"""Packages whose classes are no devices; by name, because drivers do not import them."""

_QUIET_S, _ANSWERED_S = 0.2, 2.0
"""Silence of a device that ends the answer to a safe command, and longest time until then, in seconds."""

METHODS: dict[Part, tuple[str, ...]] = {
    "stage": ("move_to", "stop"),
    "laser": ("fire", "disarm"),
    "receiver": ("settle", "arm", "acquire"),
}
"""Methods of the three protocols (`markerseek.core`), which a class must have."""


class ForeignStage(StageSettings, frozen=True, kw_only=True):
    """A stage with a foreign driver."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    """Keys that only its class knows."""
    beside: str = ""
    """Folder of the rig file, in which its module may lie; empty for one of a journal, which is never imported."""


class ForeignLaser(LaserSettings, frozen=True, kw_only=True):
    """A laser with a foreign driver."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    beside: str = ""


class ForeignReceiver(ReceiverSettings, frozen=True, kw_only=True):
    """A receiver with a foreign driver; it records as many pulses as it is triggered."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    beside: str = ""


Foreign = (ForeignStage, ForeignLaser, ForeignReceiver)
AnyForeign: typing.TypeAlias = ForeignStage | ForeignLaser | ForeignReceiver


def split_keys(table: Mapping[str, object], kind: type[DeviceSettings]) -> dict[str, object]:
    """A table of a rig file with the keys that only the class knows apart from the others."""
    common = {name for name in kind.__struct_fields__ if name not in ("keys", "beside")}
    own = {key: None if value == "none" else value for key, value in table.items() if key not in common}
    return {key: value for key, value in table.items() if key in common} | {"keys": own}


def require_class(part: Part, settings: AnyForeign) -> None:
    """Import the class, and compare the keys with its arguments; `ConfigError` says what was not found, or not fits."""
    made = _class_of(part, settings)
    _line(part, settings)
    _arguments(part, settings, made, dict.fromkeys((*_OFFERED, "line")))


def foreign_line(part: Part, settings: AnyForeign, *, supervised: bool) -> str:
    """What a person must know of a foreign driver before arming it, in one line."""
    made = _class_of(part, settings)
    line = _line(part, settings)
    where = getattr(sys.modules.get(made.__module__), "__file__", None) or made.__module__
    if line is None or not supervised:
        reason = "supervisor.enabled is false" if line else f"{made.__name__} names no safe_command"
        how = f"when the search dies, nothing stops it ({reason}): stand by its switch"
    else:
        how = f"when the search dies, the supervisor sends {line.safe_command!r} to {line.path}"
    return f"FOREIGN DRIVER of the {part}: {settings.driver}, of {where}; {how}"


_OFFERED = {
    "clock": "all waiting is done on it",
    "travel": "angles at which the probe may be",
    "pulses": "pulses of one acquisition",
    "rate_hz": "pulses per second",
    "sampling_hz": "sampling frequency",
}
"""What a class may ask for by name, besides ``line`` and the keys of its table."""


def _class_of(part: Part, settings: AnyForeign) -> type:
    name = f'{part}.driver = "{settings.driver}"'
    module_name, _, class_name = settings.driver.partition(":")
    if not (class_name.isidentifier() and all(word.isidentifier() for word in module_name.split("."))):
        raise ConfigError(
            f'{name}: it must be "module:Class", as in "my_stage:Stage": the name of the file without its folder and '
            ".py, a colon, and that of the class"
        )
    if not settings.beside:
        raise ConfigError(f"{name}: a foreign driver is only imported for a rig file; name the rig file")
    file = Path(settings.beside) / f"{module_name}.py"
    try:
        with time_limit(f"importing {module_name}"):
            module = _from_file(module_name, str(file)) if file.is_file() else _installed(module_name, settings.beside)
    except ModuleNotFoundError as problem:
        if problem.name is None or not f"{module_name}.".startswith(f"{problem.name}."):
            raise ConfigError(f"{name}: importing {module_name} failed: {problem}; install what it needs") from problem
        raise ConfigError(
            f"{name}: there is no file {file}, and no module {module_name} is installed; correct the name, or put the "
            "file beside the rig file"
        ) from problem
    except DeviceTimeoutError as problem:
        raise ConfigError(f"{name}: {problem}") from problem
    except MarkerseekError:
        raise
    # Code of the user: any error in it is reported under its name, and not as one of this program.
    except (Exception, SystemExit) as problem:
        raise ConfigError(f"{name}: importing {module_name} failed: {_described(problem)}; correct it") from problem
    made = getattr(module, class_name, None)
    if not isinstance(made, type):
        there = [
            key
            for key, value in vars(module).items()
            if isinstance(value, type) and value.__module__ == module.__name__ and not key.startswith("_")
        ]
        raise ConfigError(
            f"{name}: {module_name} has no class {class_name}; its classes are: {', '.join(there) or 'none'}"
        )
    missing = [method for method in METHODS[part] if not callable(getattr(made, method, None))]
    if missing:
        raise ConfigError(
            f"{name}: {class_name} has no {' and no '.join(missing)}; a {part} has {', '.join(METHODS[part])} "
            "(docs/how-to/bring-your-own-stage.md)"
        )
    return made


@cache
def _from_file(name: str, path: str) -> Any:
    """Module of a file beside the rig file; an installed one of that name does not take its place."""
    _find_beside(str(Path(path).parent))
    # A name of its own: another rig file's module may have the same.
    spec = importlib.util.spec_from_file_location(f"markerseek_rig.{abs(hash(path)):x}.{name}", path)
    assert spec is not None  # noqa: S101  a path that ends with .py has a loader
    assert spec.loader is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[spec.name]
        raise
    return module


def _installed(name: str, beside: str) -> Any:
    _find_beside(beside)
    return importlib.import_module(name)


def _find_beside(folder: str) -> None:
    """Let modules of the rig file's folder be found, after all that is installed: none of them can be replaced."""
    if folder not in sys.path:
        sys.path.append(folder)


def _line(part: Part, settings: AnyForeign) -> Line | None:
    """The serial line of a class with a safe command."""
    if not settings.beside:
        return None
    made, name = _class_of(part, settings), f'{part}.driver = "{settings.driver}"'
    safe = getattr(made, "safe_command", None)
    if safe is None:
        return None
    if not isinstance(safe, bytes):
        raise ConfigError(f"{name}: safe_command is {safe!r}, it must be bytes, as in b'STOP\\r'")
    port = settings.keys.get("port")
    if not isinstance(port, str):
        raise ConfigError(f"the key {part}.port is missing; add it: the serial port on which {safe!r} is sent")
    return Line(
        name=part,
        path=port,
        safe_command=safe,
        baud=getattr(made, "baud", 115200),
        parity=getattr(made, "parity", "N"),
        rtscts=getattr(made, "rtscts", False),
    )


def _arguments(part: Part, settings: AnyForeign, made: type, offered: Mapping[str, object]) -> dict[str, object]:
    """Keyword arguments of the class; `ConfigError` if a key is unknown, missing, or of another type."""
    parameters = _parameters(made, name=f'{part}.driver = "{settings.driver}"')
    takes_any = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    named = {
        name: each for name, each in parameters.items() if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
    }
    hints = _hints(made)
    given: dict[str, object] = {}
    supervised_port = hasattr(made, "safe_command")
    for key, value in settings.keys.items():
        if key == "port" and supervised_port and "port" not in named:
            continue
        if key not in named and takes_any and key not in offered:
            given[key] = value
            continue
        nearest_key(key, [name for name in named if name not in offered], prefix=f"{part}.")
        given[key] = setting_from(value, hints[key], name=f"{part}.{key}") if key in hints else value
    for name, parameter in named.items():
        if name in given or name not in offered:
            if name not in given and parameter.default is parameter.empty:
                raise ConfigError(f"the key {part}.{name} is missing; add it: {settings.driver} needs it")
        elif name == "line" and not supervised_port:
            raise ConfigError(
                f'{part}.driver = "{settings.driver}": it asks for a line, and has no safe_command; give the class the '
                "bytes that make the device safe, as in safe_command = b'STOP\\r'"
            )
        else:
            given[name] = offered[name]
    return given


def _parameters(made: type, *, name: str) -> Mapping[str, inspect.Parameter]:
    """Arguments of the class; `ConfigError` if one cannot be given by its name."""
    try:
        parameters = inspect.signature(made).parameters
    except (ValueError, TypeError) as problem:
        raise ConfigError(
            f"{name}: the arguments of {made.__name__} are not known ({problem}); derive a class with an __init__"
        ) from problem
    nameless = [each.name for each in parameters.values() if each.kind is each.POSITIONAL_ONLY]
    if nameless:
        raise ConfigError(
            f"{name}: {made.__name__} takes {', '.join(nameless)} by position only, and arguments are given by name; "
            "take the / out of its __init__"
        )
    return parameters


def _hints(made: type) -> dict[str, Any]:
    try:
        return typing.get_type_hints(made.__init__)  # type: ignore[misc]
    # An annotation that only a type checker can resolve says nothing here.
    except Exception:  # noqa: BLE001
        return {}


class DryLine:
    """The line of a foreign driver; while it is dry, nothing that is written reaches the device."""

    def __init__(self, line: Port) -> None:
        self._line = line
        self._is_dry = False

    def write(self, data: bytes) -> None:
        """Send all of it, or nothing while it is dry."""
        if not self._is_dry:
            self._line.write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As of the line."""
        return self._line.read(size, timeout_s=timeout_s)

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    @contextmanager
    def dry(self) -> Iterator[None]:
        """Keep from the device what is written meanwhile."""
        self._is_dry = True
        try:
            yield
        finally:
            self._is_dry = False


DeviceT = TypeVar("DeviceT", Stage, Laser, Receiver)


class _Named(Generic[DeviceT]):
    """A device with a foreign driver, whose own errors become errors of a device that name its driver."""

    def __init__(self, part: Part, settings: AnyForeign, opening: Opening) -> None:
        self.driver: str = settings.driver
        self.dry_line: DryLine | None = None
        made = _class_of(part, settings)
        offered: dict[str, object] = {
            "clock": opening.clock,
            "travel": opening.limits.travel,
            "pulses": opening.pulses,
            "rate_hz": getattr(settings, "rate_hz", None),
            "sampling_hz": getattr(settings, "sampling_hz", None),
            "line": None,
        }
        if _line(part, settings) is not None:
            self.dry_line = DryLine(opening.line)
            self._read_away(opening.clock)
            offered["line"] = self.dry_line
        with self.in_time("connecting"), self.errors(NotConnectedError):
            self.device: DeviceT = made(**_arguments(part, settings, made, offered))

    def _read_away(self, clock: Clock) -> None:
        """Read until nothing comes: the supervisor has sent the safe command, and a device may answer that."""
        assert self.dry_line is not None  # noqa: S101  made just before
        ends_s = clock.now_s() + _ANSWERED_S
        while clock.now_s() < ends_s and self.dry_line.read(4096, timeout_s=_QUIET_S):
            pass

    def in_time(self, what: str) -> AbstractContextManager[None]:
        """Raise `DeviceTimeoutError` if what is done with it takes too long; nothing moves and nothing fires."""
        return time_limit(f"{self.driver}: {what}")

    @contextmanager
    def errors(self, kind: type[DeviceError]) -> Iterator[None]:
        """Give an error of the class its name."""
        try:
            yield
        except MarkerseekError:
            raise
        except (Exception, SystemExit) as problem:
            raise kind(f"{self.driver}: {_described(problem)}; this is an error of that driver") from problem

    @property
    def emulated(self) -> bool:
        """Whether it says that it is an emulator, or is a simulated or emulated device of ours, whatever it says."""
        ours = any(each.__module__.startswith(_NOT_REAL) for each in type(self.device).__mro__)
        with self.errors(NotConnectedError):
            return ours or bool(getattr(self.device, "emulated", False))

    @property
    def description(self) -> str:
        """What it says of itself, after the name of its driver."""
        with self.errors(NotConnectedError):
            says = getattr(self.device, "description", None)
        return f"{self.driver} (foreign driver{f': {says}' if isinstance(says, str) else ''})"


class NamedStage(_Named[Stage]):
    """A stage with a foreign driver."""

    @property
    def limits(self) -> Interval:
        """As of the class."""
        with self.errors(MoveError):
            return self.device.limits

    @property
    def angle_deg(self) -> float:
        """As of the class."""
        with self.errors(MoveError):
            return self.device.angle_deg

    def move_to(self, angle_deg: float) -> float:
        """As of the class."""
        with self.errors(MoveError):
            return self.device.move_to(angle_deg)

    def stop(self) -> None:
        """As of the class."""
        with self.errors(MoveError):
            self.device.stop()


class NamedLaser(_Named[Laser]):
    """A laser with a foreign driver."""

    def fire(self, permit: Permit) -> int:
        """As of the class."""
        with self.errors(LaserError):
            return self.device.fire(permit)

    def disarm(self) -> None:
        """As of the class."""
        with self.errors(LaserError):
            self.device.disarm()


class NamedReceiver(_Named[Receiver]):
    """A receiver with a foreign driver."""

    def settle(self) -> None:
        """As of the class."""
        with self.errors(DeviceError):
            self.device.settle()

    def arm(self, permit: Permit) -> None:
        """As of the class."""
        with self.errors(DeviceError):
            self.device.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        """As of the class."""
        with self.errors(DeviceError):
            return self.device.acquire(permit)


def _described(problem: BaseException) -> str:
    """An error as its class and message in one line."""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())}"


STAGE_ENTRY: Entry[ForeignStage, NamedStage] = Entry(
    settings=ForeignStage,
    open=lambda settings, opening: NamedStage("stage", settings, opening),
    describe=lambda _settings, stage: f"stage {stage.description}",
    line=lambda settings: _line("stage", settings),
    same=("",),
)
LASER_ENTRY: Entry[ForeignLaser, NamedLaser] = Entry(
    settings=ForeignLaser,
    open=lambda settings, opening: NamedLaser("laser", settings, opening),
    describe=lambda _settings, laser: f"laser {laser.description}",
    line=lambda settings: _line("laser", settings),
    same=("",),
    without_supervisor="a foreign driver's laser may have no lease of its own",
)
RECEIVER_ENTRY: Entry[ForeignReceiver, NamedReceiver] = Entry(
    settings=ForeignReceiver,
    open=lambda settings, opening: NamedReceiver("receiver", settings, opening),
    describe=lambda _settings, receiver: f"receiver {receiver.description}",
    line=lambda settings: _line("receiver", settings),
    same=("",),
)
