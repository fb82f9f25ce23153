"""Check that a number lies in a range, with one form of message: argument, value with unit, limits, cure."""

from __future__ import annotations

import math

from markerseek.core.errors import ConfigError
from markerseek.core.number import is_real


def require_range(
    name: str, value: object, *, low: float, high: float, unit: str = "", open_low: bool = False, cure: str = ""
) -> None:
    """Refuse a number outside its range; NaN, a truth value and text lie in none.

    Parameters
    ----------
    name
        Name of the argument with its owner: "stage: zero_deg".
    value
        The number.
    low, high
        The limits, both included; infinity for none.
    unit
        Unit of the value and the limits.
    open_low
        Whether the lower limit itself is outside.
    cure
        What to do about it, where that is not clear from the limits.

    Raises
    ------
    ConfigError
        If it lies outside.
    """
    # True would pass as 1, and text would end in a TypeError without the name of the argument.
    if is_real(value) and (low < value if open_low else low <= value) and value <= high:
        return
    # {:g} for the limits, which are round; the value in full, or 1.0000001 would read as 1.
    after = f" {unit}" if unit else ""
    allowed = f"{'(' if open_low else '['}{low:g}, {high:g}{')' if math.isinf(high) else ']'}{after}"
    raise ConfigError(f"{name} is {value}{after}, it must lie in {allowed}" + (f"; {cure}" if cure else ""))
