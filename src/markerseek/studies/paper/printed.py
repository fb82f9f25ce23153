"""The numbers that the paper prints, from `printed.csv`: value, place, and why a number cannot be reproduced.

The file holds nothing of ours. `markerseek.studies.paper.section.compared` puts a number of ours beside one of them.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib import resources

import msgspec

from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """One number of the paper; or, without a value, what a number of ours is for which the paper has none."""

    key: str = ""
    """Name by which the code refers to it."""
    place: str = "not in the paper"
    """Where in the paper it is."""
    quantity: str
    value: float | None = None
    sd: float | None = None
    """What the paper prints after ±."""
    unit: str = "deg"
    limitation: str | None = None
    """Why the number cannot be reproduced, or not fully; None if nothing is known against it."""
    note: str | None = None
    """What else is known of the number."""

    def __str__(self) -> str:
        if self.value is None:
            return "–"
        sd = "" if self.sd is None else f" ± {self.sd:g}"
        return f"{self.value:g}{sd} {self.unit}".replace(" deg", "°")


def _read() -> dict[str, PaperNumber]:
    lines = resources.files(__package__).joinpath("printed.csv").read_text(encoding="utf-8").splitlines()
    # An empty cell is a missing value.
    rows = [{name: cell or None for name, cell in row.items()} for row in csv.DictReader(lines)]
    return {number.key: number for number in msgspec.convert(rows, list[PaperNumber], strict=False)}


PAPER_NUMBERS = _read()
"""All numbers by key."""

MATERIALS = tuple(key.removeprefix("table1/WA/") for key in PAPER_NUMBERS if key.startswith("table1/WA/"))
"""Columns of Table 1."""


def paper_number(key: str) -> PaperNumber:
    """Return a number of the paper by its key."""
    if key not in PAPER_NUMBERS:
        raise ConfigError(f"printed: {key!r} is not a number of the paper; the keys are: {', '.join(PAPER_NUMBERS)}")
    return PAPER_NUMBERS[key]


def printed_value(key: str) -> float:
    """Return the value of a number of the paper."""
    return paper_number(key).value or math.nan


SENSITIVE_DEG = printed_value("sensitive")
"""Error beyond which the tool tip leaves the image: a search with a larger error counts as failed."""
