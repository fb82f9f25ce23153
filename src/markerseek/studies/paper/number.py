"""What is known of one number of the paper: where it stands, and what of it cannot be had."""

from __future__ import annotations

from dataclasses import dataclass

MATERIALS = ("Bovine Liver", "Bovine Muscle", "Chicken Breast", "Plastisol Phantom", "Bovine Muscle +ICG")
"""Columns of Table 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reported:
    """One number of the paper.

    Attributes
    ----------
    key
        Name by which a reproduction asks for it.
    what
        What it is, in words.
    place
        Where in the paper it stands.
    mean
        The number.
    spread
        What the paper prints behind ±; None where it prints none.
    unit
        Unit of both.
    limits
        Plain sentence about what of it cannot be had, and why; None where nothing is known to stand in the way.
    note
        Plain sentence about what else is known of it; None where nothing is.
    """

    key: str
    what: str
    place: str
    mean: float
    spread: float | None = None
    unit: str = "deg"
    limits: str | None = None
    note: str | None = None

    def __str__(self) -> str:
        spread = "" if self.spread is None else f" ± {self.spread:g}"
        return f"{self.mean:g}{spread} {self.unit}".replace(" deg", "°")
