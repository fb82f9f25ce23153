"""A simulated stereo endoscope: its cameras, the errors of their calibration, and images of tissue with the laser spot.

`SimulatedEndoscope` gives image pairs that show the spot while the laser of a simulated rig fires.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np

from markerseek.core import (
    MAX_PAIRS,
    Clock,
    Float64,
    Int16,
    StereoPair,
    UInt8,
    Within,
    require_fields,
    require_range,
)
from markerseek.geometry import Camera, RigidTransform, StereoCameras


def endoscope(*, focal_px: float = 1100.0, base_m: float = 5e-3) -> StereoCameras:
    """Parallel cameras like those of a stereo endoscope: 1280 x 1024 pixels, with the distortion of a wide lens.

    ``focal_px``: focal length. ``base_m``: distance between the two cameras.
    """
    lens = Camera(
        focal_px=(focal_px, focal_px),
        centre_px=(639.5, 511.5),
        size_px=(1280, 1024),
        distortion=(-0.30, 0.10, 0.0005, -0.0005, 0.0),
    )
    return StereoCameras(
        left=lens,
        right=lens,
        left_to_right=RigidTransform(
            source="Left", target="Right", rotation=np.eye(3), translation_m=np.array([-base_m, 0.0, 0.0])
        ),
    )


def camera_above(
    middle_m: Float64[np.ndarray, " 3"], *, distance_m: float, roll_deg: float, tilt_deg: float = 0.0
) -> RigidTransform:
    """Where a camera stands that looks at a point of the TRUS frame from above: the transform ``DaVinciToProbeHome``.

    ``middle_m``: the point in the TRUS frame. ``roll_deg``: rotation about the line of sight. ``tilt_deg``: angle
    between the line of sight and the z axis of the TRUS frame.
    """
    from scipy.spatial.transform import Rotation

    # At 0 the camera's view (its z axis) is against the TRUS z axis, which points from the probe to the tissue.
    turned = Rotation.from_euler("x", 180 + tilt_deg, degrees=True) * Rotation.from_euler("z", roll_deg, degrees=True)
    rotation = turned.as_matrix()
    return RigidTransform(
        source="DaVinci", target="ProbeHome", rotation=rotation, translation_m=middle_m - distance_m * rotation[:, 2]
    )


def on_tissue_m(
    camera_to_trus: RigidTransform, direction: Float64[np.ndarray, " 3"], *, height_m: float
) -> Float64[np.ndarray, " 3"]:
    """Where a line of sight meets level tissue at this z of the TRUS frame; ``direction`` in the camera's frame."""
    origin_m, towards = camera_to_trus.translation_m, camera_to_trus.rotation @ direction
    return np.asarray(origin_m + towards * (height_m - origin_m[2]) / towards[2])


class EndoscopeSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of the simulated cameras, and the look of their images."""

    spot_sigma_px: Annotated[float, Within(0, 20, "px")] = 0.3
    """Standard deviation of the spot's position in one frame, in both directions."""
    calibration_sigma_px: Annotated[float, Within(0, 20, "px")] = 0.2
    """Standard deviation of the error of the calibration at a point of the image, in both directions: it is the same in
    all frames."""
    frames: Annotated[int, Within(1, 1000)] = 25
    spot_radius_px: Annotated[float, Within(1, 20, "px")] = 5.0
    """Standard deviation of the spot's Gaussian profile."""
    spot_counts: Annotated[float, Within(0, 255, "counts")] = 130.0
    """Its height; 255 is full scale."""
    tissue_counts: Annotated[float, Within(0, 255, "counts")] = 70.0
    """Mean brightness of the tissue."""
    noise_counts: Annotated[float, Within(0, 50, "counts")] = 3.0
    """Standard deviation of a pixel's noise."""
    motion_px: Annotated[float, Within(0, 500, "px")] = 0.0
    """How far the spot moves in both images once it has been seen in as many pairs as there are frames."""
    dropped_share: Annotated[float, Within(0, 1)] = 0.0
    """Share of the image pairs that do not come."""

    def __post_init__(self) -> None:
        require_fields(self, "endoscope")


def uneven_tissue(
    size_px: tuple[int, int], *, settings: EndoscopeSettings, rng: np.random.Generator
) -> Float64[np.ndarray, "rows columns"]:
    """Brightness of tissue in uneven light, in counts: waves of random direction and phase, 80 to 400 pixels long.

    ``size_px``: width and height of the image.
    """
    width, height = size_px
    across, down = [], []
    for _ in range(6):
        length_px, direction, phase = rng.uniform(80, 400), rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
        wave = 2 * np.pi / length_px
        x, y = wave * np.cos(direction) * np.arange(width), wave * np.sin(direction) * np.arange(height) + phase
        # sin(x + y), as products of what depends on the column and on the row alone.
        across += [np.sin(x), np.cos(x)]
        down += [np.cos(y), np.sin(y)]
    waves = np.stack(down, axis=1) @ np.stack(across)
    return np.asarray(settings.tissue_counts * (1 + 0.08 * waves))


RATE_HZ = 30.0
"""Image pairs a second, on the clock of the rig."""

DARK_PAIRS = 5
"""Most pairs of one call that show the tissue with the laser off."""

_BITS = 4
_SCALE = 1 << _BITS
"""Images are summed in sixteenths of a count, as whole numbers of 16 bits: much faster than in single precision."""

_MORE_NOISE = 1 << 20
"""Pixels by which the noise that is drawn once exceeds an image: the noise of each image begins at another of them."""

_REACH_RADII = 6.0
"""Radii of the spot beyond which its light is below a sixteenth of a count."""

Side: TypeAlias = Literal["left", "right"]
"""One of the two cameras."""

Places: TypeAlias = dict[Side, Float64[np.ndarray, " 2"] | None]
"""Pixel (x, y) of the spot in each camera; None: it is behind the camera."""


class _Moment(NamedTuple):
    """What both cameras see in one frame."""

    frame: int
    lit: bool
    spot_px: Places | None


class _View:
    """What one camera sees of the tissue, without a spot."""

    def __init__(self, camera: Camera, settings: EndoscopeSettings, *, rng: np.random.Generator) -> None:
        self._rng = rng
        tissue = uneven_tissue(camera.size_px, settings=settings, rng=rng)
        # Beyond 500 counts all is white; half a count more, because the sum is rounded down.
        self._tissue = np.rint(_SCALE * (np.minimum(tissue, 500.0) + 0.5)).astype(np.int16)
        self._total = np.empty_like(self._tissue)

    def image(
        self,
        noise: Int16[np.ndarray, " pixels"],
        spot_px: Float64[np.ndarray, " 2"] | None,
        settings: EndoscopeSettings,
    ) -> UInt8[np.ndarray, "rows columns"]:
        """An image, with the spot if it is lit."""
        rows, columns = self._tissue.shape
        first = int(self._rng.integers(len(noise) - rows * columns + 1))
        total = np.add(self._tissue, noise[first : first + rows * columns].reshape(rows, columns), out=self._total)
        if spot_px is not None:
            (x, y), radius_px = spot_px, settings.spot_radius_px
            reach_px = _REACH_RADII * radius_px
            right = np.arange(max(0, int(x - reach_px)), min(columns, int(x + reach_px) + 1))
            down = np.arange(max(0, int(y - reach_px)), min(rows, int(y + reach_px) + 1))
            if right.size and down.size:
                across = np.exp(-0.5 * ((right - x) / radius_px) ** 2)
                height = settings.spot_counts * np.exp(-0.5 * ((down - y) / radius_px) ** 2)
                light = np.rint(_SCALE * np.minimum(height[:, None] * across, 500.0)).astype(np.int16)
                total[down[0] : down[-1] + 1, right[0] : right[-1] + 1] += light
        np.clip(total, 0, 255 * _SCALE + _SCALE - 1, out=total)
        total >>= _BITS
        return np.asarray(total.astype(np.uint8))


class SimulatedEndoscope:
    """Image pairs of a spot that a simulated operator shows, as a `StereoImages`.

    A pair that comes when flashes were fired since the pairs of the last call shows the spot; all others show tissue
    alone. Of the pairs that have come, a call makes the newest: of those with the spot at most as many as the settings
    have frames, of the others at most `DARK_PAIRS`.

    ``cameras``: the calibration, as the session has it. ``camera_to_trus``: where the left camera stands, the transform
    ``DaVinciToProbeHome``. ``flashes``: number of flashes fired so far: ``lambda: len(world.flashes)``. ``clock``: that
    of the rig. ``focal_error``: by which share the calibration states the focal lengths of both cameras too large.
    """

    name = "simulated endoscope"

    def __init__(
        self,
        *,
        cameras: StereoCameras,
        camera_to_trus: RigidTransform,
        settings: EndoscopeSettings,
        rng: np.random.Generator,
        clock: Clock,
        flashes: Callable[[], int],
        focal_error: float = 0.0,
    ) -> None:
        require_range("endoscope: focal_error", focal_error, low=-0.5, high=0.5)
        self._settings, self._rng, self._clock, self._flashes = settings, rng, clock, flashes
        self._true = replace(
            cameras, left=_refocused(cameras.left, focal_error), right=_refocused(cameras.right, focal_error)
        )
        self._trus_to_camera = camera_to_trus.inverse()
        self._views: dict[Side, _View] = {side: _View(camera, settings, rng=rng) for side, camera in _sides(cameras)}
        pixels = max(int(np.prod(camera.size_px)) for _, camera in _sides(cameras))
        noise = rng.standard_normal(pixels + _MORE_NOISE, dtype=np.float32)
        noise *= np.float32(_SCALE * settings.noise_counts)
        self._noise = np.rint(noise, out=noise).astype(np.int16)
        self._errors_px: dict[tuple[float, ...], dict[Side, Float64[np.ndarray, " 2"]]] = {}
        self._spot_px: Places | None = None
        self._motion_px = np.zeros(2)
        self._lit_pairs = 0
        self._began_s, self._frames = clock.now_s(), 0
        self._seen_flashes = flashes()

    def show(self, spot_trus_m: Float64[np.ndarray, " 3"] | None) -> None:
        """Put the spot there, in the TRUS frame, or take the fibre away.

        The calibration's error at a point is the same whenever the spot comes back to that point.
        """
        self._lit_pairs, self._motion_px = 0, np.zeros(2)
        if spot_trus_m is None:
            self._spot_px = None
            return
        error = self._errors_px.get(tuple(spot_trus_m.tolist()))
        if error is None:
            sigma_px = self._settings.calibration_sigma_px
            error = {side: sigma_px * self._rng.standard_normal(2) for side, _ in _sides(self._true)}
            self._errors_px[tuple(spot_trus_m.tolist())] = error
        left_m = self._trus_to_camera.apply(spot_trus_m)
        points_m: dict[Side, Float64[np.ndarray, " 3"]] = {
            "left": left_m,
            "right": self._true.left_to_right.apply(left_m),
        }
        self._spot_px = {
            side: camera.project(points_m[side][None])[0] + error[side] if points_m[side][2] > 0 else None
            for side, camera in _sides(self._true)
        }

    def newest(self) -> list[StereoPair]:
        """Pairs that came since the last call, the oldest first; see the class for how many."""
        moments = self._come()
        limits = {True: min(self._settings.frames, MAX_PAIRS), False: DARK_PAIRS}
        wanted = []
        for moment in reversed(moments):
            if limits[moment.lit] > 0:
                limits[moment.lit] -= 1
                wanted.append(moment)
        return [self._pair(moment) for moment in reversed(wanted)]

    def close(self) -> None:
        """Nothing to release."""

    def _come(self) -> list[_Moment]:
        """What the cameras saw in the frames that came since the last call."""
        frames = int((self._clock.now_s() - self._began_s) * RATE_HZ + 1e-6)
        if frames == self._frames:
            return []
        flashes = self._flashes()
        lit, self._seen_flashes = flashes > self._seen_flashes, flashes
        new = range(max(self._frames, frames - MAX_PAIRS), frames)
        self._frames = frames
        come = [_Moment(frame=frame + 1, lit=lit, spot_px=self._spot_px) for frame in new]
        return [moment for moment in come if not self._rng.random() < self._settings.dropped_share]

    def _pair(self, moment: _Moment) -> StereoPair:
        if moment.lit and moment.spot_px is not None:
            if self._lit_pairs == self._settings.frames:
                direction = self._rng.uniform(0, 2 * np.pi)
                self._motion_px = self._settings.motion_px * np.array([np.cos(direction), np.sin(direction)])
            self._lit_pairs += 1
        images = {side: self._image(side, moment) for side, _ in _sides(self._true)}
        at_s = self._began_s + moment.frame / RATE_HZ
        return StereoPair(left=images["left"], right=images["right"], at_s=at_s)

    def _image(self, side: Side, moment: _Moment) -> UInt8[np.ndarray, "rows columns"]:
        settings = self._settings
        middle_px = None if moment.spot_px is None or not moment.lit else moment.spot_px[side]
        if middle_px is not None:
            middle_px = middle_px + self._motion_px + settings.spot_sigma_px * self._rng.standard_normal(2)
        return self._views[side].image(self._noise, middle_px, settings)


def _sides(cameras: StereoCameras) -> tuple[tuple[Side, Camera], ...]:
    return ("left", cameras.left), ("right", cameras.right)


def _refocused(camera: Camera, error: float) -> Camera:
    """The true camera, if its calibration states focal lengths that are too large by this share."""
    x_px, y_px = camera.focal_px
    return replace(camera, focal_px=(x_px / (1 + error), y_px / (1 + error)))
