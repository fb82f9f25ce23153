"""The imaging chain as a `Reader`: filter, beamform, envelope, features.

`ImageReader.read` returns the reading that a search needs; `ImageReader.findings` also decides whether there is a
source at all. Both list the coherent arrivals. Frames that hold an intensity instead of channel data have an
`IntensityReader`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from markerseek.core import (
    MAX_ARRIVALS,
    AcquisitionError,
    Arrival,
    ChannelFrame,
    ConfigError,
    Float32,
    Float64,
    Frame,
    PaImage,
    Reading,
    ReadingFrame,
)
from markerseek.signals import features
from markerseek.signals.beamform import ImageGrid, beamform, beamform_at, image_grid, image_rows
from markerseek.signals.filtering import TAPER_SAMPLES, band_pass, envelope
from markerseek.signals.focus import focused_coherence
from markerseek.signals.noise_gain import cell_pixels, envelope_cells
from markerseek.signals.peaks import BlockGrid, refine_peak, strongest_peaks
from markerseek.signals.presets import ProbePreset
from markerseek.signals.spot import spot_energy


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFindings:
    """Sources in one frame."""

    # Separate from `strongest`, which is there also if no peak passes: it says how far from a source the frame is.
    found: bool
    """Whether any peak passes both tests."""
    reason: str
    """Why, or why not, in words."""
    strongest: Arrival
    """The strongest arrival; if none was found, the largest peak of the image."""
    others: tuple[Arrival, ...]
    """The other arrivals, strongest first."""
    noise_sigma: float
    """Standard deviation of the beamformed signal where there is no source, in ADC counts."""
    cells: int
    """Number of independent envelope cells."""
    saturated_channels: tuple[int, ...]
    """Channels that touch full scale while the strongest arrives."""
    dead_channels: tuple[int, ...]
    """Channels without any signal."""

    def peak_snr_db(self, arrival: Arrival) -> float | None:
        """Return the intensity of an arrival over the noise floor of the frame in dB.

        None if there is no noise at all.
        """
        if not (arrival.intensity > 0 and self.noise_sigma > 0):
            return None
        return 20 * math.log10(arrival.intensity / self.noise_sigma)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Layout:
    """Grid for records of one length, its rows that count, cells in them, pixels of a cell, and their blocks."""

    grid: ImageGrid
    rows: slice
    cells: int
    cell_pixels: float
    blocks: BlockGrid


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Chain:
    """Intermediate results for one frame: filtered channels, image, noise."""

    frame: ChannelFrame
    signals: Float32[np.ndarray, "samples columns"]
    image: Float32[np.ndarray, "depth lateral"]
    envelope: Float32[np.ndarray, "depth lateral"]
    layout: _Layout
    sigma: float
    profile: Float64[np.ndarray, " blocks"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Peak:
    """A peak of the image: its arrival, the energy of its coherent sum, and of its channels the saturated and all."""

    arrival: Arrival
    energy: float
    saturated: tuple[int, ...]
    channels: int


class ImageReader:
    """Reads channel frames of one probe."""

    method = "one-way delay-and-sum of channel data"
    """The reconstruction in words, for results."""

    def __init__(self, preset: ProbePreset) -> None:
        self.preset = preset
        self._layouts: dict[int, _Layout] = {}
        self._last: _Chain | None = None

    def read(self, frame: Frame) -> Reading:
        """Return the features of the frame at the largest envelope in its image.

        Raises `AcquisitionError` if the frame is not one of this probe: number of channels, sampling frequency or
        length.
        """
        chain = self._chain(frame)
        largest = self._describe(chain, self._largest(chain))
        peak = largest.arrival
        middle, spread = features.energy_in_depth(
            chain.signals, self.preset, lateral_m=peak.lateral_m, depth_m=peak.depth_m, sigma=chain.sigma
        )
        speed = self.preset.sound_speed_m_s
        return Reading(
            intensity=peak.intensity,
            lateral_m=peak.lateral_m,
            depth_m=peak.depth_m,
            arrival_s=peak.arrival_s,
            centroid_s=middle / speed + self.preset.trigger_offset_s,
            spread_s=spread / speed,
            noise_sigma=chain.sigma,
            cells=chain.layout.cells,
            coherence=peak.coherence,
            focused_coherence=focused_coherence(
                chain.signals,
                self.preset,
                lateral_m=peak.lateral_m,
                depth_m=peak.depth_m,
                intensity=peak.intensity,
                sigma=chain.sigma,
            ),
            spot=spot_energy(
                chain.envelope[chain.layout.rows],
                at_lateral_m=chain.layout.grid.lateral_m,
                at_depth_m=chain.layout.grid.depth_m[chain.layout.rows],
                lateral_m=peak.lateral_m,
                depth_m=peak.depth_m,
                sigma=chain.sigma,
                cell_pixels=chain.layout.cell_pixels,
            ),
            saturated_fraction=len(largest.saturated) / max(1, largest.channels),
            dead_channels=features.dead_channels(chain.signals, channels=self.preset.array.elements),
            arrivals=tuple(each.arrival for each in self._peaks(chain)),
            local_maxima=chain.layout.blocks.maxima(chain.image, chain.envelope, rows=chain.layout.rows),
        )

    def picture(self, frame: Frame) -> PaImage:
        """Return the envelope image of the frame; that of the frame that was read last is there already."""
        chain = self._chain(frame)
        return PaImage(
            envelope=chain.envelope[chain.layout.rows],
            lateral_m=chain.layout.grid.lateral_m,
            depth_m=chain.layout.grid.depth_m[chain.layout.rows],
        )

    def findings(self, frame: Frame) -> FrameFindings:
        """Return whether there is a source, where, and which other arrivals there are: at most `MAX_ARRIVALS`."""
        chain = self._chain(frame)
        peaks = self._peaks(chain)
        strongest = peaks[0] if peaks else self._describe(chain, self._largest(chain))
        return FrameFindings(
            found=bool(peaks),
            reason=self._reason(chain, strongest.arrival, found=bool(peaks)),
            strongest=strongest.arrival,
            others=tuple(each.arrival for each in peaks[1:]),
            noise_sigma=chain.sigma,
            cells=chain.layout.cells,
            saturated_channels=strongest.saturated,
            dead_channels=features.dead_channels(chain.signals, channels=self.preset.array.elements),
        )

    def _chain(self, frame: Frame) -> _Chain:
        last = self._last
        # The very object, and not only the same samples: a receiver may use its memory again.
        if last is None or last.frame is not frame:
            last = self._new_chain(frame)
            self._last = last
        return last

    def _new_chain(self, frame: Frame) -> _Chain:
        if not isinstance(frame, ChannelFrame):
            raise AcquisitionError(
                f"image reader: a {type(frame).__name__} was handed over, and it reads channel data only"
            )
        self._admit(frame)
        layout = self._layout(frame.samples.shape[1])
        signals = band_pass(frame.samples, self.preset)
        image = beamform(signals, layout.grid)
        magnitude = envelope(image)
        profile = features.noise_profile(magnitude[layout.rows])
        return _Chain(
            frame=frame,
            signals=signals,
            image=image,
            envelope=magnitude,
            layout=layout,
            sigma=features.noise_floor(profile),
            profile=profile,
        )

    def _admit(self, frame: ChannelFrame) -> None:
        preset = self.preset
        channels, samples = frame.samples.shape
        if channels != preset.array.elements:
            raise AcquisitionError(
                f"frame of {channels} channels: probe {preset.name} has {preset.array.elements}; "
                "choose the probe that took the frame"
            )
        if abs(frame.sampling_hz - preset.sampling_hz) > 1e-6 * preset.sampling_hz:
            raise AcquisitionError(
                f"frame sampled at {frame.sampling_hz:g} Hz: probe {preset.name} is read at {preset.sampling_hz:g} Hz; "
                "choose the probe that took the frame"
            )
        least = preset.pickup_samples + 4 * TAPER_SAMPLES
        if samples < least:
            raise AcquisitionError(
                f"frame of {samples} samples: probe {preset.name} needs at least {least}, for the first "
                f"{preset.pickup_samples} are blanked (the laser's pick-up, or none recorded); record for longer"
            )

    def _layout(self, samples: int) -> _Layout:
        if samples not in self._layouts:
            preset = self.preset
            depth, rows = image_rows(preset, samples=samples)
            grid = image_grid(preset, samples=samples, depth_m=depth)
            inside = depth[rows]
            self._layouts[samples] = _Layout(
                grid=grid,
                rows=rows,
                cells=envelope_cells(preset, depth_m=inside),
                cell_pixels=cell_pixels(preset),
                blocks=BlockGrid(preset, lateral_m=grid.lateral_m, depth_m=inside),
            )
        return self._layouts[samples]

    def _largest(self, chain: _Chain) -> tuple[int, int]:
        window = chain.envelope[chain.layout.rows]
        row, column = np.unravel_index(int(np.argmax(window)), window.shape)
        return int(row) + chain.layout.rows.start, int(column)

    def _describe(self, chain: _Chain, place: tuple[int, int]) -> _Peak:
        """Return the peak at a pixel, refined between the columns."""
        lateral, depth, intensity = refine_peak(
            partial(beamform_at, chain.signals, self.preset), self.preset, chain.layout.grid, place=place
        )
        place_m = {"lateral_m": np.array([lateral]), "depth_m": np.array([depth])}
        (energy,), (used,) = features.coherent_energies(chain.signals, self.preset, **place_m)
        saturated, channels = features.saturated_channels(
            chain.frame.samples, self.preset, lateral_m=lateral, depth_m=depth
        )
        arrival = Arrival(
            lateral_m=lateral,
            depth_m=depth,
            arrival_s=depth / self.preset.sound_speed_m_s + self.preset.trigger_offset_s,
            intensity=intensity,
            coherence=min(1.0, float(energy) / max(1, int(used))),
        )
        return _Peak(arrival=arrival, energy=float(energy), saturated=saturated, channels=channels)

    def _peaks(self, chain: _Chain) -> list[_Peak]:
        """Return the peaks above the noise and coherent, strongest first, none on the flank of a stronger one."""
        preset = self.preset
        window = chain.envelope[chain.layout.rows]
        level = features.found_level(chain.layout.cells)
        coherent = features.COHERENT_LEVEL
        speed = preset.sound_speed_m_s
        centre = (preset.low_hz + preset.high_hz) / 2
        apart_depth = 4 * speed / (preset.high_hz - preset.low_hz)
        apart_lateral = 4 * speed / centre * max(1.0, preset.f_number)
        places = strongest_peaks(window, level=level * chain.sigma, limit=features.MAX_TESTED)
        grid = chain.layout.grid
        first = chain.layout.rows.start
        depths = np.array([grid.depth_m[row + first] for row, _ in places])
        laterals = np.array([grid.lateral_m[column] for _, column in places])
        # All at once: one after another, they take longer than beamforming does.
        energies, _ = features.coherent_energies(chain.signals, preset, lateral_m=laterals, depth_m=depths)
        peaks: list[_Peak] = []
        for (row, column), lateral, depth, energy in zip(places, laterals, depths, energies, strict=True):
            # In some receivers the gain, and so the noise, grows with depth: the floor at the peak's depth counts too.
            local = chain.profile[min(row // features.BLOCK_ROWS, len(chain.profile) - 1)]
            # Between two columns the coherence comes out too low, by half at most: below that it need not be refined.
            if window[row, column] <= level * local or energy <= coherent / 2:
                continue
            if any(
                abs(each.depth_m - depth) < apart_depth and abs(each.lateral_m - lateral) < apart_lateral
                for each in (peak.arrival for peak in peaks)
            ):
                continue
            peak = self._describe(chain, (row + first, column))
            if peak.energy <= coherent:
                continue
            peaks.append(peak)
            if len(peaks) == MAX_ARRIVALS:
                break
        return sorted(peaks, key=lambda each: -each.arrival.intensity)

    def _reason(self, chain: _Chain, peak: Arrival, *, found: bool) -> str:
        level = features.found_level(chain.layout.cells)
        ratio = peak.intensity / chain.sigma if chain.sigma > 0 else math.inf
        if found:
            return f"a coherent peak {ratio:.3g} times the noise; {level:.3g} times is the detection threshold"
        if peak.intensity == 0:
            return "the frame is zero"
        if ratio <= level:
            return f"the largest peak is {ratio:.3g} times the noise, and noise alone reaches {level:.3g} times"
        return (
            f"the largest peak is {ratio:.3g} times the noise, but its sound does not come from one point: "
            f"{100 * (peak.coherence or 0.0):.0f} % of it is in phase"
        )


class IntensityReader:
    """Reader of frames that were reduced to one number elsewhere, as in a CSV of intensities."""

    def read(self, frame: Frame) -> Reading:
        """Return the reading with the intensity, and with the noise where the frame states it."""
        if not isinstance(frame, ReadingFrame):
            raise ConfigError("this reader takes intensities; channel data need a probe preset")
        return Reading(intensity=frame.intensity, noise_sigma=frame.noise_sigma, cells=frame.cells)
