"""A recording of one's own: each of its angles once, the same answer in every unit, and the answer from all of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

Shell = Callable[..., tuple[int, str, str]]
PER_DEGREE = {"deg": 1.0, "rad": math.pi / 180, "mrad": 1e3 * math.pi / 180}


def scan(path: Path, unit: str = "deg") -> Path:
    """A clean scan of 36 angles with its marker at 7.3°, as a table in this unit."""
    angles_deg = np.linspace(-35, 35, 36)
    noise = 0.3 * np.abs(np.random.default_rng(3).normal(size=36))
    intensities = 100 / (1 + ((angles_deg - 7.3) / 6) ** 2) ** 1.2 + noise
    rows = np.column_stack([angles_deg * PER_DEGREE[unit], intensities])
    np.savetxt(path, rows, delimiter=",", header=f"angle_{unit},intensity", comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize("unit", PER_DEGREE)
def test_a_clean_scan_is_found_in_every_unit(shell: Shell, tmp_path: Path, unit: str) -> None:
    code, out, _ = shell("replay", scan(tmp_path / "mine.csv", unit), "--json")
    result = json.loads(out)
    assert (code, result["answer"]) == (0, "found")
    assert result["angle_deg"] == pytest.approx(7.3, abs=0.1)
    assert [each["angle_deg"] for each in result["samples"]] == pytest.approx(np.linspace(-35, 35, 36).tolist())
    search = result["search"]
    assert len({each["angle_deg"] for each in search["samples"]}) == len(search["samples"]) == search["acquisitions"]
    assert result["confirmation"] is None
    low_deg, high_deg = result["interval95_deg"]
    assert low_deg < 7.3 < high_deg
    assert high_deg - low_deg < 1.0


def test_a_recording_too_short_for_a_method_is_said_to_be_so(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("angle_deg,intensity\n-10,1\n-5,4\n0,9\n5,4\n10,1\n")
    code, _, err = shell("replay", path, "--method", "manual")
    assert code == 2
    assert "manual needs at least 10 acquisitions, and the recording holds 5 angles" in " ".join(err.split())


@pytest.mark.parametrize(("marker_deg", "answer", "code"), [(12.0, "found", 0), (None, "not found", 3)])
def test_amounts_of_noise_in_a_file_are_no_second_source(
    shell: Shell, tmp_path: Path, marker_deg: float | None, answer: str, code: int
) -> None:
    rng = np.random.default_rng(5)
    angles_deg = np.linspace(-62, 62, 87)
    curve = 0.0 if marker_deg is None else 100 / (1 + ((angles_deg - marker_deg) / 4.6) ** 2) * rng.normal(1, 0.03, 87)
    rows = np.column_stack([angles_deg, abs(curve + rng.normal(size=87))])
    np.savetxt(tmp_path / "mine.csv", rows, delimiter=",", header="angle_deg,intensity", comments="")
    ended, out, _ = shell("replay", tmp_path / "mine.csv", "--json")
    result = json.loads(out)
    assert (result["answer"], ended) == (answer, code)
    # Some of the angles of a file of noise do not always show that it holds nothing else.
    searched = result["search"]["answer"]
    assert searched == answer or (marker_deg is None and searched in ("unsure", "ambiguous"))


def test_variables_of_ones_own_are_named_and_a_bank_says_by_what_it_is_imaged(shell: Shell, tmp_path: Path) -> None:
    frames = np.random.default_rng(1).integers(-99, 99, (128, 300, 4)).astype(np.int16)
    savemat(tmp_path / "mine.mat", {"theta": np.radians([-3.0, 0.0, 3.0, 6.0]), "rf": frames})
    words = ("bank", "import", tmp_path / "mine.mat", tmp_path / "mine.hdf5", "--sampling-mhz", 40)
    code, _, err = shell(*words)
    assert (code, "angle_deg" in err or "intensity or frames expected" in err) == (2, True)
    named = (*words, "--columns", "theta,rf", "--unit", "rad")
    code, _, err = shell(*named)
    assert (code, "--axes channels,samples,angles" in err) == (2, True)
    code, _, err = shell(*named, "--axes", "channels,samples,angles")
    assert code == 0, err
    known = json.loads(shell("bank", "info", tmp_path / "mine.hdf5", "--json")[1])
    assert (known["angles"], known["first_deg"]) == (4, pytest.approx(-3.0))
    assert known["intensities_stored"]
    assert known["imaged_by"].startswith("the chain of BPL9-5/55 (as the file has it): 128 elements of 0.4")
    other = json.loads(shell("bank", "info", tmp_path / "mine.hdf5", "--probe", "BPL9-5/55", "--json")[1])
    assert not other["intensities_stored"]
    assert other["imaged_by"].startswith("the chain of BPL9-5/55 (--probe): 128 elements")


def test_a_picture_goes_to_out_or_into_the_file_that_is_named(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bank = scan(tmp_path / "mine.csv")
    assert shell("bank", "info", bank, "--plot")[0] == 0
    assert (tmp_path / "out" / "mine.png").read_bytes().startswith(b"\x89PNG")
    assert shell("replay", bank, "--plot", "--out", "paper/fig.pdf")[0] == 0
    assert [each.name for each in (tmp_path / "paper").iterdir()] == ["fig.pdf"]
    assert (tmp_path / "paper" / "fig.pdf").read_bytes().startswith(b"%PDF-")


def frames_of(path: Path, *, per_degree: float, channels: int = 128) -> Path:
    """A scan of a point at 7.3°, at 61 angles; ``per_degree``: what is written for a degree."""
    angles_deg = np.arange(-30.0, 31.0)
    across_m = 0.43e-3 * (np.arange(channels) - (channels - 1) / 2)
    since_s = np.arange(2600) / 40e6 - np.hypot(across_m - 5e-3, 45e-3)[:, None] / 1500
    pulse = np.exp(-((since_s / 0.15e-6) ** 2)) * np.cos(2 * math.pi * 5e6 * since_s)
    rng = np.random.default_rng(5)
    height = 900 * np.exp(-0.5 * ((angles_deg - 7.3) / 2) ** 2)
    frames = [np.rint(each * pulse + rng.normal(0, 20, pulse.shape)).astype(np.int16) for each in height]
    np.savez(path, angle_deg=angles_deg * per_degree, frames=frames)
    return path


@pytest.mark.parametrize("per_degree", [math.pi / 180, 0.017, 0.04, 0.1])
def test_angles_that_are_no_degrees_are_no_defect_and_no_marker_at_the_end_of_the_range(
    shell: Shell, tmp_path: Path, per_degree: float
) -> None:
    path = frames_of(tmp_path / "mine.npz", per_degree=per_degree)
    code, out, err = shell("replay", path, "--json")
    result = json.loads(out)
    assert (code in (0, 3), result["answer"] in ("found", "unsure")) == (True, True), err
    if result["answer"] == "unsure":
        assert "check unit and scale of the angles" in result["reason"]
    else:
        low_deg, high_deg = result["interval95_deg"]
        assert low_deg < 7.3 * per_degree < high_deg
        assert "are these radians?" in err


def test_frames_of_another_probe_are_refused_before_a_search(shell: Shell, tmp_path: Path) -> None:
    code, out, err = shell("replay", frames_of(tmp_path / "mine.npz", per_degree=1.0, channels=64))
    assert (code, out, err.count("refused")) == (2, "", 0)
    assert "mine.npz: its frames have 64 channels, and the probe BPL9-5/55 has 128" in err
    assert "describe it, --probe FILE.toml" in err
