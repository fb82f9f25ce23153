"""Frames: the data of one acquisition (channels, beamformed lines, a B-mode image, or one intensity), with a header."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from markerseek.core.errors import ConfigError
from markerseek.core.image import ScanGeometry
from markerseek.core.shapes import CHECKED, Int16, UInt8

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
    """

    sequence: int
    token: str
    pulses: int
    commanded_deg: float
    started_s: float
    ended_s: float
    angle_before_deg: float | None = None
    angle_after_deg: float | None = None


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
        # At run time too: the samples come from drivers and files that other people write.
        _require_samples("channel frame", "channels", self.samples, self.sampling_hz)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RFFrame:
    """Lines that an ultrasound machine has beamformed for pulse-echo imaging, before the envelope (post-beamformed RF).

    Attributes
    ----------
    header
        See `FrameHeader`.
    samples
        Counts, shape (lines, samples); line 0 is at the first element. Sample 0 is the machine's time of transmission.
    sampling_hz
        Sampling frequency in Hz.
    """

    header: FrameHeader
    samples: Int16[np.ndarray, "lines samples"]
    sampling_hz: float

    def __post_init__(self) -> None:
        _require_samples("RF frame", "lines", self.samples, self.sampling_hz)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BModeFrame:
    """B-mode image, as a machine shows it: grey values of the compressed envelope.

    Attributes
    ----------
    header
        See `FrameHeader`; ``pulses`` counts the images that were averaged.
    pixels
        Grey values, shape (rows, columns); row 0 is the shallowest.
    geometry
        Where the pixels are.
    """

    header: FrameHeader
    pixels: UInt8[np.ndarray, "rows columns"]
    geometry: ScanGeometry

    def __post_init__(self) -> None:
        if self.pixels.ndim != 2 or self.pixels.dtype != "uint8":
            raise ConfigError(
                f"B-mode frame: pixels are {self.pixels.dtype} of shape {self.pixels.shape}, "
                "they must be uint8 of shape (rows, columns)"
            )


def _require_samples(name: str, rows: str, samples: np.ndarray, sampling_hz: float) -> None:
    if samples.ndim != 2 or samples.dtype != "int16":
        raise ConfigError(
            f"{name}: samples are {samples.dtype} of shape {samples.shape}, they must be int16 of shape "
            f"({rows}, samples)"
        )
    if not 0 < sampling_hz < math.inf:
        raise ConfigError(f"{name}: sampling_hz is {sampling_hz} Hz, it must be positive and finite")


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
        Noise of that image and the number of its independent cells, as in `Reading`, where they are known.
    """

    header: FrameHeader
    intensity: float
    noise_sigma: float | None = None
    cells: int | None = None


Frame: TypeAlias = ChannelFrame | RFFrame | BModeFrame | ReadingFrame
"""Any frame; each kind has a reader of its own."""
