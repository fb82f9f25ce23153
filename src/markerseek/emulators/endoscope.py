"""An emulated stereo endoscope on an emulated bench: image files in two folders, and a spot that a person moves."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from markerseek.core import Clock, ConfigError, Float64, UInt8
from markerseek.files import overwrite
from markerseek.rigs import marker_scene
from markerseek.sim import (
    EndoscopeSettings,
    SimulatedEndoscope,
    SimulatedSettings,
    TexturedTissue,
    World,
    camera_above,
    endoscope,
    on_tissue_m,
)

EVERY_S = 0.1
"""Time between two image pairs, in seconds."""

_FILES = 20
"""Files of each camera; then the first is written again."""

_DISTANCE_M = 0.1
_TILT_DEG = 30.0
_ROLL_DEG = 20.0
"""Where the cameras stand: distance from the tissue, and tilt and roll in degrees."""

_CONTRAST = 0.25
"""Standard deviation of the brightness of moving tissue over its mean."""


class EmulatedEndoscope:
    """Writes what both cameras see of a world as PGM files into the folders ``left`` and ``right``.

    Its calibration is that of `markerseek.sim.endoscope`.

    ``world``: world in which the laser fires. ``settings``: its settings. ``folder``: where the two folders are made.
    ``clock``: time of the images. ``rng``: of the images, and of each spot that is lit. ``displacement_m``: how far the
    tissue has moved in the TRUS frame, at a time of that clock; None: it is at rest, and has no texture to follow.
    """

    def __init__(
        self,
        *,
        world: World,
        settings: SimulatedSettings,
        folder: Path,
        clock: Clock,
        rng: np.random.Generator,
        displacement_m: Callable[[float], Float64[np.ndarray, " 3"]] | None = None,
    ) -> None:
        self._world = world
        self._settings = settings
        self._clock = clock
        self._rng = rng
        self.folders = folder / "left", folder / "right"
        for each in self.folders:
            each.mkdir(parents=True, exist_ok=True)
        self.cameras = endoscope()
        """Their calibration."""
        self.true = camera_above(
            np.array([0.0, 0.0, settings.marker.radius_m]),
            distance_m=_DISTANCE_M,
            roll_deg=_ROLL_DEG,
            tilt_deg=_TILT_DEG,
        )
        """The true transform from the left camera to the probe."""
        look = EndoscopeSettings(frames=1)
        self.calibration_sigma_px = look.calibration_sigma_px
        """Standard deviation of the error of the calibration, in pixels."""
        tissue = None
        if displacement_m is not None:
            # Level, as the places are that a person lights.
            tissue = TexturedTissue.drawn(seed=1, level_m=settings.marker.radius_m, relief_m=0.0, contrast=_CONTRAST)
        self.images = SimulatedEndoscope(
            cameras=self.cameras,
            camera_to_trus=self.true,
            settings=look,
            rng=rng,
            clock=clock,
            flashes=lambda: len(world.flashes),
            tissue=tissue,
            displacement_m=displacement_m,
        )
        self._next_s = clock.now_s()
        self._written = 0
        width, height = self.cameras.left.size_px
        self.light((width / 2, height / 2))

    @property
    def said(self) -> str:
        """Where its files are, and how the spot is moved, for people."""
        return (
            f"images: {self.folders[0]} and {self.folders[1]}\n"
            'to move the spot of light, type its place in the left image here, in pixels: "640 512"'
        )

    def type(self, line: str) -> str:
        """Light the place that a person types; returns what to answer."""
        try:
            x, y = (float(word) for word in re.split(r"[\s,()]+", line.strip(" ()\n")))
        except ValueError:
            return 'a place is two numbers, in pixels of the left image: "640 512"'
        try:
            self.light((x, y))
        except ConfigError as problem:
            return f"{str(problem).removeprefix('pixel 1 is ')}; the spot stays where it is"
        return f"the spot is at ({x:.0f}, {y:.0f}) px of the left image"

    def light(self, left_px: tuple[float, float]) -> None:
        """Light the place of the tissue that the left camera sees there; the spot and its sound move.

        Raises `ConfigError` outside the image.
        """
        x, y = self.cameras.left.undistort(np.array([left_px]))[0]
        spot_m = on_tissue_m(self.true, np.array([x, y, 1.0]), height_m=self._settings.marker.radius_m)
        angle_deg = math.degrees(math.atan2(spot_m[0], spot_m[2]))
        scene = marker_scene(
            self._settings,
            self._rng,
            angle_deg=angle_deg,
            radius_m=math.hypot(spot_m[0], spot_m[2]),
            lateral_m=float(spot_m[1]),
        )
        self._world.replace_absorbers(scene.absorbers)
        self.images.show(spot_m)

    def advance(self) -> None:
        """Write an image pair, if one is due."""
        if self._clock.now_s() < self._next_s:
            return
        self._next_s = self._clock.now_s() + EVERY_S
        for pair in self.images.newest()[-1:]:
            for folder, image in zip(self.folders, (pair.left, pair.right), strict=True):
                draft = folder / "next.part"
                overwrite(draft, _pgm(image))
                draft.replace(folder / f"{self._written % _FILES:02d}.pgm")
            self._written += 1


def _pgm(image: UInt8[np.ndarray, "rows columns"]) -> bytes:
    rows, columns = image.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + image.tobytes()
