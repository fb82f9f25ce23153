"""`bank import` of IQ data, with their carrier and without it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import hilbert, resample_poly

from markerseek.records.banks import FrameBank, read_bank
from tests.base_scan import MARKER_DEG, SAMPLING_HZ
from tests.system.foreign_imports import STEPS, Shell, answer_deg, imported, info, refused, zea

pytestmark = pytest.mark.usefixtures("notes_allowed")


CARRIER_HZ = 6.3e6


def iq_of(frames: np.ndarray, *, every: int = 1) -> np.ndarray:
    """The frames mixed down by the carrier, filtered, and every so many-th sample kept, as a machine does."""
    time_s = np.arange(frames.shape[2]) / SAMPLING_HZ
    mixed = hilbert(frames.astype(float), axis=2) * np.exp(-2j * np.pi * CARRIER_HZ * time_s)
    return mixed if every == 1 else resample_poly(mixed, 1, every, axis=2)


def zea_of_iq(path: Path, frames: np.ndarray, every: int) -> Path:
    iq = iq_of(frames, every=every)
    pairs = np.stack([iq.real, iq.imag], axis=-1).astype(np.float32)
    zea(path, pairs.transpose(0, 2, 1, 3)[:, None])
    with h5py.File(path, "r+") as file:
        place = file["tracks/track_0/scan"]
        place["sampling_frequency"][...] = SAMPLING_HZ / every
        place["demodulation_frequency"] = np.float32(CARRIER_HZ)
    return path


@pytest.mark.parametrize("every", [1, 4])
def test_iq_data_with_their_carrier_are_imaged(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, every: int
) -> None:
    """In every form: pairs of zea, pairs along a last axis, complex numbers of NumPy and of MATLAB."""
    imported(shell, zea_of_iq(tmp_path / "zea.hdf5", frames, every), *STEPS)
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    assert found["sampling_hz"] == SAMPLING_HZ
    iq = iq_of(frames, every=every)
    held = {"angle_deg": angles_deg, "sampling_hz": SAMPLING_HZ / every, "demodulation_frequency": CARRIER_HZ}
    np.savez(tmp_path / "scan.npz", frames=iq.astype(np.complex64), **held)
    np.savez(tmp_path / "pairs.npz", frames=np.stack([iq.real, iq.imag], axis=-1).astype(np.float32), **held)
    savemat(tmp_path / "scan.mat", {"frames": iq, **held})
    for name in ("scan.npz", "pairs.npz", "scan.mat"):
        bank = read_bank(tmp_path / name)
        assert isinstance(bank, FrameBank)
        # Between the filter's edges, in the strongest sound behind the pick-up.
        channel, sample = np.unravel_index(np.abs(frames[5, :, 500:].astype(int)).argmax(), frames[5, :, 500:].shape)
        window = np.s_[channel, 500 + sample - 20 : 500 + sample + 20]
        alike = np.corrcoef(bank.frame(5).samples[window], frames[5][window])[0, 1]
        assert alike > (0.999 if every == 1 else 0.95)


def test_iq_data_without_their_carrier_are_read_by_their_envelope(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    iq = iq_of(frames)
    pairs = np.stack([iq.real, iq.imag], axis=-1).astype(np.float32)
    path = zea(tmp_path / "scan.hdf5", pairs.transpose(0, 2, 1, 3)[:, None])
    said = imported(shell, path, *STEPS)
    assert "its frames are IQ data, and demodulation_frequency is missing, without which there is no image" in said
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.3)
    # Also at a rate that would be too low for an image.
    for every in (1, 4):
        np.savez(
            tmp_path / "scan.npz", frames=iq_of(frames, every=every), angle_deg=angles_deg, sampling_hz=40e6 / every
        )
        assert answer_deg(shell, tmp_path / "scan.npz") == pytest.approx(MARKER_DEG, abs=0.3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"demodulation_frequency": 6.3},
            r"demodulation_frequency is [6.3], it must be one number in Hz, 100000 to 1e+08",
        ),
        ({"frames": None}, "6.3e+06 Hz, as of IQ data, and its frames are real numbers; save them as complex numbers"),
        ({"sampling_hz": None}, "its frames are IQ data, and sampling_hz is missing; add the rate of the pairs, in Hz"),
    ],
)
def test_carrier_that_makes_no_sense_is_refused(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, changes: dict[str, Any], message: str
) -> None:
    held = {"frames": iq_of(frames), "angle_deg": angles_deg, "sampling_hz": 40e6, "demodulation_frequency": CARRIER_HZ}
    held |= changes
    if held["frames"] is None:
        held["frames"] = frames
    np.savez(tmp_path / "scan.npz", **{name: value for name, value in held.items() if value is not None})
    assert message in refused(shell, tmp_path / "scan.npz")
