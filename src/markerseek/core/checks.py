"""One check and one sentence for numbers that must lie in a range: argument, value with unit, limits and cure."""

from __future__ import annotations

import math

from markerseek.core.errors import ConfigError


def require_range(
    name: str, value: float, *, low: float, high: float, unit: str = "", open_low: bool = False, cure: str = ""
) -> None:
    """Refuse a number outside its range; NaN lies in none.

    Parameters
    ----------
    name
        What it is, with what it belongs to: "stage: zero_deg".
    value
        The number.
    low, high
        The limits, both included; infinity for none.
    unit
        Unit of the three.
    open_low
        Whether the lower limit itself is outside.
    cure
        What to do about it, where the limits do not say so.

    Raises
    ------
    ConfigError
        If it lies outside.
    """
    if (low < value if open_low else low <= value) and value <= high:
        return
    after = f" {unit}" if unit else ""
    allowed = f"{'(' if open_low else '['}{low:g}, {high:g}{')' if math.isinf(high) else ']'}{after}"
    raise ConfigError(f"{name} is {value}{after}, it must lie in {allowed}" + (f"; {cure}" if cure else ""))
