"""Frames: the data of one acquisition (channels, or one intensity), with a header."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from markerseek.core.errors import ConfigError
from markerseek.core.shapes import CHECKED, Int16

if TYPE_CHECKING or CHECKED:
    import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameHeader:
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
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelFrame:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingFrame:
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
