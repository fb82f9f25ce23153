"""A simulated endoscope with what goes wrong in an operating room: reflections, a bad gain, a covered camera, delay."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from markerseek.sim import SimulatedEndoscope

REFLECTION_PX = (90.0, 40.0)
REFLECTION_COUNTS = 150.0
"""Where a reflection is, (x, y) from the spot, and its height over the tissue."""


class FaultyEndoscope(SimulatedEndoscope):
    """``reflection``: "steady" shines with the laser off as well, "laser" only while it fires. ``saturated``: camera
    whose gain is four times too high. ``occluded``: camera that does not see the spot. ``delay_frames``: by how many
    frames the images come late."""

    def __init__(
        self,
        *,
        reflection: Literal["steady", "laser"] | None = None,
        saturated: Literal["left", "right"] | None = None,
        occluded: Literal["left", "right"] | None = None,
        delay_frames: int = 0,
        **more: Any,
    ) -> None:
        super().__init__(**more)
        self._reflection = reflection
        self._saturated = saturated
        self._occluded = occluded
        self._delay_frames = delay_frames
        self._late = []

    def _come(self) -> list[Any]:
        before = self._frames
        came = super()._come()
        self._late += [each._replace(frame=each.frame + self._delay_frames) for each in came]
        due = [] if self._frames == before else [each for each in self._late if each.frame <= self._frames]
        self._late = [each for each in self._late if each not in due]
        return due

    def _image(self, side: Literal["left", "right"], moment: Any) -> np.ndarray:
        covered = moment._replace(lit=False) if side == self._occluded else moment
        image = super()._image(side, covered).astype(float)
        if self._reflection == "steady" or (self._reflection == "laser" and moment.lit):
            x, y = moment.spot_px[side] + REFLECTION_PX
            rows, columns = np.indices(image.shape)
            away = np.hypot(columns - x, rows - y) / self._settings.spot_radius_px
            image += REFLECTION_COUNTS * np.exp(-0.5 * away**2)
        if side == self._saturated:
            image *= 4
        return np.clip(image, 0, 255).astype(np.uint8)
