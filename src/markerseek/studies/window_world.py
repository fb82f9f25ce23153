"""A world of readings: frames cut to where the marker can be heard, and the noise of the rest of the image drawn.

At each angle the channels are computed as for a whole frame, kept from shortly before the earliest to shortly after the
latest arrival that the marker can have, given noise, and read by the imaging chain itself, whose trigger is moved by
what was cut away. What the reader finds there is therefore real: intensity, place, arrival, coherence. Drawn are

- the largest peak that noise has in the rest of the image, from the law of `markerseek.sim.curve_world`; where it
  exceeds the window's, the reading is that of noise somewhere else. A dark frame is nothing but that;
- the noise floor that a whole frame would have told, which scatters by `FLOOR_SCATTER`.

Not here: the converter (rounding to 12 bits and full scale), coloured noise, clutter, reverberation and bursts. Tests
hold it against frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from markerseek.acoustics import Noise
from markerseek.core import ConfigError, Frame, FrameHeader, Reading, ReadingFrame
from markerseek.signals import beamformed_sigma
from markerseek.signals.features import LEAST_CHANNELS
from markerseek.sim import Flash
from markerseek.sim.curve_world import largest_noise
from markerseek.sim.world import flash_of
from markerseek.studies.window import Window, frame_of

FLOOR_SCATTER = 0.01
"""Relative standard deviation of the noise floor that one frame tells."""

NOISE_COUNTS = 20.0
"""Noise of a channel in counts, less where the marker would not fit into 16 bits: rounding does not count."""

_COHERENCE = 0.3
"""Coherence of a noise peak of height uσ heard by n elements, over u²/n: the median of 150 dark frames."""

_SPREAD_S, _WIDE_SPREAD_S, _WIDE = 0.083e-6, 0.7e-6, 0.15
"""Spread of the energy about a noise peak in seconds: usually, where a second peak is near, and how often that is."""


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
        sigma = window.peak / 10 ** (peak_snr_db / 20)
        white_sigma = sigma / beamformed_sigma(1.0, preset=window.reader.preset)
        gain = min(1.0, NOISE_COUNTS / white_sigma)
        self._sigma = gain * sigma
        self._noise = Noise(white_sigma=gain * white_sigma)
        self._marker = replace(window.marker, strength=gain * window.marker.strength)

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
        heard = model.channel_data([self._marker], angle_deg=self.angle_deg)
        counts += np.float32(flash.energy) * heard[:, window.first : window.last]
        reading = window.reader.read(frame_of(counts, sampling_hz=model.sampling_hz))
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
        coherence = _COHERENCE * (intensity / self._sigma) ** 2 / max(LEAST_CHANNELS, heard_by)
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
