"""What a frame says besides its largest peak: coherent arrivals, the energy of a spot, the largest of each block."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, fields

from markerseek.core.checks import is_finite, is_whole, require_range
from markerseek.core.errors import ConfigError

MAX_BLOCKS = 1_000_000
"""Most blocks of an image; the simulated probe's has some 1,200."""

_BYTES = 4
"""Bytes of one intensity, float32."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
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
        for each in fields(self):
            value = getattr(self, each.name)
            if value is not None and not is_finite(value):
                raise ConfigError(f"arrival: {each.name} is {value}, it must be finite")


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotEnergy:
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

    amplitude: float
    relative_sigma: float
    lateral_m: float
    depth_m: float

    def __post_init__(self) -> None:
        for name in ("amplitude", "relative_sigma"):
            require_range(f"spot energy: {name}", getattr(self, name), low=0.0, high=math.inf, open_low=True)
        for name in ("lateral_m", "depth_m"):
            require_range(f"spot energy: {name}", getattr(self, name), low=-10.0, high=10.0, unit="m")


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalMaxima:
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

    first_lateral_m: float
    first_depth_m: float
    lateral_step_m: float
    depth_step_m: float
    columns: int
    noise_peaks: float
    intensities: bytes

    def __post_init__(self) -> None:
        for name in ("first_lateral_m", "first_depth_m"):
            require_range(f"local maxima: {name}", getattr(self, name), low=-10.0, high=10.0, unit="m")
        for name in ("lateral_step_m", "depth_step_m"):
            require_range(f"local maxima: {name}", getattr(self, name), low=1e-6, high=1.0, unit="m")
        require_range("local maxima: noise_peaks", self.noise_peaks, low=0.0, high=1e9, open_low=True)
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
        """Largest envelope near a place, and among how many independent cells of noise it is the largest.

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
        """M for which noise stays below u·σ in this many blocks with a probability of (1 − exp(−u²/2))^M."""
        # M = ρ(u² − 1) is not the same for all u: it is exact where the probability is one half, M·exp(−u²/2) = ln 2,
        # so that u² = 2·ln(M/ln 2): the fixed point, by iteration.
        square = 9.0
        for _ in range(8):
            square = 2 * math.log(max(blocks * self.noise_peaks * (square - 1), 2.0) / math.log(2))
        return max(1, round(blocks * self.noise_peaks * (square - 1)))

    def _row(self, start: int, count: int) -> tuple[float, ...]:
        return struct.unpack_from(f"<{count}f", self.intensities, _BYTES * start)


def _touched(low_m: float, high_m: float, *, first_m: float, step_m: float, count: int) -> range:
    """Numbers of the blocks that an interval touches."""
    low, high = (math.floor((each - first_m) / step_m + 0.5) for each in (low_m, high_m))
    return range(max(low, 0), min(high, count - 1) + 1)
