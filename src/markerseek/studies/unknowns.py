"""What a study draws in each trial: the rig and its marker, of which policies receive nothing, and what is beside it.

Rig and marker are drawn over the ranges of the physics table. In addition to the table the attenuation of the medium is
drawn, from that of a gel pad to that of soft tissue. The receiver's settings (sampling, samples, noise) are those of
the study.

Beside the marker there may be a second source, clutter, and repeats behind every source. The loudness of a source is
its noise-free envelope peak in the image with the probe on it, over that of the marker with the probe on the marker.
The marker is the loudest source: it is the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import structs

from markerseek.acoustics import (
    Absorber,
    AcousticModel,
    Band,
    Clutter,
    GaussianAbsorber,
    GaussianPulse,
    LaserPulse,
    Medium,
    Probe,
    RectanglePulse,
    Reverberation,
)
from markerseek.core import ConfigError, Float64, Interval, Within, is_whole, require_fields, require_range
from markerseek.sim import ReceiverSettings, SimulatedSettings, TissueMotion

ELEMENT_HEIGHT_M = (3e-3, 6e-3)
"""Element height in metres."""

FOCUS_M = (20e-3, 40e-3)
"""Elevation focus in metres."""

NO_LENS = 0.2
"""Share of probes without a lens."""

FACE_RADII_M = (8e-3, 12e-3)
"""Distance of the face from the axis in metres."""

MARKER_RADIUS_M = (35e-3, 70e-3)
"""Distance of the marker from the axis in metres."""

SOURCE_RADIUS_M = (0.05e-3, 0.4e-3)
"""Radius of the Gaussian absorber in metres, evenly spread in its logarithm."""

PULSE_S = (5e-9, 600e-9)
"""Length of the laser pulse in seconds: of a rectangle, or (as often) the full width at half maximum of a Gaussian."""

TRIGGER_OFFSET_S = (-1e-6, 1e-6)
"""Trigger offset in seconds."""

SOUND_SPEEDS_M_S = (1450.0, 1600.0)
"""Speed of sound in m/s."""

CENTRE_HZ = (4e6, 7e6)
"""Frequency of the band's largest gain in Hz; the band reaches 1.5 MHz below and 2.5 MHz above it, as usual."""

ATTENUATION_DB_CM_MHZ = (0.05, 0.5)
"""Attenuation in dB/(cm MHz)."""

STAMP_DELAY_S = (-10e-3, 20e-3)
"""Time from the stamp of a pulse to its light, in seconds."""

STAMP_JITTER_S = (0.5e-3, 3e-3)
"""Standard deviation of a stamp by itself, in seconds."""

BACKLASH_DEG = (0.05, 0.2)
"""Backlash between encoder and probe, in degrees; the rig states 0.1."""

WITHOUT_LIGHT = 0.01
"""Share of the pulses that give no light."""

DRIFT_PER_MIN = (-0.08, 0.08)
"""Change of ln energy in a minute."""

_PULSES = (1, 128)
"""Pulses averaged, evenly spread in their logarithm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknowns:
    """One rig and one marker."""

    model: AcousticModel
    """The acoustic model of the rig."""
    marker: Absorber
    """The marker, of strength 1."""
    pulses: int
    """Pulses averaged in one acquisition."""


def draw_unknowns(
    rng: np.random.Generator, *, marker_deg: float, lateral_m: float, receiver: ReceiverSettings
) -> Unknowns:
    """Draw a rig and a marker."""
    # The order of the draws is part of the study: another order would give other markers.
    focus_m = None if rng.random() < NO_LENS else float(rng.uniform(*FOCUS_M))
    probe = Probe(
        element_height_m=float(rng.uniform(*ELEMENT_HEIGHT_M)),
        elevation_focus_m=focus_m,
        face_radius_m=float(rng.uniform(*FACE_RADII_M)),
    )
    pulse_s = float(rng.uniform(*PULSE_S))
    laser: LaserPulse = RectanglePulse(duration_s=pulse_s) if rng.random() < 0.5 else GaussianPulse(fwhm_s=pulse_s)
    centre_hz = float(rng.uniform(*CENTRE_HZ))
    medium = Medium(
        sound_speed_m_s=float(rng.uniform(*SOUND_SPEEDS_M_S)),
        attenuation_db_cm_mhz=float(rng.uniform(*ATTENUATION_DB_CM_MHZ)),
    )
    model = AcousticModel(
        probe=probe,
        medium=medium,
        laser=laser,
        band=Band(centre_hz=centre_hz, low_hz=centre_hz - 1.5e6, high_hz=centre_hz + 2.5e6),
        sampling_hz=receiver.sampling_hz,
        samples=receiver.samples,
        trigger_offset_s=float(rng.uniform(*TRIGGER_OFFSET_S)),
    )
    marker = Absorber(
        radius_m=float(rng.uniform(*MARKER_RADIUS_M)),
        angle_deg=marker_deg,
        lateral_m=lateral_m,
        source=GaussianAbsorber(radius_m=log_uniform(rng, *SOURCE_RADIUS_M)),
    )
    return Unknowns(model=model, marker=marker, pulses=round(log_uniform(rng, *_PULSES)))


def with_timing(settings: SimulatedSettings, rng: np.random.Generator) -> SimulatedSettings:
    """Return the settings with what a sweep does not know of stage and laser, drawn."""
    laser = structs.replace(
        settings.laser,
        stamp_delay_s=float(rng.uniform(*STAMP_DELAY_S)),
        stamp_jitter_s=float(rng.uniform(*STAMP_JITTER_S)),
        energy_drift_per_min=float(rng.uniform(*DRIFT_PER_MIN)),
        without_light=WITHOUT_LIGHT,
    )
    backlash_deg = float(rng.uniform(*BACKLASH_DEG))
    stage = structs.replace(settings.stage, backlash_deg=backlash_deg, stated_backlash_deg=settings.stage.backlash_deg)
    return structs.replace(settings, laser=laser, stage=stage)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number that is evenly spread in its logarithm."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


LATERAL_M = 20e-3
"""Largest distance of the marker, and of a second source, from the middle of the array along it, in metres."""

_MAX_DRAWS = 10_000


class SecondSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A second source in the search range."""

    least_apart_deg: float = 6.0
    """Least distance from the marker, which is drawn evenly, to either side as the range allows."""
    most_apart_deg: float = 60.0
    """Largest distance from the marker."""
    least_relative: float = 0.5
    """Least loudness over the marker's, which is drawn evenly."""
    most_relative: float = 1.0
    """Largest loudness over the marker's."""
    same_place: bool = False
    """Whether lateral position, radius and size are those of the marker; otherwise they are drawn."""
    least_lateral_m: float = 0.0
    """Least lateral distance from the marker; 0 allows them to overlap in place."""

    def __post_init__(self) -> None:
        _require_span(self, "scene.second", "apart_deg", low=0.0, high=90.0, unit="deg")
        _require_span(self, "scene.second", "relative", low=0.0, high=1.0, open_low=True)
        require_range("scene.second: least_lateral_m", self.least_lateral_m, low=0.0, high=LATERAL_M, unit="m")
        if self.same_place and self.least_lateral_m > 0:
            raise ConfigError("scene.second: same_place is true, and least_lateral_m is above 0; leave one out")


class ClutterAround(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Absorbers around the marker."""

    count: int = 8
    least_db: float = -20.0
    """Least loudness of the loudest absorber over the marker's, which is drawn evenly; the others follow an exponential
    law."""
    most_db: float = -3.0
    """Largest loudness of the loudest absorber over the marker's."""

    def __post_init__(self) -> None:
        if not is_whole(self.count) or not 1 <= self.count <= 1000:
            raise ConfigError(f"scene.clutter: count is {self.count}, it must be a whole number from 1 to 1000")
        _require_span(self, "scene.clutter", "db", low=-60.0, high=0.0, unit="dB")


class Repeats(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Repeats behind every source."""

    least_delay_s: float = 1e-6
    """Least time from one repeat to the next, which is drawn evenly."""
    most_delay_s: float = 20e-6
    """Largest time from one repeat to the next."""
    least_gain: float = 0.05
    """Least amplitude of a repeat over that of the repeat before, which is drawn evenly, with either sign as likely."""
    most_gain: float = 0.5
    """Largest amplitude of a repeat over that of the repeat before."""
    most_repeats: int = 3
    """Number of repeats, drawn from 1 to this."""

    def __post_init__(self) -> None:
        _require_span(self, "scene.repeats", "delay_s", low=0.0, high=1e-3, unit="s", open_low=True)
        _require_span(self, "scene.repeats", "gain", low=0.0, high=1.0)
        if not is_whole(self.most_repeats) or not 1 <= self.most_repeats <= 10:
            raise ConfigError(f"scene.repeats: most_repeats is {self.most_repeats}, it must be 1 to 10")


class Breathing(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Tissue that breathes; the truth is the marker's place in the pause."""

    amplitude_mm: Annotated[float, Within(0, 30, "mm")] = 0.3
    """Half of the way."""
    least_period_s: Annotated[float, Within(1, 60, "s")] = 3.0
    """Least time from breath to breath, which is drawn evenly."""
    most_period_s: Annotated[float, Within(1, 60, "s")] = 5.0
    """Largest time from breath to breath."""
    most_power: Annotated[int, Within(1, 10)] = 3
    """n of the shape cos²ⁿ, drawn from 2 to this, or from 1 where this is 1."""
    along: Literal["any", "turn", "axis", "depth"] = "any"
    """Direction at the marker: any, each as probable, or along the turn of the probe, the axis of rotation, or the
    depth."""

    def __post_init__(self) -> None:
        require_fields(self, "scene.breathing")
        _require_span(self, "scene.breathing", "period_s", low=1.0, high=60.0, unit="s")


class SceneSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is drawn beside the marker; None for nothing."""

    second: SecondSource | None = None
    clutter: ClutterAround | None = None
    repeats: Repeats | None = None
    breathing: Breathing | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnScene:
    """What was drawn beside the marker."""

    second: Absorber | None = None
    """The second source, its strength the loudness over the marker's."""
    clutter: tuple[Absorber, ...] = ()
    """The clutter, with strengths likewise, some negative."""
    reverberation: Reverberation | None = None
    motion: TissueMotion | None = None


def draw_extra_sources(
    settings: SceneSettings, rng: np.random.Generator, *, marker: Absorber, limits: Interval
) -> DrawnScene:
    """Draw the second source, the clutter and the repeats beside a marker.

    ``limits``: range of the search, which holds both sources.
    """
    return DrawnScene(
        second=None if settings.second is None else _second(settings.second, rng, marker=marker, limits=limits),
        clutter=() if settings.clutter is None else _clutter(settings.clutter, rng),
        reverberation=None if settings.repeats is None else _repeats(settings.repeats, rng),
        motion=None if settings.breathing is None else _motion(settings.breathing, rng, marker=marker),
    )


def _motion(settings: Breathing, rng: np.random.Generator, *, marker: Absorber) -> TissueMotion:
    at = math.radians(marker.angle_deg)
    # Along the turn, along the axis and away from it, at the marker.
    axes = np.array([[math.cos(at), 0.0, -math.sin(at)], [0.0, 1.0, 0.0], [math.sin(at), 0.0, math.cos(at)]])
    drawn: Float64[np.ndarray, " 3"] = rng.standard_normal(3)
    sign = float(rng.choice((-1.0, 1.0)))
    direction = drawn if settings.along == "any" else sign * axes[("turn", "axis", "depth").index(settings.along)]
    x, y, z = direction.tolist()
    return TissueMotion(
        breathing_mm=settings.amplitude_mm,
        period_s=float(rng.uniform(settings.least_period_s, settings.most_period_s)),
        power=int(rng.integers(min(2, settings.most_power), settings.most_power + 1)),
        phase=float(rng.random()),
        direction=(x, y, z),
    )


def _second(settings: SecondSource, rng: np.random.Generator, *, marker: Absorber, limits: Interval) -> Absorber:
    for _ in range(_MAX_DRAWS):
        apart_deg = rng.uniform(settings.least_apart_deg, settings.most_apart_deg) * rng.choice((-1.0, 1.0))
        lateral_m = float(rng.uniform(-LATERAL_M, LATERAL_M))
        angle_deg = marker.angle_deg + float(apart_deg)
        if angle_deg in limits and abs(lateral_m - marker.lateral_m) >= settings.least_lateral_m:
            break
    else:
        raise ConfigError(
            f"scene.second: there is no place {settings.least_apart_deg:g} to {settings.most_apart_deg:g} deg from a "
            f"marker at {marker.angle_deg:.1f} deg in the range {limits}; widen the range"
        )
    loudness = float(rng.uniform(settings.least_relative, settings.most_relative))
    radius_m = float(rng.uniform(*MARKER_RADIUS_M))
    size_m = log_uniform(rng, *SOURCE_RADIUS_M)
    if settings.same_place:
        return structs.replace(marker, angle_deg=angle_deg, strength=loudness)
    return Absorber(
        radius_m=radius_m,
        angle_deg=angle_deg,
        lateral_m=lateral_m,
        strength=loudness,
        source=GaussianAbsorber(radius_m=size_m),
    )


def _clutter(settings: ClutterAround, rng: np.random.Generator) -> tuple[Absorber, ...]:
    """Return the clutter in the volume in which markers are drawn, and 25° beyond the range on either side."""
    nearest_m, farthest_m = MARKER_RADIUS_M
    around = Clutter(count=settings.count, strength=1.0, nearest_m=nearest_m, farthest_m=farthest_m).draw(rng)
    loudest_db = float(rng.uniform(settings.least_db, settings.most_db))
    scale = 10 ** (loudest_db / 20) / max(abs(each.strength) for each in around)
    return tuple(structs.replace(each, strength=each.strength * scale) for each in around)


def _repeats(settings: Repeats, rng: np.random.Generator) -> Reverberation:
    return Reverberation(
        delay_s=float(rng.uniform(settings.least_delay_s, settings.most_delay_s)),
        gain=float(rng.uniform(settings.least_gain, settings.most_gain) * rng.choice((-1.0, 1.0))),
        repeats=int(rng.integers(1, settings.most_repeats + 1)),
    )


def _require_span(
    settings: object, name: str, quantity: str, *, low: float, high: float, unit: str = "", open_low: bool = False
) -> None:
    """Refuse a range, from ``least_`` to ``most_``, that leaves its limits or descends."""
    least = getattr(settings, f"least_{quantity}")
    most = getattr(settings, f"most_{quantity}")
    require_range(f"{name}: least_{quantity}", least, low=low, high=high, unit=unit, open_low=open_low)
    require_range(f"{name}: most_{quantity}", most, low=least, high=high, unit=unit, cure="the range must not descend")
