"""SPARE: photoacoustic images from the lines that an ultrasound machine has beamformed already (post-beamformed RF).

The machine delays its channels for pulse and echo, but a photoacoustic wave travels one way only: in the machine's data
a point at (xs, zs) is smeared over neighbouring lines. The wave and the machine's delays touch at one element of each
line, and the sum along these contacts focuses the point (H. K. Zhang et al., Biomed. Opt. Express 7, 3056 (2016)). With
dx = x − xs, c·t the path in the line at x, τ the laser's trigger offset, and a dynamic receive focus, the sum runs over
x at c·t = 2·c·τ + z' + dx²/z', z' = zs − c·τ.

The machine's aperture of zb/F at depth zb receives rays up to the angle a, tan a = 1/(2F), so that lines contribute as
far as |dx| = z'·tan(a/2).
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from markerseek.core import (
    AcquisitionError,
    Arrival,
    Bool,
    ChannelFrame,
    Float32,
    Float64,
    PaImage,
)
from markerseek.signals import features
from markerseek.signals._kernel import PAD
from markerseek.signals.beamform import (
    ImageGrid,
    beamform,
    delay_table,
    image_rows,
    path_delay,
)
from markerseek.signals.filtering import ENVELOPE_MARGIN, band_pass, envelope
from markerseek.signals.peaks import refine_peak
from markerseek.signals.presets import ProbePreset
from markerseek.signals.reader import FrameFindings

FULL_SCALE = 32767
"""Largest count of an RF line."""


class SpareReader:
    """Finds a source in the lines of one ultrasound machine, each of which takes the place of a channel.

    ``preset``: ``array`` is the row of the machine's lines, ``f_number`` is that of its receive aperture, which must
    focus dynamically.
    """

    method = "SPARE, from post-beamformed RF, dynamic receive focus"
    """The reconstruction in words, for results."""

    def __init__(self, preset: ProbePreset) -> None:
        self.preset = preset
        self._grids: dict[int, tuple[ImageGrid, slice]] = {}

    def picture(self, frame: ChannelFrame) -> PaImage:
        """Return the envelope image of the frame."""
        _, image, grid, rows = self._image(frame)
        return PaImage(envelope=image[rows], lateral_m=grid.lateral_m, depth_m=grid.depth_m[rows])

    def findings(self, frame: ChannelFrame) -> FrameFindings:
        """Return whether there is a source, and where; lines stand for channels, and the coherence is unknown.

        Raises `AcquisitionError` if the number of lines or the sampling frequency is not that of the machine, or if the
        frame is too short.
        """
        signals, image, grid, rows = self._image(frame)
        window = image[rows]
        profile = features.noise_profile(window)
        sigma = features.noise_floor(profile)
        row, column = (int(each) for each in np.unravel_index(int(np.argmax(window)), window.shape))
        # In some machines the gain, and so the noise, grows with depth: the floor at the peak's depth counts too.
        local = max(sigma, float(profile[min(row // features.BLOCK_ROWS, len(profile) - 1)]))
        lateral, depth, intensity = refine_peak(
            partial(self._image_at, signals), self.preset, grid, place=(row + rows.start, column)
        )
        # Neighbouring lines share channels: the number of pixels is above that of independent cells, which is unknown.
        cells = window.size
        level = features.found_level(cells)
        found = intensity > level * local
        ratio = intensity / local if local > 0 else math.inf
        reason = (
            f"the largest peak is {ratio:.3g} times the noise; the detection threshold is {level:.3g} times "
            f"({self.method})"
        )
        return FrameFindings(
            found=found,
            reason=reason if intensity > 0 else "the frame is zero",
            strongest=Arrival(
                lateral_m=lateral,
                depth_m=depth,
                arrival_s=depth / self.preset.sound_speed_m_s + self.preset.trigger_offset_s,
                intensity=intensity,
                coherence=None,
            ),
            others=(),
            noise_sigma=sigma,
            cells=cells,
            saturated_channels=self._saturated_lines(frame, lateral_m=lateral, depth_m=depth),
            dead_channels=features.dead_channels(signals, channels=self.preset.array.elements),
        )

    def _image(
        self, frame: ChannelFrame
    ) -> tuple[Float32[np.ndarray, "samples columns"], Float32[np.ndarray, "depth lateral"], ImageGrid, slice]:
        """Return the filtered lines, envelope, its grid, and the rows that count."""
        samples = self._admitted(frame).samples
        grid, rows = self._grid(samples.shape[1])
        signals = band_pass(samples, self.preset)
        return signals, envelope(beamform(signals, grid)), grid, rows

    def _admitted(self, frame: ChannelFrame) -> ChannelFrame:
        preset = self.preset
        lines, samples = frame.samples.shape
        if lines != preset.array.elements:
            raise AcquisitionError(
                f"SPARE: a frame of {lines} lines, {preset.array.elements} are expected; set the machine's lines"
            )
        if abs(frame.sampling_hz - preset.sampling_hz) > 1e-6 * preset.sampling_hz:
            raise AcquisitionError(
                f"SPARE: a frame sampled at {frame.sampling_hz:g} Hz, {preset.sampling_hz:g} Hz is expected; set the "
                "machine's sampling frequency"
            )
        least = preset.pickup_samples + 4 * ENVELOPE_MARGIN
        if samples < least:
            raise AcquisitionError(f"SPARE: a frame of {samples} samples, at least {least} are needed; record longer")
        return frame

    def _grid(self, samples: int) -> tuple[ImageGrid, slice]:
        if samples not in self._grids:
            preset = self.preset
            depth, rows = image_rows(preset, samples=samples)
            table = delay_table(
                preset.array,
                place=lambda offset_m: self._place(offset_m, depth),
                reach_m=self._half_aperture_m(depth),
                samples=samples,
            )
            grid = ImageGrid(lateral_m=preset.array.lateral_m, depth_m=depth, samples=samples, table=table)
            self._grids[samples] = (grid, rows)
        return self._grids[samples]

    def _place(
        self, offset_m: Float64[np.ndarray, " ..."], depth_m: Float64[np.ndarray, " ..."]
    ) -> Float64[np.ndarray, " ..."]:
        """Return the sample of the line at this distance that belongs to a source at this depth."""
        per_metre, origin = path_delay(self.preset)
        laser_m = self.preset.trigger_offset_s * self.preset.sound_speed_m_s
        beyond = np.maximum(depth_m - laser_m, 1e-9)
        return np.asarray((beyond + offset_m**2 / beyond) * per_metre + 2 * origin)

    def _half_aperture_m(self, depth_m: Float64[np.ndarray, " depth"]) -> Float64[np.ndarray, " depth"]:
        """Return the distance of the farthest line that contributes, at least half a line, in metres."""
        steepest = math.atan(1 / (2 * self.preset.f_number)) if self.preset.f_number > 0 else math.pi / 2
        laser_m = self.preset.trigger_offset_s * self.preset.sound_speed_m_s
        half = (depth_m - laser_m) * math.tan(steepest / 2)
        # Wider by 1e-9, so that rounding does not decide about a line on the edge.
        return np.maximum(half, 0.5 * self.preset.array.pitch_m) * (1 + 1e-9)

    def _image_at(
        self,
        signals: Float32[np.ndarray, "samples columns"],
        *,
        lateral_m: Float64[np.ndarray, " lateral"],
        depth_m: Float64[np.ndarray, " depth"],
    ) -> Float32[np.ndarray, "depth lateral"]:
        """Return the sum on any columns, for the surroundings of one peak: plain NumPy is fast enough."""
        half = self._half_aperture_m(depth_m)[:, None]
        total = np.zeros((len(depth_m), len(lateral_m)))
        used = np.zeros_like(total)
        sample = np.arange(signals.shape[0])
        for line, line_m in enumerate(self.preset.array.lateral_m.tolist()):
            offset = np.abs(lateral_m - line_m)
            if not np.any(offset <= half.max()):
                continue
            place = self._place(offset, depth_m[:, None])
            inside: Bool[np.ndarray, "depth lateral"] = (offset <= half) & (place >= 0) & (place < len(sample) - 1)
            total += np.where(inside, np.interp(place, sample, signals[:, PAD + line]), 0.0)
            used += inside
        return (total / np.sqrt(np.maximum(used, 1))).astype(np.float32)

    def _saturated_lines(self, frame: ChannelFrame, *, lateral_m: float, depth_m: float) -> tuple[int, ...]:
        """Return the lines that reach full scale at the arrival of a point's sound."""
        offset = np.abs(self.preset.array.lateral_m - lateral_m)
        middle = np.rint(self._place(offset, np.array(depth_m))).astype(np.int64)
        samples = self._admitted(frame).samples
        inside = (middle >= 0) & (middle < samples.shape[1])
        used = np.flatnonzero((offset <= self._half_aperture_m(np.array([depth_m]))) & inside)
        return features.at_full_scale(samples, self.preset, rows=used, middle=middle[used], full_scale=FULL_SCALE)
