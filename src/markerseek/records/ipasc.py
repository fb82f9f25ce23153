"""Writes a bank as IPASC HDF5, by pacfish, and keeps what was written readable while it grows.

pacfish wants a whole bank in memory, drops values of kinds that it does not know without a word, and writes all at
once. So it writes everything but the frames, and these are put into their place one by one: the file has its full
size from the first frame on and nothing but numbers changes in it, so that a process that is killed leaves a file that
opens. An angle of NaN has not been measured. `BankWriter.close` cuts off what was not.
"""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, RecordError, Sample
from markerseek.records._hdf5 import require_h5py
from markerseek.records.banks import HDF5_SUFFIXES, BankFacts
from markerseek.records.ipasc_fields import (
    ANGLES,
    DARK_FRAMES,
    DARK_TAKEN,
    FRAMES,
    INTENSITIES,
    PULSE_ENERGY,
    PULSES,
    SIZES,
    TIMES,
    acquisition_fields,
    device_fields,
    pacfish_package,
)

if TYPE_CHECKING:
    import h5py

_ROOM_BYTES = 1 << 20
"""Room for everything but frames."""

_BY_MEASUREMENT = (ANGLES, INTENSITIES, PULSES, TIMES, PULSE_ENERGY)


def require_new_bank(path: Path) -> None:
    """Refuse a place where no bank can be written, before anything is done for it.

    Raises
    ------
    ConfigError
        If the suffix is another than .hdf5 and .h5.
    RecordError
        If there is a file already.
    MissingExtraError
        If h5py or pacfish is not installed.
    """
    require_h5py()
    pacfish_package()
    if path.suffix.lower() not in HDF5_SUFFIXES:
        raise ConfigError(f"{path}: the name of a bank must end in {' or '.join(HDF5_SUFFIXES)}")
    if path.exists():
        raise RecordError(f"{path}: there is a file already; name another, or delete it")


class BankWriter:
    """A bank that grows by one acquisition at a time; a context manager that closes it.

    Parameters
    ----------
    path
        Where to write; the suffix is .hdf5 or .h5.
    angles
        Most acquisitions with the laser that will come.
    dark_frames
        Most acquisitions without.
    facts
        What else is known of the bank.

    Raises
    ------
    ConfigError
        If the path has another suffix.
    RecordError
        If there is a file already.
    MissingExtraError
        If h5py or pacfish is not installed.
    """

    def __init__(self, path: Path, *, angles: int, dark_frames: int = 0, facts: BankFacts) -> None:
        require_new_bank(path)
        self._path = path
        self._planned, self._planned_dark = angles, dark_frames
        self._facts = facts
        self._file: h5py.File | None = None
        self._shape: tuple[int, int] = (0, 0)
        self._taken = self._taken_dark = 0

    @property
    def taken(self) -> int:
        """Acquisitions with the laser that are in the file."""
        return self._taken

    def add(self, sample: Sample) -> None:
        """Write one acquisition, dark or not, and hand it to the disk.

        Raises
        ------
        RecordError
            If it cannot be written, differs in shape from those before, or is one more than was announced.
        """
        frame = sample.frame if isinstance(sample.frame, ChannelFrame) else None
        if sample.dark and frame is None:
            return
        try:
            file = self._file or self._begin(frame)
            self._require_same(frame)
            self._put(file, sample, frame)
            file.flush()
        except (OSError, RuntimeError) as problem:
            raise self._unwritten(problem) from problem
        if sample.dark:
            self._taken_dark += 1
        else:
            self._taken += 1

    def close(self) -> None:
        """Cut off what was announced and did not come, and close the file; allowed twice."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            with file:
                if self._taken < self._planned:
                    self._cut(file)
        except (OSError, RuntimeError) as problem:
            raise self._unwritten(problem) from problem

    def __enter__(self) -> Self:
        """The writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, whatever happened."""
        self.close()

    def _begin(self, frame: ChannelFrame | None) -> h5py.File:
        import h5py

        self._shape = (0, 0) if frame is None else (frame.samples.shape[0], frame.samples.shape[1])
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._require_room()
        pacfish = pacfish_package()
        elements, samples = self._shape
        facts = self._facts
        sampling_hz = facts.sampling_hz if frame is None else frame.sampling_hz
        data = pacfish.PAData(np.zeros((elements, samples, 1, 0), np.int16))
        data.meta_data_acquisition = acquisition_fields(facts, self._planned, self._shape, sampling_hz)
        data.meta_data_device = device_fields(facts, self._shape, sampling_hz)
        pacfish.write_data(str(self._path), data)
        self._file = h5py.File(self._path, "r+")
        _reserve(self._file, FRAMES, (*self._shape, 1), self._planned)
        if self._shape != (0, 0):
            _reserve(self._file, DARK_FRAMES, self._shape, self._planned_dark)
        self._file.flush()
        if hasattr(os, "posix_fallocate"):
            with self._path.open("r+b") as plain:
                os.posix_fallocate(plain.fileno(), 0, self._path.stat().st_size)
        return self._file

    def _require_room(self) -> None:
        """Refuse a disk that cannot hold it all: the library says nothing of a write that fails, and dies of it."""
        needed = 2 * math.prod(self._shape) * (self._planned + self._planned_dark) + _ROOM_BYTES
        free = shutil.disk_usage(self._path.parent).free
        if free < needed:
            raise RecordError(
                f"{self._path}: the bank needs {needed / 1e6:.1f} MB, {free / 1e6:.1f} MB are free; "
                "nothing was written: make room, or name another place"
            )

    def _require_same(self, frame: ChannelFrame | None) -> None:
        shape = (0, 0) if frame is None else frame.samples.shape
        if shape != self._shape:
            raise RecordError(
                f"{self._path}: a frame of {shape} follows frames of {self._shape} (channels, samples); "
                "keep one probe and one record length in a bank"
            )

    def _put(self, file: h5py.File, sample: Sample, frame: ChannelFrame | None) -> None:
        row, planned = (self._taken_dark, self._planned_dark) if sample.dark else (self._taken, self._planned)
        if row >= planned:
            raise RecordError(f"{self._path}: {planned} acquisitions were announced and one more came; announce it")
        if frame is not None:
            # Past the library's cache, which loses what it cannot write without a word.
            place = (0, 0, row) if sample.dark else (0, 0, 0, row)
            counts = frame.samples.astype("<i2").tobytes()
            file[DARK_FRAMES if sample.dark else FRAMES].id.write_direct_chunk(place, counts)
        if sample.dark:
            file[DARK_TAKEN][()] = row + 1
            return
        file[INTENSITIES][row] = sample.reading.intensity
        if sample.frame is not None:
            file[PULSES][row] = sample.frame.header.pulses
            file[TIMES][row] = sample.frame.header.started_s
        file.flush()
        # The angle last: a row with an angle is whole.
        file[ANGLES][row] = sample.angle_deg

    def _cut(self, file: h5py.File) -> None:
        for name in _BY_MEASUREMENT:
            if name in file:
                kept = file[name][: self._taken]
                del file[name]
                file[name] = kept
        file[FRAMES].resize(self._taken, axis=3)
        file[SIZES][3] = self._taken

    def _unwritten(self, problem: Exception) -> RecordError:
        return RecordError(
            f"{self._path}: the bank cannot be written: {problem}; {self._taken} acquisitions are in it and stay "
            "readable; make room, or name another place"
        )


def _reserve(file: h5py.File, name: str, shape: tuple[int, ...], count: int) -> None:
    """A dataset that has its place on the disk at once, one chunk a frame."""
    import h5py

    if name in file:
        del file[name]
    dims = (*shape, count)
    if 0 in dims:
        file.create_dataset(name, shape=dims, dtype="i2")
        return
    kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    kind.set_chunk((*shape, 1))
    kind.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    kind.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    room = h5py.h5s.create_simple(dims, (*shape, h5py.h5s.UNLIMITED))
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.STD_I16LE, room, kind)
