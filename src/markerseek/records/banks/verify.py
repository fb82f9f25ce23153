"""Reads every frame of a bank once, and reports those that cannot be read or have changed since they were written."""

from __future__ import annotations

from collections.abc import Iterator

from markerseek.core import RecordError
from markerseek.records.banks.bank import FrameBank, IntensityBank
from markerseek.records.banks.ipasc import IpascBank


def frame_faults(bank: IntensityBank | FrameBank) -> Iterator[str | None]:
    """Fault of each frame, dark ones last; None for a frame without one.

    Opening a bank has already checked its numbers and read the first frame. Frames are compared with their checksums
    where the file has any (`has_checksums`).

    Yields
    ------
    str or None
        The fault in words, for each frame that the bank should hold; nothing for a bank of intensities.
    """
    if isinstance(bank, IntensityBank):
        return
    readers = ((bank.frame, len(bank.angles_deg)), (bank.dark_frame, bank.dark_frames))
    for read, count in readers:
        for index in range(count):
            try:
                read(index)
            except RecordError as problem:
                yield str(problem)
            else:
                yield None


def has_checksums(bank: IntensityBank | FrameBank) -> bool:
    """Whether the frames have checksums, by which a change of one is detected."""
    return isinstance(bank, IpascBank) and bool(bank.frame_sums)


def require_whole(bank: IntensityBank | FrameBank) -> None:
    """Refuse a bank in IPASC HDF5 of which a frame cannot be read or has changed; other banks are read anyway.

    Raises
    ------
    RecordError
        For the first such frame.
    """
    if not isinstance(bank, IpascBank):
        return
    for fault in frame_faults(bank):
        if fault is not None:
            raise RecordError(fault)
