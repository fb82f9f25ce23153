"""The image on the page: its layers, where their pixels are, and its peak."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from markerseek import rigs
from markerseek.bridges.page.run_history import (
    BRIGHT_SIGMAS,
    RANGE_DB,
    image_model,
    image_texts,
    picture_of,
    pooled_levels,
)
from markerseek.core import (
    PaImage,
)


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


def test_picture_of_a_simulated_frame_has_its_peak_where_the_reading_has_it():
    rig = rigs.simulated(seed=1, marker_deg=2.0)
    sample = rig.scanner.measure(2.0)
    picture = picture_of(sample, rig.imaging.picture(sample.frame))
    lateral_mm, depth_mm = centre_mm(picture.image, *np.unravel_index(levels_of(picture.image).argmax(), (198, 128)))
    # A pixel is 0.43 mm wide and 0.39 mm deep; the reading has found the peak between its pixels.
    assert (lateral_mm, depth_mm) == pytest.approx(picture.peak_mm, abs=0.25)
    for elsewhere, title in (
        (False, f"image of {sample.angle_deg:.2f}°"),
        (True, f"last image: {sample.angle_deg:.2f}°"),
    ):
        assert image_texts(picture, elsewhere=elsewhere) == (title, "photoacoustic, 40 dB; ring: its peak")
    assert image_model(picture, floor=None)["deg"] == sample.angle_deg
    assert image_model(None, floor=None)["pixels"] == ""
    # The largest envelope of noise is no marker.
    below, above = (image_model(picture, floor=share * sample.reading.intensity) for share in (0.9, 1.0))
    assert (below["peak"], above["peak"]) == (picture.peak_mm, None)
