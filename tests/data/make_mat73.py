"""Makes .mat files of version 7.3 with an independent writer, as fixtures: python make_mat73.py FOLDER.

Needs ``pip install hdf5storage==0.2.2 mat73==0.65``; mat73, a third program, must read what hdf5storage wrote.
"""

from __future__ import annotations

import sys
from pathlib import Path

import hdf5storage
import mat73
import numpy as np

ANGLES = np.array([[2.0, -1.0, 0.5, 7.0]])
COUNTS = np.random.default_rng(73).integers(-2048, 2048, (4, 8, 30)).astype(np.int16)
FRAME = np.random.default_rng(74).integers(-2048, 2048, (32, 20, 4)).astype(np.int16)
CONTENTS = {
    "scan-7.3.mat": {
        "angle_deg": ANGLES,
        "frames": COUNTS,
        "sampling_hz": 31.25e6,
        "reference_angle_deg": 0.7,
        "note": "a text",
        "empty": np.empty((0, 3)),
        "complex": np.array([1.0 + 2.0j]),
        "cells": np.array([1.0, "two"], dtype=object),
    },
    "frame-7.3.mat": {"AdcData_frame000": FRAME, "SampleNum": 15.0},
}

for name, content in CONTENTS.items():
    path = Path(sys.argv[1]) / name
    hdf5storage.savemat(str(path), content, format="7.3", store_python_metadata=False)
    read = mat73.loadmat(path)
    for key, value in content.items():
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind in "if" and value.size):
            np.testing.assert_array_equal(np.squeeze(read[key]), np.squeeze(value))
