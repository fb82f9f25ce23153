"""A simulated room in which a spot or the tip of an instrument moves, with the truth about it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from msgspec import structs

from markerseek.core import ConfigError, Float64, require_range
from markerseek.following.spot_source import SpotSource
from markerseek.following.target import Look, Target
from markerseek.registration import KnownRegistration, PointPair, SimulatedRoom, SimulatedRoomSettings, register_pairs

Motion: TypeAlias = Literal["still", "sine", "steps", "jump", "lost"]
"""How the target moves: not at all, to and fro, by steps, with one jump, or it is gone for a while."""

STEP_M = 10e-3
STEP_S = 4.0
"""Length of a step along the tissue, and time from one to the next."""

GONE_S = (5.0, 7.5)
"""When a target that gets lost is gone."""

JUMP_S = 5.0
JUMP_M = 30e-3
"""When a target jumps, and how far."""

TIP_SIGMA_M = 0.2e-3
"""Standard deviation of the noise of a simulated tip along each direction."""

REGISTRATION_M = 0.5e-3
"""Usual error of a simulated registration: root mean square of its length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPath:
    """How a simulated target moves along the tissue, across the image plane."""

    motion: Motion = "sine"
    amplitude_m: float = 15e-3
    """Half of the way of a sine."""
    speed_m_s: float = 2e-3
    """Largest speed of a sine."""
    begins_s: float = 0.0
    """When it begins to move."""
    beside_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """By how much the source is beside the spot, in the TRUS frame: what a wrong registration looks like."""

    def __post_init__(self) -> None:
        require_range("simulated target: amplitude_m", self.amplitude_m, low=1e-4, high=30e-3, unit="m")
        require_range("simulated target: speed_m_s", self.speed_m_s, low=1e-5, high=1.0, unit="m/s")

    def way_m(self, at_s: float) -> float | None:
        """Return the way from the middle at a time; None while the target is gone."""
        at_s = max(at_s - self.begins_s, 0.0)
        match self.motion:
            case "still":
                return 0.0
            case "sine":
                return self.amplitude_m * math.sin(at_s * self.speed_m_s / self.amplitude_m)
            case "steps":
                return STEP_M * (int(at_s / STEP_S) % 2)
            case "jump":
                return 0.0 if at_s < JUMP_S else JUMP_M * 0.7
            case "lost":
                return None if GONE_S[0] <= at_s < GONE_S[1] else 0.0


class FollowedRoom(SimulatedRoom):
    """A `SimulatedRoom` whose target moves by itself.

    ``seed``: of everything that is drawn.
    """

    def __init__(self, settings: SimulatedRoomSettings, path: TargetPath, *, seed: int) -> None:
        look = structs.replace(settings.look, frames=_LIT_FRAMES)
        super().__init__(replace(settings, look=look), seed=seed)
        self.path = path
        """How the target moves."""
        self._noise = self._rng.spawn(1)[0]
        self._shown_m: float | None = None

    def target_m(self, at_s: float) -> Float64[np.ndarray, " 3"] | None:
        """Return the true place of the target in the frame of the camera; None while it is gone."""
        way_m = self.path.way_m(at_s)
        if way_m is None:
            return None
        return self.true.inverse().apply(self._on_tissue_m(way_m) + self._moved_m(at_s))

    def angle_deg(self, at_s: float) -> float | None:
        """Return the true angle of the probe whose image plane holds the target; None while it is gone."""
        way_m = self.path.way_m(at_s)
        if way_m is None:
            return None
        x, _, z = self._on_tissue_m(way_m) + self._moved_m(at_s)
        return math.degrees(math.atan2(x, z))

    def angle_at_deg(self, left_px: tuple[float, float]) -> float:
        """Return the true angle of the probe whose image plane holds what the left image shows at a pixel.

        Errors as below.
        """
        x, _, z = self.true.apply(self.place_at_m(left_px))
        return math.degrees(math.atan2(x, z))

    def place_at_m(self, left_px: tuple[float, float]) -> Float64[np.ndarray, " 3"]:
        """Return the true place, in the frame of the camera, of what the left image shows at a pixel (x, y).

        Raises `ConfigError` where the tissue has no texture.
        """
        if self._tissue is None:
            raise ConfigError("`textured` is False: what images without texture show at a pixel has no place")
        true = self.true
        camera = self.images.cameras.left
        direction = np.append(camera.undistort(np.array([left_px], dtype=np.float64))[0], 1.0)
        place_m = self._tissue.met_by(true.translation_m, (true.rotation @ direction)[None])
        return true.inverse().apply(np.append(place_m[0], self._tissue.height_m(place_m)))

    def _on_tissue_m(self, way_m: float) -> Float64[np.ndarray, " 3"]:
        angle = way_m / self._tissue_m
        x_m = self._tissue_m * math.sin(angle)
        height_m = self._tissue_m * math.cos(angle)
        if self._tissue is not None:
            height_m = float(self._tissue.height_m(np.array([[x_m, 0.0]]))[0])
        return np.array([x_m, 0.0, height_m])

    def _moved_m(self, at_s: float) -> Float64[np.ndarray, " 3"]:
        """Return how far the tissue has moved."""
        return np.asarray(self._movable.world.motion.displacement_m(np.array([at_s]))[0])

    def shine(self) -> None:
        """Put the light where the target is now."""
        way_m = self.path.way_m(self.rig.scanner.clock.now_s())
        if way_m is None:
            self.images.show(None)
            self._shown_m = None
            return
        if way_m == self._shown_m:
            return
        self._shown_m = way_m
        spot_m = self._on_tissue_m(way_m)
        self.images.show(spot_m)
        x, y, z = (self._heard_m(spot_m) + np.array(self.path.beside_m)).tolist()
        self.rig = self._movable.move(angle_deg=math.degrees(math.atan2(x, z)), radius_m=math.hypot(x, z), lateral_m=y)

    def tip(self) -> SimulatedTip:
        """Return the target as the tip of an instrument, which a robot reports."""
        return SimulatedTip(self, self._noise)

    def registration(self, *, error_m: float = REGISTRATION_M) -> KnownRegistration:
        """Return a registration of this room whose error is drawn; ``error_m``: its root mean square length."""
        require_range("simulated registration: error_m", error_m, low=0, high=20e-3, unit="m")
        true = self.true
        places_m = np.array([self._on_tissue_m(way_m) for way_m in (-0.02, -0.01, 0.01, 0.02)])
        places_m[:, 1] = [0.012, -0.012, 0.012, -0.012]
        places_m[::2, 2] -= 8e-3
        off_m = error_m / math.sqrt(3) * self._noise.standard_normal(3)
        pairs = [
            PointPair(name=str(number), trus_m=place_m + off_m, camera_m=true.inverse().apply(place_m))
            for number, place_m in enumerate(places_m, start=1)
        ]
        covariance_m2 = np.eye(3) * error_m**2 / 3
        report = structs.replace(
            register_pairs(pairs),
            tre_m=error_m,
            # 95 % of the lengths of a vector of three equal coordinates are below 2.795 standard deviations of one.
            tre95_m=2.795 * error_m / math.sqrt(3),
            target_covariance_m2=covariance_m2.tolist(),
        )
        return KnownRegistration.of(report, source=None, simulated=True)


_LIT_FRAMES = 4
"""Image pairs with light of one look that are made."""


class SimulatedTip:
    """The tip of a simulated instrument."""

    name = "the tip of a simulated instrument"

    def __init__(self, room: FollowedRoom, rng: np.random.Generator) -> None:
        self._room = room
        self._rng = rng

    def newest(self) -> Target | None:
        """Return where the robot reports it now."""
        now_s = self._room.rig.scanner.clock.now_s()
        place_m = self._room.target_m(now_s)
        if place_m is None:
            return None
        noise_m = TIP_SIGMA_M * self._rng.standard_normal(3)
        return Target(at_s=now_s, camera_m=place_m + noise_m, covariance_m2=np.eye(3) * TIP_SIGMA_M**2)

    @property
    def heard_s(self) -> float:
        """Its link is never silent."""
        return self._room.rig.scanner.clock.now_s()


class SimulatedSpot(SpotSource):
    """A laser spot that somebody moves."""

    def __init__(self, room: FollowedRoom) -> None:
        super().__init__(room)
        self._followed = room

    def look(self, pulses: int) -> Look:
        """As of `SpotSource`, at the spot where it is now."""
        self._followed.shine()
        return super().look(pulses)
