"""Reads a bank from a file or folder of any format: the first of `FORMATS` that recognises it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from msgspec import structs

from markerseek.core import ConfigError, RecordError
from markerseek.files import as_read_error, quoted, require_input
from markerseek.records.banks.arrays import bank_of_arrays, read_arrays
from markerseek.records.banks.bank import HDF5_SUFFIXES, FrameBank, IntensityBank, record_of, without_channels
from markerseek.records.banks.frames import read_folder
from markerseek.records.banks.ipasc import (
    ANGLES,
    FRAMES_PATH,
    IpascBank,
    arrays_of_others,
    as_bank_error,
    read_probed,
    walk_bank,
)
from markerseek.records.banks.sequence import is_sequence, read_sequence
from markerseek.records.banks.table import read_table
from markerseek.records.banks.table_format import DEFAULT_FORMAT, TableFormat
from markerseek.records.banks.zea import zea_arrays
from markerseek.records.child import try_files
from markerseek.records.hdf5 import CheckedHdf5, require_h5py
from markerseek.records.journal import is_journal
from markerseek.records.named_arrays import ARRAY_SUFFIXES, plain_arrays
from markerseek.records.notes import noting

# 4 TiB: frames are read one at a time, so that the size of the file is harmless.
_LARGEST_BYTES = 1 << 42


def read_bank(path: Path, table: TableFormat = DEFAULT_FORMAT, *, blanked: int = 0) -> IntensityBank | FrameBank:
    """Return the bank at a path, its frames left on disk where their format allows that.

    ``path``: an HDF5 file (``.hdf5``, ``.h5``; `read_hdf5`); arrays of NumPy or MATLAB (``.npy``, ``.npz``, ``.mat``;
    `read_arrays`); a sequence of PLUS (``.mha``, ``.nrrd``); a CSV of ``angle_deg,intensity``; or a folder that holds
    for each angle a sub-folder of SonixDAQ files or a file of channel data (``.npy``, ``.mat``), named by its angle in
    degrees (``-12.5``, ``angle_-12.5deg``). ``table``: what the recording does not say itself. ``blanked``: samples
    from the trigger on that are not imaged (`ProbePreset.pickup_samples`), and do not count for the scale of data that
    are no counts.

    What was assumed, changed or left out is in ``notes`` of the bank, and logged as a warning.
    """
    with noting() as notes:
        bank = _read(path, table, blanked=blanked)
    return replace(bank, notes=tuple(notes))


def _read(path: Path, table: TableFormat, *, blanked: int) -> IntensityBank | FrameBank:
    """As `read_bank`, without the notes."""
    with as_read_error(path):
        if not path.exists():
            record = record_of(path)
            imported = f"`journal_bank({quoted(record)}, {quoted(path)})`"
            kept = f"its scan did not become a bank, and is kept: {imported}"
            cure = kept if record.exists() else "check the name and the rights"
            raise RecordError(f"{path}: there is no such file or folder; {cure}")
        if path.is_file() and is_journal(path):
            raise RecordError(
                f"{path}: it is the journal of a run and no bank; its run is computed again by "
                f"`answer_again({quoted(path)})`, and its frames become a bank by "
                f"`journal_bank({quoted(path)}, frames.hdf5)`"
            )
        if table.angle_field is not None and not is_sequence(path):
            raise ConfigError(f"`angle_field={table.angle_field}`: {path} is no sequence (.mha, .nrrd); leave it out")
        if table.angle_field is not None and table.states_angles:
            raise ConfigError(
                f"`angle_field={table.angle_field}`, and `first_and_step_deg` or `angles_deg` both give the angles; "
                "leave one out"
            )
        (bank_format, *_) = (each for each in FORMATS if each.recognises(path))
        return bank_format.read(path, table, blanked)


def _require_usual(path: Path, table: TableFormat, *, is_table: bool) -> None:
    """Refuse what a person says of a recording that says it itself."""
    said = structs.replace(table, without_channels=(), angle_field=None)
    of_angles = structs.replace(DEFAULT_FORMAT, first_and_step_deg=said.first_and_step_deg, angles_deg=said.angles_deg)
    if (said.axes, said.first_frame) != (None, None):
        raise ConfigError(f"{path}: `axes` and `first_frame` are for arrays of frames; leave them out")
    if not is_table and said != of_angles:
        raise ConfigError(
            f"{path}: it is no CSV, and columns, units and rows to be left out are of a CSV; leave them out"
        )


def read_hdf5(path: Path, table: TableFormat, *, blanked: int) -> IntensityBank | FrameBank:
    """Return the bank in an HDF5 file.

    One of ours keeps its frames on disk (`read_probed`). One of IPASC by another program, one of zea, and one with
    ``frames`` or ``intensity`` at its top level is read into memory. ``table``: as of `read_bank`.
    """
    with as_read_error(path):
        require_input(path, most_bytes=_LARGEST_BYTES)
        require_h5py()
        try_files(walk_hdf5, [path])
    arrays, ordered = _arrays(path)
    if arrays is not None:
        return bank_of_arrays(path, arrays, table, ordered=ordered, blanked=blanked)
    _require_usual(path, table, is_table=False)
    if table.states_angles:
        raise ConfigError(f"{path}: this recording has its angles; leave `first_and_step_deg` and `angles_deg` out")
    return without_channels(read_probed(path), path, table.without_channels)


HDF5_LAYOUTS: tuple[Callable[[Path, CheckedHdf5], Mapping[str, np.ndarray] | None], ...] = (
    zea_arrays,
    arrays_of_others,
)
"""Readers of other programs' HDF5 files; each returns its arrays, or None for a file that is not its own."""


def _arrays(path: Path) -> tuple[Mapping[str, np.ndarray] | None, bool]:
    """Return the arrays of a file that is no bank of ours, else None, and whether their axes have our order."""
    with as_bank_error(path), CheckedHdf5(path) as file:
        for arrays_of in HDF5_LAYOUTS:
            if arrays := arrays_of(path, file):
                return arrays, True
        of_ipasc = any(map(file.has, (FRAMES_PATH, ANGLES, "meta_data")))
        return (None if of_ipasc else plain_arrays(path, file)), False


def walk_hdf5(path: Path) -> None:
    """Read as much of an HDF5 file as a bank of it needs."""
    if _arrays(path)[0] is None:
        walk_bank(path)


def require_whole(bank: IntensityBank | FrameBank) -> None:
    """Refuse a bank in IPASC HDF5 with a frame that cannot be read or has changed; other banks are read anyway."""
    if isinstance(bank, IpascBank):
        for index in range(len(bank.angles_deg)):
            bank.frame(index)
        for index in range(bank.dark_frames):
            bank.dark_frame(index)


@dataclass(frozen=True, slots=True, kw_only=True)
class BankFormat:
    """A format of recordings, with its reader."""

    recognises: Callable[[Path], bool]
    """Whether a file or folder is of this format, by its name or by its first bytes."""
    read: Callable[[Path, TableFormat, int], IntensityBank | FrameBank]
    """Takes the path, what a person says of the recording, and how many samples are blanked."""


def _is_file_of(suffixes: Collection[str]) -> Callable[[Path], bool]:
    return lambda path: path.is_file() and path.suffix.lower() in suffixes


def _read_folder(path: Path, table: TableFormat, blanked: int) -> IntensityBank | FrameBank:
    _require_usual(path, table, is_table=False)
    return without_channels(read_folder(path, table, blanked=blanked), path, table.without_channels)


def _read_sequence(path: Path, table: TableFormat, _blanked: int) -> IntensityBank | FrameBank:
    _require_usual(path, table, is_table=False)
    bank = read_sequence(path, angle_field=table.angle_field, table=table)
    return without_channels(bank, path, table.without_channels)


def _read_table(path: Path, table: TableFormat, _blanked: int) -> IntensityBank | FrameBank:
    _require_usual(path, table, is_table=True)
    return without_channels(read_table(path, table), path, table.without_channels)


FORMATS: tuple[BankFormat, ...] = (
    BankFormat(
        recognises=_is_file_of(ARRAY_SUFFIXES),
        read=lambda path, table, blanked: read_arrays(path, table, blanked=blanked),
    ),
    BankFormat(
        recognises=_is_file_of(HDF5_SUFFIXES),
        read=lambda path, table, blanked: read_hdf5(path, table, blanked=blanked),
    ),
    BankFormat(recognises=Path.is_dir, read=_read_folder),
    BankFormat(recognises=is_sequence, read=_read_sequence),
    # Any other file may be a table.
    BankFormat(recognises=lambda _path: True, read=_read_table),
)
"""Formats in the order in which they are asked; a format of arrays alone is one of `HDF5_LAYOUTS`."""
