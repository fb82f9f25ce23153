"""The errors of markerseek, one tree.

::

    MarkerseekError
    ├── ConfigError            an argument, option or rig file is wrong
    │   └── MissingExtraError  an optional package is not installed
    ├── RecordError            a file cannot be read or written
    ├── SearchError            a policy was used against its rules
    └── DeviceError            a device, or what it sent, cannot be trusted
        ├── NotConnectedError  it does not answer
        ├── DeviceTimeoutError it answered too late
        ├── LimitError         it was asked to leave its limits
        ├── MoveError          the stage did not arrive
        ├── LaserError         the laser did not do what was permitted
        └── AcquisitionError   a frame was refused, or none came
            ├── ReadingError    a number made of it cannot be a measurement
            └── SaturationError it is at full scale, and would be again

A message names the argument, its value with the unit, the limit, and what to do about it.
Programs tell the classes apart; the command line maps them to exit codes by ``exit_code``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar


class MarkerseekError(Exception):
    """Base of all errors that markerseek raises on purpose."""

    exit_code: ClassVar[int] = 1


# Also a ValueError: callers of the library expect that for a wrong argument.
class ConfigError(MarkerseekError, ValueError):
    """An argument, an option or a rig file holds something that cannot be used."""

    exit_code: ClassVar[int] = 2


def extra_install(extra: str) -> str:
    """Return how an extra is installed: markerseek is on no package index, so from its clone or its wheel."""
    return f"pip install '.[{extra}]' in the clone of markerseek, or pip install 'FILE.whl[{extra}]' with its wheel"


class MissingExtraError(ConfigError):
    """An optional package is needed and not installed."""

    # What is given to `Exception`, another process makes the error again from.
    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(package, extra, purpose)

    def __str__(self) -> str:
        package, extra, purpose = self.args
        return f"{purpose} needs the package {package}, which is not installed; install it: {extra_install(extra)}"


@contextmanager
def needs_package(package: str, *, extra: str, purpose: str, module: str | None = None) -> Iterator[None]:
    """Import an optional package in the block; `MissingExtraError` names the extra that installs it where it is absent.

    ``purpose``: what it is needed for, as the subject of a sentence: "a picture". ``module``: name of its module, where
    that is not the package's. Raises `ConfigError` with the cause where it is there and cannot be imported.
    """
    try:
        yield
    except ImportError as problem:
        if is_absent(module or package.replace("-", "_"), problem):
            raise MissingExtraError(package=package, extra=extra, purpose=purpose) from problem
        raise ConfigError(
            f"{purpose} needs the package {package}, which is installed and cannot be imported: {described(problem)}; "
            f"install what is missing, or it again: pip install --force-reinstall {package}"
        ) from problem


def is_absent(module: str, problem: BaseException) -> bool:
    """Return whether importing a module failed because that very module, or its package, is not installed."""
    return isinstance(problem, ModuleNotFoundError) and f"{module}.".startswith(f"{problem.name}.")


def described(problem: BaseException) -> str:
    """Return an error as its class and message in one line."""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())}"


class RecordError(MarkerseekError):
    """A file that was named cannot be read or written."""

    exit_code: ClassVar[int] = 2


class SearchError(MarkerseekError):
    """A policy was used against its rules, or a scan holds no usable answer."""


class DeviceError(MarkerseekError):
    """A device, or what it sent, cannot be trusted: the run ends without an angle."""


class NotConnectedError(DeviceError):
    """The device does not answer."""


class DeviceTimeoutError(DeviceError):
    """The device did not answer in time."""


class LimitError(DeviceError):
    """The device was asked to leave its limits; nothing was moved or fired."""


class MoveError(DeviceError):
    """The stage did not arrive where it was sent."""


class LaserError(DeviceError):
    """The laser did not do what was permitted."""


class AcquisitionError(DeviceError):
    """A frame was refused, or none came."""


# An AcquisitionError, so that a reader that makes a NaN of a frame has that frame refused and taken again, like any
# other that the guard refuses. A ValueError for callers of the library, who made the reading themselves.
class ReadingError(AcquisitionError, ValueError):
    """A reading holds a number that cannot be a measurement."""


# A class of its own: `run` repeats a refused acquisition, and repeating this one cannot help.
class SaturationError(AcquisitionError):
    """A frame is at full scale: the same acquisition would give the same."""
