"""Vectors and matrices of three dimensions as they are stored: tuples of numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from markerseek.core.shapes import CHECKED, Float64

if TYPE_CHECKING or CHECKED:
    import numpy as np

Vector: TypeAlias = tuple[float, float, float]
"""Three numbers for the axes x, y and z."""

Matrix: TypeAlias = tuple[Vector, Vector, Vector]
"""Its rows."""


def as_vector(values: Float64[np.ndarray, " 3"]) -> Vector:
    """Return three numbers as they are stored."""
    x, y, z = values.tolist()
    return x, y, z


def as_matrix(values: Float64[np.ndarray, "3 3"]) -> Matrix:
    """Return nine numbers as they are stored."""
    first, second, third = (as_vector(row) for row in values)
    return first, second, third
