"""A bank or a finished journal as acquisitions in the order of time, to be played to other programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from markerseek.core import ConfigError, Frame
from markerseek.records.banks import FrameBank, IntensityBank, read_bank
from markerseek.records.exports import Series, series_of
from markerseek.records.journal import is_journal, read_journal, run_state
from markerseek.rigs import preset_of
from markerseek.runs import bank_curve, described, journal_bank
from markerseek.signals import ImageReader


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayedSample:
    """One recorded acquisition.

    Attributes
    ----------
    after_s
        Time since the first, in seconds.
    angle_deg, intensity
        Where it was taken, in degrees, and its intensity.
    frame
        Its frame; None where the recording holds intensities only.
    """

    after_s: float
    angle_deg: float
    intensity: float
    frame: Frame | None


class RecordedSeries:
    """A recording, open to be played.

    Parameters
    ----------
    path
        A bank, or the journal of a run that is over.

    Raises
    ------
    RecordError
        If it cannot be read.
    ConfigError
        If it is the journal of a run that is not over.
    """

    def __init__(self, path: Path) -> None:
        if path.is_file() and is_journal(path):
            state = run_state(read_journal(path, frames=False).entries).state
            if state != "finished":
                raise ConfigError(f"{path}: its run is not over (it is {state}); resume it, or play another recording")
            self._bank: IntensityBank | FrameBank = journal_bank(path)
        else:
            self._bank = read_bank(path)
        intensities = tuple(bank_curve(self._bank).intensity.tolist())
        self.series: Series = series_of(self._bank, facts=described(self._bank), intensities=intensities)
        self.imaging = ImageReader(preset_of(self._bank, None)) if isinstance(self._bank, FrameBank) else None

    def samples(self) -> Iterator[PlayedSample]:
        """Its acquisitions in the order of time, one frame at a time."""
        series = self.series
        for index, angle_deg, time_s, intensity in zip(
            series.order, series.angles_deg, series.times_s, series.intensities, strict=True
        ):
            frame = self._bank.frame(index) if isinstance(self._bank, FrameBank) else None
            after_s = time_s - series.times_s[0]
            yield PlayedSample(after_s=after_s, angle_deg=angle_deg, intensity=intensity, frame=frame)
