"""A foreign driver: ``driver = "module:Class"`` in a rig file names a lab's own stage, laser or receiver.

The class is made with keyword arguments: the keys of its table, and what a rig has for it and it asks for by name
(`OFFERED`). It is found in the folder of the rig file or as Python finds any module, and never from a journal. What
the supervisor can do for it stands in the class: with ``safe_command`` it gets a serial line that the supervisor holds.
"""

from __future__ import annotations

import sys
import typing
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Generic, TypeVar

import msgspec

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
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
    described,
)
from markerseek.drivers._foreign_class import OFFERED, arguments_of, class_of
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
from markerseek.files import Line
from markerseek.wire import Port

_NOT_REAL = ("markerseek.sim.", "markerseek.emulators.")
"""Packages whose classes are no devices; by name, because drivers do not import them."""

_QUIET_S, _ANSWERED_S = 0.2, 2.0
"""Silence of a device that ends the answer to a safe command, and longest time until then, in seconds."""


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
    """Import the class, and compare the keys with its arguments; `ConfigError` says what is missing or does not fit."""
    made = class_of(part, settings.driver, beside=settings.beside)
    _line(part, settings)
    arguments_of(made, settings.keys, offered=dict.fromkeys((*OFFERED, "line")), part=part, driver=settings.driver)


def foreign_line(part: Part, settings: AnyForeign, *, supervised: bool) -> str:
    """What a person must know of a foreign driver before arming it, in one line."""
    made = class_of(part, settings.driver, beside=settings.beside)
    line = _line(part, settings)
    where = getattr(sys.modules.get(made.__module__), "__file__", None) or made.__module__
    if line is None or not supervised:
        reason = "supervisor.enabled is false" if line else f"{made.__name__} names no safe_command"
        how = f"when the search dies, nothing stops it ({reason}): stand by its switch"
    else:
        how = f"when the search dies, the supervisor sends {line.safe_command!r} to {line.path}"
    return f"FOREIGN DRIVER of the {part}: {settings.driver}, of {where}; {how}"


def _line(part: Part, settings: AnyForeign) -> Line | None:
    """The serial line of a class with a safe command."""
    if not settings.beside:
        return None
    made, name = class_of(part, settings.driver, beside=settings.beside), f'{part}.driver = "{settings.driver}"'
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


def _read_away(line: Port, clock: Clock) -> None:
    """Read until nothing comes: the supervisor has sent the safe command, and a device may answer that."""
    ends_s = clock.now_s() + _ANSWERED_S
    while clock.now_s() < ends_s and line.read(4096, timeout_s=_QUIET_S):
        pass


DeviceT = TypeVar("DeviceT", Stage, Laser, Receiver)


class _Named(Generic[DeviceT]):
    """A device with a foreign driver, whose own errors become errors of a device that name its driver."""

    def __init__(self, part: Part, settings: AnyForeign, opening: Opening) -> None:
        self.driver: str = settings.driver
        self.dry_line: DryLine | None = None
        made = class_of(part, settings.driver, beside=settings.beside)
        offered: dict[str, object] = {
            "clock": opening.clock,
            "travel": opening.limits.travel,
            "pulses": opening.pulses,
            "rate_hz": getattr(settings, "rate_hz", None),
            "sampling_hz": getattr(settings, "sampling_hz", None),
            "line": None,
        }
        if _line(part, settings) is not None:
            offered["line"] = self.dry_line = DryLine(opening.line)
            _read_away(self.dry_line, opening.clock)
        with self.in_time("connecting"), self.errors(NotConnectedError):
            self.device: DeviceT = made(
                **arguments_of(made, settings.keys, offered=offered, part=part, driver=settings.driver)
            )

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
            raise kind(f"{self.driver}: {described(problem)}; this is an error of that driver") from problem

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
