"""Simulated stereo endoscope: images of tissue with the laser spot, and the errors of their calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from markerseek.core import Float64, UInt8, Within, require_fields
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


@dataclass(frozen=True, slots=True, kw_only=True)
class EndoscopeSettings:
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
