"""Which images of a camera show the light of a pulsed laser: a camera sees some pulses and misses others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.core import Float32, StereoPair, UInt8
from markerseek.vision.opencv import opencv

LIT_SHARE = 0.5
"""Least light of an image over that of the brightest one."""

MIN_LIGHT_COUNTS = 6.0
"""Least light over the images with the laser off, in counts of 255, smoothed."""

_BLUR_PX = 0.75
"""Standard deviation of the smoothing, in pixels of an image of half the size, which is four times as fast."""


def lit_pairs(pairs: Sequence[StereoPair], dark: Sequence[StereoPair]) -> list[StereoPair]:
    """Return the pairs in which at least one camera saw the laser's light.

    Parameters
    ----------
    pairs
        Pairs taken while the laser fired, lit or not.
    dark
        Pairs of the same scene with the laser off; at least one.
    """
    if not pairs or not dark:
        return []
    left = np.asarray(np.mean([_halved(pair.left) for pair in dark], axis=0, dtype=np.float32))
    right = np.asarray(np.mean([_halved(pair.right) for pair in dark], axis=0, dtype=np.float32))
    light = [max(_light(pair.left, left), _light(pair.right, right)) for pair in pairs]
    least = max(LIT_SHARE * max(light), MIN_LIGHT_COUNTS)
    return [pair for pair, counts in zip(pairs, light, strict=True) if counts >= least]


def _light(image: UInt8[np.ndarray, "rows columns"], dark: Float32[np.ndarray, "rows columns"]) -> float:
    """The most that a place of an image is brighter than with the laser off, in counts."""
    return float(opencv(_PURPOSE).GaussianBlur(_halved(image) - dark, (0, 0), _BLUR_PX).max())


def _halved(image: UInt8[np.ndarray, "rows columns"]) -> UInt8[np.ndarray, "rows columns"]:
    """The image at half its size: the mean of each four pixels."""
    cv2 = opencv(_PURPOSE)
    half: UInt8[np.ndarray, "rows columns"] = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return half


_PURPOSE = "finding the laser's light in camera images"
