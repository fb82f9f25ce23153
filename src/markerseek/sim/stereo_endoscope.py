"""A simulated stereo endoscope: its cameras, the errors of their calibration, and images of tissue with the laser spot.

`SimulatedEndoscope` gives image pairs that show the spot while the laser of a simulated rig fires. The tissue may move
under it, and somebody may move the endoscope. What the cameras see of the tissue is uneven brightness that stays where
it is in the image, or a surface with texture (`textured_tissue`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, TypeAlias

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import (
    MAX_PAIRS,
    Clock,
    Float64,
    Int16,
    Side,
    StereoPair,
    UInt8,
    Within,
    require_fields,
    require_range,
)
from markerseek.geometry import Camera, RigidTransform, StereoCameras
from markerseek.sim.textured_tissue import TexturedTissue, TissueView, draw_shaft


def endoscope(*, focal_px: float = 1100.0, base_m: float = 5e-3) -> StereoCameras:
    """Return parallel cameras as of a stereo endoscope: 1280 x 1024 pixels, with the distortion of a wide lens.

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
    """Return ``DaVinciToProbeHome`` of a camera that looks at a point of the TRUS frame from above.

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
    """Return where a line of sight meets level tissue at this z of the TRUS frame.

    ``direction`` in the camera's frame.
    """
    origin_m = camera_to_trus.translation_m
    towards = camera_to_trus.rotation @ direction
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
    exposure_swing: Annotated[float, Within(0, 0.9)] = 0.0
    """By which share the brightness rises and falls as the exposure changes; of textured tissue only."""
    highlight_counts: Annotated[float, Within(0, 500, "counts")] = 220.0
    """Height of the highlights of textured tissue; 0: it is matt."""
    instrument: bool = False
    """Whether the shaft of an instrument moves through the view of textured tissue."""

    def __post_init__(self) -> None:
        require_fields(self, "endoscope")


def uneven_tissue(
    size_px: tuple[int, int], *, settings: EndoscopeSettings, rng: np.random.Generator
) -> Float64[np.ndarray, "rows columns"]:
    """Return the brightness of tissue in uneven light, in counts: random waves, 80 to 400 pixels long.

    ``size_px``: width and height of the image.
    """
    width, height = size_px
    across = []
    down = []
    for _ in range(6):
        length_px = rng.uniform(80, 400)
        direction = rng.uniform(0, np.pi)
        phase = rng.uniform(0, 2 * np.pi)
        wave = 2 * np.pi / length_px
        x = wave * np.cos(direction) * np.arange(width)
        y = wave * np.sin(direction) * np.arange(height) + phase
        # sin(x + y), as products of what depends on the column and on the row alone.
        across += [np.sin(x), np.cos(x)]
        down += [np.cos(y), np.sin(y)]
    waves = np.stack(down, axis=1) @ np.stack(across)
    return np.asarray(settings.tissue_counts * (1 + 0.08 * waves))


RATE_HZ = 30.0
"""Image pairs a second, on the clock of the rig."""

_DARK_PAIRS = 5
"""Most pairs of one call that show the tissue with the laser off."""

_BITS = 4
_SCALE = 1 << _BITS
"""Images are summed in sixteenths of a count, as whole numbers of 16 bits: much faster than in single precision."""

_MORE_NOISE = 1 << 20
"""Pixels by which the noise that is drawn once exceeds an image: the noise of each image begins at another of them."""

_REACH_RADII = 6.0
"""Radii of the spot beyond which its light is below a sixteenth of a count."""

Places: TypeAlias = dict[Side, Float64[np.ndarray, " 2"] | None]
"""Pixel (x, y) of the spot in each camera; None: it is behind the camera."""


class _Scene(NamedTuple):
    """Where the cameras and the tissue are at a time."""

    at_s: float
    camera_to_trus: RigidTransform
    """Where the left camera stands."""
    displaced_m: Float64[np.ndarray, " 3"]
    """How far the tissue has moved, in the TRUS frame."""


class _Moment(NamedTuple):
    """What both cameras see in one frame."""

    frame: int
    lit: bool
    spot_px: Places | None
    scene: _Scene


EXPOSURE_S = 11.0
"""Time in which the exposure changes and comes back, in seconds."""

SHAFT_M = 4e-3
SHAFT_TIP_M = np.array([0.018, 0.012, 0.08])
SHAFT_SWING_M = 8e-3
SHAFT_S = 5.0
"""Radius of the instrument's shaft, the middle place of its tip in the frame of the left camera, how far the tip moves
to either side, and the time of one such movement in seconds."""

SHAFT_COUNTS = 110.0
"""Brightness of the middle of the shaft."""

_SHAFT_ALONG = 0.8, 0.6
"""Direction (x, y) in the image from the tip along the shaft."""


class _View:
    """What one camera sees of the tissue, without a spot.

    ``from_left``: transform of the left camera's frame to that of this one. ``tissue``: None: uneven brightness that
    stays where it is in the image.
    """

    def __init__(
        self,
        camera: Camera,
        settings: EndoscopeSettings,
        *,
        rng: np.random.Generator,
        from_left: RigidTransform,
        tissue: TexturedTissue | None,
    ) -> None:
        self._rng = rng
        self._camera = camera
        self._from_left = from_left
        # Drawn in any case: what is drawn later does not depend on the tissue.
        uneven = uneven_tissue(camera.size_px, settings=settings, rng=rng)
        # Beyond 500 counts all is white; half a count more, because the sum is rounded down.
        self._uneven = np.rint(_SCALE * (np.minimum(uneven, 500.0) + 0.5)).astype(np.int16)
        self._total = np.empty_like(self._uneven)
        self._texture = None if tissue is None else TissueView(camera, tissue)

    def image(
        self,
        noise: Int16[np.ndarray, " pixels"],
        spot_px: Float64[np.ndarray, " 2"] | None,
        settings: EndoscopeSettings,
        scene: _Scene,
    ) -> UInt8[np.ndarray, "rows columns"]:
        """Return an image, with the spot if it is lit."""
        rows, columns = self._uneven.shape
        first = int(self._rng.integers(len(noise) - rows * columns + 1))
        drawn = noise[first : first + rows * columns].reshape(rows, columns)
        if self._texture is None:
            total = np.add(self._uneven, drawn, out=self._total)
        else:
            self._draw(self._texture, settings, scene)
            total = np.add(self._total, drawn, out=self._total)
        if spot_px is not None:
            _add_light(total, spot_px, radius_px=settings.spot_radius_px, counts=settings.spot_counts)
        np.clip(total, 0, 255 * _SCALE + _SCALE - 1, out=total)
        total >>= _BITS
        return np.asarray(total.astype(np.uint8))

    def _draw(self, texture: TissueView, settings: EndoscopeSettings, scene: _Scene) -> None:
        """Fill in textured tissue, its highlights and the instrument."""
        left_to_trus = scene.camera_to_trus
        back = self._from_left.inverse()
        to_trus = replace(
            left_to_trus,
            rotation=left_to_trus.rotation @ back.rotation,
            translation_m=left_to_trus.apply(back.translation_m),
        )
        exposure = 1 + settings.exposure_swing * math.sin(2 * math.pi * scene.at_s / EXPOSURE_S)
        texture.into(
            self._total,
            camera_to_trus=to_trus,
            displaced_m=scene.displaced_m,
            counts=_SCALE * exposure * settings.tissue_counts,
        )
        if settings.highlight_counts > 0:
            pixels, sizes_px = texture.highlights(camera_to_trus=to_trus, displaced_m=scene.displaced_m)
            for pixel, size_px in zip(pixels, sizes_px.tolist(), strict=True):
                _add_light(self._total, pixel, radius_px=size_px, counts=exposure * settings.highlight_counts)
        if settings.instrument:
            swing_m = SHAFT_SWING_M * math.sin(2 * math.pi * scene.at_s / SHAFT_S)
            tip_m = self._from_left.apply(SHAFT_TIP_M + np.array([swing_m, -swing_m, 0.0]))
            tip_px = self._camera.seen(tip_m[None])[0][0]
            radius_px = self._camera.focal_px[0] * SHAFT_M / tip_m[2]
            tip_x, tip_y = tip_px.tolist()
            along_x, along_y = _SHAFT_ALONG
            draw_shaft(self._total, tip_x, tip_y, along_x, along_y, radius_px, _SCALE * exposure * SHAFT_COUNTS)


def _add_light(
    total: Int16[np.ndarray, "rows columns"], at_px: Float64[np.ndarray, " 2"], *, radius_px: float, counts: float
) -> None:
    """Add light with a Gaussian profile to an image in sixteenths of a count."""
    rows, columns = total.shape
    (x, y) = at_px
    reach_px = _REACH_RADII * radius_px
    right = np.arange(max(0, int(x - reach_px)), min(columns, int(x + reach_px) + 1))
    down = np.arange(max(0, int(y - reach_px)), min(rows, int(y + reach_px) + 1))
    if right.size and down.size:
        across = np.exp(-0.5 * ((right - x) / radius_px) ** 2)
        height = counts * np.exp(-0.5 * ((down - y) / radius_px) ** 2)
        light = np.rint(_SCALE * np.minimum(height[:, None] * across, 500.0)).astype(np.int16)
        total[down[0] : down[-1] + 1, right[0] : right[-1] + 1] += light


class SimulatedEndoscope:
    """Image pairs of a spot that a simulated operator shows, as a `StereoImages`.

    A pair shows the spot if light fell on the tissue since the pair before it or, without ``is_lit``, since the pairs
    of the last call; all others show tissue alone. Of the pairs that have come, a call makes the newest: of those with
    the spot at most as many as the settings have frames, of the others at most `_DARK_PAIRS`.

    ``cameras``: the calibration, as the session has it. ``camera_to_trus``: where the left camera stands, the transform
    ``DaVinciToProbeHome``. ``flashes``: number of flashes fired so far: ``lambda: len(world.flashes)``. ``clock``: that
    of the rig. ``focal_error``, ``base_error``: by which share the calibration states the focal lengths of both
    cameras, and their distance, too large; ``vergence_px``: by how much farther to the right the right camera sees.
    ``tissue``: what the cameras look at; None: brightness without texture. ``displacement_m``: how far the tissue has
    moved in the TRUS frame, at a time of the clock; None: it is at rest. ``is_lit``: whether a pulse was fired between
    two times of the clock: `World.is_lit`. ``late_s``: how long after its exposure a pair comes.
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
        base_error: float = 0.0,
        vergence_px: float = 0.0,
        tissue: TexturedTissue | None = None,
        displacement_m: Callable[[float], Float64[np.ndarray, " 3"]] | None = None,
        is_lit: Callable[[float, float], bool] | None = None,
        late_s: float = 0.0,
    ) -> None:
        require_range("endoscope: focal_error", focal_error, low=-0.5, high=0.5)
        require_range("endoscope: base_error", base_error, low=-0.5, high=0.5)
        require_range("endoscope: vergence_px", vergence_px, low=-20, high=20, unit="px")
        self._settings = settings
        self._rng = rng
        self._clock = clock
        self._flashes = flashes
        right = _refocused(cameras.right, focal_error)
        x_px, y_px = right.centre_px
        base_m = cameras.left_to_right.translation_m / (1 + base_error)
        self._true = replace(
            cameras,
            left=_refocused(cameras.left, focal_error),
            right=structs.replace(right, centre_px=(x_px + vergence_px, y_px)),
            left_to_right=replace(cameras.left_to_right, translation_m=base_m),
        )
        self._poses = [_Pose(since_s=-math.inf, lasts_s=0.0, before=camera_to_trus, after=camera_to_trus)]
        self._displacement_m = displacement_m
        self._is_lit = is_lit
        self._late_s = late_s
        # With their true focal lengths, but what they saw of untextured tissue is the same whatever these are.
        self._views: dict[Side, _View] = {
            side: _View(
                camera,
                settings,
                rng=rng,
                from_left=self._true.left_to_right if side == "right" else _NOWHERE,
                tissue=tissue,
            )
            for side, camera in _sides(self._true)
        }
        pixels = max(int(np.prod(camera.size_px)) for _, camera in _sides(cameras))
        noise = rng.standard_normal(pixels + _MORE_NOISE, dtype=np.float32)
        noise *= np.float32(_SCALE * settings.noise_counts)
        self._noise = np.rint(noise, out=noise).astype(np.int16)
        self._errors_px: dict[tuple[float, ...], dict[Side, Float64[np.ndarray, " 2"]]] = {}
        self._spot_m: Float64[np.ndarray, " 3"] | None = None
        self._motion_px = np.zeros(2)
        self._lit_pairs = 0
        self._began_s = clock.now_s()
        self._frames = 0
        self._seen_flashes = flashes()

    @property
    def cameras(self) -> StereoCameras:
        """The true cameras, without the errors of their calibration."""
        return self._true

    def show(self, spot_trus_m: Float64[np.ndarray, " 3"] | None) -> None:
        """Put the spot there on the tissue, in the TRUS frame while it is undisplaced, or take the fibre away.

        The calibration's error at a point is the same whenever the spot comes back to that point.
        """
        self._lit_pairs = 0
        self._motion_px = np.zeros(2)
        self._spot_m = spot_trus_m
        if spot_trus_m is None:
            return
        error = self._errors_px.get(tuple(spot_trus_m.tolist()))
        if error is None:
            sigma_px = self._settings.calibration_sigma_px
            error = {side: sigma_px * self._rng.standard_normal(2) for side, _ in _sides(self._true)}
            self._errors_px[tuple(spot_trus_m.tolist())] = error

    def move(self, camera_to_trus: RigidTransform, *, after_s: float = 0.0, lasts_s: float = 0.0) -> None:
        """Move the endoscope evenly to where the left camera then stands.

        A move that is not over when another begins ends there.

        ``after_s``: time until it begins; it is given after all moves that begin before it. ``lasts_s``: its duration.
        """
        require_range("endoscope: after_s", after_s, low=0.0, high=86_400.0, unit="s")
        require_range("endoscope: lasts_s", lasts_s, low=0.0, high=86_400.0, unit="s")
        since_s = self._clock.now_s() + after_s
        self._poses.append(_Pose(since_s=since_s, lasts_s=lasts_s, before=self.pose(since_s), after=camera_to_trus))

    def pose(self, at_s: float) -> RigidTransform:
        """Return where the left camera stood at a time of the clock, in truth: ``DaVinciToProbeHome``."""
        return next(each for each in reversed(self._poses) if each.since_s <= at_s).at(at_s)

    def _scene(self, at_s: float) -> _Scene:
        displaced_m = np.zeros(3) if self._displacement_m is None else self._displacement_m(at_s)
        return _Scene(at_s=at_s, camera_to_trus=self.pose(at_s), displaced_m=displaced_m)

    def _places(self, scene: _Scene) -> Places | None:
        """Return where the spot is in both images, without the error of a single frame."""
        if self._spot_m is None:
            return None
        error = self._errors_px[tuple(self._spot_m.tolist())]
        left_m = scene.camera_to_trus.inverse().apply(self._spot_m + scene.displaced_m)
        points_m: dict[Side, Float64[np.ndarray, " 3"]] = {
            "left": left_m,
            "right": self._true.left_to_right.apply(left_m),
        }
        return {
            side: camera.project(points_m[side][None])[0] + error[side] if points_m[side][2] > 0 else None
            for side, camera in _sides(self._true)
        }

    def newest(self, most: int = MAX_PAIRS) -> list[StereoPair]:
        """Return the pairs that came since the last call, the oldest first.

        How many they are the class says; at most ``most``.
        """
        moments = self._come()[-most:]
        limits = {True: min(self._settings.frames, MAX_PAIRS), False: _DARK_PAIRS}
        wanted = []
        for moment in reversed(moments):
            if limits[moment.lit] > 0:
                limits[moment.lit] -= 1
                wanted.append(moment)
        return [self._pair(moment) for moment in reversed(wanted)]

    def close(self) -> None:
        """Nothing to release."""

    def _come(self) -> list[_Moment]:
        """Return what the cameras saw in the frames that came since the last call."""
        frames = int((self._clock.now_s() - self._began_s - self._late_s) * RATE_HZ + 1e-6)
        if frames <= self._frames:
            return []
        flashes = self._flashes()
        lit = flashes > self._seen_flashes
        self._seen_flashes = flashes
        new = range(max(self._frames, frames - MAX_PAIRS), frames)
        self._frames = frames
        come = [frame + 1 for frame in new if not self._rng.random() < self._settings.dropped_share]
        return [self._moment(frame, lit=lit) for frame in come]

    def _moment(self, frame: int, *, lit: bool) -> _Moment:
        at_s = self._began_s + frame / RATE_HZ
        if self._is_lit is not None:
            lit = self._is_lit(at_s - 1 / RATE_HZ, at_s)
        scene = self._scene(at_s)
        return _Moment(frame=frame, lit=lit, spot_px=self._places(scene), scene=scene)

    def _pair(self, moment: _Moment) -> StereoPair:
        if moment.lit and moment.spot_px is not None:
            if self._lit_pairs == self._settings.frames:
                direction = self._rng.uniform(0, 2 * np.pi)
                self._motion_px = self._settings.motion_px * np.array([np.cos(direction), np.sin(direction)])
            self._lit_pairs += 1
        images = {side: self._image(side, moment) for side, _ in _sides(self._true)}
        at_s = self._began_s + moment.frame / RATE_HZ + self._late_s
        return StereoPair(left=images["left"], right=images["right"], at_s=at_s)

    def _image(self, side: Side, moment: _Moment) -> UInt8[np.ndarray, "rows columns"]:
        settings = self._settings
        middle_px = None if moment.spot_px is None or not moment.lit else moment.spot_px[side]
        if middle_px is not None:
            middle_px = middle_px + self._motion_px + settings.spot_sigma_px * self._rng.standard_normal(2)
        return self._views[side].image(self._noise, middle_px, settings, moment.scene)


_NOWHERE = RigidTransform(source="Left", target="Left", rotation=np.eye(3), translation_m=np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pose:
    """Where the left camera stands from a time on: it moves evenly from one place to another, and stays there."""

    since_s: float
    lasts_s: float
    before: RigidTransform
    after: RigidTransform

    def at(self, time_s: float) -> RigidTransform:
        """Return the transform ``DaVinciToProbeHome`` at a time."""
        done = 1.0 if self.lasts_s <= 0 else min((time_s - self.since_s) / self.lasts_s, 1.0)
        return between(self.before, self.after, done)


def between(before: RigidTransform, after: RigidTransform, done: float) -> RigidTransform:
    """Return a transform on the way from one to another: turned and shifted by this share of the way."""
    if done >= 1:
        return after
    from scipy.spatial.transform import Rotation

    way = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec()
    turned = Rotation.from_rotvec(done * way).as_matrix() @ before.rotation
    shifted_m = before.translation_m + done * (after.translation_m - before.translation_m)
    return replace(before, rotation=turned, translation_m=shifted_m)


def _sides(cameras: StereoCameras) -> tuple[tuple[Side, Camera], ...]:
    return ("left", cameras.left), ("right", cameras.right)


def _refocused(camera: Camera, error: float) -> Camera:
    """Return the true camera, if its calibration states focal lengths that are too large by this share."""
    x_px, y_px = camera.focal_px
    return structs.replace(camera, focal_px=(x_px / (1 + error), y_px / (1 + error)))
