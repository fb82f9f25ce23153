"""What was assumed when a file was read is a field of the bank and of the result, and is logged."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import numpy as np
import pytest

import markerseek
from markerseek.records.banks import read_bank
from markerseek.records.notes import note, noting
from tests.notes import notes_collected

ANGLES_DEG = np.arange(-12.0, 12.1, 1.0)


@pytest.fixture
def turned(tmp_path: Path) -> Path:
    """A scan across 0, whose angles below 0 were written as 348 to 359."""
    heights = 20 + 900 * np.exp(-0.5 * ((ANGLES_DEG - 1.4) / 2.2) ** 2)
    rows = [f"{angle_deg % 360:g},{height:.1f}" for angle_deg, height in zip(ANGLES_DEG, heights, strict=True)]
    path = tmp_path / "scan.csv"
    path.write_text("\n".join(["angle_deg,intensity", *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("action", ["error", "ignore"])
def test_the_bank_and_the_result_have_the_notes_whatever_the_filters(
    turned: Path, caplog: pytest.LogCaptureFixture, action: str
) -> None:
    with warnings.catch_warnings(action=action), notes_collected() as said:
        bank = read_bank(turned)
        result = markerseek.find_marker(markerseek.replayed(turned))
    (sentence,) = bank.notes
    assert sentence.startswith(
        f"{turned}: the angles jump by a full turn, so that 348 to 359 deg are read as -12 to -1"
    )
    assert result.notes == bank.notes
    # A file that is read twice is logged twice.
    assert said == [sentence, sentence]
    assert {(each.name, each.levelno) for each in caplog.records} == {("markerseek.records", logging.WARNING)}


def test_notes_do_not_make_banks_different(turned: Path, tmp_path: Path) -> None:
    text = turned.read_text(encoding="utf-8").splitlines()
    plain = tmp_path / "plain.csv"
    angle = {f"{each % 360:g}": f"{each:g}" for each in ANGLES_DEG}
    rows = [f"{angle[line.partition(',')[0]]},{line.partition(',')[2]}" for line in text[1:]]
    plain.write_text("\n".join([text[0], *rows, ""]), encoding="utf-8")
    with notes_collected():
        assert read_bank(turned) == read_bank(plain)
    assert read_bank(plain).notes == ()


def test_notes_belong_to_the_innermost_block_and_stand_there_once() -> None:
    with notes_collected() as said, noting() as outer:
        note(Path("a.csv"), "of the first")
        with noting() as inner:
            note(Path("b.csv"), "of the second")
            note(Path("b.csv"), "of the second")
        note(Path("a.csv"), "of the first again")
    assert inner == ["b.csv: of the second"]
    assert outer == ["a.csv: of the first", "a.csv: of the first again"]
    assert len(said) == 4
