"""Reads a bank from a file or folder of any format, by its suffix; and every frame of it once, to find damaged ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from markerseek.core import ConfigError, RecordError
from markerseek.files import as_read_error, quoted, require_input
from markerseek.records.banks.arrays import ArrayBank, bank_of_arrays
from markerseek.records.banks.bank import HDF5_SUFFIXES, FrameBank, IntensityBank, record_of
from markerseek.records.banks.frames import read_folder
from markerseek.records.banks.ipasc.reading import IpascBank, read_probed, walk_bank
from markerseek.records.banks.sequence import is_sequence, read_sequence
from markerseek.records.banks.table import DEFAULT_FORMAT, TableFormat, read_table
from markerseek.records.banks.zea import zea_arrays
from markerseek.records.child import try_files
from markerseek.records.hdf5 import require_h5py
from markerseek.records.journal import is_journal

# 4 TiB: frames are read one at a time, so that the size of the file is harmless.
_LARGEST_BYTES = 1 << 42


def read_bank(path: Path, table: TableFormat = DEFAULT_FORMAT, *, blanked: int = 0) -> IntensityBank | FrameBank:
    """Bank at a path, its frames left on disk.

    ``path``: an HDF5 file of IPASC or zea (``.hdf5``, ``.h5``); a sequence of PLUS (``.mha``,
    ``.nrrd``); a CSV of ``angle_deg,intensity``; or a folder that
    holds for each angle a sub-folder of SonixDAQ files or a file of channel data (``.npy``, ``.mat``), named by its
    angle in degrees (``-12.5``, ``angle_-12.5deg``). ``table``: of a CSV. ``blanked``: samples from the trigger on that
    are not imaged (`ProbePreset.pickup_samples`), and do not count for the scale of data that are no counts.
    """
    with as_read_error(path):
        journal = path.is_file() and is_journal(path)
        is_table = path.is_file() and not (journal or is_sequence(path) or path.suffix.lower() in HDF5_SUFFIXES)
        if table != DEFAULT_FORMAT and path.exists() and not is_table:
            raise ConfigError(
                f"{path}: it is no CSV, and columns, units and rows to be left out are of a CSV; leave them out"
            )
        if path.is_dir():
            return read_folder(path, blanked=blanked)
        if not path.exists():
            record = record_of(path)
            imported = f"markerseek bank import {quoted(record)} {quoted(path)}"
            kept = f"; its scan did not become a bank, and is kept: '{imported}'"
            raise RecordError(f"{path}: there is no such file or folder{kept if record.exists() else ''}")
        if journal:
            raise RecordError(
                f"{path}: it is the journal of a run and no bank; its run is computed again by "
                f"'markerseek journal replay {quoted(path)}', and its frames become a bank by "
                f"'markerseek bank import {quoted(path)} frames.hdf5'"
            )
        if is_sequence(path):
            return read_sequence(path)
        if path.suffix.lower() not in HDF5_SUFFIXES:
            return read_table(path, table)
    return read_hdf5(path, blanked=blanked)


def read_hdf5(path: Path, *, blanked: int = 0) -> IntensityBank | IpascBank | ArrayBank:
    """Bank in an HDF5 file of IPASC, its frames left on disk (`read_probed`), or of zea, in memory (`zea_arrays`)."""
    with as_read_error(path):
        require_input(path, most_bytes=_LARGEST_BYTES)
    require_h5py()
    with as_read_error(path):
        try_files(walk_hdf5, [path])
    arrays = zea_arrays(path)
    return bank_of_arrays(path, arrays, blanked=blanked) if arrays else read_probed(path, blanked=blanked)


def walk_hdf5(path: Path) -> None:
    """Read as much of an HDF5 file as a bank of it needs."""
    if not zea_arrays(path):
        walk_bank(path)


def frame_faults(bank: IntensityBank | FrameBank) -> Iterator[str | None]:
    """Fault of each frame, dark ones last; None for a frame without one.

    Opening a bank has already checked its numbers and read the first frame. Frames are compared with their checksums
    where the file has any (`has_checksums`).

    Yields the fault in words, for each frame that the bank should hold; nothing for a bank of intensities.
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
    """Whether the frames have checksums, which detect a change."""
    return isinstance(bank, IpascBank) and bank.checked


def require_whole(bank: IntensityBank | FrameBank) -> None:
    """Refuse a bank in IPASC HDF5 with a frame that cannot be read or has changed; other banks are read anyway."""
    if not isinstance(bank, IpascBank):
        return
    for fault in frame_faults(bank):
        if fault is not None:
            raise RecordError(fault)
