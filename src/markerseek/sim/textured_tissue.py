"""A surface of simulated tissue with texture and relief, and how a camera sees it.

The texture has structure of all sizes from a tenth of a millimetre to centimetres, and vessels. Wet bumps reflect the
light of the endoscope: a highlight is where the surface reflects it into the camera, so that it is at another place of
the tissue for each camera, and moves over the tissue with the endoscope.

A view is computed as from each pixel's line of sight: where it meets the surface is found on a grid of pixels, and
linear in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float32, Float64, Int16
from markerseek.geometry import Camera, RigidTransform

SIZE_M = 0.26
"""Width of the surface in both directions."""

TEXTURE_M = 0.13e-3
"""Step of the texture: about a pixel of an endoscope at 100 mm."""

RELIEF_STEP_M = 2e-3
"""Step of the relief."""

LENGTHS_M = (0.35e-3, 0.8e-3, 2e-3, 5e-3, 14e-3)
"""Lengths over which the brightness changes."""

SHARES = (0.30, 0.45, 0.50, 0.45, 0.35)
"""Standard deviation of the brightness over each, before the whole is scaled to the contrast."""

VESSEL_M = 6e-3
"""Distance between vessels."""

BUMPS = 400
"""Wet bumps of the surface that may reflect the light."""

BUMP_RADIUS_M = (1.5e-3, 6e-3)
"""Radii of their curvature."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TexturedTissue:
    """Tissue between the two edges of a square about the origin, level at a height in the TRUS frame."""

    level_m: float
    """Mean height z."""
    relief_m: Float64[np.ndarray, "rows columns"]
    """Height over that, in steps of `RELIEF_STEP_M`."""
    brightness: Float32[np.ndarray, "rows columns"]
    """Brightness over its mean, in steps of `TEXTURE_M`: rows along y, columns along x."""
    bumps_m: Float64[np.ndarray, "bumps 2"]
    """Places (x, y) of the wet bumps."""
    bump_radius_m: Float64[np.ndarray, " bumps"]
    """Radii of their curvature."""

    @staticmethod
    @lru_cache(maxsize=4)
    def drawn(*, seed: int, level_m: float, relief_m: float, contrast: float) -> TexturedTissue:
        """Draw tissue; cached, because sessions in turn look at the same.

        ``relief_m``: range of its heights. ``contrast``: standard deviation of the brightness over its mean.
        """
        rng = np.random.default_rng(seed)  # noqa: TID251  a generator is no key of a cache
        count = round(SIZE_M / TEXTURE_M)
        brightness = np.zeros((count, count), dtype=np.float32)
        for length_m, share in zip(LENGTHS_M, SHARES, strict=True):
            brightness += np.float32(share) * _noise(rng, count=count, length=length_m / TEXTURE_M)
        # A vessel is where a slowly changing field passes through zero.
        vessels = np.exp(-((_noise(rng, count=count, length=VESSEL_M / TEXTURE_M) / 0.08) ** 2))
        brightness -= np.float32(1.2) * vessels
        brightness *= np.float32(contrast / float(brightness.std()))
        brightness += np.float32(1.0 - float(brightness.mean()))
        relief = _noise(rng, count=round(SIZE_M / RELIEF_STEP_M) + 1, length=10e-3 / RELIEF_STEP_M)
        relief *= np.float32(relief_m / float(np.ptp(relief)))
        return TexturedTissue(
            level_m=level_m,
            relief_m=relief.astype(np.float64),
            brightness=np.maximum(brightness, np.float32(0.05)),
            bumps_m=rng.uniform(-SIZE_M / 2, SIZE_M / 2, size=(BUMPS, 2)),
            bump_radius_m=rng.uniform(*BUMP_RADIUS_M, size=BUMPS),
        )

    def height_m(self, places_m: Float64[np.ndarray, "places 2"]) -> Float64[np.ndarray, " places"]:
        """Return the height z of the surface at places (x, y)."""
        # Imported here: a search without an endoscope does not need it.
        from scipy import ndimage

        rows = (places_m[:, 1] + SIZE_M / 2) / RELIEF_STEP_M
        columns = (places_m[:, 0] + SIZE_M / 2) / RELIEF_STEP_M
        relief_m = ndimage.map_coordinates(self.relief_m, [rows, columns], order=1, mode="nearest")
        return np.asarray(self.level_m + relief_m)

    def met_by(
        self, origin_m: Float64[np.ndarray, " 3"], towards: Float64[np.ndarray, "rays 3"]
    ) -> Float64[np.ndarray, "rays 2"]:
        """Return the places (x, y) where lines of sight meet the surface, by fixed-point iteration of its height."""
        height_m = np.full(len(towards), self.level_m)
        places_m = np.empty((len(towards), 2))
        for _ in range(_MEETING_STEPS):
            places_m = origin_m[:2] + towards[:, :2] * ((height_m - origin_m[2]) / towards[:, 2])[:, None]
            height_m = self.height_m(places_m)
        return places_m

    def highlights_m(self, origin_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "bumps 3"]:
        """Return where each bump reflects the light at a camera back into it, in the TRUS frame.

        A sphere reflects the light of a lamp beside the camera where its normal points at the camera.
        """
        foot_m = np.column_stack([self.bumps_m, self.height_m(self.bumps_m)])
        outwards = origin_m - foot_m
        outwards /= np.linalg.norm(outwards, axis=1)[:, None]
        # The tissue is seen from above: its normal points away from the probe, along z.
        sideways = outwards - np.array([0.0, 0.0, 1.0])
        return np.asarray(foot_m + self.bump_radius_m[:, None] * sideways)


_MEETING_STEPS = 4
"""Steps of the iteration: the surface is flat, and each step leaves a tenth of the error."""


def _noise(rng: np.random.Generator, *, count: int, length: float) -> Float32[np.ndarray, "count count"]:
    """Return noise of standard deviation 1 on a square, smooth over a length in its steps."""
    from scipy import ndimage

    # Drawn in steps of the length, and interpolated: a filter of that length would take seconds.
    coarse = max(4, round(count / length) + 4)
    drawn = rng.standard_normal((coarse, coarse))
    at = np.linspace(1.0, coarse - 2.0, count)
    along = ndimage.spline_filter(drawn, order=3, mode="nearest")
    by_row = _weights(at, coarse)
    smooth = (by_row @ along @ by_row.T).astype(np.float32)
    return np.asarray(smooth / smooth.std())


def _weights(at: Float64[np.ndarray, " places"], count: int) -> Float64[np.ndarray, "places knots"]:
    """Return the cubic B-spline of each knot at places between them."""
    away = np.abs(at[:, None] - np.arange(count))
    near = 2 / 3 - away**2 + away**3 / 2
    return np.asarray(np.where(away < 1, near, np.where(away < 2, (2 - away) ** 3 / 6, 0.0)))


STEP_PX = 16
"""Distance between the pixels whose lines of sight are followed."""


class TissueView:
    """What one camera sees of textured tissue."""

    def __init__(self, camera: Camera, tissue: TexturedTissue) -> None:
        self._camera = camera
        self._tissue = tissue
        width, height = camera.size_px
        self._shape = height, width
        x_px = np.arange(0, width + STEP_PX, STEP_PX, dtype=np.float64)
        y_px = np.arange(0, height + STEP_PX, STEP_PX, dtype=np.float64)
        inside_px = np.stack(np.meshgrid(x_px[x_px < width], y_px[y_px < height]), axis=-1)
        rays = camera.undistort(inside_px.reshape(-1, 2)).reshape(*inside_px.shape[:2], 2)
        # Beyond the last row and column of the image, straight on.
        padding = ((0, y_px.size - rays.shape[0]), (0, x_px.size - rays.shape[1]), (0, 0))
        rays = np.pad(rays, padding, mode="reflect", reflect_type="odd")
        self._rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
        # The light falls off towards the corners, as cos⁴ of the angle to the axis.
        self._light = (1 + (rays**2).sum(axis=-1)) ** -2

    def into(
        self,
        total: Int16[np.ndarray, "rows columns"],
        *,
        camera_to_trus: RigidTransform,
        displaced_m: Float64[np.ndarray, " 3"],
        counts: float,
    ) -> None:
        """Fill in what the camera sees, without noise.

        ``displaced_m``: how far the tissue has moved in the TRUS frame. ``counts``: the value of mean brightness in the
        middle of the image.
        """
        rows, columns, _ = self._rays.shape
        origin_m = camera_to_trus.translation_m - displaced_m
        towards = self._rays.reshape(-1, 3) @ camera_to_trus.rotation.T
        places = (self._tissue.met_by(origin_m, towards) + SIZE_M / 2) / TEXTURE_M
        _draw_texture(
            self._tissue.brightness,
            places[:, 0].reshape(rows, columns),
            places[:, 1].reshape(rows, columns),
            counts * self._light,
            STEP_PX,
            total,
        )

    def highlights(
        self, *, camera_to_trus: RigidTransform, displaced_m: Float64[np.ndarray, " 3"]
    ) -> tuple[Float64[np.ndarray, "seen 2"], Float64[np.ndarray, " seen"]]:
        """Return the pixels of the highlights in the image, and their standard deviations in pixels."""
        at_m = self._tissue.highlights_m(camera_to_trus.translation_m - displaced_m) + displaced_m
        in_camera_m = camera_to_trus.inverse().apply(at_m)
        ahead = in_camera_m[:, 2] > 1e-3
        pixels = self._camera.seen(in_camera_m[ahead])[0]
        size_px = self._camera.focal_px[0] * _HIGHLIGHT * self._tissue.bump_radius_m[ahead] / in_camera_m[ahead, 2]
        height, width = self._shape
        # The light of one whose middle lies beside the image still reaches into it.
        reach_px = _HIGHLIGHT_REACH * size_px[:, None]
        inside = ((pixels + reach_px > 0) & (pixels - reach_px < [width, height])).all(axis=1)
        return pixels[inside], size_px[inside]


_HIGHLIGHT = 0.03
"""Standard deviation of a highlight over the radius of its bump."""

_HIGHLIGHT_REACH = 4.0
"""Standard deviations from its middle beyond which a highlight adds less than a tenth of a count."""


@compiled
def _draw_texture(
    brightness: Float32[np.ndarray, "texture_rows texture_columns"],
    across: Float64[np.ndarray, "grid_rows grid_columns"],
    along: Float64[np.ndarray, "grid_rows grid_columns"],
    counts: Float64[np.ndarray, "grid_rows grid_columns"],
    step: int,
    out: Int16[np.ndarray, "rows columns"],
) -> None:
    """Fill in the texture at each pixel, its place and its light linear between the pixels of the grid."""
    last_row = brightness.shape[0] - 2
    last_column = brightness.shape[1] - 2
    for row in range(out.shape[0]):
        top = row // step
        down = (row - top * step) / step
        for left in range(across.shape[1] - 1):
            first = left * step
            end = min(first + step, out.shape[1])
            u = across[top, left] + down * (across[top + 1, left] - across[top, left])
            v = along[top, left] + down * (along[top + 1, left] - along[top, left])
            light = counts[top, left] + down * (counts[top + 1, left] - counts[top, left])
            u_step = across[top, left + 1] + down * (across[top + 1, left + 1] - across[top, left + 1])
            v_step = along[top, left + 1] + down * (along[top + 1, left + 1] - along[top, left + 1])
            light_step = counts[top, left + 1] + down * (counts[top + 1, left + 1] - counts[top, left + 1])
            u_step = (u_step - u) / step
            v_step = (v_step - v) / step
            light_step = (light_step - light) / step
            for column in range(first, end):
                # Beyond the edge of the tissue its edge goes on.
                x = min(max(u, 0.0), last_column + 0.999)
                y = min(max(v, 0.0), last_row + 0.999)
                i = int(y)
                k = int(x)
                right = x - k
                below = y - i
                upper = brightness[i, k] + right * (brightness[i, k + 1] - brightness[i, k])
                lower = brightness[i + 1, k] + right * (brightness[i + 1, k + 1] - brightness[i + 1, k])
                out[row, column] = int(min(light * (upper + below * (lower - upper)), 8000.0) + 0.5)
                u += u_step
                v += v_step
                light += light_step


@compiled
def draw_shaft(
    total: Int16[np.ndarray, "rows columns"],
    tip_x: float,
    tip_y: float,
    along_x: float,
    along_y: float,
    half_width_px: float,
    bright: float,
) -> None:
    """Draw a round metal shaft that ends at a pixel and reaches out of the image along a unit vector.

    ``bright``: its value in the middle; it darkens towards both sides.
    """
    for row in range(total.shape[0]):
        for column in range(total.shape[1]):
            x = column - tip_x
            y = row - tip_y
            beside = (x * along_y - y * along_x) / half_width_px
            if -1.0 < beside < 1.0 and x * along_x + y * along_y > 0.0:
                total[row, column] = int(bright * (0.25 + 0.75 * (1.0 - beside * beside)))
