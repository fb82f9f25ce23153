"""The tip of an instrument as a `Reader` of B-mode frames, so that it can be searched like a marker."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import AcquisitionError, BModeFrame, Frame, Reading, require_range
from markerseek.vision.rectangle import Rectangle
from markerseek.vision.tooltip import brightest_blob, find_tip


@dataclass(frozen=True, slots=True, kw_only=True)
class TipSettings:
    """How the grey values of a machine are read."""

    dynamic_range_db: float = 60.0
    """From black to white."""
    white: float = 1000.0
    """Amplitude that is shown white, in any unit."""
    rectangle: tuple[int, int, int, int] | None = None
    """Row, column, rows and columns in which the tip is looked for; None: the whole image."""

    def __post_init__(self) -> None:
        require_range("tip: dynamic_range_db", self.dynamic_range_db, low=20, high=120, unit="dB")
        require_range("tip: white", self.white, low=1e-6, high=1e6)
        self.part()

    def part(self) -> Rectangle | None:
        """The rectangle, checked."""
        if self.rectangle is None:
            return None
        row, column, rows, columns = self.rectangle
        return Rectangle(row=row, column=column, rows=rows, columns=columns)


class TipReader:
    """Reads the echo of an instrument's tip from B-mode frames; nothing here is photoacoustic.

    Grey values are turned back into amplitudes, which a search compares as ratios. The noise stays unknown: what is
    seen without a tip is the brightest speckle, whose distribution is not that of noise in a photoacoustic image; the
    search methods then estimate the floor from the intensities themselves.
    """

    method = "B-mode echo of the tool tip (GrabCut), as amplitude"

    def __init__(self, settings: TipSettings | None = None) -> None:
        self.settings = settings or TipSettings()

    def read(self, frame: Frame) -> Reading:
        """Amplitude and place of the tip; where there is none, those of the brightest region.

        Raises `AcquisitionError` if the frame is no B-mode image.
        """
        if not isinstance(frame, BModeFrame):
            raise AcquisitionError(
                f"tip reader: a {type(frame).__name__} was handed over, and it reads B-mode frames only"
            )
        geometry = frame.geometry
        pixel_m = (geometry.depth_step_m, geometry.lateral_step_m)
        # No state from frame to frame: a replay must read each frame as the run did.
        rectangle, top = brightest_blob(frame.pixels, pixel_m=pixel_m, inside=self.settings.part())
        tip = find_tip(frame.pixels, rectangle, pixel_m=pixel_m)
        lateral_m, depth_m = geometry.position_m(row=tip.row, column=tip.column)
        return Reading(
            intensity=self._amplitude(tip.intensity if tip.visible else top),
            lateral_m=lateral_m,
            depth_m=depth_m,
        )

    def _amplitude(self, grey: float) -> float:
        return float(self.settings.white * 10 ** ((grey / 255 - 1) * self.settings.dynamic_range_db / 20))
