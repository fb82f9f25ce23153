"""A simulated world that computes only the time window in which the marker's signal can arrive, and draws the rest.

At each angle the channels are computed as for a whole frame, cut to the window (`Window`, made once for a drawn rig and
marker, and shared by all searches of a trial), given noise, and read by the imaging chain itself with its trigger moved
accordingly. Intensity, place, arrival and coherence in the window, the arrivals, and the local maxima are therefore
those of the imaging chain. Drawn are

- the largest peak of the noise in the rest of the image, from the law of `markerseek.sim.curve_world`; if it exceeds
  the window's, it is the reading. A dark frame consists of it only;
- the local maxima of the rest of the image, from the law of `markerseek.core.LocalMaxima`;
- the noise floor that a whole frame would give, with the scatter `FLOOR_SCATTER`.

Not modelled: the converter (rounding to 12 bits and full scale), coloured noise, clutter, reverberation and bursts. The
coherence at the best focus takes the noise of the channels from the window, where the marker is: that of a point is
nearer to 1 (0.999 in the mean at 40 dB) than from whole frames (0.997). Tests compare it with frames, which take about
twice as long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Noise
from markerseek.core import (
    NO_HEADER,
    Arrival,
    ChannelFrame,
    ConfigError,
    Float32,
    Frame,
    FrameHeader,
    Interval,
    LocalMaxima,
    Reading,
    ReadingFrame,
)
from markerseek.rigs import image_reader
from markerseek.scan import divided_reading
from markerseek.signals import FALSE_PER_FRAME, MIN_CHANNELS, ImageReader, beamformed_sigma, found_level
from markerseek.sim import Flash, SimulatedSettings, flash_of, largest_noise, noise_gain
from markerseek.studies.unknowns import Unknowns

PEAK_COUNTS = 20_000.0
"""Largest count that the marker alone gives a channel with the probe on it, of the 32,767 that a frame holds."""

_BEFORE_S, _AFTER_S = 4e-6, 6e-6
"""Kept before the earliest and after the latest arrival at the middle of the aperture, in seconds: the edge waves of
an element, the pulse, what the reader gathers about a peak, and (after) the way to the aperture's edge."""

_MARGIN_SAMPLES = 80
"""Samples that the filter fades in or out at each end of the cut."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """What of a rig and its marker is the same for every search; made once."""

    model: AcousticModel
    """The acoustic model of the rig."""
    marker: Absorber
    """The marker, scaled to `PEAK_COUNTS`."""
    first: int
    last: int
    """``first`` and ``last``: samples of the record that are kept: the first, and the one behind the last."""
    reader: ImageReader
    peak: float
    """Intensity of the marker without noise, with the probe on it, in counts."""
    cells: int
    """Independent cells of a whole image."""
    share: float
    """Share of the image's depths that is in the window."""
    blocks: LocalMaxima
    """Local maxima of a whole image without noise, whose blocks those of the window are a part of."""


# The policies of a trial follow one another in one process: few windows are in use at a time.
@lru_cache(maxsize=4)
def window_of(unknowns: Unknowns, travel: Interval) -> Window:
    """Prepare a rig and its marker, which is the same for all policies of a trial.

    ``travel``: angles that the probe can have.
    """
    model, marker = unknowns.model, unknowns.marker
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    preset = imaging.preset
    on_marker = model.channel_data([marker], angle_deg=marker.angle_deg)
    strongest = float(np.abs(on_marker).max())
    if not strongest > 0:
        raise ConfigError(
            f"marker: at radius_m {marker.radius_m} m its signal arrives after the {model.samples} samples of a frame"
        )
    marker = replace(marker, strength=marker.strength * PEAK_COUNTS / strongest)
    frame = frame_of(on_marker * (PEAK_COUNTS / strongest), sampling_hz=preset.sampling_hz)
    reading = imaging.read(frame)
    blocks = reading.local_maxima
    if blocks is None:
        raise ConfigError("the imaging chain gives no local maxima of its image")
    farthest_deg = max(abs(travel.low_deg - marker.angle_deg), abs(travel.high_deg - marker.angle_deg))
    # The path grows with the angle off the marker: the first arrival is at 0, the last at the farthest angle.
    # Beyond 90° the marker is behind the face and gives no signal.
    arrivals = [_arrival_s(unknowns, off_deg) for off_deg in (0.0, min(farthest_deg, 90.0))]
    rate = preset.sampling_hz
    metres = preset.sound_speed_m_s
    low_s, high_s = min(arrivals) - _BEFORE_S, max(arrivals) + _AFTER_S
    # The window begins with a block of the whole image, so that its blocks are some of the image's.
    nearest_m = blocks.first_depth_m - (blocks.depth_step_m - preset.depth_step_m) / 2
    low_m = nearest_m + max(0, math.floor((low_s * metres - nearest_m) / blocks.depth_step_m)) * blocks.depth_step_m
    first = max(0, math.floor(low_m / metres * rate) - _MARGIN_SAMPLES)
    last = min(model.samples, math.ceil(1.04 * high_s * rate) + _MARGIN_SAMPLES)
    # The reader's least depth excludes the laser's pick-up, and the counts of a cut use all 16 bits.
    cut = replace(preset, pickup_samples=0, trigger_offset_s=preset.trigger_offset_s - first / rate, full_scale=32767)
    whole_m = (model.samples - preset.pickup_samples) / rate * metres
    high_m = min(high_s, (last - 1) / rate) * metres
    return Window(
        model=model,
        marker=marker,
        first=first,
        last=last,
        reader=ImageReader(cut, min_depth_m=low_m, max_depth_m=high_m),
        peak=reading.intensity,
        cells=reading.cells or 1,
        share=min(1.0, (high_m - low_m) / whole_m),
        blocks=blocks,
    )


def noise_free(window: Window, *, off_deg: float) -> float:
    """Intensity of the marker without noise, over that with the probe on it.

    ``off_deg``: angle of the probe less that of the marker.
    """
    channels = window.model.channel_data([window.marker], angle_deg=window.marker.angle_deg + off_deg)
    reading = window.reader.read(
        frame_of(channels[:, window.first : window.last], sampling_hz=window.model.sampling_hz)
    )
    return reading.intensity / window.peak


def frame_of(counts: Float32[np.ndarray, "channels samples"], *, sampling_hz: float) -> ChannelFrame:
    """Frame of these counts, rounded, and held where 16 bits end."""
    # Clipped like a converter: an overflow of int16 would change the sign.
    held = np.clip(np.rint(counts), -32767, 32767).astype(np.int16)
    return ChannelFrame(header=NO_HEADER, samples=held, sampling_hz=sampling_hz)


def _arrival_s(unknowns: Unknowns, off_deg: float) -> float:
    """When sound of the marker reaches the middle of the face, in seconds after the trigger."""
    model = unknowns.model
    elevation_m, axial_m = model.probe.in_probe_frame(radius_m=unknowns.marker.radius_m, off_plane_deg=off_deg)
    return math.hypot(elevation_m, axial_m) / model.medium.sound_speed_m_s + model.trigger_offset_s


FLOOR_SCATTER = 0.01
"""Relative standard deviation of the noise floor of one frame."""

NOISE_COUNTS = 20.0
"""Noise of a channel in counts, less where the marker would not fit into 16 bits: rounding does not count."""

_COHERENCE = 0.3
"""Coherence of a noise peak of height uσ in n elements, over u²/n: the median of 150 dark frames."""

_BLOCK_CELLS = 0.7
"""Cells of a block over those that its law names: the law holds for the highest peaks and overstates the others. With
it, the upper half is right to 0.1 σ, and the lowest tenth 0.3 σ too high."""

_SPREAD_S, _WIDE_SPREAD_S, _WIDE = 0.083e-6, 0.7e-6, 0.15
"""Spread of the energy about a noise peak in seconds: usually, where a second peak is near, and how often that is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _PrecomputedFrame(ReadingFrame):
    """A frame that holds its reading instead of channel data."""

    reading: Reading


class PrecomputedReader:
    """Returns the readings of `_PrecomputedFrame`."""

    def read(self, frame: Frame) -> Reading:
        """Reading of the frame."""
        if not isinstance(frame, _PrecomputedFrame):
            raise ConfigError(f"a {type(frame).__name__} holds no reading")
        return frame.reading


class WindowWorld:
    """Tissue computed in the marker's window only.

    ``settings``: noise, laser, start, and whether there is a marker; the rest is in the window.
    """

    def __init__(self, window: Window, settings: SimulatedSettings, *, rng: np.random.Generator) -> None:
        self.angle_deg = settings.start_deg
        self.flashes: list[Flash] = []
        self._window = window
        self._present = settings.marker.present
        self._energy_jitter = settings.laser.energy_jitter
        self._rng = rng
        sigma = window.peak / 10 ** (settings.noise.peak_snr_db / 20)
        # Peak SNR is defined in the image; the noise is added to the channels.
        white_sigma = sigma / beamformed_sigma(1.0, preset=window.reader.preset)
        # Noise and marker alike, so that the SNR stays: strong noise would not fit into 16 bits.
        gain = min(1.0, NOISE_COUNTS / white_sigma)
        self._sigma = gain * sigma
        self._noise = Noise(white_sigma=gain * white_sigma)
        self._marker = replace(window.marker, strength=gain * window.marker.strength)
        self._averaged = settings.laser.pulses

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue with the mean energy of this number of pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._energy_jitter))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> _PrecomputedFrame:
        """Frame with the reading after a flash; after none, that of noise alone."""
        noise = 1.0 if flash is None else noise_gain(self._averaged, flash)
        # The noise of fewer pulses is computed as a weaker signal, for strong noise would not fit into 16 bits.
        weaker = flash if flash is None or noise == 1 else replace(flash, energy=flash.energy / noise)
        reading = self._reading(weaker)
        if noise != 1:
            reading = divided_reading(reading, 1 / noise)
        return _PrecomputedFrame(
            header=header,
            intensity=reading.intensity,
            noise_sigma=reading.noise_sigma,
            cells=reading.cells,
            reading=reading,
        )

    def _reading(self, flash: Flash | None) -> Reading:
        window, rng = self._window, self._rng
        floor = self._sigma * (1 + FLOOR_SCATTER * rng.standard_normal())
        if flash is None or not self._present:
            peak = self._noise_peak(self._sigma * largest_noise(rng, cells=window.cells))
            maxima = self._blocks(self._block_noise(peak))
            return replace(peak, noise_sigma=floor, cells=window.cells, local_maxima=maxima)
        inside = self._in_window(flash)
        # The cells of the window are in its own reading; `largest_noise` needs at least 10.
        cells = max(10, round((1 - window.share) * window.cells))
        elsewhere = self._noise_peak(self._sigma * largest_noise(rng, cells=cells))
        heights = self._block_noise(elsewhere)
        if inside.local_maxima is not None:
            self._copy(inside.local_maxima, into=heights)
        # The reading is the largest peak of the image: that of the window, or of the independent rest.
        reading = max(inside, elsewhere, key=lambda each: each.intensity)
        return replace(
            reading,
            noise_sigma=floor,
            cells=window.cells,
            arrivals=inside.arrivals,
            local_maxima=self._blocks(heights),
        )

    def _in_window(self, flash: Flash) -> Reading:
        """Reading of the cut frame, with its times from the trigger."""
        window, model = self._window, self._window.model
        elements, kept = model.probe.array.elements, window.last - window.first
        counts = self._noise.sample(self._rng, channels=elements, samples=kept, sampling_hz=model.sampling_hz)
        signal = model.channel_data([self._marker], angle_deg=self.angle_deg)
        counts += np.float32(flash.energy) * signal[:, window.first : window.last]
        reading = window.reader.read(frame_of(counts, sampling_hz=model.sampling_hz))
        # The reader counts time from the first sample of the cut.
        cut_s = window.first / model.sampling_hz
        arrival_s, centroid_s = reading.arrival_s, reading.centroid_s
        return replace(
            reading,
            arrival_s=None if arrival_s is None else arrival_s + cut_s,
            centroid_s=None if centroid_s is None else centroid_s + cut_s,
            arrivals=tuple(
                replace(each, arrival_s=each.arrival_s + cut_s) for each in reading.arrivals if self._stands_out(each)
            ),
        )

    def _stands_out(self, arrival: Arrival) -> bool:
        """Whether an arrival would be one in a whole frame too, which has more noise to stand out from."""
        return arrival.intensity > self._sigma * found_level(self._window.cells, false_found=FALSE_PER_FRAME)

    def _block_noise(self, peak: Reading) -> Float32[np.ndarray, "deep wide"]:
        """Largest noise of each block of a whole image whose largest noise is this peak."""
        blocks = self._window.blocks
        cells = _BLOCK_CELLS * blocks.cells_of(1)
        # The law of a block, on the condition that its noise is below the peak.
        below = (1 - np.exp(-((peak.intensity / self._sigma) ** 2) / 2)) ** cells
        share = self._rng.uniform(size=(blocks.rows, blocks.columns)) * below
        highest = self._sigma * np.sqrt(-2 * np.log1p(-(share ** (1 / cells))))
        heights: Float32[np.ndarray, "deep wide"] = highest.astype(np.float32)
        row = round(((peak.depth_m or 0.0) - blocks.first_depth_m) / blocks.depth_step_m)
        column = round(((peak.lateral_m or 0.0) - blocks.first_lateral_m) / blocks.lateral_step_m)
        heights[min(max(row, 0), blocks.rows - 1), min(max(column, 0), blocks.columns - 1)] = peak.intensity
        return heights

    def _copy(self, part: LocalMaxima, *, into: Float32[np.ndarray, "deep wide"]) -> None:
        """Copy the blocks of the window into those of the whole image."""
        blocks = self._window.blocks
        first = round((part.first_depth_m - blocks.first_depth_m) / blocks.depth_step_m)
        rows = into[first : first + part.rows]
        rows[:] = np.frombuffer(part.intensities, "<f4").reshape(part.rows, part.columns)[: len(rows)]

    def _blocks(self, heights: Float32[np.ndarray, "deep wide"]) -> LocalMaxima:
        return replace(self._window.blocks, intensities=heights.astype("<f4").tobytes())

    def _noise_peak(self, intensity: float) -> Reading:
        """Reading of noise somewhere in the image."""
        preset, array, rng = self._window.reader.preset, self._window.model.probe.array, self._rng
        speed = preset.sound_speed_m_s
        reach_m = self._window.model.samples / preset.sampling_hz * speed
        depth_m = float(rng.uniform(5e-3, reach_m))
        lateral_m = float(rng.uniform(array.lateral_m[0], array.lateral_m[-1]))
        half_m = depth_m / (2 * preset.f_number)
        elements = int(np.sum(np.abs(array.lateral_m - lateral_m) <= half_m))
        coherence = _COHERENCE * (intensity / self._sigma) ** 2 / max(MIN_CHANNELS, elements)
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
