"""What one acquisition gives: a frame, its features (`Reading`), and these at the angle of the probe (`Sample`)."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeAlias

import msgspec

from markerseek.core.checks import Within, is_finite, is_whole, require_fields, require_range
from markerseek.core.displacement import Displacement
from markerseek.core.errors import ConfigError, ReadingError
from markerseek.core.shapes import CHECKED, Int16
from markerseek.core.sweep import SweepTiming
from markerseek.core.values import EqualWithout, repr_without

if TYPE_CHECKING or CHECKED:
    import numpy as np
else:
    from markerseek.core.shapes import np


class FrameHeader(msgspec.Struct, frozen=True, kw_only=True):
    """Time, angle and permit of a frame.

    Attributes
    ----------
    sequence
        Number of the acquisition on this receiver, rising by one.
    token
        Name of the permit under which it was taken.
    pulses
        Laser pulses that were averaged; 0 is a dark frame.
    commanded_deg
        Angle that the stage was sent to, in degrees.
    started_s, ended_s
        First and last moment of the acquisition on the rig's clock, in seconds.
    angle_before_deg, angle_after_deg
        Readback of the stage just before and just after, in degrees; None until the scanner adds them.
    energy
        Measured energy of the pulses over the usual energy; None if the rig does not measure it.
    """

    sequence: int
    token: str
    pulses: int
    commanded_deg: float
    started_s: float
    ended_s: float
    angle_before_deg: float | None = None
    angle_after_deg: float | None = None
    energy: float | None = None


NO_HEADER = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
"""Header of a frame that does not come from a rig."""


# eq=False: comparing arrays gives an array, so that == of two frames would raise.
class ChannelFrame(msgspec.Struct, frozen=True, kw_only=True, eq=False, tag=True):
    """Channel data of one acquisition, before beamforming.

    Attributes
    ----------
    header
        See `FrameHeader`.
    samples
        ADC counts, shape (channels, samples); channel 0 is the first element along the array. Sample 0 is the trigger.
    sampling_hz
        Sampling frequency in Hz.
    """

    header: FrameHeader
    samples: Int16[np.ndarray, "channels samples"]
    sampling_hz: float

    def __post_init__(self) -> None:
        # Checked at run time too, because the samples come from drivers and files of other people.
        if self.samples.ndim != 2 or self.samples.dtype != "int16":
            raise ConfigError(
                f"channel frame: samples are {self.samples.dtype} of shape {self.samples.shape}, they must be int16 of "
                "shape (channels, samples)"
            )
        if not 0 < self.sampling_hz < math.inf:
            raise ConfigError(f"channel frame: sampling_hz is {self.sampling_hz} Hz, it must be positive and finite")


class ReadingFrame(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A frame that another program has already reduced to one intensity (a row of a CSV).

    Attributes
    ----------
    header
        See `FrameHeader`.
    intensity
        Peak of the photoacoustic image, in any unit that stays the same over a scan.
    noise_sigma, cells
        Noise of that image and the number of its independent cells, as in `Reading`; None if not known.
    """

    header: FrameHeader
    intensity: float
    noise_sigma: float | None = None
    cells: int | None = None


Frame: TypeAlias = ChannelFrame | ReadingFrame
"""Any frame; each kind has a reader of its own."""


MAX_BLOCKS = 1_000_000
"""Most blocks of an image; the simulated probe's has some 1,200."""

_BYTES = 4
"""Bytes of one intensity, float32."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A peak of the image that is above the noise and coherent.

    Attributes
    ----------
    lateral_m, depth_m
        Where it is, in metres.
    arrival_s
        When its sound reached the array after the laser's trigger, in seconds.
    intensity
        Its envelope, in the frame's unit.
    coherence
        Share of the channels' energy that is in phase, 0 to 1; None if single channels are not known.
    """

    lateral_m: float
    depth_m: float
    arrival_s: float
    intensity: float
    coherence: float | None

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            low, high = _POSSIBLE[name]
            if value is not None and not (is_finite(value) and low <= value <= high):
                raise ConfigError(f"arrival: {name} is {value}, it must lie between {low:g} and {high:g}")


class SpotEnergy(msgspec.Struct, frozen=True, kw_only=True):
    """Energy of the image about its largest peak, noise subtracted, and its centroid.

    The peak of a stained spot is speckle: which of its grains add up there changes with the angle. Their energy does
    not.

    Attributes
    ----------
    amplitude
        Root of the energy over that of one resolution cell, in the frame's unit: of a point about its intensity.
    relative_sigma
        Standard deviation that noise gives the amplitude, over the amplitude.
    lateral_m, depth_m
        Centroid of the energy, in metres.
    """

    amplitude: Annotated[float, Within(0.0, math.inf, open_low=True)]
    relative_sigma: Annotated[float, Within(0.0, math.inf, open_low=True)]
    lateral_m: Annotated[float, Within(-10.0, 10.0, "m")]
    depth_m: Annotated[float, Within(-10.0, 10.0, "m")]

    def __post_init__(self) -> None:
        require_fields(self, "spot energy")


class LocalMaxima(msgspec.Struct, frozen=True, kw_only=True):
    """Largest envelope in each block of an image, to look up later how strong the image was at a given place.

    The image is divided into equal blocks, about 2 mm wide and deep. Those at the far ends may hold less of the image.

    Attributes
    ----------
    first_lateral_m, first_depth_m
        Centre of the first block, in metres.
    lateral_step_m, depth_step_m
        Width and depth of a block, in metres.
    columns
        Number of blocks side by side along the array.
    noise_peaks
        ρ of one block: noise of the standard deviation σ (one quadrature) has ρ·(u² − 1)·exp(−u²/2) peaks above u·σ
        in it on average.
    intensities
        Largest envelope of each block in the frame's unit, as little-endian float32: the blocks of the least depth
        first, in each depth those of the least lateral position first.
    """

    first_lateral_m: Annotated[float, Within(-10.0, 10.0, "m")]
    first_depth_m: Annotated[float, Within(-10.0, 10.0, "m")]
    lateral_step_m: Annotated[float, Within(1e-6, 1.0, "m")]
    depth_step_m: Annotated[float, Within(1e-6, 1.0, "m")]
    columns: int
    noise_peaks: Annotated[float, Within(0.0, 1e9, open_low=True)]
    intensities: bytes

    def __post_init__(self) -> None:
        require_fields(self, "local maxima")
        count, left = divmod(len(self.intensities), _BYTES)
        if left or not is_whole(self.columns) or not 1 <= self.columns <= count <= MAX_BLOCKS or count % self.columns:
            raise ConfigError(
                f"local maxima: {len(self.intensities)} bytes of intensities and {self.columns} columns; "
                f"{_BYTES} bytes for each block of whole rows are needed, and at most {MAX_BLOCKS:,} blocks"
            )
        values = self._row(0, count)
        # One sum instead of a test of each: NaN and infinity stay in it.
        if not (math.isfinite(sum(values)) and min(values) >= 0):
            raise ConfigError("local maxima: an intensity is negative or not finite; give those of an envelope")

    @property
    def rows(self) -> int:
        """Number of blocks in depth."""
        return len(self.intensities) // (_BYTES * self.columns)

    def near(
        self, *, lateral_m: float, low_depth_m: float, high_depth_m: float, within_m: float = 0.5e-3
    ) -> tuple[float, int] | None:
        """Return the largest envelope near a place, and among how many independent cells of noise it is the largest.

        Noise alone stays below u·σ there with a probability of (1 − exp(−u²/2))^cells, for u about 2 or more.

        Parameters
        ----------
        lateral_m
            Lateral position of the place in metres.
        low_depth_m, high_depth_m
            Depths between which it is, in metres.
        within_m
            How far from the lateral position the peak may be, in metres.

        Returns
        -------
        Intensity and cells of all blocks that the window touches; None if it touches none.

        Raises
        ------
        ConfigError
            If the window is none: the depths descend, or a number is not finite.
        """
        for name, value in (("lateral_m", lateral_m), ("low_depth_m", low_depth_m)):
            require_range(f"local maxima: {name}", value, low=-10.0, high=10.0, unit="m")
        require_range("local maxima: high_depth_m", high_depth_m, low=low_depth_m, high=10.0, unit="m")
        require_range("local maxima: within_m", within_m, low=0.0, high=1.0, unit="m")
        columns = _touched(
            lateral_m - within_m,
            lateral_m + within_m,
            first_m=self.first_lateral_m,
            step_m=self.lateral_step_m,
            count=self.columns,
        )
        rows = _touched(
            low_depth_m, high_depth_m, first_m=self.first_depth_m, step_m=self.depth_step_m, count=self.rows
        )
        if not columns or not rows:
            return None
        largest = max(max(self._row(row * self.columns + columns.start, len(columns))) for row in rows)
        return largest, self.cells_of(len(rows) * len(columns))

    def cells_of(self, blocks: int) -> int:
        """Return the M for which noise stays below u·σ in this many blocks with a probability of (1 − exp(−u²/2))^M."""
        # M = ρ(u² − 1) is not the same for all u: it is exact where the probability is one half, M·exp(−u²/2) = ln 2,
        # so that u² = 2·ln(M/ln 2): the fixed point, by iteration.
        square = 9.0
        for _ in range(8):
            square = 2 * math.log(max(blocks * self.noise_peaks * (square - 1), 2.0) / math.log(2))
        return max(1, round(blocks * self.noise_peaks * (square - 1)))

    def _row(self, start: int, count: int) -> tuple[float, ...]:
        return struct.unpack_from(f"<{count}f", self.intensities, _BYTES * start)


def _touched(low_m: float, high_m: float, *, first_m: float, step_m: float, count: int) -> range:
    """Return the numbers of the blocks that an interval touches."""
    low, high = (math.floor((each - first_m) / step_m + 0.5) for each in (low_m, high_m))
    return range(max(low, 0), min(high, count - 1) + 1)


MAX_ACQUISITIONS = 500
"""Most acquisitions of one search, without dark frames."""

MAX_ARRIVALS = 8
"""Most arrivals that a reading lists."""

MIN_INTENSITY = 1e-60
MAX_INTENSITY = 1e60
"""Intensities outside are refused as damaged: squares and ratios of those inside neither vanish nor overflow."""


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """The features of one frame; all but the intensity may be unknown (None).

    Attributes
    ----------
    intensity
        Largest envelope in the image, in the unit of the frame (ADC counts for channel data).
    lateral_m, depth_m
        Where that is: along the array from its centre, and from the array's face, in metres.
    arrival_s
        When that sound reached the array after the laser's trigger, in seconds.
    centroid_s
        When the energy about that peak reached the array on the average, in seconds after the trigger.
    spread_s
        Standard deviation of that energy in time, in seconds.
    noise_sigma
        Standard deviation of the beamformed signal where there is no source (one quadrature), in the intensity's unit.
    cells
        Number of independent envelope cells over which the maximum was taken.
    coherence
        Share of the channels' energy at the peak that is in phase, 0 to 1.
    focused_coherence
        Share of all energy about the peak that is in phase at its best focus, 0 to 1: near 1 for a point.
    spot
        Energy about that peak, and its centroid; None if noise decides it.
    saturated_fraction
        Share of the channels that touch full scale in the marker's window, 0 to 1.
    dead_channels
        Numbers of channels without any signal, counted from 0.
    arrivals
        The coherent arrivals above the noise, strongest first, `MAX_ARRIVALS` at most.
    local_maxima
        Largest envelope in each block of the image.

    Raises
    ------
    ReadingError
        If the intensity is not a finite number of at least 0, or another feature is neither None nor a number that it
        can be.
    """

    intensity: float
    lateral_m: float | None = None
    depth_m: float | None = None
    arrival_s: float | None = None
    centroid_s: float | None = None
    spread_s: float | None = None
    noise_sigma: float | None = None
    cells: int | None = None
    coherence: float | None = None
    focused_coherence: float | None = None
    spot: SpotEnergy | None = None
    saturated_fraction: float | None = None
    dead_channels: tuple[int, ...] = ()
    arrivals: tuple[Arrival, ...] = ()
    local_maxima: LocalMaxima | None = None

    def __post_init__(self) -> None:
        # The guard checks this again, because a reader from elsewhere may return a class of its own.
        if not (is_finite(self.intensity) and self.intensity >= 0):
            raise ReadingError(
                f"intensity is {self.intensity!r}, it must be a finite number of at least 0; take the frame again"
            )
        for name in _OPTIONAL:
            value = getattr(self, name)
            if value is not None and not is_finite(value):
                raise ReadingError(f"{name} is {value!r}, it must be a finite number, or None if not known")
            # Wide: what lies outside was damaged, or is in another unit, and its square or exponential may overflow.
            low, high = _POSSIBLE[name]
            if value is not None and not low <= value <= high:
                raise ReadingError(f"{name} is {value!r}, it must lie between {low:g} and {high:g}")

    def __repr__(self) -> str:
        # A thousand numbers would hide the others.
        return repr_without(self, "local_maxima")


_POSSIBLE: dict[str, tuple[float, float]] = {
    "intensity": (0.0, MAX_INTENSITY),
    "lateral_m": (-10.0, 10.0),
    "depth_m": (-10.0, 10.0),
    "arrival_s": (-1.0, 1.0),
    "centroid_s": (-1.0, 1.0),
    "spread_s": (0.0, 1.0),
    "noise_sigma": (0.0, MAX_INTENSITY),
    "cells": (0, 1e12),
    # Shares, with room for rounding.
    **dict.fromkeys(("coherence", "focused_coherence", "saturated_fraction"), (-1e-6, 1 + 1e-6)),
}
"""Limits of the features of a frame, and of its arrivals."""

_OPTIONAL = tuple(
    name
    for name in Reading.__struct_fields__
    if name not in ("intensity", "spot", "dead_channels", "arrivals", "local_maxima")
)
"""Features that are a number, or None if unknown."""


def not_finite(reading: Reading) -> str | None:
    """Return the name of the first feature that is neither None nor a finite number; None if there is none.

    For a reading of a class that does not check itself.
    """
    for name in _OPTIONAL:
        value = getattr(reading, name)
        if value is not None and not is_finite(value):
            return name
    return None


class Sample(EqualWithout, frozen=True, kw_only=True):
    """One acquisition as a policy receives it.

    Attributes
    ----------
    angle_deg
        Angle that the stage reached, in degrees: not the one it was sent to. In a sweep, that at the pulse.
    reading
        Features of the frame.
    dark
        Whether the laser was off: such a sample gives the detection threshold only.
    angle_sigma_deg
        Standard deviation of the error of this angle, independent from sample to sample, in degrees.
    sweep
        What it shares with the other samples of its sweep; None if the probe was at rest.
    displacement
        Displacement of the tissue meanwhile, as cameras saw it; None: not known. Angle and reading are those of the
        displaced marker.
    frame
        What the receiver sent, with its header; None for samples that no rig took.

    Raises
    ------
    ConfigError
        If ``angle_sigma_deg`` is negative or no number.
    """

    # Channel data are large, and samples of a replay must equal those of the run.
    left_out: ClassVar[str] = "frame"
    angle_deg: float
    reading: Reading
    dark: bool = False
    angle_sigma_deg: Annotated[float, Within(0, 10, "deg")] = 0.0
    sweep: SweepTiming | None = None
    displacement: Displacement | None = None
    frame: Frame | None = None

    def __post_init__(self) -> None:
        require_fields(self, "sample")

    def __repr__(self) -> str:
        return repr_without(self, self.left_out)
