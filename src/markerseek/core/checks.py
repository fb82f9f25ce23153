"""Checks of numbers: text, NaN or a complex number never passes a limit, and a number outside its range is refused."""

from __future__ import annotations

import math
import typing
from functools import cache
from numbers import Integral, Real
from typing import Any, TypeGuard

import msgspec
from msgspec import structs

from markerseek.core.errors import ConfigError


def is_real(value: object) -> TypeGuard[float]:
    """Return whether a value is a real number, of Python or NumPy, infinity and NaN included; a truth value is not."""
    # Python counts True as the number 1, and a limit of True would be a limit of 1. Float comes
    # first because the abstract class is slow, and readings are checked by the thousand.
    return isinstance(value, float | Real) and not isinstance(value, bool)


def is_finite(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite real number, of Python or NumPy; a truth value, text or an array is not."""
    try:
        return is_real(value) and math.isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a whole number, of Python or NumPy; 16.0 and a truth value are not."""
    # Integral and not int: counts that come from NumPy arrays are np.int64.
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_range(
    name: str, value: object, *, low: float, high: float, unit: str = "", open_low: bool = False, cure: str = ""
) -> None:
    """Refuse a number outside its range; NaN, a truth value and text lie in no range.

    The message has one form: argument, value with unit, limits, cure.

    ``name``: name of the argument with its owner: "stage: zero_deg". ``low``, ``high``: the limits, both included;
    infinity for none. ``open_low``: whether the lower limit itself is outside. ``cure``: what to do about it, if
    that is not clear from the limits.
    """
    # True would pass as 1, and text would end in a TypeError without the name of the argument.
    if is_real(value) and (low < value if open_low else low <= value) and value <= high:
        return
    # {:g} for the limits, which are round; the value in full, or 1.0000001 would read as 1.
    after = f" {unit}" if unit else ""
    allowed = f"{'(' if open_low else '['}{low:g}, {high:g}{')' if math.isinf(high) else ']'}{after}"
    raise ConfigError(f"{name} is {value}{after}, it must lie in {allowed}" + (f"; {cure}" if cure else ""))


class Within(msgspec.Struct, frozen=True):
    """Limits of a number, as the annotation of its field: ``Annotated[float, Within(0, 5, "deg")]``.

    Attributes
    ----------
    low, high
        The limits, both included.
    unit
        Unit of the number, for the message.
    open_low
        Whether the lower limit itself is outside.
    cure
        What to do about a number outside, if that is not clear from the limits.
    """

    low: float
    high: float
    unit: str = ""
    open_low: bool = False
    cure: str = ""


def require_fields(settings: Any, owner: str) -> None:
    """Refuse a field that lies outside its `Within` or is not a value of its `Literal`.

    None passes where the type of the field has it.

    ``owner``: name of what the settings belong to, for the message: "stage".
    """
    for name, limits, words, optional in _checked(settings.__class__):
        value = getattr(settings, name)
        if limits is not None and not (optional and value is None):
            require_range(f"{owner}: {name}", value, **limits)
        if words and value not in words:
            raise ConfigError(f"{owner}: {name} is {value!r}, it must be {' or '.join(map(repr, words))}")


@cache
def _checked(kind: type) -> tuple[tuple[str, dict[str, Any] | None, tuple[Any, ...], bool], ...]:
    """Return the limits of fields as arguments of `require_range`, their words, and whether None is a value."""
    found = []
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        limits = next(
            (structs.asdict(each) for each in getattr(hint, "__metadata__", ()) if isinstance(each, Within)), None
        )
        words = typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()
        if limits is not None or words:
            value = typing.get_args(hint)[0] if limits is not None else hint
            found.append((name, limits, words, type(None) in typing.get_args(value)))
    return tuple(found)
