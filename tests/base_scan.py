"""The base scan of the field reports: simulated channel data with the marker at 12.5°, for tests to spoil."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from markerseek.records.banks import FrameBank, read_bank

MARKER_DEG = 12.5
SAMPLING_HZ = 40e6
RIG = f'kind = "simulated"\n[marker]\nangle_deg = {MARKER_DEG}\nlateral_m = 0.004\n'


class BaseScan(NamedTuple):
    """A scan of 71 angles in steps of 1°; its arrays are shared by tests: copy before you change them."""

    angles_deg: npt.NDArray[np.float64]
    frames: npt.NDArray[np.int16]
    """Channel data, (angle, element, sample)."""
    dark: npt.NDArray[np.int16]
    """Frames without laser, (frame, element, sample)."""
    pitch_m: float


@cache
def base_scan() -> BaseScan:
    """``markerseek bank scan --step-deg 1`` of the simulated rig, once for each process of tests."""
    with TemporaryDirectory() as folder:
        rig = Path(folder, "rig.toml")
        path = Path(folder, "scan.hdf5")
        rig.write_text(RIG)
        command = ("bank", "scan", path, "--rig", rig, "--step-deg", "1", "--seed", "1")
        subprocess.run([sys.executable, "-m", "markerseek", *command], check=True, capture_output=True)
        bank = read_bank(path)
        assert isinstance(bank, FrameBank)
        frames = [bank.frame(index).samples for index in range(len(bank.angles_deg))]
        dark = [bank.dark_frame(index).samples for index in range(bank.dark_frames)]
        return BaseScan(np.array(bank.angles_deg), np.array(frames), np.array(dark), 0.43e-3)
