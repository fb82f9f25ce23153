"""The image on the page: its layers, where their pixels are, and its peak."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from markerseek import rigs
from markerseek.bridges.page.image_bytes import (
    BRIGHT_SIGMAS,
    OVER_B_MODE_DB,
    RANGE_DB,
    _b_mode_layer,
    picture_of,
    pooled_levels,
)
from markerseek.bridges.page.models import image_model, image_texts
from markerseek.bridges.page.run_history import RunHistory
from markerseek.core import (
    BModeImage,
    Measured,
    PaImage,
    ScanGeometry,
    SearchPlan,
)
from markerseek.runs import new_session
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings


def test_image_keeps_its_peak_and_noise_looks_like_noise():
    rng = np.random.default_rng(1)
    envelope = rng.rayleigh(1.0, (990, 12)).astype(np.float32)
    envelope[517, 7] = 300.0
    image = PaImage(envelope=envelope, lateral_m=np.linspace(-0.02, 0.02, 12), depth_m=np.linspace(0.004, 0.08, 990))
    levels = pooled_levels(image, brightest=300.0)
    assert levels.shape == (198, 12)
    assert np.unravel_index(levels.argmax(), levels.shape) == (517 // 5, 7)
    assert levels.max() == 255
    # Brute force, pixel by pixel.
    for row, column in ((0, 0), (100, 3), (197, 11)):
        relative = envelope[5 * row : 5 * row + 5, column].max() / 300.0
        expected = 255 * max(0.0, 1 + 20 * np.log10(relative) / RANGE_DB)
        assert levels[row, column] == pytest.approx(expected, abs=0.5)
    assert pooled_levels(image, brightest=BRIGHT_SIGMAS)[:50].max() < 255 * (
        1 + 20 * np.log10(6 / BRIGHT_SIGMAS) / RANGE_DB
    )


def levels_of(layer):
    return np.frombuffer(base64.b64decode(layer.pixels), dtype=np.uint8).reshape(layer.rows, layer.columns)


def centre_mm(layer, row, column):
    """Lateral position and depth of a pixel's centre, from the edges between which the browser draws it."""
    (left, right), (top, bottom) = layer.lateral_mm, layer.depth_mm
    return (
        left + (right - left) * (column + 0.5) / layer.columns,
        top + (bottom - top) * (row + 0.5) / layer.rows,
    )


def test_b_mode_of_the_frame_is_the_background_and_both_are_where_their_pixels_are():
    receiver, marker = ReceiverSettings(b_mode=True), MarkerSettings(angle_deg=4.0, lateral_m=6e-3)
    rig = rigs.simulated(seed=1, settings=SimulatedSettings(receiver=receiver, marker=marker))
    run = RunHistory(new_session(rig, SearchPlan(method="posterior")).configuration)
    sample = rig.scanner.measure(4.0)
    run.add(Measured(role="search", index=1, sample=sample), clock_s=0.0)
    picture, b_mode = run.picture(run.last), sample.frame.b_mode
    _, note = image_texts(picture, elsewhere=False, simulated=True)
    assert note == "photoacoustic, 20 dB; ring: its peak; grey: B-mode (simulated)"
    np.testing.assert_array_equal(levels_of(picture.b_mode), b_mode.pixels)
    for layer, geometry, row, column in (
        (picture.b_mode, b_mode.geometry, 40, 200),
        (picture.image, rig.imaging.picture(sample.frame).geometry, 100, 90),
    ):
        # Five rows of the photoacoustic image are drawn as one.
        full_row = row if layer is picture.b_mode else 5 * row + 2
        place_m = geometry.position_m(row=full_row, column=column)
        assert centre_mm(layer, row, column) == pytest.approx([1e3 * each for each in place_m], abs=1e-6)
    assert picture.range_db == OVER_B_MODE_DB


def test_large_b_mode_images_are_thinned_where_they_are():
    pixels = np.arange(1000 * 640, dtype=np.uint32).astype(np.uint8).reshape(1000, 640)
    geometry = ScanGeometry(first_lateral_m=-0.02, lateral_step_m=1e-4, first_depth_m=0.01, depth_step_m=2e-4)
    layer = _b_mode_layer(BModeImage(pixels=pixels, geometry=geometry))
    assert (layer.rows, layer.columns) == (334, 214)
    assert levels_of(layer)[7, 11] == pixels[21, 33]
    assert centre_mm(layer, 7, 11) == pytest.approx([1e3 * each for each in geometry.position_m(row=21, column=33)])


def test_picture_of_a_simulated_frame_has_its_peak_where_the_reading_has_it():
    rig = rigs.simulated(seed=1, marker_deg=2.0)
    sample = rig.scanner.measure(2.0)
    picture = picture_of(sample, rig.imaging.picture(sample.frame), None)
    lateral_mm, depth_mm = centre_mm(picture.image, *np.unravel_index(levels_of(picture.image).argmax(), (198, 128)))
    # A pixel is 0.43 mm wide and 0.39 mm deep; the reading has found the peak between its pixels.
    assert (lateral_mm, depth_mm) == pytest.approx(picture.peak_mm, abs=0.25)
    # Nothing is drawn below data that is not data.
    assert picture.b_mode is None
    for elsewhere, title in (
        (False, f"image of {sample.angle_deg:.2f}°"),
        (True, f"last image: {sample.angle_deg:.2f}°"),
    ):
        assert image_texts(picture, elsewhere=elsewhere, simulated=True)[0] == title
    assert image_model(picture, floor=None)["deg"] == sample.angle_deg
    assert image_model(None, floor=None)["pixels"] == ""
    # The largest envelope of noise is no marker.
    below, above = (image_model(picture, floor=share * sample.reading.intensity) for share in (0.9, 1.0))
    assert (below["peak"], above["peak"]) == (picture.peak_mm, None)
