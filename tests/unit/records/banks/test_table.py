"""CSV tables as people have them: separators, decimal commas, encodings, names, units, order, repeated angles."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import IntensityBank, TableFormat, angles_in, read_bank
from tests.notes import noted, notes_collected

ANGLES_DEG = (-10.5, -2.0, 0.25, 7.0)
INTENSITIES = (1.5, 20.0, 300.25, 4.0)
EXPECTED = IntensityBank(angles_deg=ANGLES_DEG, intensities=INTENSITIES)


def table(names: str, separator: str, *, comma: bool = False, angles: tuple[float, ...] = ANGLES_DEG) -> str:
    rows = [f"{angle!r}{separator}{value!r}" for angle, value in zip(angles, INTENSITIES, strict=True)]
    text = "\n".join(rows) + "\n"
    return (names + "\n" if names else "") + (text.replace(".", ",") if comma else text)


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "scan.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    "text",
    [
        table("angle_deg,intensity", ","),
        table("Angle_deg;Intensity", ";"),
        table("angle_deg;intensity", ";", comma=True),
        table("angle_deg\tintensity", "\t", comma=True),
        table("angle_deg intensity", "   "),
        table("# angle_deg,intensity", ","),
        table("# my scan, 2024\nangle_deg\tintensity", "\t"),
        table("# my scan, 2024\n\n# second; line\n# angle_deg,intensity", ","),
        "sep=;\n" + table("angle_deg;intensity", ";", comma=True),
        '"angle_deg","intensity"\n' + table("", ","),
    ],
)
def test_separators_decimal_commas_and_encodings(tmp_path: Path, text: str, encoding: str) -> None:
    assert read_bank(written(tmp_path, text, encoding)) == EXPECTED


def test_what_numpy_writes_is_read(tmp_path: Path) -> None:
    file = io.StringIO()
    np.savetxt(file, np.column_stack([ANGLES_DEG, INTENSITIES]))
    with noted("no names; the first is taken as the angle, the second as the intensity"):
        assert read_bank(written(tmp_path, file.getvalue())) == EXPECTED


@pytest.mark.parametrize(
    ("names", "columns"),
    [("Winkel [°];Höhe", ("Winkel [°]", "Höhe")), ("Winkel [°];Höhe", ("1", "2")), ("", ("1", "2"))],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_columns_by_name_and_by_number(tmp_path: Path, names: str, columns: tuple[str, str], encoding: str) -> None:
    path = written(tmp_path, table(names, ";", comma=True), encoding)
    assert read_bank(path, TableFormat(columns=columns)) == EXPECTED
    turned = read_bank(written(tmp_path, "9;8;7\n-1;5;6\n3;4;1\n"), TableFormat(columns=("2", "3")))
    assert turned == IntensityBank(angles_deg=(4.0, 5.0, 8.0), intensities=(1.0, 6.0, 7.0))


def test_a_column_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    path = written(tmp_path, table("a,b", ","))
    with pytest.raises(RecordError, match=r"line 1: there is no column c, it has a, b$"):
        read_bank(path, TableFormat(columns=("a", "c")))
    with pytest.raises(ConfigError, match="two different names or numbers"):
        TableFormat(columns=("a", "a"))


@pytest.mark.parametrize(("unit", "per_deg"), [("rad", math.pi / 180), ("mrad", math.pi / 0.18)])
def test_units_by_the_option_and_by_the_name_of_the_column(tmp_path: Path, unit: str, per_deg: float) -> None:
    angles = tuple(angle * per_deg for angle in ANGLES_DEG)
    by_option = read_bank(written(tmp_path, table("angle,intensity", ",", angles=angles)),
                          TableFormat(columns=("angle", "intensity"), unit=unit))  # type: ignore[arg-type]  # fmt: skip
    by_name = read_bank(written(tmp_path, table(f"angle_{unit},intensity", ",", angles=angles)))
    assert by_option == by_name
    assert by_name.angles_deg == pytest.approx(ANGLES_DEG, abs=1e-12)


def test_a_range_below_two_asks_for_the_unit(tmp_path: Path) -> None:
    path = written(tmp_path, "angle,intensity\n-0.6,1\n0,3\n0.6,2\n")
    columns = ("angle", "intensity")
    with pytest.raises(RecordError, match=r"from -0\.6 to 0\.6: are these radians\? Say so: `unit=rad`, or `unit=deg`"):
        read_bank(path, TableFormat(columns=columns))
    assert read_bank(path, TableFormat(columns=columns, unit="deg")).angles_deg == (-0.6, 0.0, 0.6)
    assert read_bank(path, TableFormat(columns=columns, unit="rad")).range.width_deg == pytest.approx(68.7549, abs=1e-4)
    named = written(tmp_path, "angle_deg,intensity\n-0.6,1\n0,3\n0.6,2\n")
    with noted("are these radians"):
        assert read_bank(named).angles_deg == (-0.6, 0.0, 0.6)


def test_below_the_names_in_a_comment_a_row_that_lacks_a_number_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"line 2.*n/a"):
        read_bank(written(tmp_path, "# angle_deg,intensity\nn/a,3.0\n" + table("", ",")))


def test_any_order_and_repeated_angles_averaged_with_a_word(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    angles = rng.permutation(np.repeat(np.arange(-20.0, 21.0, 4.0), 3))
    values = rng.uniform(0, 100, angles.size)
    rows = "".join(f"{angle!r},{value!r}\n" for angle, value in zip(angles.tolist(), values.tolist(), strict=True))
    with noted("11 repeated angles; the acquisitions of each are averaged; they differ by at most"):
        bank = read_bank(written(tmp_path, "angle_deg,intensity\n" + rows))
    assert isinstance(bank, IntensityBank)
    # NumPy's own histogram as the second opinion.
    edges = np.arange(-22.0, 23.0, 4.0)
    mean = np.histogram(angles, edges, weights=values)[0] / np.histogram(angles, edges)[0]
    assert bank.angles_deg == tuple(np.arange(-20.0, 21.0, 4.0).tolist())
    assert bank.intensities == pytest.approx(mean.tolist(), rel=1e-12)
    with noted("1 repeated angle;"):
        assert len(read_bank(written(tmp_path, "angle_deg,intensity\n0,1\n1e-300,3\n2,3\n5,1\n")).angles_deg) == 3


def test_rows_without_numbers_are_left_out_and_named(tmp_path: Path) -> None:
    path = written(tmp_path, "angle_deg,intensity\n-1,5\n0,nan\n1,7\n2,\n3,n/a\ninf,1\n4,2\n")
    with pytest.raises(
        RecordError, match=r"line 3: intensity is nan, it must be finite; .*all such rows: `skip_invalid`"
    ):
        read_bank(path)
    with noted(r"4 without a finite number left out \(`skip_invalid`\): line 3, 5, 6, 7$"):
        bank = read_bank(path, TableFormat(skip_invalid=True))
    assert bank == IntensityBank(angles_deg=(-1.0, 1.0, 4.0), intensities=(5.0, 7.0, 2.0))


def test_decibels_are_asked_for_and_become_amplitudes(tmp_path: Path) -> None:
    path = written(tmp_path, "angle_deg,intensity\n-1,-40\n0,-20\n1,0\n")
    with pytest.raises(RecordError, match=r"line 2: intensity is -40.0, it must not be negative; are these dB.* `db`"):
        read_bank(path)
    bank = read_bank(path, TableFormat(db=True))
    assert isinstance(bank, IntensityBank)
    assert bank.intensities == pytest.approx((0.01, 0.1, 1.0))
    with pytest.raises(RecordError, match="line 2: intensity is inf, it must be at most"):
        read_bank(written(tmp_path, "angle_deg,intensity\n-1,1e9\n0,1\n1,0\n"), TableFormat(db=True))


def test_two_long_rows_are_taken_for_a_transposed_table(tmp_path: Path) -> None:
    with pytest.raises(
        RecordError, match=r"are its two rows angles and intensities. Then write one row for each of the 4"
    ):
        read_bank(written(tmp_path, "-1,0,1,2\n5,6,7,1\n"))


@pytest.mark.parametrize("name", ["energy", "pulse energy [mJ]", "Laser energy"])
def test_a_column_of_energies_takes_the_laser_out_of_the_intensities(tmp_path, name):
    path = tmp_path / "a.csv"
    path.write_text(f"angle_deg,intensity,{name}\n-5,10,1\n0,60,3\n5,20,2\n", encoding="utf-8")
    with noted(re.escape(f"the intensities are divided by {name} over its mean")):
        bank = read_bank(path)
    assert bank.intensities == pytest.approx((20.0, 40.0, 20.0))
    path.write_text(f"angle_deg,intensity,{name}\n-5,10,1\n0,60,0\n5,20,2\n", encoding="utf-8")
    with pytest.raises(RecordError, match=re.escape(f"line 3: {name} is 0, it must be positive")):
        read_bank(path)


IN_UNIT = {"gon": 1 / 0.9, "arcmin": 60.0, "mdeg": 1000.0, "urad": math.pi / 180 * 1e6, "turn": 1 / 360}


@pytest.mark.parametrize("unit", IN_UNIT)
@pytest.mark.parametrize("name", ["angle_{}", "Probe angle [{}]", "angle ({})"])
def test_a_unit_in_the_name_of_the_column_is_read(tmp_path: Path, unit: str, name: str) -> None:
    rows = "".join(
        f"{angle * IN_UNIT[unit]!r},{value!r}\n" for angle, value in zip(ANGLES_DEG, INTENSITIES, strict=True)
    )
    bank = read_bank(written(tmp_path, f"{name.format(unit)},intensity\n{rows}"))
    assert bank.angles_deg == pytest.approx(ANGLES_DEG, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "other"),
    [("angle [steps]", "steps"), ("encoder_counts", "counts"), ("position [mm]", "mm"), ("Winkel [Grad]", "Grad")],
)
def test_a_unit_that_is_none_of_angle_is_refused_by_its_name_with_the_way_to_degrees(
    tmp_path: Path, name: str, other: str
) -> None:
    path = written(tmp_path, table(f"{name},intensity", ",", angles=(0.0, 250.0, 500.0, 750.0)))
    with pytest.raises(RecordError, match=rf"'{other}' is no unit of an angle; .*`deg_per_unit`, .* `offset_deg`"):
        read_bank(path, TableFormat(columns=(name, "intensity")))
    bank = read_bank(path, TableFormat(columns=(name, "intensity"), deg_per_unit=-0.02, offset_deg=7.5))
    assert bank.angles_deg == (-7.5, -2.5, 2.5, 7.5)
    assert bank.intensities == INTENSITIES[::-1]


def test_counts_may_have_thousands_separators(tmp_path: Path) -> None:
    path = written(tmp_path, "counts;intensity\n-12.000;1,5\n6.000;20\n24.500;300\n")
    bank = read_bank(path, TableFormat(columns=("counts", "intensity"), deg_per_unit=0.001))
    assert bank.angles_deg == (-12.0, 6.0, 24.5)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"deg_per_unit": 0.0}, "`deg_per_unit` is 0: a finite number is needed, and not 0"),
        ({"deg_per_unit": math.nan}, "`deg_per_unit` is nan"),
        ({"offset_deg": math.inf}, "`offset_deg` is inf"),
        ({"deg_per_unit": 2.0, "unit": "gon"}, "both say what a unit is; leave one out"),
        ({"columns": ("", "b")}, "INTENSITY alone with `first_and_step_deg`"),
        ({"columns": ("a", "b"), "first_and_step_deg": (0.0, 1.0)}, "`columns` is 'a,b'"),
    ],
)
def test_a_format_that_contradicts_itself_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        TableFormat(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("names", "units", "angles"),
    [
        ("angle_deg;intensity", "deg;mV", ANGLES_DEG),
        ("Angle;Peak", "[mrad];[V]", tuple(angle * math.pi / 0.18 for angle in ANGLES_DEG)),
        ("Winkel;Signal", "(gon);(a.u.)", tuple(angle / 0.9 for angle in ANGLES_DEG)),
        ("angle;intensity", "°;", ANGLES_DEG),
    ],
)
def test_a_second_line_of_the_head_holds_the_units(
    tmp_path: Path, names: str, units: str, angles: tuple[float, ...]
) -> None:
    bank = read_bank(written(tmp_path, f"{names}\n{units}\n" + table("", ";", angles=angles)))
    assert bank.angles_deg == pytest.approx(ANGLES_DEG, abs=1e-4)
    assert bank.intensities == INTENSITIES
    named = TableFormat(columns=(names.partition(";")[0], names.partition(";")[2]))
    assert read_bank(written(tmp_path, f"{names}\n{units}\n" + table("", ";", angles=angles)), named) == bank


def test_decibels_in_the_second_line_are_amplitudes(tmp_path: Path) -> None:
    bank = read_bank(written(tmp_path, "angle,level\ndeg,dB\n-1,-40\n0,-20\n9,0\n"))
    assert bank.intensities == pytest.approx((0.01, 0.1, 1.0))


def test_a_row_without_numbers_is_no_second_line_of_units(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="line 2: angle_deg is 'n/a', it must be a number"):
        read_bank(written(tmp_path, "angle_deg,intensity\nn/a,-\n" + table("", ",")))


@pytest.mark.parametrize("names", ["angle (deg),amplitude (mV)", "amplitude [V],Winkel [°]", "stage_deg,level_dBV"])
def test_two_columns_with_units_in_their_names_need_no_option(tmp_path: Path, names: str) -> None:
    first = names.startswith("amplitude")
    pairs = [f"{value},{angle}" if first else f"{angle},{value}" for angle, value in ((-9, 3), (0, 12), (9, 5))]
    bank = read_bank(written(tmp_path, "\n".join([names, *pairs])))
    assert bank.angles_deg == (-9.0, 0.0, 9.0)
    assert np.argmax(bank.intensities) == 1


def test_intensities_by_frames_take_stated_angles(tmp_path: Path) -> None:
    path = written(tmp_path, "frame,intensity\n1,5\n2,n/a\n3,9\n4,2\n")
    steps = TableFormat(first_and_step_deg=(8.0, -2.0), skip_invalid=True)
    with noted("line 3"):
        bank = read_bank(path, steps)
    # The row without a number has its place in the scan.
    assert (bank.angles_deg, bank.intensities) == ((2.0, 4.0, 8.0), (2.0, 9.0, 5.0))
    with pytest.raises(RecordError, match="the column angle_deg is missing"):
        read_bank(path)
    named = written(tmp_path, "a,b\n1,5\n2,7\n3,9\n")
    stated = TableFormat(columns=("", "b"), angles_deg=(1.0, 5.0, 9.0))
    assert read_bank(named, stated).angles_deg == (1.0, 5.0, 9.0)
    with pytest.raises(RecordError, match="2 angles are given for 3 rows"):
        read_bank(named, TableFormat(columns=("", "b"), angles_deg=(1.0, 5.0)))
    with pytest.raises(ConfigError, match="its column angle_deg has the angles; leave `first_and_step_deg"):
        read_bank(written(tmp_path, table("angle_deg,intensity", ",")), TableFormat(first_and_step_deg=(0.0, 1.0)))


def test_intensities_without_names_take_stated_angles(tmp_path: Path) -> None:
    steps = TableFormat(first_and_step_deg=(-2.0, 2.0))
    assert read_bank(written(tmp_path, "5.5\n7\n9\n"), steps).angles_deg == (-2.0, 0.0, 2.0)
    path = written(tmp_path, "1,5.5\n2,7\n3,9\n")
    with pytest.raises(ConfigError, match=r"the first may hold the angles; .* `columns=2`"):
        read_bank(path, steps)
    assert read_bank(path, TableFormat(first_and_step_deg=(-2.0, 2.0), columns=("", "2"))).intensities == (
        5.5,
        7.0,
        9.0,
    )


@pytest.mark.parametrize("first", [0, 1])
def test_a_first_column_without_a_name_that_counts_is_asked_about(tmp_path: Path, first: int) -> None:
    path = written(tmp_path, "".join(f"{first + number};{value}\n" for number, value in enumerate(INTENSITIES)))
    with notes_collected() as said:
        assert read_bank(path).notes == tuple(said)
    assert "its columns have no names" in said[0]
    assert "if it only counts, state the angles: `columns=2` `first_and_step_deg" in said[1]


def test_a_list_of_angles_has_the_unit_of_its_name(tmp_path: Path) -> None:
    path = tmp_path / "angles.txt"
    path.write_text("angle [gon]\n-10\n0\n5.5\n", encoding="utf-8")
    assert angles_in(path) == (-9.0, 0.0, 4.95)
    path.write_text("stage [steps]\n-10\n0\n", encoding="utf-8")
    with pytest.raises(RecordError, match="'steps' is no unit of an angle; write them in degrees, or in one of deg"):
        angles_in(path)


def test_the_numbers_of_the_rows_below_no_name_are_no_intensities(tmp_path: Path) -> None:
    bank = read_bank(written(tmp_path, ",angle [gon],amplitude [mV]\n0,-10,3\n1,0,12\n2,10,5\n"))
    assert (bank.angles_deg, bank.intensities) == ((-9.0, 0.0, 9.0), (3.0, 12.0, 5.0))


@pytest.mark.parametrize("overload", ["9.9E+37", "9.9100000e37", "3.4028235e+38", "9.8999997e37", "inf", "Infinity"])
def test_the_sign_of_an_overload_is_refused_by_that_name(tmp_path: Path, overload: str) -> None:
    rows = [f"{angle_deg},{overload if 3 < angle_deg < 7 else 80 - angle_deg}" for angle_deg in range(-10, 11)]
    path = written(tmp_path, "\n".join(["angle_deg,intensity", *rows, ""]))
    with pytest.raises(RecordError, match=r"line 16: intensity is .*its range was exceeded, most probably on the mark"):
        read_bank(path)
