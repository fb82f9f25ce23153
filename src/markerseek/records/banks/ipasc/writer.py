"""Writes a bank as IPASC HDF5; the file stays readable at every moment of a scan.

The file has its full size from the first frame on and only numbers change in it, so that a killed process leaves a file
that opens. An angle of NaN marks an empty row: the angle is written last, after the rest of its row is on disk. The
file is never truncated: `BankWriter.close` replaces one that was not filled by a smaller copy (decision 12).

A bank of intensities has no detection elements and frames of size zero; PATATO opens it, too.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

from markerseek.core import ChannelFrame, ConfigError, RecordError, Sample
from markerseek.files import create_atomically, replace_file, require_new
from markerseek.records.banks.bank import HDF5_SUFFIXES, BankFacts
from markerseek.records.banks.ipasc import fields
from markerseek.records.banks.ipasc.layout import copy_trimmed, make_file, write_frame
from markerseek.records.banks.ipasc.rows import frame_sum, probe_pose, require_keepable, row_sum
from markerseek.records.untrusted_hdf5 import require_h5py

if TYPE_CHECKING:
    import h5py

_ROOM_BYTES = 1 << 20
"""Space for everything but frames, in bytes."""


def require_new_bank(path: Path) -> None:
    """Refuse a path where no bank can be written, before anything is measured."""
    require_h5py()
    if path.suffix.lower() not in HDF5_SUFFIXES:
        raise ConfigError(f"{path}: the name of a bank must end in {' or '.join(HDF5_SUFFIXES)}")
    require_new(path)


class BankWriter:
    """A bank that grows by one acquisition at a time; a context manager that closes it.

    ``path``: where to write; the suffix is .hdf5 or .h5. ``angles``: most acquisitions with the laser that will come.
    ``dark_frames``: most acquisitions without. ``whole_as``: final name of the file, given by `whole_bank` when it is
    complete; until then it is not flushed after each acquisition. None: it has its name from the first acquisition on.
    """

    def __init__(
        self, path: Path, *, angles: int, dark_frames: int = 0, facts: BankFacts, whole_as: Path | None = None
    ) -> None:
        self._path, self._named, self._grows = path, whole_as or path, whole_as is None
        require_new_bank(self._named)
        self._planned, self._planned_dark = angles, dark_frames
        self._facts = facts
        self._file: h5py.File | None = None
        self._descriptor = -1
        self._layout: fields.Layout | None = None
        self._angles_deg: dict[float, None] = {}
        self._taken_dark = 0

    @property
    def taken(self) -> int:
        """Acquisitions with the laser that are in the file."""
        return len(self._angles_deg)

    def add(self, sample: Sample) -> None:
        """Write one acquisition, dark or not; when this returns, it is on the disk."""
        frame = sample.frame if isinstance(sample.frame, ChannelFrame) else None
        if sample.dark and frame is None:
            return
        row, planned = (self._taken_dark, self._planned_dark) if sample.dark else (self.taken, self._planned)
        if row >= planned:
            raise RecordError(
                f"{self._named}: {planned} acquisitions were announced and one more came; announce it too"
            )
        require_keepable(self._named, sample, layout=self._layout, angles_deg=self._angles_deg)
        try:
            file = self._file or self._begin(frame)
            if sample.dark and frame is not None:
                self._put_dark(file, frame)
            else:
                self._put(file, sample, frame)
        except (OSError, RuntimeError) as problem:
            raise self._unwritten(problem) from problem

    def close(self) -> None:
        """Close the file, and remove the rows that were announced and not filled; allowed twice.

        The empty rows stay, and readers skip them, where the disk has no space for a copy.
        """
        if not self.release() or (self.taken, self._taken_dark) == (self._planned, self._planned_dark):
            return
        try:
            if shutil.disk_usage(self._path.parent).free > self._path.stat().st_size + _ROOM_BYTES:
                with replace_file(self._path) as part:
                    copy_trimmed(self._path, part)
        except (OSError, RuntimeError):
            return

    def __enter__(self) -> Self:
        """The writer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file, whatever happened."""
        self.close()

    def release(self) -> bool:
        """Close the file without removing empty rows; returns whether it was open. `RecordError` if the flush fails."""
        file, self._file = self._file, None
        if file is None:
            return False
        try:
            file.close()
            os.fsync(self._descriptor)
        except (OSError, RuntimeError) as problem:
            raise self._unwritten(problem) from problem
        finally:
            os.close(self._descriptor)
        return True

    def require_whole(self) -> None:
        """Refuse a bank with fewer acquisitions than announced."""
        if (self.taken, self._taken_dark) != (self._planned, self._planned_dark):
            raise RecordError(
                f"{self._named}: {self.taken} of {self._planned} angles and {self._taken_dark} of "
                f"{self._planned_dark} dark frames came; nothing was kept: read the source again"
            )

    def _begin(self, frame: ChannelFrame | None) -> h5py.File:
        import h5py

        facts = self._facts
        self._layout = fields.Layout(
            angles=self._planned,
            dark_frames=self._planned_dark,
            shape=(0, 0) if frame is None else (frame.samples.shape[0], frame.samples.shape[1]),
            sampling_hz=facts.sampling_hz if frame is None else frame.sampling_hz,
        )
        self._require_room(self._layout.frame_bytes + _ROOM_BYTES)
        with create_atomically(self._path) as part:
            make_file(part, self._layout, facts)
        self._file = h5py.File(self._path, "r+")
        self._descriptor = os.open(self._path, os.O_RDWR)
        return self._file

    def _require_room(self, needed: int) -> None:
        """Refuse a disk without enough space: HDF5 can crash on a write that fails."""
        free = shutil.disk_usage(self._path.parent).free
        if free < needed:
            raise RecordError(
                f"{self._named}: the bank needs {needed / 1e6:.1f} MB, {free / 1e6:.1f} MB are free; "
                "nothing was written: make room, or name another place"
            )

    def _put(self, file: h5py.File, sample: Sample, frame: ChannelFrame | None) -> None:
        row, angle_deg, intensity = self.taken, sample.angle_deg, sample.reading.intensity
        header = None if sample.frame is None else sample.frame.header
        pulses = 0 if header is None else header.pulses
        started_s = math.nan if header is None or not math.isfinite(header.started_s) else header.started_s
        energy = math.nan if header is None or header.energy is None else header.energy
        summed = row_sum(angle_deg=angle_deg, intensity=intensity, pulses=pulses, started_s=started_s, energy=energy)
        if frame is not None:
            write_frame(file[fields.FRAMES], (0, 0, 0, row), frame.samples.astype("<i2").tobytes())
            file[fields.FRAME_SUMS][row] = frame_sum(frame.samples, after=summed)
        file[fields.INTENSITIES][row] = intensity
        file[fields.PULSES][row] = pulses
        file[fields.ENERGY][row] = energy
        if self._facts.pulse_energy_j is not None and not math.isnan(energy):
            file[fields.PULSE_ENERGY][row] = self._facts.pulse_energy_j * energy
        file[fields.RIG_CLOCK][row] = started_s
        zero_s = self._facts.clock_zero_unix_s
        file[fields.TIMES][row] = math.nan if zero_s is None else zero_s + started_s
        if self._facts.face_radius_m is not None:
            first_deg = next(iter(self._angles_deg), angle_deg)
            pose = probe_pose(angle_deg, first_deg=first_deg, face_radius_m=self._facts.face_radius_m)
            file[fields.POSES][row] = pose
        file[fields.ROW_SUMS][row] = summed
        self._sync(file)
        # The angle last, after a flush: a row with an angle is complete.
        file[fields.ANGLES][row] = angle_deg
        self._sync(file)
        self._angles_deg[angle_deg] = None

    def _put_dark(self, file: h5py.File, frame: ChannelFrame) -> None:
        row = self._taken_dark
        write_frame(file[fields.DARK_FRAMES], (0, 0, row), frame.samples.astype("<i2").tobytes())
        file[fields.DARK_SUMS][row] = frame_sum(frame.samples)
        self._sync(file)
        file[fields.DARK_TAKEN][()] = row + 1
        self._sync(file)
        self._taken_dark += 1

    def _sync(self, file: h5py.File) -> None:
        if self._grows:
            # flush() hands the data to the system, fsync() to the disk; HDF5 has no call for the latter.
            file.flush()
            os.fsync(self._descriptor)

    def _unwritten(self, problem: Exception) -> RecordError:
        return RecordError(
            f"{self._named}: the bank cannot be written: {problem}; {self.taken} acquisitions are in it and stay "
            "readable; make room, or name another place"
        )


@contextmanager
def whole_bank(path: Path, *, angles: int, dark_frames: int = 0, facts: BankFacts) -> Iterator[BankWriter]:
    """A writer of a bank that is renamed when the block ends with everything announced, and deleted if not."""
    require_new_bank(path)
    inside = False
    try:
        with create_atomically(path) as part:
            writer = BankWriter(part, angles=angles, dark_frames=dark_frames, facts=facts, whole_as=path)
            try:
                inside = True
                yield writer
                inside = False
            except BaseException:
                # The error of the block is the cause; one of closing the temporary file would hide it.
                with suppress(RecordError):
                    writer.release()
                raise
            writer.release()
            writer.require_whole()
    except OSError as problem:
        if inside:
            raise
        raise RecordError(
            f"{path}: the bank cannot be written: {problem}; nothing was kept: make room, or name another place"
        ) from problem
