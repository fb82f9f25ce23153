"""Result of the analysis of one frame: its arrivals, and whether there is a source.

`reader.ImageReader` and `spare.SpareReader` return it; `core.Reading` is the short form that a search uses.
"""

from __future__ import annotations

from dataclasses import dataclass


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
        Its envelope in ADC counts.
    peak_snr_db
        The intensity over the frame's noise floor in dB; None where there is no noise at all.
    coherence
        Share of the channels' energy that is in phase, 0 to 1; None where single channels are not known.
    """

    lateral_m: float
    depth_m: float
    arrival_s: float
    intensity: float
    peak_snr_db: float | None
    coherence: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFindings:
    """Sources in one frame.

    Attributes
    ----------
    found
        Whether any peak passes both tests.
    reason
        Why, or why not, in words.
    strongest
        The strongest arrival; if none was found, the largest peak of the image.
    others
        The other arrivals, strongest first.
    noise_sigma
        Standard deviation of the beamformed signal where there is no source, in ADC counts.
    cells
        Number of independent envelope cells.
    saturated_channels
        Channels that touch full scale while the strongest arrives.
    dead_channels
        Channels without any signal.
    """

    # Separate from `strongest`, which is there also if no peak passes: it says how far from a source the frame is.
    found: bool
    reason: str
    strongest: Arrival
    others: tuple[Arrival, ...]
    noise_sigma: float
    cells: int
    saturated_channels: tuple[int, ...]
    dead_channels: tuple[int, ...]
