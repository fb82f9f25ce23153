"""Values as JSON holds them exactly: finite numbers, and texts that are Unicode."""

from __future__ import annotations

import math

import msgspec

from markerseek.core import RecordError


def plain(value: object, *, what: str) -> object:
    """A value of built-in parts, its texts as `readable`.

    Parameters
    ----------
    value
        Whatever msgspec can encode, without raw JSON in it.
    what
        What it is, for the message.

    Raises
    ------
    RecordError
        If a number in it is not finite: JSON would make it null, which stands for what is not known.
    """
    return _checked(msgspec.to_builtins(value), what=what, where="")


def readable(text: str) -> str:
    """A text with whatever is no Unicode in it (bytes of a device or a file's name) written as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


def require_finite(number: float, *, what: str) -> float:
    """The number, if it is finite.

    Raises
    ------
    RecordError
        If it is not.
    """
    if not math.isfinite(number):
        raise RecordError(f"journal: {what} is {number}, which is not finite and cannot be recorded")
    return number


def _checked(value: object, *, what: str, where: str) -> object:
    match value:
        case float():
            return require_finite(value, what=f"{what}{where}")
        case str():
            return readable(value)
        case dict():
            return {
                _checked(key, what=what, where=where): _checked(each, what=what, where=f"{where}.{key}")
                for key, each in value.items()
            }
        case list() | tuple():
            return [_checked(each, what=what, where=f"{where}[{index}]") for index, each in enumerate(value)]
        case _:
            return value
