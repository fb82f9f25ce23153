"""Writes a bank as IPASC HDF5, by pacfish, and keeps what was written readable while it grows.

The file has its full size from the first frame on and nothing but numbers changes in it, so that a process that is
killed leaves a file that opens. An angle of NaN has not been measured: it is written last, when all else of its
measurement is on the disk, and a checksum with it. A file is never cut: `BankWriter.close` puts a smaller copy into the
place of one that was not filled.

A bank of intensities only has no detection elements and frames of no size, by which PATATO, too, opens it.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from markerseek.core import ChannelFrame, ConfigError, RecordError, Sample
from markerseek.files import create_atomically, replace_file, require_new
from markerseek.records.banks.bank import HDF5_SUFFIXES, BankFacts
from markerseek.records.banks.ipasc import fields
from markerseek.records.banks.ipasc.admission import require_keepable
from markerseek.records.banks.ipasc.layout import Layout, copy_trimmed, make_file, write_frame
from markerseek.records.banks.ipasc.rows import frame_sum, probe_pose, row_sum
from markerseek.records.untrusted_hdf5 import require_h5py

if TYPE_CHECKING:
    import h5py

_ROOM_BYTES = 1 << 20
"""Room for everything but frames."""


def require_new_bank(path: Path) -> None:
    """Refuse a place where no bank can be written, before anything is done for it.

    Raises
    ------
    ConfigError
        If the suffix is another than .hdf5 and .h5.
    RecordError
        If there is a file already, or no folder for it.
    MissingExtraError
        If h5py or pacfish is not installed.
    """
    require_h5py()
    fields.pacfish_package()
    if path.suffix.lower() not in HDF5_SUFFIXES:
        raise ConfigError(f"{path}: the name of a bank must end in {' or '.join(HDF5_SUFFIXES)}")
    require_new(path)


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
    whole_as
        Name that the file gets when it is whole, by `whole_bank`: until then nobody reads it, and the disk is not
        waited for. None: it has its name from the first acquisition on.

    Raises
    ------
    ConfigError
        If the name has another suffix.
    RecordError
        If there is a file already.
    MissingExtraError
        If h5py or pacfish is not installed.
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
        self._layout: Layout | None = None
        self._angles_deg: dict[float, None] = {}
        self._taken_dark = 0

    @property
    def taken(self) -> int:
        """Acquisitions with the laser that are in the file."""
        return len(self._angles_deg)

    def add(self, sample: Sample) -> None:
        """Write one acquisition, dark or not; when this returns, it is on the disk.

        Raises
        ------
        RecordError
            If it cannot be written, or not be read as a bank again: it differs in shape or rate from those before, is
            one more than was announced, or has an angle or intensity that no bank can hold. Nothing is written then.
        """
        frame = sample.frame if isinstance(sample.frame, ChannelFrame) else None
        if sample.dark and frame is None:
            return
        row, planned = (self._taken_dark, self._planned_dark) if sample.dark else (self.taken, self._planned)
        if row >= planned:
            raise RecordError(f"{self._named}: {planned} acquisitions were announced and one more came; announce it")
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
        """Close the file, and leave off the room for what was announced and did not come; allowed twice.

        The room stays, and readers pass over it, where the disk cannot hold a copy beside the file.
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

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, whatever happened."""
        self.close()

    def release(self) -> bool:
        """Close the file as it is, and say whether there was one; `RecordError` where the disk does not take it."""
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
        """Refuse a bank in which something that was announced is missing."""
        if (self.taken, self._taken_dark) != (self._planned, self._planned_dark):
            raise RecordError(
                f"{self._named}: {self.taken} of {self._planned} angles and {self._taken_dark} of "
                f"{self._planned_dark} dark frames came; nothing was kept: read the source again"
            )

    def _begin(self, frame: ChannelFrame | None) -> h5py.File:
        import h5py

        facts = self._facts
        self._layout = Layout(
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
        """Refuse a disk that cannot hold it all: the library says nothing of a write that fails, and dies of it."""
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
        summed = row_sum(angle_deg=angle_deg, intensity=intensity, pulses=pulses, started_s=started_s)
        if frame is not None:
            write_frame(file[fields.FRAMES], (0, 0, 0, row), frame.samples.astype("<i2").tobytes())
            file[fields.FRAME_SUMS][row] = frame_sum(frame.samples, after=summed)
        file[fields.INTENSITIES][row] = intensity
        file[fields.PULSES][row] = pulses
        file[fields.RIG_CLOCK][row] = started_s
        zero_s = self._facts.clock_zero_unix_s
        file[fields.TIMES][row] = math.nan if zero_s is None else zero_s + started_s
        if self._facts.face_radius_m is not None:
            first_deg = next(iter(self._angles_deg), angle_deg)
            pose = probe_pose(angle_deg, first_deg=first_deg, face_radius_m=self._facts.face_radius_m)
            file[fields.POSES][row] = pose
        file[fields.ROW_SUMS][row] = summed
        self._sync(file)
        # The angle last: a row with an angle is whole.
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
            file.flush()
            os.fsync(self._descriptor)

    def _unwritten(self, problem: Exception) -> RecordError:
        return RecordError(
            f"{self._named}: the bank cannot be written: {problem}; {self.taken} acquisitions are in it and stay "
            "readable; make room, or name another place"
        )


@contextmanager
def whole_bank(path: Path, *, angles: int, dark_frames: int = 0, facts: BankFacts) -> Iterator[BankWriter]:
    """A writer of a bank that gets its name when the block ends with all that was announced, and is gone if not.

    Parameters
    ----------
    path, angles, dark_frames, facts
        As of `BankWriter`.

    Raises
    ------
    RecordError
        If there is a file already, it cannot be written, or less came than was announced.
    ConfigError, MissingExtraError
        As of `BankWriter`.
    """
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
