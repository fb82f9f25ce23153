"""Checks of one number each that refuse infinity too; `markerseek.core.require_range` allows it."""

from __future__ import annotations

import math

from markerseek.core import ConfigError


def positive(value: float, *, name: str, unit: str = "", cure: str) -> None:
    """Refuse what is not a positive finite number; NaN is not."""
    if not 0 < value < math.inf:
        raise ConfigError(f"{name} is {quantity(value, unit)}, it must be positive and finite; {cure}")


def not_negative(value: float, *, name: str, unit: str = "", cure: str) -> None:
    """Refuse what is not zero or a positive finite number; NaN is not."""
    if not 0 <= value < math.inf:
        raise ConfigError(f"{name} is {quantity(value, unit)}, it must be finite and not negative; {cure}")


def quantity(value: float, unit: str) -> str:
    """Return a number with its unit, where it has one."""
    return f"{value} {unit}" if unit else f"{value}"
