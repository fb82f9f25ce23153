"""The numbers that the paper prints, from `printed.csv`: value, place, and why a number cannot be reproduced.

The file holds nothing of ours. `markerseek.studies.paper.section.compared` puts a number of ours beside one of them.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from importlib import resources

import msgspec

from markerseek.core import ConfigError

MATERIALS = ("Bovine Liver", "Bovine Muscle", "Chicken Breast", "Plastisol Phantom", "Bovine Muscle +ICG")
"""Columns of Table 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """One number of the paper."""

    key: str
    """Name by which the code refers to it."""
    place: str
    """Where in the paper it is."""
    quantity: str
    value: float
    sd: float | None
    """``value`` and ``sd``: the number, and what the paper prints after ±; None where it prints nothing."""
    unit: str
    limitation: str | None
    """Why it cannot be reproduced, or not fully; None where nothing is known against it."""
    note: str | None
    """What else is known of it; None where nothing is."""

    def __str__(self) -> str:
        sd = "" if self.sd is None else f" ± {self.sd:g}"
        return f"{self.value:g}{sd} {self.unit}".replace(" deg", "°")


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnNumber:
    """A number that the paper has not, because it is of the posterior: what it is, and its unit."""

    quantity: str
    unit: str = "deg"
    place: str = "not in the paper"
    value: None = None
    sd: None = None
    limitation: None = None
    note: None = None

    def __str__(self) -> str:
        return "–"


def _read() -> dict[str, PaperNumber]:
    text = resources.files(__package__).joinpath("printed.csv").read_text(encoding="utf-8")
    # An empty cell is a missing value.
    rows = [{name: cell or None for name, cell in row.items()} for row in csv.DictReader(io.StringIO(text))]
    return {number.key: number for number in msgspec.convert(rows, list[PaperNumber], strict=False)}


PAPER_NUMBERS = _read()
"""All numbers by key."""


def paper_number(key: str) -> PaperNumber:
    """Return a number of the paper by its key."""
    if key not in PAPER_NUMBERS:
        raise ConfigError(f"printed: {key!r} is not a number of the paper; the keys are: {', '.join(PAPER_NUMBERS)}")
    return PAPER_NUMBERS[key]


SENSITIVE_DEG = paper_number("sensitive").value
"""Error beyond which the tool tip leaves the image: a search with a larger error counts as failed."""
