"""A folder as a bank: for each angle a sub-folder of SonixDAQ files, or one file of channel data."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from markerseek.core import ChannelFrame, RecordError
from markerseek.records.bank_arrays import USUAL_SAMPLING_HZ
from markerseek.records.banks import FrameBank, require_angles
from markerseek.records.frame_files import load_frame

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?", re.ASCII)
_FRAME_FILES = (".mat", ".npy")


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderBank(FrameBank):
    """One acquisition for each angle, in a folder or file of its own.

    Attributes
    ----------
    places
        Where each is, in the order of the angles.
    """

    places: tuple[Path, ...] = field(repr=False)

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, from the disk.

        Raises
        ------
        RecordError
            If they cannot be read.
        """
        sampling_hz = self.facts.sampling_hz or USUAL_SAMPLING_HZ
        return load_frame(self.places[index], sampling_hz=sampling_hz, angle_deg=self.angles_deg[index])

    def dark_frame(self, index: int) -> ChannelFrame:
        """Such a folder holds no frames without laser."""
        raise RecordError(f"{self.places[0].parent}: there is no dark frame {index + 1}, it holds none")


def read_folder(path: Path) -> FolderBank:
    """Bank in a folder; the name of each sub-folder or file of channel data holds its angle as its only number.

    Raises
    ------
    RecordError
        If a name holds no angle, or one that was given before.
    """
    by_angle: dict[float, Path] = {}
    for place in sorted(path.iterdir()):
        if place.name.startswith(".") or not (place.is_dir() or place.suffix.lower() in _FRAME_FILES):
            continue
        numbers = _NUMBER.findall(place.name if place.is_dir() else place.stem)
        if len(numbers) != 1:
            raise RecordError(
                f"{place}: the name must hold the angle in degrees as its only number, as in 'angle_-12.5deg'; "
                f"it holds {len(numbers)}"
            )
        angle = float(numbers[0])
        if angle in by_angle:
            raise RecordError(f"{place}: the angle {angle:g} deg was given before, by {by_angle[angle].name}")
        by_angle[angle] = place
    if not by_angle:
        raise RecordError(
            f"{path}: there is no scan in this folder; it must hold one folder or file of channel data for each angle, "
            "with the angle in its name, as in 'angle_-12.5deg'"
        )
    require_angles(path, len(by_angle))
    angles = sorted(by_angle)
    return FolderBank(angles_deg=tuple(angles), places=tuple(by_angle[angle] for angle in angles))
