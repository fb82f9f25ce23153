"""Small tables as people write them, and what is read of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from markerseek.records.banks import TableFormat, read_bank

MARKER_DEG = -8.25
ANGLES_DEG = np.arange(-24.5, 25)
COUNTS = np.round(
    400 + 7900 * np.exp(-0.5 * ((ANGLES_DEG - MARKER_DEG) / 2) ** 2) + np.random.default_rng(1).normal(0, 30, 50)
).astype(int)
"""Whole numbers around 400, up to 8,000 at the marker: those above 999 are written with thousands separators."""


def read(path: Path, form: TableFormat | None = None) -> tuple[list[float], list[float]]:
    bank = read_bank(path, form or TableFormat())
    return list(bank.angles_deg), list(bank.intensities)


def small(folder: Path, *rows: str) -> Path:
    path = folder / "small.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    return path
