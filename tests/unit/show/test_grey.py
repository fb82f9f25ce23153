"""Grey levels of photoacoustic images."""

from __future__ import annotations

import numpy as np

from markerseek.show import grey_levels


def test_shades_are_decibels_below_the_brightest_and_a_frame_without_sound_is_black() -> None:
    envelope = np.array([[1.0, 10**-0.5, 0.01, 0.001]], np.float32)
    assert grey_levels(envelope, brightest=1.0).tolist() == [[255, 191, 0, 0]]
    assert grey_levels(0 * envelope, brightest=0.0).tolist() == [[0, 0, 0, 0]]
