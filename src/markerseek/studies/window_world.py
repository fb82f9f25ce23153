"""A world of readings: frames cut to where the marker can be heard, and the noise of the rest of the image drawn.

At each angle the channels are computed as for a whole frame, kept from shortly before the earliest to shortly after the
latest arrival that the marker can have, given noise, and read by the imaging chain itself, whose trigger is moved by
what was cut away. What the reader finds there is therefore real: intensity, place, arrival, coherence. Drawn are

- the largest peak that noise has in the rest of the image, from the law of `markerseek.sim.curve_world`; where it
  exceeds the window's, the reading is that of noise somewhere else. A dark frame is nothing but that;
- the noise floor that a whole frame would have told, which scatters by `FLOOR_SCATTER`.

Not here: the converter (rounding to 12 bits and full scale), clutter, reverberation and bursts. Studies test the
agreement with frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Noise
from markerseek.core import ChannelFrame, ConfigError, Frame, FrameHeader, Interval, Reading, ReadingFrame
from markerseek.signals import ImageReader, beamformed_sigma
from markerseek.sim import Flash
from markerseek.sim.curve_world import largest_noise
from markerseek.sim.world import flash_of
from markerseek.studies.unknowns import Unknowns

FLOOR_SCATTER = 0.01
"""Relative standard deviation of the noise floor that one frame tells."""

PEAK_COUNTS = 600.0
"""Largest count that the marker alone gives a channel with the probe on it: rounding does not count."""

_COHERENCE = 0.3
"""Coherence of a noise peak of height uσ heard by n elements, over u²/n: the median of 150 dark frames."""

_SPREAD_S, _WIDE_SPREAD_S, _WIDE = 0.083e-6, 0.7e-6, 0.15
"""Spread of the energy about a noise peak in seconds: usually, where a second peak is near, and how often that is."""

_BEFORE_S, _AFTER_S = 4e-6, 6e-6
"""Kept before the earliest and after the latest arrival at the middle of the aperture, in seconds: the edge waves of
an element, the pulse, what the reader gathers about a peak, and (after) the way to the aperture's edge."""

_MARGIN_SAMPLES = 80
"""Samples that the filter fades in or out at each end of the cut."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardFrame(ReadingFrame):
    """A frame of which only the reading was kept.

    Attributes
    ----------
    reading
        What it said.
    """

    reading: Reading


class HeardReader:
    """Hands out the readings of `HeardFrame`."""

    def read(self, frame: Frame) -> Reading:
        """Reading that the frame carries.

        Raises
        ------
        ConfigError
            If it carries none.
        """
        if not isinstance(frame, HeardFrame):
            raise ConfigError(f"a {type(frame).__name__} carries no reading")
        return frame.reading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """What of a rig and its marker is the same for every search; made once.

    Attributes
    ----------
    model
        How the marker is heard.
    marker
        The marker, scaled to `PEAK_COUNTS`.
    first, last
        Samples of the record that are kept: the first, and the one behind the last.
    reader
        Reads the cut frames.
    peak
        Intensity of the marker without noise, with the probe on it, in counts.
    cells
        Independent cells of a whole image.
    share
        Share of the image's depths that lies in the window.
    """

    model: AcousticModel
    marker: Absorber
    first: int
    last: int
    reader: ImageReader
    peak: float
    cells: int
    share: float


def window_of(unknowns: Unknowns, *, imaging: ImageReader, travel: Interval) -> Window:
    """Prepare a rig and its marker.

    Parameters
    ----------
    unknowns
        The rig and the marker.
    imaging
        Reads whole frames of this probe.
    travel
        Angles that the probe can have.

    Raises
    ------
    ConfigError
        If the marker is not heard with the probe on it.
    """
    model, marker, preset = unknowns.model, unknowns.marker, imaging.preset
    on_marker = model.channel_data([marker], angle_deg=marker.angle_deg)
    loudest = float(np.abs(on_marker).max())
    if not loudest > 0:
        raise ConfigError(f"marker: at radius_m {marker.radius_m} m it is not heard in {model.samples} samples")
    marker = replace(marker, strength=marker.strength * PEAK_COUNTS / loudest)
    frame = _frame(on_marker * (25_000 / loudest), preset.sampling_hz)
    reading = imaging.read(frame)
    farthest_deg = max(abs(travel.low_deg - marker.angle_deg), abs(travel.high_deg - marker.angle_deg))
    arrivals = [_arrival_s(unknowns, off_deg) for off_deg in (0.0, min(farthest_deg, 90.0))]
    rate = preset.sampling_hz
    metres = preset.sound_speed_m_s
    low_s, high_s = min(arrivals) - _BEFORE_S, max(arrivals) + _AFTER_S
    first = max(0, math.floor(low_s * rate) - _MARGIN_SAMPLES)
    last = min(model.samples, math.ceil(1.04 * high_s * rate) + _MARGIN_SAMPLES)
    cut = replace(preset, pickup_samples=0, trigger_offset_s=preset.trigger_offset_s - first / rate, full_scale=32767)
    whole_m = (model.samples - preset.pickup_samples) / rate * metres
    low_m = max(low_s * metres, preset.pickup_samples / rate * metres)
    high_m = min(high_s, (last - 1) / rate) * metres
    return Window(
        model=model,
        marker=marker,
        first=first,
        last=last,
        reader=ImageReader(cut, min_depth_m=low_m, max_depth_m=high_m),
        peak=reading.intensity * PEAK_COUNTS / 25_000,
        cells=reading.cells or 1,
        share=min(1.0, (high_m - low_m) / whole_m),
    )


def noise_free(window: Window, *, off_deg: float) -> float:
    """Intensity of the marker without noise, over that with the probe on it.

    Parameters
    ----------
    window
        The rig and the marker.
    off_deg
        Angle of the probe less that of the marker, in degrees.
    """
    heard = window.model.channel_data([window.marker], angle_deg=window.marker.angle_deg + off_deg)
    loud = 25_000 / PEAK_COUNTS
    reading = window.reader.read(_frame(heard[:, window.first : window.last] * loud, window.model.sampling_hz))
    return reading.intensity / (window.peak * loud)


class WindowWorld:
    """Tissue of which only the marker's window is heard.

    Parameters
    ----------
    window
        What was prepared.
    present
        Whether there is a marker.
    peak_snr_db
        Peak SNR of the physics notes, in dB.
    energy_jitter
        Standard deviation of a pulse's energy over its mean.
    start_deg
        Where the probe points at first, in degrees.
    rng
        Source of randomness.
    """

    def __init__(
        self,
        window: Window,
        *,
        present: bool,
        peak_snr_db: float,
        energy_jitter: float,
        start_deg: float,
        rng: np.random.Generator,
    ) -> None:
        self.angle_deg = start_deg
        self.flashes: list[Flash] = []
        self._window = window
        self._present = present
        self._energy_jitter = energy_jitter
        self._rng = rng
        self._sigma = window.peak / 10 ** (peak_snr_db / 20)
        gain = beamformed_sigma(1.0, preset=window.reader.preset)
        self._noise = Noise(white_sigma=self._sigma / gain)

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Let light fall on the tissue: the mean energy of so many pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._energy_jitter))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> HeardFrame:
        """Frame with the reading after a flash; after none, that of noise alone."""
        reading = self._heard(flash)
        return HeardFrame(
            header=header,
            intensity=reading.intensity,
            noise_sigma=reading.noise_sigma,
            cells=reading.cells,
            reading=reading,
        )

    def _heard(self, flash: Flash | None) -> Reading:
        window, rng = self._window, self._rng
        floor = self._sigma * (1 + FLOOR_SCATTER * rng.standard_normal())
        if flash is None or not self._present:
            reading = self._noise_peak(self._sigma * largest_noise(rng, cells=window.cells))
        else:
            reading = self._in_window(flash)
            cells = max(10, round((1 - window.share) * window.cells))
            elsewhere = self._noise_peak(self._sigma * largest_noise(rng, cells=cells))
            reading = max(reading, elsewhere, key=lambda each: each.intensity)
        return replace(reading, noise_sigma=floor, cells=window.cells)

    def _in_window(self, flash: Flash) -> Reading:
        """What the reader says of the cut frame, its moments counted from the trigger."""
        window, model = self._window, self._window.model
        elements, kept = model.probe.array.elements, window.last - window.first
        counts = self._noise.sample(self._rng, channels=elements, samples=kept, sampling_hz=model.sampling_hz)
        heard = model.channel_data([window.marker], angle_deg=self.angle_deg)
        counts += np.float32(flash.energy) * heard[:, window.first : window.last]
        reading = window.reader.read(_frame(counts, model.sampling_hz))
        cut_s = window.first / model.sampling_hz
        arrival_s, centroid_s = reading.arrival_s, reading.centroid_s
        return replace(
            reading,
            arrival_s=None if arrival_s is None else arrival_s + cut_s,
            centroid_s=None if centroid_s is None else centroid_s + cut_s,
        )

    def _noise_peak(self, intensity: float) -> Reading:
        """Reading of noise somewhere in the image."""
        preset, array, rng = self._window.reader.preset, self._window.model.probe.array, self._rng
        speed = preset.sound_speed_m_s
        reach_m = self._window.model.samples / preset.sampling_hz * speed
        depth_m = float(rng.uniform(5e-3, reach_m))
        lateral_m = float(rng.uniform(array.lateral_m[0], array.lateral_m[-1]))
        half_m = depth_m / (2 * preset.f_number)
        heard_by = int(np.sum(np.abs(array.lateral_m - lateral_m) <= half_m))
        coherence = _COHERENCE * (intensity / self._sigma) ** 2 / max(4, heard_by)
        wide = rng.random() < _WIDE
        return Reading(
            intensity=intensity,
            lateral_m=lateral_m,
            depth_m=depth_m,
            arrival_s=depth_m / speed,
            centroid_s=depth_m / speed,
            spread_s=float(rng.uniform(_SPREAD_S, _WIDE_SPREAD_S)) if wide else _SPREAD_S,
            coherence=min(1.0, coherence),
            saturated_fraction=0.0,
        )


def _frame(counts: np.ndarray, sampling_hz: float) -> ChannelFrame:
    held = np.clip(np.rint(counts), -32767, 32767).astype(np.int16)
    return ChannelFrame(header=_NO_HEADER, samples=held, sampling_hz=sampling_hz)


def _arrival_s(unknowns: Unknowns, off_deg: float) -> float:
    """When sound of the marker reaches the middle of the face, in seconds after the trigger."""
    model = unknowns.model
    elevation_m, axial_m = model.probe.in_probe_frame(radius_m=unknowns.marker.radius_m, off_plane_deg=off_deg)
    return math.hypot(elevation_m, axial_m) / model.medium.sound_speed_m_s + model.trigger_offset_s


_NO_HEADER = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
