"""Tables as people write them (A4, A5, A15), and scans that cross 360 or ±180 degrees (A12)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import TableFormat, read_bank
from markerseek.search import Curve, peak_of
from tests.notes import noted

MARKER_DEG = -8.25
ANGLES_DEG = np.arange(-24.5, 25)
COUNTS = np.round(
    400 + 7900 * np.exp(-0.5 * ((ANGLES_DEG - MARKER_DEG) / 2) ** 2) + np.random.default_rng(1).normal(0, 30, 50)
).astype(int)
"""Whole numbers around 400, up to 8,000 at the marker: those above 999 are written with thousands separators."""

Shell = Callable[..., tuple[int, str, str]]


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


def read(path: Path, form: TableFormat | None = None) -> tuple[list[float], list[float]]:
    bank = read_bank(path, form or TableFormat())
    return list(bank.angles_deg), list(bank.intensities)


def small(folder: Path, *rows: str) -> Path:
    path = folder / "small.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
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
def test_a4_a5_thousands_are_read_where_the_table_tells_the_decimal_sign(
    tmp_path: Path, name: str, minus: str, encoding: str
) -> None:
    counts, comma, separator = NOTATIONS[name]
    path = table(tmp_path, counts, comma=comma, separator=separator, encoding=encoding, minus=minus)
    angles, intensities = read(path)
    assert angles == ANGLES_DEG.tolist()
    assert intensities == pytest.approx(COUNTS, rel=5e-4 if name == "exponents" else 0, abs=0.5)


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize("sign", [".", ","])
@pytest.mark.parametrize("skip", [False, True])
def test_a5_without_evidence_a_sign_is_refused_and_rows_are_not_left_out(
    shell: Shell, tmp_path: Path, separator: str, sign: str, skip: bool
) -> None:
    rows = [f'{angle}{separator}"{text}"' for angle, text in ((-1, "387"), (0, f"1{sign}055"), (1, "455"))]
    path = small(tmp_path, f"angle_deg{separator}intensity", *rows)
    code, _, err = shell("bank", "info", path, *["--skip-invalid"] * skip)
    said = " ".join(err.split())
    assert code == 2
    assert f"line 3: 1{sign}055 may be 1055 or 1.055" in said
    assert "without thousands separators" in said
    assert "--skip-invalid" not in said


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
def test_a5_one_number_tells_the_notation_of_its_column(
    tmp_path: Path, texts: tuple[str, ...], expected: tuple[float, ...] | None
) -> None:
    path = small(tmp_path, "angle_deg;intensity", *(f"{angle};{text}" for angle, text in enumerate(texts)))
    if expected is None:
        with pytest.raises(RecordError, match=r"intensity is -0\.0005, it must not be negative"):
            read(path)
    else:
        assert read(path) == ([0, 1, 2], list(expected))


def test_a5_an_angle_is_never_above_a_turn(tmp_path: Path) -> None:
    """Three decimals without a 0 before them: as thousands these angles would be 10,000 degrees."""
    path = small(tmp_path, "angle_deg;intensity", "10,000;387", "11,000;8.265", "12,000;455")
    assert read(path) == ([10, 11, 12], [387, 8265, 455])


def test_a5_decibels_are_never_above_a_thousand(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_deg;intensity_db", "10;-7,387", "11;-1,055", "12;-9")
    assert read(path)[1] == pytest.approx([10 ** (each / 20) for each in (-7.387, -1.055, -9)])


def test_a5_negative_numbers_are_ambiguous_as_well(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_mrad;intensity", "-1,055;387", "-1;455", "100;1", "200;2")
    with pytest.raises(RecordError, match=r"line 2: -1,055 may be -1055 or -1\.055, because"):
        read(path)


def test_a5_two_notations_in_a_column_are_refused_by_both_lines(tmp_path: Path) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1;387,5", "0;1055.25", "1;455")
    with pytest.raises(RecordError, match=r"line 3: 1055\.25 and 387,5 \(line 2\) are written in two notations; save"):
        read(path)
    # Two columns, each of which tells its own.
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387.5", "0;1055.25", "1;455")
    assert read(path) == ([-1.5, 0, 1], [387.5, 1055.25, 455])


@pytest.mark.parametrize("cell", ["8265 mV", ">4095", "8265?", "8 26", "1,05,5", "12.03.2024", "~900", "$900"])
def test_a5_what_looks_like_a_number_is_never_left_out(shell: Shell, tmp_path: Path, cell: str) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387", f"0;{cell}", "1;455", "2;n/a", "3;1")
    for options in ((), ("--skip-invalid",)):
        code, _, err = shell("bank", "info", path, *options)
        said = " ".join(err.split())
        assert (code, "looks like a number and cannot be read" in said) == (2, True)
        assert "all such rows: --skip-invalid" not in said


@pytest.mark.parametrize("cell", ["n/a", "", "-", "NaN", "#DIV/0!", "1.#QNAN", "Err:502", "inf"])
def test_a5_cells_without_a_number_are_left_out_as_before(tmp_path: Path, cell: str) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387", f"0;{cell}", "1;455", "2;1")
    with noted("1 without a finite number left out"):
        assert read(path, TableFormat(skip_invalid=True)) == ([-1.5, 1, 2], [387, 455, 1])


def test_a5_a_space_that_may_separate_columns_is_not_read(tmp_path: Path) -> None:
    """-35.5 and 387, or -35 and 5387."""
    with noted("no names"), pytest.raises(RecordError, match="looks like a number"):
        read(small(tmp_path, "-35,5 387", "-34,5 455", "-33,5 413"))


def test_a5_a_first_row_with_a_typographic_minus_is_no_heading(tmp_path: Path) -> None:
    with noted("no names"):
        assert read(small(tmp_path, "−35,5;1.387", "−34,5;455", "−33,5;413"))[1] == [1387, 455, 413]


@pytest.mark.parametrize("comma", [True, False])
def test_a5_points_of_a_registration_are_read_in_their_notation(tmp_path: Path, comma: bool) -> None:
    from markerseek.registration.points import point_pairs

    names = "name;trus_x_m;trus_y_m;trus_z_m;camera_x_m;camera_y_m;camera_z_m"
    rows = ["a;0,075933;−0,025899;0,061;1.055e-2;0.5;1.055", "b;0,5;−0,1;0,06;0.01;0.5;0.7"]
    text = "\n".join([names, *rows])
    path = tmp_path / "points.csv"
    path.write_text(text.replace(".", ",") if comma else text.replace(",", "."), encoding="utf-8")
    first = point_pairs(path)[0]
    assert first.trus_m.tolist() == [0.075933, -0.025899, 0.061]
    assert first.camera_m.tolist() == [0.01055, 0.5, 1.055]
    path.write_text("trus_x_m,trus_y_m,trus_z_m,camera_x_m,camera_y_m,camera_z_m\n0,1,0,2,0,3,0,4,0,5,0,6\n")
    with pytest.raises(RecordError, match="line 2: it has 12 columns, 6 are named; a number with a decimal comma"):
        point_pairs(path)


# A15


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
def test_a15_decibels_in_the_name_of_a_column_are_read(
    tmp_path: Path, name: str, columns: tuple[str, str] | None, offset_db: float
) -> None:
    path = decibel_table(tmp_path, name, offset_db)
    for option in (False, True):
        intensities = read(path, TableFormat(columns=columns, db=option))[1]
        assert intensities == pytest.approx((COUNTS * 10 ** (offset_db / 20)).tolist(), rel=1e-4)


def test_a15_two_columns_with_units_in_their_names_need_no_option(shell: Shell, tmp_path: Path) -> None:
    path = decibel_table(tmp_path, "level_dBV")
    for options in ((), ("--columns", "angle_deg,level_dBV")):
        code, out, _ = shell("replay", path, *options, "--json")
        assert (code, json.loads(out)["angle_deg"]) == (0, pytest.approx(MARKER_DEG, abs=0.5))


@pytest.mark.parametrize("name", ["amplitude [mV]", "counts"])
def test_a15_a_name_and_the_option_that_disagree_are_refused(shell: Shell, tmp_path: Path, name: str) -> None:
    path = small(tmp_path, f"angle_deg,{name}", "-1,5", "0,7", "1,5")
    for command in (("bank", "info", path), ("bank", "import", path, tmp_path / "bank.hdf5"), ("replay", path)):
        code, _, err = shell(*command, "--columns", f"angle_deg,{name}", "--db")
        assert code == 2
        assert f"--db is given, and the column {name} names another unit" in " ".join(err.split())
    assert shell("bank", "info", path, "--columns", f"angle_deg,{name}")[0] == 0


def test_a15_a_variable_of_an_array_file_too(shell: Shell, tmp_path: Path) -> None:
    np.savez(tmp_path / "scan.npz", angle_deg=ANGLES_DEG, intensity_db=20 * np.log10(COUNTS))
    assert shell("bank", "import", tmp_path / "scan.npz", tmp_path / "bank.hdf5")[0] == 0
    assert max(read_bank(tmp_path / "bank.hdf5").intensities) == pytest.approx(COUNTS.max())
    np.savez(tmp_path / "volts.npz", angle_deg=ANGLES_DEG, level_V=COUNTS)
    options = ("--columns", "angle_deg,level_V", "--db")
    assert shell("bank", "import", tmp_path / "volts.npz", tmp_path / "volts.hdf5", *options)[0] == 2
    with pytest.raises(ConfigError, match="another unit"):
        read(small(tmp_path, "angle_deg,level_V", "0,1"), TableFormat(columns=("1", "2"), db=True))


# A12

WRAPPED = {
    # angles as recorded, where the marker is among them, the range and the marker's place once unwrapped
    "0": (np.r_[312:360:0.5, 0:23:0.5], 355.2, (-48, 22.5), -4.8),
    "0, no 0": (np.r_[312:360:0.5, 0.5:23:0.5], 0.4, (-48, 22.5), 0.4),
    "360 and 0": (np.r_[312:360.5:0.5, 0:23:0.5], 3.0, (-48, 22.5), 3.0),
    "180": (np.r_[150:180:0.5, -180:-149.5:0.5], -178.3, (150, 210), 181.7),
    "180, mostly below": (np.r_[170:180:0.5, -180:-129.5:0.5], 176.0, (-190, -130), -184.0),
    "tenths": (np.r_[340:360:0.7, 0.3:30:0.7], 359.0, (-20, 29.7), -1.0),
    "more than half a turn": (np.r_[200:360:1.0, 0:101:1.0], 359.0, (-160, 100), -1.0),
}
ORDERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as scanned": lambda angles: angles,
    "down": lambda angles: angles[::-1],
    "sorted": np.sort,
    "shuffled": lambda angles: np.random.default_rng(2).permutation(angles),
}


def curve(angles: np.ndarray, marker_deg: float) -> np.ndarray:
    off = (angles - marker_deg + 180) % 360 - 180
    return 400 + 7900 * np.exp(-0.5 * (off / 2) ** 2) + np.random.default_rng(1).normal(0, 20, angles.size)


def wrapped_table(folder: Path, angles: np.ndarray, marker_deg: float) -> Path:
    return small(folder, "angle_deg,intensity", *map("{0:.1f},{1:.2f}".format, angles, curve(angles, marker_deg)))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", WRAPPED)
@pytest.mark.usefixtures("notes_allowed")
def test_a12_a_scan_across_a_turn_is_unwrapped(tmp_path: Path, name: str, order: str) -> None:
    recorded, marker_deg, (low_deg, high_deg), found_deg = WRAPPED[name]
    path = wrapped_table(tmp_path, ORDERS[order](recorded), marker_deg)
    with noted(f"it runs from {low_deg:g} to {high_deg:g} deg, and all angles of the answer"):
        bank = read_bank(path)
    assert (bank.range.low_deg, bank.range.high_deg) == (low_deg, high_deg)
    assert max(np.diff(bank.angles_deg)) <= 1.000001
    peak = peak_of(Curve(angle_deg=np.array(bank.angles_deg), intensity=np.array(bank.intensities)))
    assert [peak.com_deg, peak.cen_deg] == pytest.approx([found_deg] * 2, abs=0.2)


def test_a12_the_unwrapped_scan_is_searched_and_that_is_said_once(shell: Shell, tmp_path: Path) -> None:
    angles, marker_deg, _, found_deg = WRAPPED["0"]
    path = wrapped_table(tmp_path, angles[::2], marker_deg)
    code, out, err = shell("replay", path, "--tolerance-deg", 2, "--reference-deg", marker_deg, "--json")
    said = json.loads(out)
    assert (code, said["angle_deg"]) == (0, pytest.approx(found_deg, abs=1))
    assert said["reference_deg"] == pytest.approx(found_deg)
    assert " ".join(err.split()).count("jump by a full turn") == 1


@pytest.mark.parametrize(
    ("angles", "says"),
    [
        (np.arange(170, 231.0), None),  # beyond 180 without a jump
        (np.arange(300, 361.0), None),
        (np.r_[-60:-29.0, 30:61.0], None),  # two parts of a scan: the gap is not the rest of the turn
        (np.array([-100.0, 0, 100]), None),
        (np.arange(-179, 180, 2.0), "cover the full circle"),
        (np.arange(0, 361, 5.0), "cover the full circle"),
        (np.delete(np.arange(0, 360, 5.0), 20), "cover the full circle"),  # one angle is missing
    ],
)
def test_a12_other_scans_keep_their_angles(tmp_path: Path, angles: np.ndarray, says: str | None) -> None:
    path = small(tmp_path, "angle_deg,intensity", *(f"{angle},{1 + index}.5" for index, angle in enumerate(angles)))
    if says is None:
        assert read(path)[0] == angles.tolist()
    else:
        with noted(says):
            assert read(path)[0] == angles.tolist()
