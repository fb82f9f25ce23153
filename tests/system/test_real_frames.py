"""The imaging chain on measured frames, which are stored outside of the repository.

The positions are those of the data set's README, read off by another beamformer, and no ground truth.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

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
OTHERS_MM = {
    "waterbath_20170419-171121": (0.6, 17.0, None),
    "waterbath_20170419-171235": (1.6, 23.6, None),
    "waterbath_20170419-171529": (-8.1, 22.6, None),
    "waterbath_20170419-171551": (-7.2, 27.6, None),
    "waterbath_20170419-171659": (11.2, 15.0, None),
    "waterbath_20170419-171723": (11.0, 23.6, None),
    "phantom_20180124-144553": (-13.0, 17.5, -2.5),
    "phantom_20180124-144741": (-9.7, 26.7, -0.7),
    "phantom_20180124-145542": (9.0, 9.7, None),
    "phantom_20180124-150201": (2.4, 8.8, -1.6),
}
"""The other source of each frame, and its loudness over the first in dB where the README states it."""

READER = ImageReader(probe_preset("L3-8"))


def real_frame(name):
    return load_frame(FOLDER / f"{name}.mat")


def is_at(arrival, lateral_mm, depth_mm):
    return abs(1e3 * arrival.lateral_m - lateral_mm) <= 0.5 and abs(1e3 * arrival.depth_m - depth_mm) <= 0.5


@pytest.mark.parametrize("name", FIRST_MM)
def test_the_sources_are_listed_in_the_readmes_order(name):
    """The first is the strongest. Only lobes and echoes of a source stand between it and the other one."""
    findings = READER.findings(real_frame(name))
    reading = READER.read(real_frame(name))
    assert findings.found, findings.reason
    # Saturation is reported in the phantom and nowhere else.
    assert bool(findings.saturated_channels) == name.startswith("phantom")
    assert findings.dead_channels == ()
    assert reading.arrivals == (findings.strongest, *findings.others)
    assert is_at(findings.strongest, *FIRST_MM[name])
    lateral_mm, depth_mm, relative_db = OTHERS_MM[name]
    places = [index for index, each in enumerate(reading.arrivals) if is_at(each, lateral_mm, depth_mm)]
    assert places, reading.arrivals
    # In two frames the pulse's second lobe and a late echo, coherent to less than a third, are louder.
    between = [
        each
        for each in reading.arrivals[1 : places[0]]
        if each.coherence > 1 / 3 and abs(each.lateral_m - findings.strongest.lateral_m) > 1e-3
    ]
    assert between == []
    assert places[0] <= 3
    if relative_db is not None:
        ratio = reading.arrivals[places[0]].intensity / reading.intensity
        assert 20 * np.log10(ratio) == pytest.approx(relative_db, abs=0.6)


@pytest.mark.long
@pytest.mark.parametrize("name", FIRST_MM)
def test_with_channels_permuted_and_signs_flipped_there_is_no_source(name):
    """100 seeds a frame, 1,000 in all, and not one is found: the rate is below 3 in 1,000 (95 %)."""
    frame = real_frame(name)
    found = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        signs = rng.choice([-1, 1], size=(len(frame.samples), 1))
        mixed = np.clip(frame.samples[rng.permutation(len(frame.samples))] * signs, -32768, 32767)
        if READER.read(replace(frame, samples=mixed.astype(np.int16))).arrivals:
            found.append(seed)
    assert found == []
