"""Checks of numbers: text, NaN or a complex number never passes a limit, and a number outside its range is refused."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import TypeGuard

from markerseek.core.errors import ConfigError


def is_real(value: object) -> TypeGuard[float]:
    """Whether a value is a real number, of Python or NumPy, infinity and NaN included; a truth value is not."""
    # Python counts True as the number 1, and a limit of True would be a limit of 1. A float is known at once, while the
    # abstract class has to be asked: readings are checked by the thousand.
    return isinstance(value, float | Real) and not isinstance(value, bool)


def is_finite(value: object) -> TypeGuard[float]:
    """Whether a value is a finite real number, of Python or NumPy; a truth value, text or an array is not."""
    try:
        return is_real(value) and math.isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False


def is_whole(value: object) -> TypeGuard[int]:
    """Whether a value is a whole number, of Python or NumPy; 16.0 and a truth value are not."""
    # Integral and not int: counts that come from NumPy arrays are np.int64.
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_range(
    name: str, value: object, *, low: float, high: float, unit: str = "", open_low: bool = False, cure: str = ""
) -> None:
    """Refuse a number outside its range; NaN, a truth value and text lie in none.

    The message has one form: argument, value with unit, limits, cure.

    ``name``: name of the argument with its owner: "stage: zero_deg". ``low``, ``high``: the limits, both included;
    infinity for none. ``open_low``: whether the lower limit itself is outside. ``cure``: what to do about it, where
    that is not clear from the limits.
    """
    # True would pass as 1, and text would end in a TypeError without the name of the argument.
    if is_real(value) and (low < value if open_low else low <= value) and value <= high:
        return
    # {:g} for the limits, which are round; the value in full, or 1.0000001 would read as 1.
    after = f" {unit}" if unit else ""
    allowed = f"{'(' if open_low else '['}{low:g}, {high:g}{')' if math.isinf(high) else ']'}{after}"
    raise ConfigError(f"{name} is {value}{after}, it must lie in {allowed}" + (f"; {cure}" if cure else ""))
