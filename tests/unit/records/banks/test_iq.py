"""IQ data keep their carrier, and the passes of a scan are compared as those of other frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import hilbert

from markerseek.records.banks import FrameBank, IntensityBank, TableFormat, read_bank
from markerseek.records.banks.arrays import ArrayBank
from markerseek.records.banks.table_format import DEFAULT_FORMAT
from tests.notes import notes_collected

ANGLES_DEG = np.arange(-18.0, 18.1, 1.5)
SAMPLING_HZ = 40e6
CARRIER_HZ = 6.25e6


def frames(marker_deg: float, *, seed: int) -> np.ndarray:
    """Frames of 8 channels with a pulse that is loudest at the marker, (angles, channels, samples)."""
    times_s = np.arange(160) / SAMPLING_HZ
    pulse = np.exp(-(((times_s - 2e-6) / 0.2e-6) ** 2)) * np.cos(2 * np.pi * CARRIER_HZ * times_s)
    height = 1500 * np.exp(-0.5 * ((ANGLES_DEG - marker_deg) / 3.0) ** 2)
    noise = np.random.default_rng(seed).normal(0, 4, (ANGLES_DEG.size, 8, times_s.size))
    return np.asarray(height[:, None, None] * pulse + noise)


def mixed_down(signals: np.ndarray) -> np.ndarray:
    """The same frames as complex IQ data, at the same rate."""
    turns = CARRIER_HZ / SAMPLING_HZ * np.arange(signals.shape[-1])
    return np.asarray(hilbert(signals) * np.exp(-2j * np.pi * turns))


def read(path: Path, table: TableFormat = DEFAULT_FORMAT) -> tuple[IntensityBank | FrameBank, str]:
    """The bank, and what was said."""
    with notes_collected():
        bank = read_bank(path, table)
    return bank, "; ".join(bank.notes)


def there_and_back(back_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles and IQ data of a scan there and back, with the marker so much further on the way back."""
    scan = np.concatenate([frames(2.0, seed=1), frames(2.0 + back_deg, seed=2)[::-1]])
    return np.concatenate([ANGLES_DEG, ANGLES_DEG[::-1]]), mixed_down(scan)


@pytest.mark.parametrize("pairs", [False, True])
@pytest.mark.parametrize("carrier", [{"demodulation_frequency": CARRIER_HZ}, {}])
def test_the_passes_of_iq_data_are_compared(tmp_path: Path, carrier: dict[str, float], pairs: bool) -> None:
    path = tmp_path / "scan.npz"
    angles_deg, iq = there_and_back(2.4)
    held = np.stack([iq.real, iq.imag], axis=-1) if pairs else iq
    np.savez(path, angle_deg=angles_deg, frames=held, sampling_hz=SAMPLING_HZ, **carrier)
    bank, said = read(path)
    assert "the pass of falling angles shows the same curve 2." in said
    assert "deg above the pass of rising angles" in said
    assert ("demodulation_frequency is missing" in said) == (not carrier)
    assert bank.angles_deg == tuple(ANGLES_DEG.tolist())
    assert isinstance(bank, ArrayBank) == bool(carrier)
    if isinstance(bank, ArrayBank):
        assert bank.facts.sampling_hz == SAMPLING_HZ
        loudest = int(np.argmax(np.abs(bank.samples).max(axis=(1, 2))))
    else:
        loudest = int(np.argmax(bank.intensities))
    assert abs(bank.angles_deg[loudest] - 2.0) <= 1.5


def test_pairs_that_are_the_only_frames_are_read_under_any_name(tmp_path: Path) -> None:
    signals = frames(-5.0, seed=3)
    iq = mixed_down(signals)
    held = {"demodulation_hz": CARRIER_HZ, "sampling_hz": SAMPLING_HZ}
    np.savez(tmp_path / "scan.npz", theta_deg=ANGLES_DEG, rx=np.stack([iq.real, iq.imag], axis=-1), **held)
    bank, said = read(tmp_path / "scan.npz")
    assert "the median of each channel is taken off float32" in said
    assert isinstance(bank, ArrayBank)
    assert np.corrcoef(bank.samples[8].ravel(), signals[8].ravel())[0, 1] > 0.999


def test_iq_data_that_end_with_nan_are_cut_off_before_they_are_mixed_up(tmp_path: Path) -> None:
    iq = mixed_down(frames(3.0, seed=4))
    iq[:, :, 150:] = np.nan
    iq[4, :, 120:] = np.nan
    held = {"demodulation_hz": CARRIER_HZ, "sampling_hz": SAMPLING_HZ}
    np.savez(tmp_path / "scan.npz", frames=iq, **held)
    table = TableFormat(first_and_step_deg=(-18.0, 1.5))
    bank, said = read(tmp_path / "scan.npz", table)
    assert "150 of 160 samples are read, and 1 shorter records are filled" in said
    assert isinstance(bank, ArrayBank)
    assert bank.samples.shape == (25, 8, 150)
    # Its end is silent: the median of I and of Q is the level, not a sample of the noise, which would be a tone.
    assert np.abs(bank.samples[4, :, 130:]).max() < 0.2 * np.abs(bank.samples[5, :, 130:]).max()
