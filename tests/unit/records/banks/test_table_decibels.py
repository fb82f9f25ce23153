"""Intensities in decibels, as the name of their column says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.records.banks import TableFormat
from tests.written_tables import ANGLES_DEG, COUNTS, MARKER_DEG, read, small

Shell = Callable[..., tuple[int, str, str]]


def test_decibels_are_never_above_a_thousand(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_deg;intensity_db", "10;-7,387", "11;-1,055", "12;-9")
    assert read(path)[1] == pytest.approx([10 ** (each / 20) for each in (-7.387, -1.055, -9)])


def decibel_table(folder: Path, name: str, offset_db: float = 0) -> Path:
    decibels = 20 * np.log10(COUNTS) + offset_db
    return small(folder, f"angle_deg,{name}", *map("{0},{1:.4f}".format, ANGLES_DEG, decibels))


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("intensity_db", None),
        ("Intensity [dB]", None),
        ("dB", ("angle_deg", "dB")),
        ("amplitude [dB]", ("angle_deg", "amplitude [dB]")),
        ("level_dBV", ("angle_deg", "level_dBV")),
        ("peakdB", ("1", "2")),
        ("Pegel (dB re 1 V)", ("1", "Pegel (dB re 1 V)")),
    ],
)
@pytest.mark.parametrize("offset_db", [0, -90])
def test_decibels_in_the_name_of_a_column_are_read(
    tmp_path: Path, name: str, columns: tuple[str, str] | None, offset_db: float
) -> None:
    path = decibel_table(tmp_path, name, offset_db)
    for option in (False, True):
        intensities = read(path, TableFormat(columns=columns, db=option))[1]
        assert intensities == pytest.approx((COUNTS * 10 ** (offset_db / 20)).tolist(), rel=1e-4)


def test_two_columns_with_units_in_their_names_need_no_option(shell: Shell, tmp_path: Path) -> None:
    path = decibel_table(tmp_path, "level_dBV")
    for options in ((), ("--columns", "angle_deg,level_dBV")):
        code, out, _ = shell("replay", path, *options, "--json")
        assert (code, json.loads(out)["angle_deg"]) == (0, pytest.approx(MARKER_DEG, abs=0.5))
