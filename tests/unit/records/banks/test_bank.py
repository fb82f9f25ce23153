"""Banks read from disk, and invalid ones refused with the place and the remedy."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from markerseek.core import Interval, LimitError, Permit, ReadingFrame, RecordError
from markerseek.records.banks import FrameBank, IntensityBank, read_bank
from markerseek.records.banks.frames import FolderBank
from markerseek.rigs.replay_devices import ReplayReceiver, ReplayStage
from markerseek.signals import IntensityReader

PERMIT = Permit(token="a", angle_deg=0.0, pulses=16, expires_s=1.0)


def write(folder: Path, text: str) -> Path:
    path = folder / "scan.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.usefixtures("notes_allowed")
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(
        st.tuples(st.floats(-90, 90), st.floats(0, 1e9)),
        min_size=3,
        max_size=30,
        unique_by=lambda row: round(row[0] * 1e5),
    ).filter(lambda rows: all(low + 1e-6 <= high for low, high in pairwise(sorted(angle for angle, _ in rows))))
)
def test_a_table_comes_back_as_another_writer_wrote_it(tmp_path: Path, rows: list[tuple[float, float]]) -> None:
    rows = sorted(rows)
    path = tmp_path / "scan.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("note", "intensity", "angle_deg"))
        writer.writerows(("x", intensity, angle) for angle, intensity in rows)
    bank = read_bank(path)
    assert isinstance(bank, IntensityBank)
    assert bank.angles_deg == tuple(angle for angle, _ in rows)
    assert bank.intensities == tuple(intensity for _, intensity in rows)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("angle_deg,intensity\n0,1\n1,1e308\n2,3\n", "line 3: intensity is 1e.308, it must be at most 1e.60"),
        ("", "this is empty, and a bank is expected; give a CSV of angle_deg,intensity"),
        ("angle_deg,height,x\n1,2,3\n", "line 1: the column intensity is missing"),
        ("angle_deg\n1\n2\n3\n", "line 1: the column intensity is missing"),
        ("angle_deg,intensity\n1,2\n2\n3,4\n", "line 3: it has 1 columns, 2 are expected"),
        ("angle_deg,intensity\n1,2,5\n2,3,5\n3,4,5\n", "line 2: it has 3 columns, 2 are expected; .* decimal comma"),
        ("angle_deg,intensity\n1,2\n2,nan\n3,4\n", "line 3: intensity is nan, it must be finite"),
        ("angle_deg,intensity\n1,2\ninf,1\n3,4\n", "line 3: angle_deg is inf"),
        ("angle_deg,intensity\n1,2\n2,x\n3,4\n", "line 3: intensity is 'x'"),
        ("angle_deg,intensity\n1,2\n2,-1\n3,4\n", "line 3: intensity is -1.0, it must not be negative"),
        (
            "Winkel;Wert\n1;2\n2;1\n3;4\n",
            r"it has Winkel, Wert; .* `columns=ANGLE,INTENSITY`, here perhaps Winkel,Wert$",
        ),
        ("A;Max V\n1;2\n2;1\n3;4\n", r"here perhaps 'A,Max V'$"),
        ("Max V;angle\n1;2\n2;1\n3;4\n", r"here perhaps 'angle,Max V'$"),
        ("encoder_counts;Max V\n1;2\n2;1\n", r"here perhaps 'encoder_counts,Max V' with `deg_per_unit`$"),
        (
            f"A report of {'long ' * 20}standing, which is prose\nand goes on, here\nto its, end\n",
            r"it has A report of [long ]{20,60}…; name the columns of angle and intensity: `columns=ANGLE,INTENSITY`$",
        ),
        ("1,2,3\n2,1,3\n3,4,3\n", "angle_deg and intensity are missing, it has 3 columns without names"),
        ("angle_deg;intensity\n1;1.23,5\n2;1\n3;4\n", "line 2: intensity is '1.23,5', .* and cannot be read"),
        ("angle_deg,intensity,angle_deg\n1,2,3\n2,1,3\n3,4,3\n", "angle_deg appears more than once"),
        ("angle_deg,intensity\n1,2\n2,1\n", "it holds 2 angles, at least 3"),
        ('angle_deg,intensity\n"1,2\n2,1\n', "line 3: this is not in rows and columns, and a bank is expected"),
    ],
)
def test_a_table_with_a_fault_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RecordError, match=message):
        read_bank(write(tmp_path, text))


def test_a_scan_from_high_to_low_is_turned_round_and_blank_lines_are_passed_over(tmp_path: Path) -> None:
    bank = read_bank(write(tmp_path, "angle_deg,intensity\r\n5,1\r\n0,3\r\n\r\n-5,2\r\n   \r\n"))
    assert bank == IntensityBank(angles_deg=(-5.0, 0.0, 5.0), intensities=(2.0, 3.0, 1.0))


def test_folders_are_ordered_by_their_angle_and_not_by_their_name(tmp_path: Path) -> None:
    for name in ("angle_10.0deg", "-2.5", "+3", "angle_-12.5deg"):
        (tmp_path / name).mkdir()
    for name in (".DS_Store", "notes.txt"):
        (tmp_path / name).touch()
    bank = read_bank(tmp_path)
    assert isinstance(bank, FolderBank)
    assert bank.angles_deg == (-12.5, -2.5, 3.0, 10.0)
    assert [place.name for place in bank.places] == ["angle_-12.5deg", "-2.5", "+3", "angle_10.0deg"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "there is no scan in this folder"),
        (("1", "2", "scan 3 of 7"), "cannot be read"),
        (("1", "2", "dark"), "cannot be read"),
        (("left_5", "left_6", "right_5"), "right_5: its name has another word than left_5"),
        (("1", "2", "1.0"), "the angle 1 deg is that of"),
        (("1", "-2"), "it holds 2 angles"),
        (("1", "2", "3"), "its number may count the frames or be an angle"),
        (
            ("frame_010", "frame_011", "frame_012"),
            "name each frame as in angle_12.5deg, or state the angles: `first_and_step_deg",
        ),
    ],
)
def test_folders_without_one_angle_each_are_refused(tmp_path: Path, names: tuple[str, ...], message: str) -> None:
    for name in names:
        (tmp_path / name).mkdir()
    with pytest.raises(RecordError, match=message):
        read_bank(tmp_path)


@pytest.mark.parametrize(
    ("name", "angle_deg"),
    [
        ("angle_-.5deg", -0.5),
        (".5", 0.5),
        ("-12.5°", -12.5),
        ("trus angle -30 deg", -30.0),
        ("Phantom_7deg", 7.0),
        ("Phantom_-7", -7.0),
        ("theta 7", 7.0),
        ("angle_50gon", 45.0),
        ("-1200mrad", -68.7549),
        ("+08", 8.0),
        ("-0.0", 0.0),
    ],
)
def test_an_angle_is_read_with_its_sign_and_its_fraction(tmp_path: Path, name: str, angle_deg: float) -> None:
    for other in ("100", "101", name):
        (tmp_path / other).mkdir()
    bank = read_bank(tmp_path)
    assert bank.angles_deg == (angle_deg, 100.0, 101.0)


@pytest.mark.parametrize(
    "name", ["angle_\N{MINUS SIGN}30", "neg30", "m30", "angle-30", "30-", "12,5", "1e1", "3of7", "30cm"]
)
@pytest.mark.parametrize("suffix", ["", ".npy", ".mat"])
def test_an_angle_that_could_be_meant_otherwise_is_refused(tmp_path: Path, name: str, suffix: str) -> None:
    for other in ("100", "101"):
        (tmp_path / other).mkdir()
    (tmp_path / (name + suffix)).touch() if suffix else (tmp_path / name).mkdir()
    with pytest.raises(RecordError, match=r"cannot be read from this name.*-12\.5 or, .*, angle_-12\.5deg"):
        read_bank(tmp_path)


FRAMES = FolderBank(angles_deg=(-10.0, 0.0, 5.0, 20.0), places=(Path(),) * 4)
BANK = IntensityBank(angles_deg=(-10.0, 0.0, 5.0, 20.0), intensities=(1.0, 3.0, 9.0, 2.0))


@given(angle_deg=st.floats(-10, 20))
def test_between_recorded_angles_the_intensity_is_interpolated_where_that_is_asked_for(angle_deg: float) -> None:
    stage = ReplayStage(BANK, between="interpolated")
    receiver = ReplayReceiver(stage=stage, bank=BANK)
    assert stage.move_to(angle_deg) == angle_deg
    receiver.arm(PERMIT)
    frame = receiver.acquire(PERMIT)
    assert isinstance(frame, ReadingFrame)
    assert IntensityReader().read(frame).intensity == pytest.approx(
        np.interp(angle_deg, BANK.angles_deg, BANK.intensities)
    )


@pytest.mark.parametrize(
    ("bank", "between"), [(BANK, "nearest"), (FRAMES, "nearest"), (FRAMES, "interpolated")], ids=str
)
def test_otherwise_the_stage_goes_to_the_nearest_recorded_angle(
    bank: IntensityBank | FrameBank, between: Literal["nearest", "interpolated"]
) -> None:
    stage = ReplayStage(bank, between=between)
    assert stage.angle_deg == -10.0
    assert stage.limits == Interval(low_deg=-10.0, high_deg=20.0)
    asked = (-10.0, -5.1, -4.9, 2.4, 2.6, 5.0, 19.0, 20.0)
    assert [stage.move_to(angle) for angle in asked] == [-10.0, -10.0, 0.0, 0.0, 5.0, 5.0, 20.0, 20.0]


@pytest.mark.parametrize("angle_deg", [-10.1, 20.5, float("nan")])
def test_what_was_not_recorded_cannot_be_replayed(angle_deg: float) -> None:
    with pytest.raises(LimitError, match="outside the recorded range"):
        ReplayStage(BANK).move_to(angle_deg)
