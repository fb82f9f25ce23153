"""Numbers of a table in the notations of several countries: decimal signs, thousands separators, minus signs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.records.banks import TableFormat
from tests.notes import noted
from tests.written_tables import ANGLES_DEG, COUNTS, read, small


def grouped(number: int, sign: str) -> str:
    return f"{number:,}".replace(",", sign)


def table(
    folder: Path,
    counts: Callable[[int], str],
    *,
    comma: bool,
    separator: str,
    encoding: str = "utf-8",
    minus: str = "-",
    digits: int = 1,
) -> Path:
    quote = '"' if separator == "," else ""
    rows = [f"angle_deg{separator}intensity"]
    for angle, count in zip(ANGLES_DEG, COUNTS, strict=True):
        angle_text = f"{angle:.{digits}f}".replace("-", minus)
        angle_text = angle_text.replace(".", ",") if comma else angle_text
        rows.append(f"{quote}{angle_text}{quote}{separator}{quote}{counts(int(count))}{quote}")
    path = folder / "scan.csv"
    path.write_bytes("\r\n".join(rows).encode(encoding))
    return path


NOTATIONS = {
    "german": (lambda n: grouped(n, "."), True, ";"),
    "german, decimals": (lambda n: f"{grouped(n, '.')},0", True, ";"),
    "german, quoted": (lambda n: grouped(n, "."), True, ","),
    "german, three decimals": (lambda n: f"{grouped(n, '.')},250", True, "\t"),
    "english, quoted": (lambda n: grouped(n, ","), False, ","),
    "english, tabs": (lambda n: f"{grouped(n, ',')}.00", False, "\t"),
    "swiss": (lambda n: grouped(n, "'"), False, ";"),
    "swiss, typographic": (lambda n: grouped(n, "’") + ".5", False, ","),
    "french, narrow space": (lambda n: grouped(n, "\u202f"), True, ";"),
    "french, no-break space": (lambda n: grouped(n, "\u00a0") + ",0", True, ";"),
    "thin space": (lambda n: grouped(n, "\u2009"), False, "\t"),
    "space": (lambda n: grouped(n, " "), True, ";"),
    "space, commas separate": (lambda n: grouped(n, " "), False, ","),
    "exponents": (lambda n: f"{n:.3E}".replace(".", ","), True, ";"),
    "plus": (lambda n: f"+{grouped(n, '.')}", True, ";"),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("minus", ["-", "\N{MINUS SIGN}", "\N{EN DASH}"])
@pytest.mark.parametrize("name", NOTATIONS)
def test_a5_thousands_are_read_where_the_table_tells_the_decimal_sign(
    tmp_path: Path, name: str, minus: str, encoding: str
) -> None:
    counts, comma, separator = NOTATIONS[name]
    path = table(tmp_path, counts, comma=comma, separator=separator, encoding=encoding, minus=minus)
    angles, intensities = read(path)
    assert angles == ANGLES_DEG.tolist()
    assert intensities == pytest.approx(COUNTS, rel=5e-4 if name == "exponents" else 0, abs=0.5)


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (("0,387", "1,055", "2"), (0.387, 1.055, 2)),  # no thousands begin with 0
        (("387", "1,055,200", "1,055"), (387, 1055200, 1055)),
        (("387", "1.055.200", "1.055"), (387, 1055200, 1055)),
        (("8.26", "1.055", "387"), (8.26, 1.055, 387)),
        (("387,5", "1.055", "387"), (387.5, 1055, 387)),
        (("12,34,567", "1,055", "387"), (1234567, 1055, 387)),  # Indian groups
        (("1,5E+03", "1,055", "387"), (1500, 1.055, 387)),
        (("1.055", "2.310", "1.500"), (1.055, 2.31, 1.5)),  # three decimals everywhere: the scale alone
        (("1055", "1.055,5", "2055"), (1055, 1055.5, 2055)),
        (("-0.5e-3", ".5", "5."), None),  # negative
        ((".5", "5.", "1e3"), (0.5, 5, 1000)),
    ],
)
def test_one_number_tells_the_notation_of_its_column(
    tmp_path: Path, texts: tuple[str, ...], expected: tuple[float, ...] | None
) -> None:
    path = small(tmp_path, "angle_deg;intensity", *(f"{angle};{text}" for angle, text in enumerate(texts)))
    if expected is None:
        with pytest.raises(RecordError, match=r"intensity is -0\.0005, it must not be negative"):
            read(path)
    else:
        assert read(path) == ([0, 1, 2], list(expected))


def test_an_angle_is_never_above_a_turn(tmp_path: Path) -> None:
    """Three decimals without a 0 before them: as thousands these angles would be 10,000 degrees."""
    path = small(tmp_path, "angle_deg;intensity", "10,000;387", "11,000;8.265", "12,000;455")
    assert read(path) == ([10, 11, 12], [387, 8265, 455])


def test_negative_numbers_are_ambiguous_as_well(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_mrad;intensity", "-1,055;387", "-1;455", "100;1", "200;2")
    with pytest.raises(RecordError, match=r"line 2: -1,055 may be -1055 or -1\.055, because"):
        read(path)


def test_two_notations_in_a_column_are_refused_by_both_lines(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1;387,5", "0;1055.25", "1;455")
    with pytest.raises(RecordError, match=r"line 3: 1055\.25 and 387,5 \(line 2\) are written in two notations; save"):
        read(path)
    # Two columns, each of which tells its own.
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387.5", "0;1055.25", "1;455")
    assert read(path) == ([-1.5, 0, 1], [387.5, 1055.25, 455])


@pytest.mark.parametrize("cell", ["n/a", "", "-", "NaN", "#DIV/0!", "1.#QNAN", "Err:502", "inf"])
def test_cells_without_a_number_are_left_out_as_before(tmp_path: Path, cell: str) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387", f"0;{cell}", "1;455", "2;1")
    with noted("1 without a finite number left out"):
        assert read(path, TableFormat(skip_invalid=True)) == ([-1.5, 1, 2], [387, 455, 1])


@pytest.mark.parametrize("cell", ["n/a", "", "-", "NaN", "#DIV/0!", "1.#QNAN", "Err:502", "inf"])
def test_cells_without_a_number_are_left_out(tmp_path: Path, cell: str) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387", f"0;{cell}", "1;455", "2;1")
    with noted("1 without a finite number left out"):
        assert read(path, TableFormat(skip_invalid=True)) == ([-1.5, 1, 2], [387, 455, 1])


def test_a_space_that_may_separate_columns_is_not_read(tmp_path: Path) -> None:
    """-35.5 and 387, or -35 and 5387."""
    with noted("no names"), pytest.raises(RecordError, match="looks like a number"):
        read(small(tmp_path, "-35,5 387", "-34,5 455", "-33,5 413"))


def test_a_first_row_with_a_typographic_minus_is_no_heading(tmp_path: Path) -> None:
    with noted("no names"):
        assert read(small(tmp_path, "−35,5;1.387", "−34,5;455", "−33,5;413"))[1] == [1387, 455, 413]
