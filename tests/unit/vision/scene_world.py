"""A wavy surface with a texture of many scales, rendered for two cameras: written for the tests of `vision`."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import StereoPair
from markerseek.geometry import Camera, RigidTransform, StereoCameras, at_rest

TEXTURE_MM = 0.08
"""Size of a pixel of the texture."""

NOISE_COUNTS = 2.0


def cameras(*, width: int = 640, focal_px: float = 550.0, base_m: float = 5e-3) -> StereoCameras:
    height = width * 4 // 5
    lens = Camera(
        focal_px=(focal_px, focal_px),
        centre_px=(width / 2 - 0.5, height / 2 - 0.5),
        size_px=(width, height),
        distortion=(-0.2, 0.05, 0.0003, -0.0002, 0.0),
    )
    turn = Rotation.from_euler("y", 0.8, degrees=True).as_matrix()
    return StereoCameras(
        left=lens,
        right=lens,
        left_to_right=RigidTransform(
            source="Left", target="Right", rotation=turn, translation_m=np.array([-base_m, 0.0, 0.0])
        ),
    )


def moved(*, turn_deg: tuple[float, float, float] = (0, 0, 0), shift_mm: tuple[float, float, float] = (0, 0, 0)):
    """A motion of the scene about its middle, 80 mm before the camera."""
    middle = np.array([0.0, 0.0, 0.08])
    rotation = Rotation.from_rotvec(turn_deg, degrees=True).as_matrix()
    rest = at_rest()
    return RigidTransform(
        source=rest.source,
        target=rest.target,
        rotation=rotation,
        translation_m=middle - rotation @ middle + 1e-3 * np.array(shift_mm),
    )


class World:
    """A surface 80 mm before the camera, at the reference."""

    def __init__(self, seed: int = 1, *, cameras: StereoCameras, contrast: float = 0.35, depth_m: float = 0.08) -> None:
        self.rng = np.random.default_rng(seed)
        self.cameras = cameras
        self.depth_m = depth_m
        self._texture = self._many_scales(contrast)
        self._waves = [
            (self.rng.uniform(0.3e-3, 1.2e-3), 2 * np.pi / self.rng.uniform(25e-3, 60e-3), *self.rng.uniform(0, 6, 2))
            for _ in range(4)
        ]
        self._rays = {side: _rays(getattr(cameras, side)) for side in ("left", "right")}

    def pair(
        self,
        motion: RigidTransform | None = None,
        *,
        at_s: float = 0.0,
        exposure: float = 1.0,
        blur_px: float = 0.0,
        local_mm: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        noise_counts: float = NOISE_COUNTS,
    ) -> StereoPair:
        """Both images after a motion of the scene; ``local_mm``: displacement along x of the surface at x, y."""
        motion = motion or at_rest()
        images = {}
        for side in ("left", "right"):
            to_camera = motion.matrix if side == "left" else self.cameras.left_to_right.matrix @ motion.matrix
            light = self._light(side, to_camera, local_mm) * exposure
            if blur_px:
                light = cv2.GaussianBlur(light, (0, 0), blur_px)
            noise = self.rng.standard_normal(light.shape, dtype=np.float32) * noise_counts
            images[side] = np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)
        return StereoPair(left=images["left"], right=images["right"], at_s=at_s)

    def surface_m(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Depth of the surface."""
        z = np.full_like(x, self.depth_m) + 0.15 * x - 0.1 * y
        for height, number, angle, phase in self._waves:
            z += height * np.sin(number * (x * np.cos(angle) + y * np.sin(angle)) + phase)
        return z

    def _light(self, side: str, to_camera: np.ndarray, local_mm: Callable | None) -> np.ndarray:
        rotation = to_camera[:3, :3]
        shift = to_camera[:3, 3]
        origin = -rotation.T @ shift
        rays = self._rays[side] @ rotation
        far = (self.depth_m - origin[2]) / rays[..., 2]
        for _ in range(6):
            x = origin[0] + far * rays[..., 0]
            y = origin[1] + far * rays[..., 1]
            far = (self.surface_m(x, y) - origin[2]) / rays[..., 2]
        x = origin[0] + far * rays[..., 0]
        y = origin[1] + far * rays[..., 1]
        if local_mm is not None:
            x = x - 1e-3 * local_mm(x, y)
        middle = np.array(self._texture.shape)[::-1] / 2
        at_x = (1e3 * x / TEXTURE_MM + middle[0]).astype(np.float32)
        at_y = (1e3 * y / TEXTURE_MM + middle[1]).astype(np.float32)
        colour = cv2.remap(self._texture, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        # The light is at the camera: it falls off with the square of the distance.
        return (110 * colour * (self.depth_m / far) ** 2).astype(np.float32)

    def _many_scales(self, contrast: float) -> np.ndarray:
        size = 2048
        total = np.zeros((size, size), dtype=np.float32)
        for scale_px in (5, 12, 40, 120):
            small = self.rng.standard_normal((size // scale_px + 2, size // scale_px + 2)).astype(np.float32)
            total += cv2.resize(small, (size, size), interpolation=cv2.INTER_CUBIC)
        return np.clip(1 + contrast * total / 2, 0.05, 2.2)


def _rays(camera: Camera) -> np.ndarray:
    width, height = camera.size_px
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.float64)
    direct = camera.undistort(pixels)
    return np.concatenate([direct, np.ones((len(direct), 1))], axis=1).reshape(height, width, 3)
