"""Features of a frame (`Reading`), and these at the angle of the probe (`Sample`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from markerseek.core.arrival import Arrival, LocalMaxima, SpotEnergy
from markerseek.core.checks import is_finite, require_range
from markerseek.core.errors import ReadingError
from markerseek.core.frame import Frame
from markerseek.core.sweep import SweepTiming

MAX_ACQUISITIONS = 500
"""Most acquisitions of one search, without dark frames."""

MAX_ARRIVALS = 8
"""Most arrivals that a reading lists."""

MIN_INTENSITY, MAX_INTENSITY = 1e-60, 1e60
"""Intensities outside are refused as damaged: squares and ratios of those inside neither vanish nor overflow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
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
        If the intensity is not a finite number of at least 0, or another feature is neither None nor finite.
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
    # Left out of repr: a thousand numbers would hide the others.
    local_maxima: LocalMaxima | None = field(default=None, repr=False)

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


_OPTIONAL = tuple(
    name for name in Reading.__slots__ if name not in ("intensity", "spot", "dead_channels", "arrivals", "local_maxima")
)
"""Features that may be unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
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
    frame
        What the receiver sent, with its header; None for samples that no rig took.

    Raises
    ------
    ConfigError
        If ``angle_sigma_deg`` is negative or no number.
    """

    angle_deg: float
    reading: Reading
    dark: bool = False
    angle_sigma_deg: float = 0.0
    sweep: SweepTiming | None = None
    # Left out of repr and ==: channel data are large, and samples of a replay must equal those of the run.
    frame: Frame | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_range("sample: angle_sigma_deg", self.angle_sigma_deg, low=0, high=10, unit="deg")
