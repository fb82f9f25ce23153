"""A photoacoustic image over the B-mode image of the same angle: one scene, two simulations, one place."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from markerseek.acoustics import Absorber, AcousticModel, Probe, RectanglePulse
from markerseek.cli.frame import b_mode_under
from markerseek.core import (
    BModeImage,
    LinearArray,
    PaImage,
    RecordError,
    ScanGeometry,
)
from markerseek.pictures import overlay_figure
from markerseek.signals import probe_preset
from markerseek.sim import BModeSettings, BModeWorld
from tests.unit.signals.machine_rf import post_beamformed

DEPTH_M, LATERAL_M = 36e-3, 4e-3
SAMPLES = 2080
PRESET = probe_preset("BPL9-5/55")


def b_mode(**changes):
    """B-mode with a tip at the place, and the region of the array's width by the machine's depth."""
    settings = BModeSettings(
        first_depth_m=0.0, last_depth_m=SAMPLES / 40e6 * 1540 / 2, half_width_m=27.5e-3, tip_m=2e-3, **changes
    )
    world = BModeWorld(
        settings=settings,
        probe=Probe(),
        tip_deg=0.0,
        tip_radius_m=DEPTH_M + 10e-3,
        tip_lateral_m=LATERAL_M,
        present=True,
        start_deg=0.0,
        rng=np.random.default_rng(1),
    )
    return settings, world.pixels()


@pytest.fixture(scope="module")
def rf():
    model = AcousticModel(laser=RectanglePulse(duration_s=50e-9))
    data = model.channel_data([Absorber(radius_m=DEPTH_M + 10e-3, angle_deg=0.0, lateral_m=LATERAL_M)], angle_deg=0.0)
    element_m = LinearArray().lateral_m
    lines = post_beamformed(
        100 / np.abs(data).max() * data + np.random.default_rng(2).standard_normal(data.shape),
        element_m=element_m,
        line_m=element_m,
        sampling_hz=40e6,
        sound_speed_m_s=1540.0,
        f_number=2.0,
    )
    return np.rint(10 * lines).astype(np.int16)


def test_the_picture_puts_both_where_their_geometry_says():
    geometry = ScanGeometry(first_lateral_m=-0.01, lateral_step_m=1e-4, first_depth_m=0.02, depth_step_m=2e-4)
    pixels = np.zeros((50, 201), np.uint8)
    envelope = np.zeros((40, 21), np.float32)
    envelope[10, 5] = 1.0
    image = PaImage(envelope=envelope, lateral_m=np.linspace(-5e-3, 5e-3, 21), depth_m=0.022 + 1e-4 * np.arange(40))
    figure = overlay_figure(
        BModeImage(pixels=pixels, geometry=geometry), image, marks_m=[(-2.5e-3, 23e-3)], title="test"
    )
    under, over = figure.axes[0].images
    assert under.get_extent() == list(geometry.edges_mm(50, 201))
    left, right, bottom, top = over.get_extent()
    # The middle of the bright pixel, from the extent that Matplotlib draws.
    assert left + (right - left) * 5.5 / 21 == pytest.approx(-2.5)
    assert top + (bottom - top) * 10.5 / 40 == pytest.approx(23.0)
    assert over.get_alpha()[10, 5] == 1
    assert over.get_alpha()[0, 0] == 0


def b8(path, pixels, corners):
    rows, columns = pixels.shape
    flat = [each for corner in corners for each in corner]
    path.write_bytes(struct.pack("<19i", 4, 1, columns, rows, 8, *flat, 2, 5, 0, 30, 128, 0) + pixels.tobytes())
    return path


def test_the_corners_of_a_b8_place_its_region(tmp_path):
    corners = ((10, 20), (110, 20), (110, 220), (10, 220))
    path = b8(tmp_path / "a.b8", np.zeros((240, 130), np.uint8), corners)
    geometry = b_mode_under(path, number=1, preset=PRESET, samples=SAMPLES).geometry
    width_m, depth_m = 128 * 0.43e-3, SAMPLES / 40e6 * 1540 / 2
    # The outer edges of the first and of the last pixel of the region.
    assert geometry.position_m(row=19.5, column=9.5) == pytest.approx((-width_m / 2, 0.0))
    assert geometry.position_m(row=219.5, column=109.5) == pytest.approx((width_m / 2, depth_m))
    odd = b8(tmp_path / "b.b8", np.zeros((240, 130), np.uint8), ((10, 20), (5, 20), (110, 220), (10, 220)))
    with pytest.raises(RecordError, match="make no rectangle"):
        b_mode_under(odd, number=1, preset=PRESET, samples=SAMPLES)


def test_the_command_draws_both(shell, tmp_path, rf):
    head = struct.pack("<19i", 16, 1, 128, SAMPLES, 16, *[0] * 8, 2, 6_500_000, 40_000_000, 30, 128, 0)
    (tmp_path / "pa.rf").write_bytes(head + rf.astype("<i2").tobytes())
    _, pixels = b_mode()
    rows, columns = pixels.shape
    b8(tmp_path / "us.b8", pixels, ((0, 0), (columns, 0), (columns, rows), (0, rows)))
    words = ("frame", tmp_path / "pa.rf", "--spare", "--over", tmp_path / "us.b8")
    code, _, err = shell(*words, "--out", tmp_path)
    assert code == 0, err
    assert (tmp_path / "pa.png").stat().st_size > 10_000
    code, _, err = shell("frame", tmp_path / "pa.rf", "--spare", "--over", "us.png", "--plot", "--out", tmp_path)
    assert (code, "--over us.png: it is no .b8" in err) == (2, True)
