"""Echoes of an absorber: repeats of its arrival behind itself, and its mirror image in a plane. Both are options."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from markerseek.acoustics._checks import positive, within
from markerseek.acoustics.absorber import Absorber
from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Reverberation:
    """Repeats of every arrival, as between the probe's face and a layer in front of it.

    Attributes
    ----------
    delay_s
        Time from one repeat to the next, in seconds: twice the layer's thickness over the speed of sound.
    gain
        Amplitude of a repeat over that of the one before it, −1 to 1; negative turns each over.
    repeats
        Number of repeats.
    """

    delay_s: float
    gain: float = 0.1
    repeats: int = 2

    def __post_init__(self) -> None:
        positive(self.delay_s, name="reverberation: delay_s", unit="s", cure="1 to 20 µs are usual")
        within(self.gain, low=-1.0, high=1.0, name="reverberation: gain", unit="", cure="0.05 to 0.3 are usual")
        if self.repeats < 1:
            raise ConfigError(
                f"reverberation: repeats is {self.repeats}, it must be at least 1; leave the reverberation out for none"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Reflector:
    """Large flat reflector parallel to the probe's axis, fixed in the patient (bone, bladder wall, the pad's far side).

    Attributes
    ----------
    distance_m
        Distance of the plane from the axis of rotation, in metres.
    angle_deg
        Direction of the plane's normal about that axis, in degrees.
    gain
        Amplitude reflected over that which arrives, −1 to 1.
    """

    distance_m: float
    angle_deg: float = 0.0
    gain: float = 0.2

    def __post_init__(self) -> None:
        positive(self.distance_m, name="reflector: distance_m", unit="m", cure="put it behind the absorbers")
        within(
            self.angle_deg, low=-180.0, high=180.0, name="reflector: angle_deg", unit="deg", cure="0 faces the probe"
        )
        within(self.gain, low=-1.0, high=1.0, name="reflector: gain", unit="", cure="0.05 to 0.5 are usual")

    def images(self, absorbers: Sequence[Absorber]) -> tuple[Absorber, ...]:
        """Mirror images of the absorbers, the sound of which is the echo; to be heard besides the absorbers.

        Parameters
        ----------
        absorbers
            Absorbers between the axis and the plane.

        Raises
        ------
        ConfigError
            If an absorber lies behind the plane.
        """
        images = []
        for absorber in absorbers:
            turned = math.radians(absorber.angle_deg - self.angle_deg)
            along_normal = absorber.radius_m * math.cos(turned)
            beside = absorber.radius_m * math.sin(turned)
            if not along_normal < self.distance_m:
                raise ConfigError(
                    f"reflector: distance_m is {self.distance_m} m, an absorber is behind it, {along_normal:.4g} m "
                    "out; move the reflector out or leave that absorber out"
                )
            mirrored = 2 * self.distance_m - along_normal
            images.append(
                replace(
                    absorber,
                    radius_m=math.hypot(mirrored, beside),
                    angle_deg=self.angle_deg + math.degrees(math.atan2(beside, mirrored)),
                    strength=absorber.strength * self.gain,
                )
            )
        return tuple(images)
