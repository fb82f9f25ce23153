"""Draws the scene of a simulated rig (marker, light spot, clutter, noise) from settings.

`draw_scene` is the only place where settings become absorbers and noise, for rigs of frames and of intensities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, GaussianAbsorber, Noise, RectanglePulse
from markerseek.rigs.spot import largest_count, scaled_spot
from markerseek.sim import MarkerSettings, SimulatedSettings, Spot, Tissue, tissue_named


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Sound sources of a simulated world, and the model of their reception.

    Attributes
    ----------
    description
        Description of the material.
    model
        Acoustic model of probe and medium.
    marker, second
        Position of the marker, and of the second one; None where there is none.
    absorbers
        Absorbers with strengths in counts: the spots of the markers that there are, and clutter.
    noise
        Noise of one acquisition, in counts.
    peak
        Noise-free envelope peak with the probe on the marker, in counts; also if the marker is absent.
    peak_counts
        Largest count of the marker in one channel with the probe on it; also if the marker is absent.
    """

    description: str
    model: AcousticModel
    marker: Absorber
    absorbers: tuple[Absorber, ...]
    noise: Noise
    peak: float
    peak_counts: float
    second: Absorber | None = None


def draw_scene(settings: SimulatedSettings, rng: np.random.Generator) -> Scene:
    """Draw a scene; values that the settings leave open are random.

    Parameters
    ----------
    settings
        The simulated rig.
    rng
        Source of randomness.

    Raises
    ------
    ConfigError
        If no signal of the marker reaches the receiver.
    """
    material = tissue_named(settings.tissue)
    model = _acoustic_model(settings, material)
    marker = draw_marker(settings, rng)
    spot = _spot_of(settings.marker, material)
    scene = scene_of(replace(material, spot=spot), marker, settings, model, rng)
    if not settings.second.present:
        return scene
    second = _draw_second(settings, marker, rng)
    other = _spot_of(settings.second, material).draw(second, rng)
    # As strong as the first: the same largest count with the probe on it.
    scale = scene.peak_counts / largest_count(other, model, second)
    others = tuple(replace(each, strength=each.strength * scale) for each in other)
    return replace(scene, absorbers=scene.absorbers + others, second=second)


def scene_of(
    material: Tissue, marker: Absorber, settings: SimulatedSettings, model: AcousticModel, rng: np.random.Generator
) -> Scene:
    """Draw the spot and the clutter of a material about a marker.

    Parameters
    ----------
    material
        The material.
    marker
        Position of the marker.
    settings
        The simulated rig; receiver and noise are used, and whether there is a marker.
    model
        Acoustic model, with the reverberation of the material where there is one.
    rng
        Source of randomness.

    Raises
    ------
    ConfigError
        If no signal of the marker reaches the receiver.
    """
    spot = scaled_spot(material.spot.draw(marker, rng), marker, settings, model)
    absorbers = spot.absorbers if settings.marker.present else ()
    if material.clutter is not None:
        scale = spot.peak_counts / largest_count([marker], model, marker)
        absorbers += tuple(replace(weak, strength=weak.strength * scale) for weak in material.clutter.draw(rng))
    return Scene(
        description=material.description,
        model=model,
        marker=marker,
        absorbers=absorbers,
        noise=spot.noise,
        peak=spot.peak,
        peak_counts=spot.peak_counts,
    )


def _acoustic_model(settings: SimulatedSettings, material: Tissue) -> AcousticModel:
    """Acoustic model of the probe in the material."""
    return AcousticModel(
        probe=settings.probe,
        medium=material.medium,
        laser=RectanglePulse(duration_s=settings.laser.pulse_s),
        sampling_hz=settings.receiver.sampling_hz,
        samples=settings.receiver.samples,
        trigger_offset_s=settings.receiver.trigger_offset_s,
        reverberation=material.reverberation,
    )


def draw_marker(settings: SimulatedSettings, rng: np.random.Generator) -> Absorber:
    """Marker of strength 1; its position is drawn where the settings leave it open.

    Parameters
    ----------
    settings
        The simulated rig.
    rng
        Source of randomness.
    """
    search, reach_m = settings.limits.search, _reach_m(settings)
    angle_deg, lateral_m = rng.uniform(search.low_deg, search.high_deg), rng.uniform(-reach_m, reach_m)
    marker = settings.marker
    return Absorber(
        radius_m=marker.radius_m,
        angle_deg=angle_deg if marker.angle_deg is None else marker.angle_deg,
        lateral_m=lateral_m if marker.lateral_m is None else marker.lateral_m,
    )


def _draw_second(settings: SimulatedSettings, first: Absorber, rng: np.random.Generator) -> Absorber:
    """Second marker of strength 1, drawn after everything of the first, so that the first does not depend on it."""
    search, second = settings.limits.search, settings.second
    angle_deg = rng.uniform(search.low_deg, search.high_deg)
    across_m = first.lateral_m - math.copysign(_reach_m(settings), first.lateral_m)
    return Absorber(
        radius_m=second.radius_m,
        angle_deg=angle_deg if second.angle_deg is None else second.angle_deg,
        lateral_m=across_m if second.lateral_m is None else second.lateral_m,
    )


def _reach_m(settings: SimulatedSettings) -> float:
    """Farthest lateral position at which a marker is drawn; beyond the array's ends it gives hardly any signal."""
    return min(20e-3, 0.8 * float(settings.probe.array.lateral_m[-1]))


def _spot_of(marker: MarkerSettings, material: Tissue) -> Spot:
    """Spot of the material, or a single absorber where the settings name its radius."""
    radius_m = marker.source_radius_m
    return material.spot if radius_m is None else Spot(grain=GaussianAbsorber(radius_m=radius_m))
