"""Imports of other people's files: recordings with less in them than ours, and what `bank import` says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from tests.base_scan import SAMPLING_HZ, base_scan

Shell = Callable[..., tuple[int, str, str]]


STEPS = ("--first-deg", "7", "--step-deg", "1")


def ipasc(path: Path, frames: np.ndarray, *, wavelength: float = 780e-9) -> Path:
    """A file as pacfish writes it for a device that knows nothing of angles."""
    with h5py.File(path, "w") as file:
        file["binary_time_series_data"] = frames.transpose(1, 2, 0)[:, :, None, :]
        file["meta_data/ad_sampling_rate"] = SAMPLING_HZ
        file["meta_data/acquisition_wavelengths"] = np.array([wavelength])
        for number in range(frames.shape[1]):
            place = f"meta_data_device/detectors/{number:010d}/detector_position"
            file[place] = np.array([base_scan().pitch_m * number, 0.0, 0.0])
    return path


def zea(path: Path, raw: np.ndarray) -> Path:
    """A file of zea without poses; ``raw``: (frames, 1, samples, elements, 1 or 2)."""
    with h5py.File(path, "w") as file:
        file["tracks/track_0/data/raw_data"] = raw
        file["tracks/track_0/scan/sampling_frequency"] = SAMPLING_HZ
    return path


def imported(shell: Shell, path: Path, *words: object) -> str:
    """What an import said."""
    code, _, said = shell("bank", "import", path, path.with_name("bank.hdf5"), *words)
    assert code == 0, said
    return " ".join(said.split())


def refused(shell: Shell, path: Path, *words: object) -> str:
    """What a refused import said."""
    code, _, said = shell("bank", "import", path, path.with_name("bank.hdf5"), *words)
    assert code == 2, said
    assert not path.with_name("bank.hdf5").exists()
    return " ".join(said.split())


def answer_deg(shell: Shell, path: Path, *words: object) -> float:
    """Angle at which a replay finds the marker."""
    code, out, said = shell("replay", path, "--json", *words)
    assert code == 0, said
    return float(json.loads(out)["angle_deg"])


def info(shell: Shell, path: Path) -> dict[str, float]:
    code, out, said = shell("bank", "info", path, "--json")
    assert code == 0, said
    found: dict[str, float] = json.loads(out)
    return found
