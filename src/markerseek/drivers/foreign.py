"""A foreign driver: ``driver = "module:Class"`` in a rig file names a lab's own stage, laser or receiver.

The class has the verbs of its part (`_METHODS`); limits, deadlines, read-back, permits and stop are those of
`StandardStage`, `StandardLaser` and `StandardReceiver`. It is made with keyword arguments: the keys of its table, and
what a rig has for it and it asks for by name (`OFFERED`). It is found in the folder of the rig file, as Python finds
any module, or by an entry point; never from a journal. With ``safe_command`` it gets a serial line that the supervisor
holds.
"""

from __future__ import annotations

import inspect
import sys
import typing
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from numbers import Integral
from typing import Any, ClassVar

import msgspec
import numpy as np

from markerseek.core import (
    MAX_RESOLUTION_DEG,
    AcquisitionError,
    Clock,
    ConfigError,
    DeviceError,
    Int16,
    LaserError,
    MarkerseekError,
    MoveError,
    NotConnectedError,
    described,
    is_finite,
)
from markerseek.drivers._stage_rules import StageRules, StageStatus
from markerseek.drivers.entry import (
    AnyEntry,
    DeviceKeys,
    Entry,
    LaserKeys,
    Opening,
    Part,
    ReceiverKeys,
    StageKeys,
    installed_drivers,
)
from markerseek.drivers.standard_laser import StandardLaser
from markerseek.drivers.standard_receiver import StandardReceiver, mean_counts
from markerseek.drivers.standard_stage import StandardStage, require_approach
from markerseek.files import Line, is_class_name, nearest_key, own_module, setting_from
from markerseek.wire import Port

_METHODS: dict[Part, tuple[str, ...]] = {
    "stage": ("read", "go", "stop"),
    "laser": ("fire", "fired", "off"),
    "receiver": ("read",),
}
"""Verbs that a class must have."""

OFFERED = {
    "clock": "all waiting is done on it",
    "travel": "angles at which the probe may be",
    "pulses": "pulses of one acquisition",
    "rate_hz": "pulses per second",
    "sampling_hz": "sampling frequency",
}
"""What a class may ask for by name, besides ``line`` and the keys of its table."""

_NOT_REAL = ("markerseek.sim.", "markerseek.emulators.")
"""Packages whose classes are no devices; by name, because drivers do not import them."""

_QUIET_S = 0.2
_ANSWERED_S = 2.0
"""Silence of a device that ends the answer to a safe command, and longest time until then, in seconds."""

_UNEXPECTED_DEG = 0.5
_BEGIN_S = 1.0
_BRAKE_S = 2.0
"""Farthest that a stage of one's own may be from where it should be, in degrees; time without motion after which it
counts as stuck, and time that it may take to stop where its acceleration is not known, in seconds."""


class ForeignStage(StageKeys, frozen=True, kw_only=True, tag=False):
    """A stage with a foreign driver."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    """Keys that only its class knows."""
    beside: str = ""
    """Folder of the rig file, in which its module may lie; empty for one of a journal, which is never imported."""


class ForeignLaser(LaserKeys, frozen=True, kw_only=True, tag=False):
    """A laser with a foreign driver."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    beside: str = ""


class ForeignReceiver(ReceiverKeys, frozen=True, kw_only=True, tag=False):
    """A receiver with a foreign driver; it records as many pulses as it is triggered."""

    driver: str
    keys: dict[str, Any] = msgspec.field(default_factory=dict)
    beside: str = ""


Foreign: typing.TypeAlias = ForeignStage | ForeignLaser | ForeignReceiver


def _driver_key(settings: Foreign) -> str:
    return f'{settings.part}.driver = "{settings.driver}"'


def class_of(settings: Foreign) -> type:
    """Return the class that a rig file names, with the methods of its part.

    Raises `ConfigError` where it is not found, fails, or lacks a method.
    """
    driver = settings.driver
    beside = settings.beside
    name = _driver_key(settings)
    class_path = installed_drivers().get(driver, driver)
    if not is_class_name(class_path):
        raise ConfigError(
            f'{name}: it must be "module:Class", as in "my_stage:Stage": the name of the file without its folder and '
            ".py, a colon, and that of the class"
        )
    if not beside:
        raise ConfigError(f"{name}: a foreign driver is only imported for a rig file; name the rig file")
    module_name, _, class_name = class_path.partition(":")
    module = own_module(module_name, beside if ":" in driver else "", named_by=name, place="beside the rig file")
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
    missing = [method for method in _METHODS[settings.part] if not callable(getattr(made, method, None))]
    if missing:
        raise ConfigError(
            f"{name}: {class_name} has no {' and no '.join(missing)}; a {settings.part} has "
            f"{', '.join(_METHODS[settings.part])} "
            "(docs/how-to/bring-your-own-stage.md)"
        )
    return made


def class_arguments(made: type, settings: Foreign, offered: Mapping[str, object]) -> dict[str, object]:
    """Return the keyword arguments of the class, from the keys of its table and what the rig has for it.

    Raises `ConfigError` if a key is unknown, missing, or of another type.
    """
    try:
        parameters = inspect.signature(made).parameters
    except (ValueError, TypeError) as problem:
        raise ConfigError(
            f"{_driver_key(settings)}: its arguments are not known ({problem}); derive a class with an __init__"
        ) from problem
    takes_any = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    named = {
        name: each for name, each in parameters.items() if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
    }
    hints = _hints(made)
    given: dict[str, object] = {}
    supervised_port = hasattr(made, "safe_command")
    # Before the keys: without a safe command the class has no port, and its key would be called unknown.
    if "line" in named and "line" in offered and not supervised_port:
        raise ConfigError(
            f"{_driver_key(settings)}: it asks for a line, and has no safe_command; give the class the "
            "bytes that make the device safe, as in safe_command = b'STOP\\r'"
        )
    for key, value in settings.keys.items():
        if key == "port" and supervised_port and "port" not in named:
            continue
        if key not in named and takes_any and key not in offered:
            given[key] = value
            continue
        nearest_key(key, [name for name in named if name not in offered], prefix=f"{settings.part}.")
        given[key] = value
        # An annotation that msgspec does not know says nothing here: the class checks the value itself.
        with suppress(TypeError):
            given[key] = setting_from(value, hints.get(key, Any), name=f"{settings.part}.{key}")
    for name, parameter in named.items():
        if name in given:
            continue
        if name in offered:
            given[name] = offered[name]
        elif parameter.default is parameter.empty:
            raise ConfigError(f"the key {settings.part}.{name} is missing; add it: {settings.driver} needs it")
    return given


def _hints(made: type) -> dict[str, Any]:
    try:
        return typing.get_type_hints(made.__init__)  # type: ignore[misc]
    # An annotation that only a type checker can resolve says nothing here.
    except Exception:  # noqa: BLE001
        return {}


def split_keys(table: Mapping[str, object], kind: type[DeviceKeys]) -> dict[str, object]:
    """Return a table of a rig file with the keys that only the class knows apart from the others."""
    common = {name for name in kind.__struct_fields__ if name not in ("keys", "beside")}
    own = {key: None if value == "none" else value for key, value in table.items() if key not in common}
    return {key: value for key, value in table.items() if key in common} | {"keys": own}


def require_class(settings: Foreign) -> None:
    """Import the class, and compare the keys with its arguments; `ConfigError` says what is missing or does not fit."""
    made = class_of(settings)
    _line(settings)
    class_arguments(made, settings, dict.fromkeys((*OFFERED, "line")))


def foreign_line(settings: Foreign, *, supervised: bool) -> str:
    """Return what a person must know of a foreign driver before arming it, in one line."""
    made = class_of(settings)
    line = _line(settings)
    where = getattr(sys.modules.get(made.__module__), "__file__", None) or made.__module__
    if line is None or not supervised:
        reason = "supervisor.enabled is false" if line else f"{made.__name__} names no safe_command"
        how = f"when the search dies, nothing stops it ({reason}): stand by its switch"
    else:
        how = f"when the search dies, the supervisor sends {line.safe_command!r} to {line.path}"
    return f"FOREIGN DRIVER of the {settings.part}: {settings.driver}, of {where}; {how}"


def _line(settings: Foreign) -> Line | None:
    """Return the serial line of a class with a safe command."""
    if not settings.beside:
        return None
    made = class_of(settings)
    safe = getattr(made, "safe_command", None)
    if safe is None:
        return None
    if not isinstance(safe, bytes):
        raise ConfigError(f"{_driver_key(settings)}: safe_command is {safe!r}, it must be bytes, as in b'STOP\\r'")
    port = settings.keys.get("port")
    if not isinstance(port, str):
        raise ConfigError(f"the key {settings.part}.port is missing; add it: the serial port on which {safe!r} is sent")
    return Line(
        name=settings.part,
        path=port,
        safe_command=safe,
        baud=getattr(made, "baud", 115200),
        parity=getattr(made, "parity", "N"),
        rtscts=getattr(made, "rtscts", False),
    )


def _read_away(line: Port, clock: Clock) -> None:
    """Read until nothing comes: the supervisor has sent the safe command, and a device may answer that."""
    ends_s = clock.now_s() + _ANSWERED_S
    while clock.now_s() < ends_s and line.read(4096, timeout_s=_QUIET_S):
        pass


class OwnDevice:
    """A device of a class of one's own, whose errors become errors of a device that name its driver."""

    error: ClassVar[type[DeviceError]]

    def __init__(self, settings: Foreign, opening: Opening) -> None:
        self.driver: str = settings.driver
        made = class_of(settings)
        offered: dict[str, object] = {
            "clock": opening.clock,
            "travel": opening.limits.travel,
            "pulses": opening.pulses,
            "rate_hz": getattr(settings, "rate_hz", None),
            "sampling_hz": getattr(settings, "sampling_hz", None),
            "line": None,
        }
        if _line(settings) is not None:
            offered["line"] = opening.line
            _read_away(opening.line, opening.clock)
        with self._errors(NotConnectedError):
            self.device: Any = made(**class_arguments(made, settings, offered))
        opening.stack.enter_context(closing(self))

    def close(self) -> None:
        """Close the device, where its class can."""
        if hasattr(self.device, "close"):
            self.call("close")

    @contextmanager
    def _errors(self, kind: type[DeviceError]) -> Iterator[None]:
        """Give an error of the class its name."""
        try:
            yield
        except MarkerseekError:
            raise
        except (Exception, SystemExit) as problem:
            raise kind(f"{self.driver}: {described(problem)}; this is an error of that driver") from problem

    def call(self, verb: str, *arguments: object) -> Any:
        """Return what a verb of the class returns."""
        with self._errors(self.error):
            return getattr(self.device, verb)(*arguments)

    def require(self, says: object, *kinds: type, verb: str, wanted: str) -> None:
        """Refuse what a verb has returned if it has another type."""
        if not isinstance(says, kinds) or isinstance(says, bool):
            raise self.error(f"{self.driver}: {verb}() returned {says!r}, it must be {wanted}; correct that driver")

    def number(self, name: str, default: float | None) -> float | None:
        """Return a number that the class has as an attribute, or the default."""
        with self._errors(NotConnectedError):
            value = getattr(self.device, name, default)
        if value is not default and not (is_finite(value) and value > 0):
            raise NotConnectedError(f"{self.driver}: {name} is {value!r}, it must be a number above 0; correct it")
        return None if value is None else float(value)

    @property
    def emulated(self) -> bool:
        """Whether it says that it is an emulator, or is a simulated or emulated device of ours, whatever it says."""
        ours = any(each.__module__.startswith(_NOT_REAL) for each in type(self.device).__mro__)
        with self._errors(NotConnectedError):
            return ours or bool(getattr(self.device, "emulated", False))

    @property
    def description(self) -> str:
        """What it says of itself, after the name of its driver."""
        with self._errors(NotConnectedError):
            says = getattr(self.device, "description", None)
        return f"{self.driver} (foreign driver{f': {says}' if isinstance(says, str) else ''})"


class OwnStage(OwnDevice):
    """The verbs of a stage of one's own."""

    error = MoveError

    def read(self) -> StageStatus:
        """As of the class."""
        status = self.call("read")
        self.require(status, StageStatus, verb="read", wanted="a markerseek.drivers.StageStatus")
        assert isinstance(status, StageStatus)  # noqa: S101  for mypy
        if not is_finite(status.angle_deg):
            raise MoveError(
                f"{self.driver}: read() says {status.angle_deg!r} deg, which is no angle; correct that driver"
            )
        if not (status.since_s is None or is_finite(status.since_s)):
            raise MoveError(
                f"{self.driver}: read() says since_s {status.since_s!r}, which is no time; correct that driver"
            )
        # Numbers of Python: those of NumPy, which drivers return too, have no place in a journal.
        return replace(
            status,
            angle_deg=float(status.angle_deg),
            moving=bool(status.moving),
            since_s=None if status.since_s is None else float(status.since_s),
        )

    def go(self, angle_deg: float) -> None:
        """As of the class."""
        self.call("go", angle_deg)

    def stop(self) -> None:
        """As of the class."""
        self.call("stop")

    def rules(self) -> StageRules:
        """Return how it moves, by its attributes."""
        speed_deg_s = self.number("speed_deg_s", None)
        if speed_deg_s is None:
            raise NotConnectedError(f"{self.driver}: it has no speed_deg_s, its speed in deg/s; add the attribute")
        resolution_deg = self.number("resolution_deg", MAX_RESOLUTION_DEG) or MAX_RESOLUTION_DEG
        if resolution_deg > MAX_RESOLUTION_DEG:
            raise NotConnectedError(
                f"{self.driver}: resolution_deg is {resolution_deg!r}, it must be above 0 and at most "
                f"{MAX_RESOLUTION_DEG} deg"
            )
        acceleration_deg_s2 = self.number("acceleration_deg_s2", None)
        return StageRules(
            speed_deg_s=speed_deg_s,
            acceleration_deg_s2=acceleration_deg_s2,
            resolution_deg=resolution_deg,
            arrival_deg=resolution_deg,
            unexpected_deg=_UNEXPECTED_DEG,
            unsteady_deg=_UNEXPECTED_DEG,
            begin_s=self.number("begin_s", _BEGIN_S) or _BEGIN_S,
            brake_s=_BRAKE_S if acceleration_deg_s2 is None else speed_deg_s / acceleration_deg_s2,
            approach_deg=self.number("approach_deg", 0.0) or 0.0,
        )


class OwnLaser(OwnDevice):
    """The verbs of a laser of one's own."""

    error = LaserError

    def fire(self, pulses: int) -> None:
        """As of the class."""
        self.call("fire", pulses)

    def fired(self) -> int | None:
        """As of the class."""
        fired = self.call("fired")
        if fired is None:
            return None
        self.require(fired, Integral, verb="fired", wanted="the number of pulses, or None while they go on")
        return int(fired)

    def off(self) -> None:
        """As of the class."""
        self.call("off")


class OwnMessages(OwnDevice):
    """The frames that a receiver of one's own reads, one for each trigger."""

    error = AcquisitionError
    used = "frames"
    called = "frames"
    cure = "the device must give one frame for each trigger"
    check = "the trigger and the device"

    def arm(self) -> None:
        """As of the class, which need not have it."""
        if hasattr(self.device, "arm"):
            self.call("arm")

    def take(self) -> tuple[list[np.ndarray], bool]:
        """Return what the class has read."""
        frames = self.call("read")
        self.require(frames, list, verb="read", wanted="a list of frames")
        for each in frames:
            if not (isinstance(each, np.ndarray) and each.dtype == np.int16 and each.ndim == 2):
                raise AcquisitionError(
                    f"{self.driver}: read() gave a frame of {getattr(each, 'dtype', type(each).__name__)}, shape "
                    f"{getattr(each, 'shape', ())}; channel data are int16 of channels x samples"
                )
        return list(frames), bool(frames)

    def samples(self, messages: list[np.ndarray]) -> Int16[np.ndarray, "channels samples"]:
        """Return the mean of frames; `AcquisitionError` if their shapes differ."""
        if len({each.shape for each in messages}) > 1:
            shapes = [each.shape for each in messages]
            raise AcquisitionError(f"{self.driver}: frames of the shapes {shapes} in one acquisition")
        return mean_counts(messages)


def _open_stage(settings: ForeignStage, opening: Opening) -> StandardStage[OwnStage]:
    logic = OwnStage(settings, opening)
    rules = logic.rules()
    if rules.approach_deg:
        require_approach(opening.limits, approach_from="below", approach_deg=rules.approach_deg)
    return StandardStage(logic, clock=opening.clock, travel=opening.limits.travel, rules=rules)


def _open_laser(settings: ForeignLaser, opening: Opening) -> StandardLaser[OwnLaser]:
    logic = OwnLaser(settings, opening)
    return StandardLaser(logic, clock=opening.clock, rate_hz=settings.rate_hz, name=settings.driver)


def _open_receiver(settings: ForeignReceiver, opening: Opening) -> StandardReceiver[OwnMessages]:
    messages = OwnMessages(settings, opening)
    return StandardReceiver(
        messages,
        clock=opening.clock,
        dark_triggers=opening.pulses,
        sampling_hz=settings.sampling_hz,
        timeout_s=messages.number("timeout_s", 20.0) or 0.0,
        quiet_s=messages.number("quiet_s", 0.2) or 0.0,
    )


FOREIGN: dict[Part, AnyEntry] = {
    "stage": Entry(
        settings=ForeignStage,
        open=_open_stage,
        describe=lambda _settings, stage: f"stage {stage.logic.description}",
        line=_line,
        same=("",),
    ),
    "laser": Entry(
        settings=ForeignLaser,
        open=_open_laser,
        describe=lambda _settings, laser: f"laser {laser.logic.description}",
        line=_line,
        same=("",),
        without_supervisor="a foreign driver's laser may have no lease of its own",
    ),
    "receiver": Entry(
        settings=ForeignReceiver,
        open=_open_receiver,
        describe=lambda _settings, receiver: f"receiver {receiver.messages.description}",
        line=_line,
        same=("",),
    ),
}
"""Entry of each part for a class of the user's own."""
