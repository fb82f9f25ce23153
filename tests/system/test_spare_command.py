"""``markerseek frame FILE.rf`` on a file as an Ultrasonix machine writes it, from a simulated scene."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from markerseek.acoustics import Absorber, AcousticModel, RectanglePulse
from markerseek.core import LinearArray
from tests.unit.signals.pulse_frames import post_beamformed

ELEMENT_M = LinearArray().lateral_m


@pytest.fixture(scope="module")
def rf_file(tmp_path_factory):
    """Two frames: noise, and a source at 4 mm, 48 mm deep."""
    rng = np.random.default_rng(1)
    model = AcousticModel(laser=RectanglePulse(duration_s=50e-9))
    data = model.channel_data([Absorber(radius_m=58e-3, angle_deg=0.0, lateral_m=4e-3)], angle_deg=0.0)
    scene = 100 / np.abs(data).max() * data
    frames = []
    for channels in (np.zeros_like(scene), scene):
        rf = post_beamformed(
            channels + rng.standard_normal(channels.shape),
            element_m=ELEMENT_M,
            line_m=ELEMENT_M,
            sampling_hz=40e6,
            sound_speed_m_s=1540.0,
            f_number=2.0,
        )
        frames.append(np.rint(10 * rf).astype("<i2").tobytes())
    path = tmp_path_factory.mktemp("rf") / "pa.rf"
    head = struct.pack("<19i", 16, 2, 128, 2080, 16, *[0] * 8, 2, 6_500_000, 40_000_000, 30, 128, 0)
    path.write_bytes(head + b"".join(frames))
    return path


def test_a_source_is_found_and_the_result_says_how(shell, rf_file, tmp_path):
    code, out, _ = shell("frame", rf_file, "--number", 2, "--json", "--plot", "--out", tmp_path)
    report = json.loads(out)
    assert (code, report["found"], report["coherence"]) == (0, True, None)
    assert report["method"] == "SPARE, from post-beamformed RF, dynamic receive focus"
    assert abs(report["lateral_m"] - 4e-3) < 0.05e-3
    assert abs(report["depth_m"] - 48e-3) < 0.05e-3
    assert [path.name for path in tmp_path.glob("*.png")] == ["pa-2.png"]
    assert "SPARE" in shell("frame", rf_file, "--number", 2)[1]


def test_noise_is_no_source(shell, rf_file):
    assert shell("frame", rf_file)[0] == 3


def test_odd_headers_are_refused(shell, rf_file, tmp_path):
    code, _, err = shell("frame", rf_file, "--number", 3)
    assert (code, "there is no frame 3, it holds 2" in " ".join(err.split())) == (2, True)
    slow = tmp_path / "slow.rf"
    body = bytearray(rf_file.read_bytes())
    body[60:64] = struct.pack("<i", 40)
    slow.write_bytes(body)
    code, _, err = shell("frame", slow)
    assert (code, "do not fit probe BPL9-5/55" in err) == (2, True), err
