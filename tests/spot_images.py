"""Frames of one camera that looks at a laser spot on tissue."""

from __future__ import annotations

import numpy as np

from markerseek.core import Float64, UInt8
from markerseek.sim import EndoscopeSettings
from markerseek.sim.stereo_endoscope import uneven_tissue


def spot_images(
    place_px: Float64[np.ndarray, " 2"] | None,
    *,
    size_px: tuple[int, int],
    settings: EndoscopeSettings,
    rng: np.random.Generator,
) -> list[UInt8[np.ndarray, "rows columns"]]:
    """Frames of one camera that looks at uneven tissue with a laser spot; simulated.

    ``place_px``: where the spot is, (x, y); None: the laser is off. ``size_px``: width and height of the images.
    """
    width, height = size_px
    columns, rows = np.arange(width), np.arange(height)
    texture = uneven_tissue(size_px, settings=settings, rng=rng)
    images = []
    for _ in range(settings.frames):
        image = texture + settings.noise_counts * rng.standard_normal((height, width), dtype=np.float32)
        if place_px is not None:
            x, y = place_px + settings.spot_sigma_px * rng.standard_normal(2)
            across = np.exp(-0.5 * ((columns - x) / settings.spot_radius_px) ** 2)
            down = np.exp(-0.5 * ((rows - y) / settings.spot_radius_px) ** 2)
            image += settings.spot_counts * down[:, None] * across[None, :]
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return images
