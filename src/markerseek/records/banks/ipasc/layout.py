"""Creates the file of a bank at its full size, and copies a bank that was not filled into a smaller file.

The file is what pacfish would write, but pacfish needs a whole bank in memory, and its installation brings pytest and
Sphinx. The tests compare the two.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek.records.banks.bank import BankFacts
from markerseek.records.banks.ipasc import fields

if TYPE_CHECKING:
    import h5py


def make_file(path: Path, layout: fields.Layout, facts: BankFacts) -> None:
    """Write an empty bank of full size; afterwards only its numbers change."""
    import h5py

    device = fields.device_identifier(facts.probe)
    with h5py.File(path, "w") as file:
        for group in ("general", "illuminators", "detectors"):
            # PATATO opens a file without elements, but not one without their group.
            file.create_group(f"{fields.DEVICE}/{group}")
        for make in (fields.acquisition_fields, fields.device_fields):
            for name, value in make(facts, layout, device=device).items():
                file[name] = value
        _reserve(file, fields.FRAMES, (*layout.shape, 1), layout.angles)
        if all(layout.shape):
            _reserve(file, fields.DARK_FRAMES, layout.shape, layout.dark_frames)
    if hasattr(os, "posix_fallocate"):
        with path.open("r+b") as plain:
            # Reserves the disk space now: a full disk in the middle of a scan would stop the run.
            os.posix_fallocate(plain.fileno(), 0, path.stat().st_size)


def copy_trimmed(source: Path, to: Path) -> None:
    """Copy a bank without its unused rows."""
    import h5py

    with h5py.File(source, "r") as held, h5py.File(to, "w") as copy:
        # Counted in the file: the writer may have been interrupted before it counted the last one itself.
        angles, dark_frames = int(np.isfinite(held[fields.ANGLES][()]).sum()), int(held[fields.DARK_TAKEN][()])
        names: list[str] = []
        held.visit(names.append)
        for name in names:
            item = held[name]
            if isinstance(item, h5py.Group):
                copy.require_group(name)
            elif name in fields.BY_MEASUREMENT:
                copy[name] = item[:angles]
            elif name == fields.DARK_SUMS:
                copy[name] = item[:dark_frames]
            elif name == fields.SIZES:
                copy[name] = np.array([*item[:3], angles])
            elif name == fields.FRAMES:
                _copy_frames(item, copy, angles)
            elif name == fields.DARK_FRAMES:
                _copy_frames(item, copy, dark_frames)
            else:
                held.copy(item, copy, name=name)


def _copy_frames(item: h5py.Dataset, copy: h5py.File, count: int) -> None:
    name = item.name.lstrip("/")
    _reserve(copy, name, item.shape[:-1], count)
    for row in range(count if 0 not in item.shape else 0):
        place = (*(0 for _ in item.shape[:-1]), row)
        # Raw chunks, so that the counts are copied without a conversion.
        write_frame(copy[name], place, item.id.read_direct_chunk(place)[1])


def write_frame(data: h5py.Dataset, place: tuple[int, ...], counts: bytes) -> None:
    """Write one frame directly: the library's cache reports no error when a later write fails."""
    data.id.write_direct_chunk(place, counts)


def _reserve(file: h5py.File, name: str, shape: tuple[int, ...], count: int) -> None:
    """Create a dataset whose space is allocated at once, one chunk per frame."""
    import h5py

    dims = (*shape, count)
    if 0 in dims:
        file.create_dataset(name, shape=dims, dtype="i2")
        return
    kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    # One chunk per frame, so that a frame is written and read in one piece.
    kind.set_chunk((*shape, 1))
    kind.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    # No fill values: gigabytes of zeros would delay the first acquisition.
    kind.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    room = h5py.h5s.create_simple(dims)
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.STD_I16LE, room, kind)
