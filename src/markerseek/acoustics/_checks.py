"""Checks of one number each, so that every refusal in this package reads the same."""

from __future__ import annotations

import math

from markerseek.core import ConfigError


def positive(value: float, *, name: str, unit: str, cure: str) -> None:
    """Refuse what is not a positive finite number; NaN is not."""
    if not 0 < value < math.inf:
        raise ConfigError(f"{name} is {value} {unit}, it must be positive and finite; {cure}")


def not_negative(value: float, *, name: str, unit: str, cure: str) -> None:
    """Refuse what is not zero or a positive finite number; NaN is not."""
    if not 0 <= value < math.inf:
        raise ConfigError(f"{name} is {value} {unit}, it must be finite and not negative; {cure}")


def within(value: float, *, low: float, high: float, name: str, unit: str, cure: str) -> None:
    """Refuse what is not between the two limits, which are themselves allowed; NaN is refused."""
    if not low <= value <= high:
        raise ConfigError(f"{name} is {value} {unit}, it must lie between {low:g} and {high:g} {unit}; {cure}")
