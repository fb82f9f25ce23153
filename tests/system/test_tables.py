"""Tables of one's own by the commands: numbers that may be read in two ways, decibels, a scan across a full turn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.records.banks import TableFormat, read_bank
from tests.written_tables import ANGLES_DEG, COUNTS, read, small

Shell = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize("sign", [".", ","])
@pytest.mark.parametrize("skip", [False, True])
def test_without_evidence_a_sign_is_refused_and_rows_are_not_left_out(
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


@pytest.mark.parametrize("cell", ["8265 mV", ">4095", "8265?", "8 26", "1,05,5", "12.03.2024", "~900", "$900"])
def test_what_looks_like_a_number_is_never_left_out(shell: Shell, tmp_path: Path, cell: str) -> None:
    path = small(tmp_path, "angle_deg;intensity", "-1,5;387", f"0;{cell}", "1;455", "2;n/a", "3;1")
    for options in ((), ("--skip-invalid",)):
        code, _, err = shell("bank", "info", path, *options)
        said = " ".join(err.split())
        assert (code, "looks like a number and cannot be read" in said) == (2, True)
        assert "all such rows: --skip-invalid" not in said


@pytest.mark.parametrize("name", ["amplitude [mV]", "counts"])
def test_a_name_and_the_option_that_disagree_are_refused(shell: Shell, tmp_path: Path, name: str) -> None:
    path = small(tmp_path, f"angle_deg,{name}", "-1,5", "0,7", "1,5")
    for command in (("bank", "info", path), ("bank", "import", path, tmp_path / "bank.hdf5"), ("replay", path)):
        code, _, err = shell(*command, "--columns", f"angle_deg,{name}", "--db")
        assert code == 2
        assert f"--db is given, and the column {name} names another unit" in " ".join(err.split())
    assert shell("bank", "info", path, "--columns", f"angle_deg,{name}")[0] == 0


def test_a_variable_of_an_array_file_too(shell: Shell, tmp_path: Path) -> None:
    np.savez(tmp_path / "scan.npz", angle_deg=ANGLES_DEG, intensity_db=20 * np.log10(COUNTS))
    assert shell("bank", "import", tmp_path / "scan.npz", tmp_path / "bank.hdf5")[0] == 0
    assert max(read_bank(tmp_path / "bank.hdf5").intensities) == pytest.approx(COUNTS.max())
    np.savez(tmp_path / "volts.npz", angle_deg=ANGLES_DEG, level_V=COUNTS)
    options = ("--columns", "angle_deg,level_V", "--db")
    assert shell("bank", "import", tmp_path / "volts.npz", tmp_path / "volts.hdf5", *options)[0] == 2
    with pytest.raises(ConfigError, match="another unit"):
        read(small(tmp_path, "angle_deg,level_V", "0,1"), TableFormat(columns=("1", "2"), db=True))
