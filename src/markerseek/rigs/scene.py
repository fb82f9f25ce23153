"""Draws the scene of a simulated rig (marker, light spot, clutter, noise) from settings.

`scene_of` is the only place where settings become absorbers and noise, for rigs of frames and of intensities, and for
studies. The curve of a scene is its intensity over the angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from msgspec import structs

from markerseek.acoustics import (
    LARGEST_COUNT,
    Absorber,
    AcousticModel,
    Band,
    GaussianAbsorber,
    Noise,
    RectanglePulse,
)
from markerseek.core import NO_HEADER, ChannelFrame, ConfigError, Float32, Float64, LinearArray, PaImage
from markerseek.signals import PRESET_NAMES, ImageReader, beamformed_sigma, probe_preset, strongest_peaks
from markerseek.sim import MarkerSettings, RecordedCurve, SimulatedSettings, StainedSpot, Tissue, World, tissue_named

_USUAL_COUNTS = 600.0
"""Largest count of the marker in a channel, where the receiver chooses its own gain and nothing speaks against it."""

_MIN_SIGMA = 2.0
"""Noise in counts to which that gain is raised where there is room: rounding (variance 1/12) then adds 1 % to it."""

_NOISE_SIGMAS = 6.0
_JITTER_SIGMAS = 5.0
"""Room for the noise's largest sample in some hundred thousand, and for the strongest flash, in standard deviations."""

MIN_NOISE_COUNTS = 0.25
"""Least noise of a channel in counts that survives rounding by the converter."""

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
        """Return the scene with a probe that receives it."""
        return World(
            model=self.model,
            absorbers=self.absorbers,
            noise=self.noise,
            energy_jitter=settings.laser.energy_jitter,
            start_deg=settings.start_deg,
            rng=rng,
            averaged=settings.laser.pulses,
            motion=settings.motion.drawn(rng),
            pulse_period_s=1 / settings.laser.rate_hz,
        )

    def hidden_noise(self, settings: SimulatedSettings, *, pulses: int) -> str | None:
        """Return why the steps of the converter hide the noise of a frame of so many pulses, and the cure, or None."""
        # That of the scene is of an average.
        sigma = math.hypot(self.noise.white_sigma, self.noise.coloured_sigma) * math.sqrt(
            settings.laser.pulses / pulses
        )
        if sigma >= MIN_NOISE_COUNTS:
            return None
        most_db = settings.noise.peak_snr_db + 20 * math.log10(sigma / MIN_NOISE_COUNTS)
        return (
            f"noise: peak_snr_db is {settings.noise.peak_snr_db:g} dB, which leaves {sigma:.2g} counts of noise in "
            f"a channel: below {MIN_NOISE_COUNTS} the steps of the converter hide it; lower peak_snr_db to at most "
            f"{math.floor(most_db)} dB" + ("" if settings.receiver.peak_counts is None else ", or raise peak_counts")
        )


def draw_scene(settings: SimulatedSettings, rng: np.random.Generator) -> Scene:
    """Draw a scene; values that the settings leave open are random."""
    material = tissue_named(settings.tissue)
    model = _acoustic_model(settings, material)
    marker = draw_marker(settings, rng)
    spot = _spot_of(settings.marker, material)
    scene = scene_of(structs.replace(material, spot=spot), marker, settings, model, rng)
    if not settings.second.present:
        return scene
    second = _draw_second(settings, marker, rng)
    other = _spot_of(settings.second, material).draw(second, rng)
    # As strong as the first: the same largest count with the probe on it.
    scale = scene.peak_counts / largest_count(other, model, second)
    others = tuple(structs.replace(each, strength=each.strength * scale) for each in other)
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
        absorbers += tuple(structs.replace(weak, strength=weak.strength * scale) for weak in material.clutter.draw(rng))
    return replace(scene, absorbers=absorbers)


def _scaled(
    spot: list[Absorber], marker: Absorber, description: str, settings: SimulatedSettings, model: AcousticModel
) -> Scene:
    """Return the scene of a spot alone in counts, with noise for the peak SNR of the settings.

    The peak SNR is that of the image: the noise-free envelope peak with the probe on the marker, over the standard
    deviation of the beamformed noise (`markerseek.signals.beamformed_sigma`).
    """
    largest = largest_count(spot, model, marker)
    peak_over_largest = image_peak(spot, model, angle_deg=marker.angle_deg) / largest
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    # Coloured noise has the spectrum of the receive band; 513 bins resolve it for the beamformer's gain.
    power = Band().gain(np.linspace(0, model.sampling_hz / 2, 513)) ** 2
    share = settings.noise.coloured
    white = np.sqrt(1 - share)
    coloured = np.sqrt(share)
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
        absorbers=tuple(structs.replace(each, strength=each.strength * (peak_counts / largest)) for each in spot),
        noise=Noise(white_sigma=sigma * white, coloured_sigma=sigma * coloured, bursts=settings.noise.bursts),
        peak=peak_counts * peak_over_largest,
        peak_counts=peak_counts,
    )


def _own_gain(settings: SimulatedSettings, sigma_over_largest: float) -> float:
    """Return the largest count of the marker for which marker and noise together stay below full scale.

    Usually `_USUAL_COUNTS`; less where the noise is strong, more where it would drown in the rounding.
    """
    averaged = math.sqrt(settings.laser.pulses)
    flash = 1 + _JITTER_SIGMAS * settings.laser.energy_jitter / averaged
    noise = _NOISE_SIGMAS * sigma_over_largest
    if settings.receiver.single_pulses:
        flash = 1 + _JITTER_SIGMAS * settings.laser.energy_jitter
        noise = noise * averaged
    # One count below full scale, at which the guard takes a channel for saturated.
    markers = 2 if settings.second.present else 1
    most = (LARGEST_COUNT - 1) / (markers * _OFF_PLANE * flash + noise)
    return min(max(_USUAL_COUNTS, _MIN_SIGMA / sigma_over_largest), most)


def _acoustic_model(settings: SimulatedSettings, material: Tissue) -> AcousticModel:
    """Return the acoustic model of the probe in the material."""
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
    """Return the marker of strength 1; its position is drawn where the settings leave it open."""
    search = settings.limits.search
    reach_m = _reach_m(settings)
    angle_deg = rng.uniform(search.low_deg, search.high_deg)
    lateral_m = rng.uniform(-reach_m, reach_m)
    return _placed(settings.marker, angle_deg=angle_deg, lateral_m=lateral_m)


def _draw_second(settings: SimulatedSettings, first: Absorber, rng: np.random.Generator) -> Absorber:
    """Return a second marker of strength 1, drawn after the first, which does not depend on it."""
    search = settings.limits.search
    angle_deg = rng.uniform(search.low_deg, search.high_deg)
    across_m = first.lateral_m - math.copysign(_reach_m(settings), first.lateral_m)
    return _placed(settings.second, angle_deg=angle_deg, lateral_m=across_m)


def _placed(marker: MarkerSettings, *, angle_deg: float, lateral_m: float) -> Absorber:
    """Return a marker of strength 1 where its settings put it, else there."""
    return Absorber(
        radius_m=marker.radius_m,
        angle_deg=angle_deg if marker.angle_deg is None else marker.angle_deg,
        lateral_m=lateral_m if marker.lateral_m is None else marker.lateral_m,
    )


def _reach_m(settings: SimulatedSettings) -> float:
    """Return the farthest lateral position at which a marker is drawn.

    Beyond the array's ends it gives hardly any signal.
    """
    return min(20e-3, 0.8 * float(settings.probe.array.lateral_m[-1]))


def _spot_of(marker: MarkerSettings, material: Tissue) -> StainedSpot:
    """Return the spot of the material, or a single absorber where the settings name its radius."""
    radius_m = marker.source_radius_m
    return material.spot if radius_m is None else StainedSpot(grain=GaussianAbsorber(radius_m=radius_m))


_OFF_PLANE_DEG = np.concatenate(
    [np.arange(0, 4, 0.2), np.arange(4, 12, 0.5), np.arange(12, 40, 1.0), np.arange(40, 80.1, 2.5)]
)
"""Angles off the marker at which a curve is computed, on one side: finer where it is steep."""

_PEAKS = 6
"""Number of separate peaks of an image that a curve stores."""

_APART_DEPTH_M = 0.3e-3
_APART_LATERAL_M = 0.5e-3
"""Peaks nearer than this, about a resolution cell, have the same noise and count as one."""


def scene_curve(scene: Scene) -> tuple[RecordedCurve, int]:
    """Return a scene's intensity over the angle off its marker, and the independent cells of its images.

    Relative to the marker's peak with the probe on it, computed by the acoustic model and the imaging chain
    without noise: one frame for each angle of a fixed grid. A single absorber without clutter gives the same curve on
    both sides, which is computed on one.
    """
    reader = image_reader(scene.model.probe.array, sampling_hz=scene.model.sampling_hz)
    marker = scene.marker
    gain_to_counts = MAX_COUNTS / scene.peak_counts
    absorbers = [structs.replace(absorber, strength=absorber.strength * gain_to_counts) for absorber in scene.absorbers]

    def frame_at(off_plane_deg: float) -> ChannelFrame:
        received = scene.model.channel_data(absorbers, angle_deg=marker.angle_deg + off_plane_deg)
        # Rounded like a real frame, at an amplitude at which rounding does not matter.
        counts = np.clip(np.rint(received), -32767, 32767).astype(np.int16)
        return ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=scene.model.sampling_hz)

    # One elevation for all sources makes the curve even in the angle, which halves the work.
    alike = all(absorber.angle_deg == marker.angle_deg for absorber in absorbers)
    off_deg = np.concatenate([-_OFF_PLANE_DEG[:0:-1], _OFF_PLANE_DEG])
    heights = _heights(reader, frame_at, _OFF_PLANE_DEG if alike else off_deg)
    if alike:
        heights = np.concatenate([heights[:0:-1], heights])
    cells = reader.read(frame_at(0.0)).cells or 1
    return RecordedCurve(off_deg, heights / (scene.peak * gain_to_counts)), cells


def _heights(
    reader: ImageReader, frame_at: Callable[[float], ChannelFrame], angles_deg: Float64[np.ndarray, " angles"]
) -> Float64[np.ndarray, "angles peaks"]:
    """Return the heights of the separate peaks at each angle, strongest first, that one as the reader refines it."""
    heights = np.zeros((len(angles_deg), _PEAKS))
    for row, angle_deg in enumerate(angles_deg.tolist()):
        frame = frame_at(angle_deg)
        peaks = _separate(reader.picture(frame))
        if peaks:
            # The reader interpolates its peak between columns; the others are scaled by the same factor.
            heights[row, : len(peaks)] = np.array(peaks) * (reader.read(frame).intensity / peaks[0])
    return heights


def _separate(picture: PaImage) -> list[float]:
    """Return the local maxima of an image at least a resolution cell apart, strongest first."""
    largest = float(picture.envelope.max())
    kept: list[tuple[float, float, float]] = []
    if largest > 0:
        # 64 candidates, because one resolution cell has several local maxima.
        for row, column in strongest_peaks(picture.envelope, level=largest / 10, limit=64):
            depth_m = float(picture.depth_m[row])
            lateral_m = float(picture.lateral_m[column])
            if all(
                abs(depth_m - depth) >= _APART_DEPTH_M or abs(lateral_m - lateral) >= _APART_LATERAL_M
                for depth, lateral, _ in kept
            ):
                kept.append((depth_m, lateral_m, float(picture.envelope[row, column])))
    return [height for _, _, height in kept[:_PEAKS]]


MAX_COUNTS = 25_000
"""Amplitude to which a noise-free frame is scaled, in counts, so that rounding to int16 has no effect on its image."""


@lru_cache(maxsize=8)
def image_reader(array: LinearArray, *, sampling_hz: float) -> ImageReader:
    """Return the imaging chain of a simulated probe; cached, because its tables are expensive to compute.

    Array and sampling are those of the rig, which a user knows; sound speed, band and aperture are those of the first
    preset even if the tissue differs, because a user would not know.
    """
    return ImageReader(structs.replace(probe_preset(PRESET_NAMES[0]), array=array, sampling_hz=sampling_hz))


def image_peak(absorbers: list[Absorber], model: AcousticModel, *, angle_deg: float) -> float:
    """Return the noise-free envelope peak of absorbers in the image at an angle, in the unit of channel data."""
    received = model.channel_data(absorbers, angle_deg=angle_deg)
    largest = _largest(received, absorbers[0], model)
    counts = np.rint(received * (MAX_COUNTS / largest)).astype(np.int16)
    frame = ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=model.sampling_hz)
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    return imaging.read(frame).intensity * largest / MAX_COUNTS


def largest_count(absorbers: list[Absorber], model: AcousticModel, marker: Absorber) -> float:
    """Return the largest channel amplitude of the absorbers with the probe on the marker."""
    return _largest(model.channel_data(absorbers, angle_deg=marker.angle_deg), marker, model)


def _largest(received: Float32[np.ndarray, "channels samples"], source: Absorber, model: AcousticModel) -> float:
    largest = float(np.abs(received).max())
    if not largest > 0:
        raise ConfigError(
            f"marker: at radius_m {source.radius_m:.4g} m and lateral_m {source.lateral_m:.4g} m its signal does not "
            f"arrive within {model.samples} samples; move it nearer or record for longer"
        )
    return largest
