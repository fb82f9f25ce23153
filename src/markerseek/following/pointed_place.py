"""A place that a person points at in the left image; it is found in the right one by its texture, once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from markerseek.core import Clock, ConfigError, StereoPair
from markerseek.following.endoscope_check import NewestPairs
from markerseek.following.target import Target
from markerseek.registration import StereoSettings, seen_point
from markerseek.vision import NotKnown, match_point

IMAGES_S = 3.0
"""Longest time for which the first image pair is awaited, in seconds."""

_POLL_S = 0.05


def named_target(
    pair: StereoPair, stereo: StereoSettings, left_px: tuple[float, float], *, at_s: float, named: int = 1
) -> Target:
    """Return the place that the left image shows at a pixel, as a target.

    Raises `ConfigError` where the texture does not suffice, with the reason, and for a pixel outside of the image.

    Parameters
    ----------
    pair
        Images of both cameras, without the laser's light.
    stereo
        Calibration of the cameras.
    left_px
        Pixel (x, y) of the left image.
    at_s
        Time of the target.
    named
        Number of the place, as of `Target`.
    """
    found = match_point(pair, stereo.cameras, left_px)
    if isinstance(found, NotKnown):
        x, y = left_px
        raise ConfigError(f"`pixel` is {x:.0f}, {y:.0f}, which cannot be followed: {found.reason}; point beside it")
    camera_m, covariance_m2, _ = seen_point(
        np.array(found.left_px),
        np.array(found.right_px),
        stereo.cameras,
        spot_px=found.sigma_px,
        calibration_px=stereo.calibration_sigma_px,
    )
    return Target(at_s=at_s, camera_m=camera_m, covariance_m2=covariance_m2, named=named)


class PointedPlace:
    """A `TargetSource` of the place that a person points at; it rests on the tissue until another one is named.

    Parameters
    ----------
    pairs
        Image pairs without the laser's light.
    stereo
        Calibration of the cameras.
    clock
        That of the rig.
    left_px
        Pixel (x, y) of the left image.
    pointed
        Returns the pixel at which somebody has pointed since it was called last, None if nobody has. A place whose
        texture does not suffice is refused: `refused` says why, and the former one is followed on. None: it stays at
        the first one.

    Raises
    ------
    ConfigError
        If the texture at the first pixel does not suffice, or no images come.
    """

    def __init__(
        self,
        pairs: NewestPairs,
        stereo: StereoSettings,
        clock: Clock,
        *,
        left_px: tuple[float, float],
        pointed: Callable[[], tuple[float, float] | None] | None = None,
    ) -> None:
        self._pairs = pairs
        self._stereo = stereo
        self._clock = clock
        self._pointed = pointed
        self._target = named_target(self._first(), stereo, left_px, at_s=clock.now_s())
        self.left_px = left_px
        """Pixel of the place that is followed."""
        self.refused = ""
        """Why the last place is not followed; empty if it is."""
        self.name = _named(left_px, self._target)
        """What is followed, in words."""

    def newest(self) -> Target:
        """Return the place, also where nothing new was named."""
        pixel = None if self._pointed is None else self._pointed()
        if pixel is not None:
            self._point_at(pixel)
        return replace(self._target, at_s=self._clock.now_s())

    @property
    def heard_s(self) -> float:
        """The present: there is no link."""
        return self._clock.now_s()

    def _point_at(self, left_px: tuple[float, float]) -> None:
        """Follow another place, if its texture suffices."""
        pair = self._pairs.newest()
        assert pair is not None  # noqa: S101  there was a first one
        try:
            target = named_target(
                pair, self._stereo, left_px, at_s=self._clock.now_s(), named=1 + (self._target.named or 0)
            )
        except ConfigError as problem:
            self.refused = str(problem)
            return
        self._target = target
        self.left_px = left_px
        self.refused = ""
        self.name = _named(left_px, target)

    def _first(self) -> StereoPair:
        """Wait for the first pair."""
        ends_s = self._clock.now_s() + IMAGES_S
        while (pair := self._pairs.newest()) is None:
            if not self._clock.now_s() < ends_s:
                raise ConfigError(
                    f"{self._pairs.name}: no image pair came within {IMAGES_S:g} s; check that both cameras send"
                )
            self._clock.wait(_POLL_S)
        return pair


def _named(left_px: tuple[float, float], target: Target) -> str:
    """Return what is followed, in words."""
    x, y = left_px
    return f"the place at {x:.0f}, {y:.0f} of the left image, {1e3 * float(target.camera_m[2]):.1f} mm deep"
