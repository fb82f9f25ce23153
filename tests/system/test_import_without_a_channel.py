"""`bank import` of recordings with a channel that is broken, or left out by hand."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.base_scan import MARKER_DEG, SAMPLING_HZ
from tests.system.foreign_imports import Shell, imported, info, refused

pytestmark = pytest.mark.usefixtures("notes_allowed")


@pytest.mark.parametrize("wrong", ["NaN", "noise"])
def test_channel_without_sound_is_left_out_and_named(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, wrong: str
) -> None:
    spoilt = frames.astype(np.float64)
    if wrong == "NaN":
        spoilt[3:, 40] = np.nan
    else:
        spoilt[:, 40] = np.random.default_rng(1).normal(0.0, 500.0, spoilt[:, 40].shape)
    np.savez(tmp_path / "scan.npz", frames=spoilt, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = imported(shell, tmp_path / "scan.npz")
    assert ("channel 41 holds NaN" if wrong == "NaN" else "times the noise of the others, and is left out") in said
    assert "channel 41 " in said
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        assert not bank["binary_time_series_data"][40].any()
        assert bank["binary_time_series_data"][39].any()


@pytest.mark.parametrize("suffix", [".npz", ".hdf5"])
def test_channels_are_left_out_by_hand(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, suffix: str
) -> None:
    np.savez(tmp_path / "scan.npz", frames=frames, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    path = tmp_path / f"scan{suffix}"
    if suffix == ".hdf5":
        imported(shell, tmp_path / "scan.npz")
        (tmp_path / "bank.hdf5").rename(path)
    assert "the channels are 1 to 128" in refused(shell, path, "--without-channel", "129")
    imported(shell, path, "--without-channel", "3", "--without-channel", "128")
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        silent = ~bank["binary_time_series_data"][()].any(axis=(1, 2, 3))
    assert np.flatnonzero(silent).tolist() == [2, 127]
    (tmp_path / "scan.csv").write_text("angle_deg,intensity\n1,2\n2,3\n3,1\n")
    (tmp_path / "bank.hdf5").unlink()
    assert "--without-channel is for frames" in refused(shell, tmp_path / "scan.csv", "--without-channel", "3")


@pytest.mark.parametrize("words", [(), ("--without-channel", "41", "--without-channel", "3")])
def test_channels_of_a_folder_of_frames_are_left_out(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, words: tuple[str, ...]
) -> None:
    """Volts in a file for each angle; one channel is broken in some of them."""
    (folder := tmp_path / "scan").mkdir()
    for number, (angle_deg, frame) in enumerate(zip(angles_deg, frames, strict=True)):
        volts = (1.65 + 1e-6 * frame).astype(np.float32)
        volts[40] = np.nan if number > 2 else 9.0
        np.save(folder / f"{angle_deg:.6f}.npy", volts)
    assert ("channel 41 holds NaN or infinity, and is left out" in imported(shell, folder, *words)) is not bool(words)
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        silent = ~bank["binary_time_series_data"][()].any(axis=(1, 2, 3))
    assert np.flatnonzero(silent).tolist() == ([2, 40] if words else [40])
    # One of its frames too.
    code, out, err = shell("frame", folder / f"{angles_deg[6]:.6f}.npy", "--json")
    assert (code, "channel 41 holds NaN" in " ".join(err.split())) == (0, True)
    assert json.loads(out)["depth_m"] == pytest.approx(0.0504, abs=0.2e-3)
