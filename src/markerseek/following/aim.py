"""Where the probe must turn to see a target, and how well that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import ConfigError, Float64, Interval
from markerseek.following.target import Target
from markerseek.geometry import effect_of_motion
from markerseek.registration import DEPTHS_M, EndoscopeMotion, KnownRegistration, reach_of
from markerseek.rigs import Rig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aim:
    """A target in the frame of the probe."""

    at_s: float
    trus_m: Float64[np.ndarray, " 3"]
    covariance_m2: Float64[np.ndarray, "3 3"]
    """Of the registration and of the target, with what is the same at all times."""
    noise_m2: Float64[np.ndarray, "3 3"]
    """Of the target alone: what differs from one time to the next."""
    named: int | None = None
    """As of `Target`."""

    @property
    def angle_deg(self) -> float:
        """Angle of the probe whose image plane holds it."""
        return math.degrees(math.atan2(self.trus_m[0], self.trus_m[2]))

    @property
    def radius_m(self) -> float:
        """Distance from the axis of the probe."""
        return math.hypot(self.trus_m[0], self.trus_m[2])

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of the angle."""
        x, _, z = self.trus_m
        across = np.array([z, 0.0, -x]) / self.radius_m
        return math.degrees(math.sqrt(float(across @ self.covariance_m2 @ across)) / self.radius_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeReach:
    """What the probe can be turned to, and can see."""

    angles: Interval
    lateral_m: float
    """Largest distance from the middle of the array, along it."""
    radius_m: tuple[float, float]
    """Least and largest distance from the axis."""

    def objection(self, aim: Aim) -> str | None:
        """Why a target is out of reach; None if it is not."""
        if aim.angle_deg not in self.angles:
            return f"the target is at {aim.angle_deg:.1f} deg, the probe turns within {self.angles}"
        lateral_m = float(aim.trus_m[1])
        if not abs(lateral_m) <= self.lateral_m:
            return f"the target is {1e3 * lateral_m:.0f} mm along the array, it sees ± {1e3 * self.lateral_m:.0f} mm"
        low_m, high_m = self.radius_m
        if not low_m <= aim.radius_m <= high_m:
            return (
                f"the target is {1e3 * aim.radius_m:.0f} mm from the axis, the probe sees {1e3 * low_m:.0f} to "
                f"{1e3 * high_m:.0f} mm"
            )
        return None


def probe_reach(rig: Rig) -> ProbeReach:
    """Return the reach of a rig that follows: its search range without the backlash at both ends."""
    reach = reach_of(rig)
    play_deg = rig.scanner.play_deg
    angles = Interval(low_deg=reach.angles.low_deg + play_deg, high_deg=reach.angles.high_deg - play_deg)
    return ProbeReach(angles=angles, lateral_m=reach.lateral_m, radius_m=DEPTHS_M)


class HeldRegistration:
    """A registration while it is used: carried along with the endoscope, and confirmed by a spot or not yet.

    ``known``: as it was registered. ``confirmed``: whether it holds as it is; a registration whose probe or camera was
    turned off since then does not.
    """

    def __init__(self, known: KnownRegistration, *, confirmed: bool) -> None:
        self.known = known
        self.confirmed = confirmed
        self._motion: EndoscopeMotion | None = None
        self.transform = known.davinci_to_trus
        """The transform from the camera as it stands now to the probe at 0 degrees."""
        self.to_camera = self.transform.inverse()
        """Its inverse, which each step needs."""
        self.tre_m = self._expected_m()
        """Expected error at the target of the registration, with that of the carried motion."""

    def carry(self, motion: EndoscopeMotion) -> None:
        """Carry it along with the endoscope, which has moved so since the registration."""
        back = motion.transform.inverse()
        self._motion = motion
        self.transform = replace(self.known.davinci_to_trus, source=back.target) @ back
        self.to_camera = self.transform.inverse()
        self.tre_m = self._expected_m()

    def _expected_m(self) -> float:
        target_m = self.to_camera.apply(np.array(self.known.report.target_trus_m))
        return math.sqrt(float(np.trace(self.error_m2(target_m))))

    def error_m2(self, camera_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 3"]:
        """Covariance of its error in the frame of the probe: that at its target, and that of the carried motion."""
        expected_m2 = np.array(self.known.report.target_covariance_m2)
        if self._motion is None:
            return expected_m2
        offset_m = camera_m - 1e-3 * np.array(self._motion.middle_mm)
        by_motion_m = self.transform.rotation @ effect_of_motion(offset_m[None])[0] @ self._motion.sigmas
        return np.asarray(expected_m2 + by_motion_m @ by_motion_m.T)

    def aim(self, target: Target, *, depth_m: float = 0.0) -> Aim:
        """Return where the probe must turn to see a target.

        ``depth_m``: how far below the target, along the line of sight, is what the probe is to see. Raises
        `ConfigError` for a target on the axis, where every angle is right.
        """
        away_m = float(np.linalg.norm(target.camera_m))
        camera_m = target.camera_m * (1 + depth_m / max(away_m, 1e-9))
        transform = self.transform
        noise_m2 = transform.rotation @ target.covariance_m2 @ transform.rotation.T
        shared_m2 = np.zeros((3, 3)) if target.shared_m2 is None else target.shared_m2
        aim = Aim(
            at_s=target.at_s,
            trus_m=transform.apply(camera_m),
            covariance_m2=noise_m2 + transform.rotation @ shared_m2 @ transform.rotation.T + self.error_m2(camera_m),
            noise_m2=noise_m2,
            named=target.named,
        )
        if not aim.radius_m > 1e-3:
            raise ConfigError(f"target: it is {1e3 * aim.radius_m:.2f} mm from the axis of the probe, 1 mm at least")
        return aim
