"""Draws the scene of a simulated rig (marker, light spot, clutter, noise) from settings.

`draw_scene` is the only place where settings become absorbers and noise, for rigs of frames and of intensities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from markerseek.acoustics import (
    LARGEST_COUNT,
    Absorber,
    AcousticModel,
    Band,
    GaussianAbsorber,
    Noise,
    RectanglePulse,
)
from markerseek.rigs.spot import image_peak, image_reader, largest_count
from markerseek.signals import beamformed_sigma
from markerseek.sim import MarkerSettings, SimulatedSettings, Spot, Tissue, World, tissue_named

_USUAL_COUNTS = 600.0
"""Largest count of the marker in a channel, where the receiver chooses its own gain and nothing speaks against it."""

_MIN_SIGMA = 2.0
"""Noise in counts to which that gain is raised where there is room: rounding (variance 1/12) then adds 1 % to it."""

_NOISE_SIGMAS, _JITTER_SIGMAS = 6.0, 5.0
"""Room for the noise's largest sample in some hundred thousand, and for the strongest flash, in standard deviations."""

_OFF_PLANE = 1.5
"""Room for a marker near the array, which is up to 1.34 times as strong in a channel off its plane as in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Sound sources of a simulated world, and the model of their reception."""

    description: str
    model: AcousticModel
    """Acoustic model of probe and medium."""
    marker: Absorber
    absorbers: tuple[Absorber, ...]
    """Absorbers with strengths in counts: the spots of the markers that there are, and clutter."""
    noise: Noise
    """Noise of one acquisition, in counts."""
    peak: float
    """Noise-free envelope peak with the probe on the marker, in counts; also if the marker is absent."""
    peak_counts: float
    """Largest count of the marker in one channel with the probe on it; also if the marker is absent."""
    second: Absorber | None = None
    """``marker`` and ``second``: position of the marker, and of the second one."""

    def world(self, settings: SimulatedSettings, rng: np.random.Generator) -> World:
        """The scene with a probe that receives it."""
        return World(
            model=self.model,
            absorbers=self.absorbers,
            noise=self.noise,
            energy_jitter=settings.laser.energy_jitter,
            start_deg=settings.start_deg,
            rng=rng,
            averaged=settings.laser.pulses,
        )


def draw_scene(settings: SimulatedSettings, rng: np.random.Generator) -> Scene:
    """Draw a scene; values that the settings leave open are random."""
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

    ``settings``: the simulated rig; receiver and noise are used, and whether there is a marker. ``model``: acoustic
    model, with the reverberation of the material where there is one.
    """
    scene = _scaled(material.spot.draw(marker, rng), marker, material.description, settings, model)
    absorbers = scene.absorbers if settings.marker.present else ()
    if material.clutter is not None:
        scale = scene.peak_counts / largest_count([marker], model, marker)
        absorbers += tuple(replace(weak, strength=weak.strength * scale) for weak in material.clutter.draw(rng))
    return replace(scene, absorbers=absorbers)


def _scaled(
    spot: list[Absorber], marker: Absorber, description: str, settings: SimulatedSettings, model: AcousticModel
) -> Scene:
    """Scene of a spot alone in counts, with noise for the peak SNR of the settings.

    The peak SNR is that of the image: the noise-free envelope peak with the probe on the marker, over the standard
    deviation of the beamformed noise (`markerseek.signals.beamformed_sigma`).
    """
    largest = largest_count(spot, model, marker)
    peak_over_largest = image_peak(spot, model, angle_deg=marker.angle_deg) / largest
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    # Coloured noise has the spectrum of the receive band; 513 bins resolve it for the beamformer's gain.
    power = Band().gain(np.linspace(0, model.sampling_hz / 2, 513)) ** 2
    share = settings.noise.coloured
    white, coloured = np.sqrt(1 - share), np.sqrt(share)
    gain = math.hypot(
        beamformed_sigma(white, preset=imaging.preset),
        beamformed_sigma(coloured, preset=imaging.preset, power=power),
    )
    # SNR in dB of amplitudes: 20 log10(peak / sigma); sigma after beamforming is gain times that of a channel.
    sigma_over_largest = peak_over_largest / 10 ** (settings.noise.peak_snr_db / 20) / gain
    peak_counts = settings.receiver.peak_counts
    if peak_counts is None:
        peak_counts = _own_gain(settings, sigma_over_largest)
    sigma = peak_counts * sigma_over_largest
    return Scene(
        description=description,
        model=model,
        marker=marker,
        absorbers=tuple(replace(each, strength=each.strength * (peak_counts / largest)) for each in spot),
        noise=Noise(white_sigma=sigma * white, coloured_sigma=sigma * coloured, bursts=settings.noise.bursts),
        peak=peak_counts * peak_over_largest,
        peak_counts=peak_counts,
    )


def _own_gain(settings: SimulatedSettings, sigma_over_largest: float) -> float:
    """Largest count of the marker for which marker and noise together stay below full scale.

    Usually `_USUAL_COUNTS`; less where the noise is strong, more where it would drown in the rounding.
    """
    averaged = math.sqrt(settings.laser.pulses)
    flash = 1 + _JITTER_SIGMAS * settings.laser.energy_jitter / averaged
    noise = _NOISE_SIGMAS * sigma_over_largest
    if settings.receiver.single_pulses:
        flash, noise = 1 + _JITTER_SIGMAS * settings.laser.energy_jitter, noise * averaged
    # One count below full scale, at which the guard takes a channel for saturated.
    markers = 2 if settings.second.present else 1
    most = (LARGEST_COUNT - 1) / (markers * _OFF_PLANE * flash + noise)
    return min(max(_USUAL_COUNTS, _MIN_SIGMA / sigma_over_largest), most)


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
    """Marker of strength 1; its position is drawn where the settings leave it open."""
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
