"""Checks of what counts as a number, so that text, NaN or a complex number never passes a limit."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import TypeGuard


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
