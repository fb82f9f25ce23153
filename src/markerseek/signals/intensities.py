"""Reader of frames that are one number already."""

from __future__ import annotations

from markerseek.core import ConfigError, Frame, Reading, ReadingFrame


class IntensityReader:
    """Reader of frames that somebody else has reduced to one number."""

    def read(self, frame: Frame) -> Reading:
        """Reading with the intensity, and with the noise where the frame states it.

        Raises
        ------
        ConfigError
            If the frame holds channel data, which needs an imaging chain.
        """
        if not isinstance(frame, ReadingFrame):
            raise ConfigError("this reader takes intensities; channel data need a probe preset")
        return Reading(intensity=frame.intensity, noise_sigma=frame.noise_sigma, cells=frame.cells)
