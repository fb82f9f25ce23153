"""`bank import` of other people's files, which say less than ours or say it otherwise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from markerseek.records.banks import FrameBank, TableFormat, read_bank
from tests.base_scan import MARKER_DEG, SAMPLING_HZ, base_scan
from tests.system.foreign_imports import STEPS, Shell, answer_deg, imported, info, ipasc, refused, zea

pytestmark = pytest.mark.usefixtures("notes_allowed")


@pytest.mark.parametrize("kind", [np.int16, np.float32, np.uint16])
def test_ipasc_without_angles(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, kind: type
) -> None:
    offset = 1 << 15 if kind is np.uint16 else 0
    path = ipasc(tmp_path / "scan.hdf5", (frames.astype(np.int64) + offset).astype(kind), wavelength=780.0)
    said = refused(shell, path)
    assert "angle_deg is missing" in said
    assert "--first-deg" in said
    assert "--angles" in said
    imported(shell, path, *STEPS)
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    # Some programs write nanometres.
    assert found["wavelength_m"] == pytest.approx(780e-9)
    assert found["pitch_m"] == pytest.approx(base_scan().pitch_m)
    # The same with a file of angles, as a spreadsheet of a German laboratory writes it.
    (tmp_path / "bank.hdf5").unlink()
    lines = ["Winkel", *(f"{each:.1f}".replace(".", ",").replace("-", "\u2212") for each in angles_deg - 30)]
    (tmp_path / "angles.txt").write_text("\n".join(lines), encoding="utf-8")
    imported(shell, path, "--angles", tmp_path / "angles.txt")
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG - 30, abs=0.1)


def test_file_of_angles_of_another_length(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    (tmp_path / "angles.txt").write_text("7\n8\n9\n")
    assert "frames has the shape (12, 128, 2080) for 3 angles" in refused(
        shell, path, "--angles", tmp_path / "angles.txt"
    )
    (tmp_path / "angles.txt").write_text("7\n8\neight\n")
    assert "write one angle in degrees on each line" in refused(shell, path, "--angles", tmp_path / "angles.txt")
    (tmp_path / "angles.txt").write_text("7\n8\n9\n")
    assert "leave one out" in refused(shell, path, "--angles", tmp_path / "angles.txt", *STEPS)


def test_zea_without_poses(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = zea(tmp_path / "scan.hdf5", frames.transpose(0, 2, 1)[:, None, :, :, None])
    assert "--first-deg" in refused(shell, path)
    imported(shell, path, *STEPS)
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)


def test_hdf5_with_frames_and_angles_alone(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    path = tmp_path / "scan.h5"
    with h5py.File(path, "w") as file:
        file["frames"] = frames
        file["angle_deg"] = angles_deg
        file["sampling_hz"] = SAMPLING_HZ
    assert answer_deg(shell, path) == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(path, "r+") as file:
        del file["frames"], file["angle_deg"]
        file["angle_deg"] = all_deg = base_scan().angles_deg
        file["intensity"] = 3.0 + 400.0 * np.exp(-(((all_deg - MARKER_DEG) / 3.0) ** 2))
    assert answer_deg(shell, path) == pytest.approx(MARKER_DEG, abs=0.1)


LOCKS = """
import sys, h5py, time
with h5py.File(sys.argv[1], "r+") as file:
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_locked_file_is_called_locked(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    with subprocess.Popen(
        [sys.executable, "-c", LOCKS, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        code, _, said = shell("replay", path)
        other.communicate("")
    assert code == 2
    assert "another program has it open for writing" in " ".join(said.split())
    assert "damaged" not in said


def test_what_is_left_out_of_a_mat_is_named(shell: Shell, tmp_path: Path, angles_deg: np.ndarray) -> None:
    cells = np.empty(3, object)
    cells[:] = [np.ones(2), np.ones(3), np.ones(4)]
    savemat(tmp_path / "scan.mat", {"frames": cells, "probe": {"pitch": 1.0}, "angle_deg": angles_deg})
    said = refused(shell, tmp_path / "scan.mat")
    assert "what cannot be read: frames (cell), probe (struct)" in said


def test_equal_axes_ask(shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray) -> None:
    square = frames[:, 58:70]
    path = tmp_path / "scan.npz"
    np.savez(path, frames=square, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = refused(shell, path)
    assert "axes of equal length do not show which is which" in said
    assert "--axes angles,channels,samples or channels,angles,samples" in said
    np.testing.assert_array_equal(first_frame(path, "angles,channels,samples"), square[0])
    np.testing.assert_array_equal(first_frame(path, "channels,angles,samples"), square[:, 0])


def test_short_record_is_not_called_transposed(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    path = tmp_path / "scan.npz"
    np.savez(path, frames=frames[:, :, 800:900], angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = refused(shell, path)
    assert "128 channels would have 100 samples each: if the record is so short, state it" in said
    assert "--axes angles,channels,samples; else state the order of the axes, --axes angles,samples,channels" in said
    assert "transposed" not in said
    np.testing.assert_array_equal(first_frame(path, "angles,channels,samples"), frames[0, :, 800:900])


def first_frame(path: Path, axes: str) -> np.ndarray:
    """The first frame of arrays with their axes in a stated order."""
    bank = read_bank(path, table=TableFormat(axes=tuple(axes.split(","))))
    assert isinstance(bank, FrameBank)
    return np.asarray(bank.frame(0).samples)


def test_damage_is_called_a_change_of_a_checksum_only(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    with h5py.File(path, "r+") as file:
        del file["meta_data/ad_sampling_rate"]
        file["meta_data/ad_sampling_rate"] = np.array([1.0, 2.0])
    said = refused(shell, path, *STEPS)
    assert "ad_sampling_rate holds 2 numbers" in said
    assert "changed since" not in said


def test_variables_of_hdf5_are_named(shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray) -> None:
    path = tmp_path / "scan.h5"
    with h5py.File(path, "w") as file:
        file["rf"] = frames
        file["theta"] = angles_deg
        file["note"] = "of Monday"
        file["more/x"] = 1
    said = refused(shell, path)
    assert "angle_deg is missing, it holds rf int16 (12, 128, 2080), theta float64 (12,)" in said
    assert "what cannot be read: more (group), note (object); state the first angle" in said
    assert "or name its variables, --columns" in said
    assert answer_deg(shell, path, "--columns", "theta,rf") == pytest.approx(MARKER_DEG, abs=0.1)
    imported(shell, ipasc(tmp_path / "ipasc.hdf5", frames), *STEPS)
    assert "it is no CSV" in shell("bank", "info", tmp_path / "bank.hdf5", "--skip-invalid")[2]
