"""The imaging chain on measured frames, which are stored outside of the repository.

The positions are those of the data set's README, read off by another beamformer, and no ground truth.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.records.banks.frames import load_frame
from markerseek.signals import ImageReader, probe_preset

FOLDER = Path(
    os.environ.get("MARKERSEEK_REAL_FRAMES", Path(__file__).parents[2] / "../shared/data/pa-point-source")
).resolve()

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no real frames in {FOLDER} (MARKERSEEK_REAL_FRAMES)")

FIRST_MM = {
    "waterbath_20170419-171121": (0.6, 12.0),
    "waterbath_20170419-171235": (1.8, 18.7),
    "waterbath_20170419-171529": (-8.1, 17.9),
    "waterbath_20170419-171551": (-7.2, 22.8),
    "waterbath_20170419-171659": (11.4, 10.4),
    "waterbath_20170419-171723": (10.9, 19.1),
    "phantom_20180124-144553": (5.4, 14.9),
    "phantom_20180124-144741": (4.8, 14.9),
    "phantom_20180124-145542": (-5.1, 19.7),
    "phantom_20180124-150201": (16.6, 19.1),
}
READER = ImageReader(probe_preset("L3-8"))


def real_frame(name):
    return load_frame(FOLDER / f"{name}.mat")


@pytest.mark.parametrize("name", FIRST_MM)
def test_the_first_arrival_is_among_the_two_strongest(name):
    findings = READER.findings(real_frame(name))
    assert findings.found, findings.reason
    lateral, depth = FIRST_MM[name]
    near = [
        each
        for each in (findings.strongest, *findings.others[:1])
        if abs(1e3 * each.lateral_m - lateral) <= 0.5 and abs(1e3 * each.depth_m - depth) <= 0.8
    ]
    assert near, findings


@pytest.mark.parametrize("name", FIRST_MM)
def test_saturation_is_reported_in_the_phantom_and_nowhere_else(name):
    findings = READER.findings(real_frame(name))
    assert bool(findings.saturated_channels) == name.startswith("phantom")
    assert findings.dead_channels == ()


@pytest.mark.parametrize("name", FIRST_MM)
def test_with_channels_permuted_and_signs_flipped_there_is_no_source(name):
    """100 seeds a frame, 1,000 in all, and not one is found: the rate is below 3 in 1,000 (95 %)."""
    frame = real_frame(name)
    found = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        signs = rng.choice([-1, 1], size=(len(frame.samples), 1))
        mixed = np.clip(frame.samples[rng.permutation(len(frame.samples))] * signs, -32768, 32767)
        if READER.findings(replace(frame, samples=mixed.astype(np.int16))).found:
            found.append(seed)
    assert found == []
