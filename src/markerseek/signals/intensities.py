"""Reader of frames that hold an intensity instead of channel data."""

from __future__ import annotations

from markerseek.core import ConfigError, Frame, Reading, ReadingFrame


class IntensityReader:
    """Reader of frames that were reduced to one number elsewhere, as in a CSV of intensities."""

    def read(self, frame: Frame) -> Reading:
        """Reading with the intensity, and with the noise where the frame states it."""
        if not isinstance(frame, ReadingFrame):
            raise ConfigError("this reader takes intensities; channel data need a probe preset")
        return Reading(intensity=frame.intensity, noise_sigma=frame.noise_sigma, cells=frame.cells)
