"""Reads banks in IPASC HDF5: our own one frame at a time, and the arrays of files of other programs."""

from __future__ import annotations

import math
import re
import warnings
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from markerseek.core import ChannelFrame, FrameHeader, Int16, RecordError
from markerseek.records.banks.bank import NUMERIC_FACTS, FrameBank, IntensityBank
from markerseek.records.banks.ipasc import fields
from markerseek.records.banks.ipasc.columns import element_row, numbers_of, one_each, read_columns, read_facts
from markerseek.records.hdf5 import CheckedHdf5, as_record_error, require_h5py


@dataclass(frozen=True, slots=True, kw_only=True)
class IpascBank(FrameBank):
    """Frames in an IPASC HDF5 file."""

    path: Path
    file: CheckedHdf5 = field(repr=False, compare=False)
    rows: tuple[int, ...] = field(repr=False)
    """Row in the file of each angle."""
    falling: bool = False
    """Whether the elements are in reverse order in the file."""
    checked: bool = False
    """Whether the library compares the frames with checksums in the file."""

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, from the disk.

        Raises `RecordError` if they cannot be read.
        """
        row = self.rows[index]
        header = self.header(index, token=self.path.name, row=row)
        return self._frame(header, fields.FRAMES, row, what=f"frame at {header.commanded_deg:g} deg")

    def dark_frame(self, index: int) -> ChannelFrame:
        """One frame without laser, from the disk; `RecordError` where it cannot be read."""
        if not 0 <= index < self.dark_frames:
            return FrameBank.dark_frame(self, index)
        header = FrameHeader(
            sequence=index + 1,
            token=self.path.name,
            pulses=0,
            commanded_deg=0.0,
            started_s=math.nan,
            ended_s=math.nan,
        )
        return self._frame(header, fields.DARK_FRAMES, index, what=f"dark frame {index + 1}")

    def _frame(self, header: FrameHeader, name: str, row: int, *, what: str) -> ChannelFrame:
        with as_bank_error(self.path):
            try:
                samples = _numbers(self.file, name, row)
            except OSError as problem:
                # HDF5 has no error of its own for a checksum: only its text says that the filter found it.
                if not self.checked or not re.search("(?i)filter returned failure|fletcher32 checksum", str(problem)):
                    raise
                raise RecordError(
                    f"{self.path}: the {what} has changed since it was written, its checksum differs; take the file "
                    "from a backup or scan again"
                ) from problem
        if self.facts.sampling_hz is None:
            raise RecordError(f"{self.path}: {fields.SAMPLING} is missing; its frames cannot be read without it")
        samples = np.ascontiguousarray(samples[::-1]) if self.falling else samples
        return ChannelFrame(header=header, samples=samples, sampling_hz=self.facts.sampling_hz)


def read_probed(path: Path) -> IntensityBank | IpascBank:
    """Bank of ours in an IPASC HDF5 file; its frames stay on disk.

    The file has been tried in a child before (`walk_bank`).
    """
    with as_bank_error(path), ExitStack() as closing:
        bank = _bank_of(path, closing.enter_context(CheckedHdf5(path)))
        # A bank of intensities is in memory by now; one of frames reads them from the open file.
        if isinstance(bank, IpascBank):
            closing.pop_all()
        return bank


def _bank_of(path: Path, file: CheckedHdf5) -> IntensityBank | IpascBank:
    if not file.has(fields.ANGLES):
        raise RecordError(f"{path}: {fields.ANGLES} is missing; without the angles it is no bank of a scan")
    columns = read_columns(path, file)
    frames = _frame_shape(path, file, len(columns.rows))
    if frames is None:
        if not all(map(math.isfinite, columns.intensities)):
            raise RecordError(f"{path}: it holds neither frames nor an intensity for each angle")
        facts = read_facts(file, pitch_m=None)
        started_s = columns.started_s if any(map(math.isfinite, columns.started_s)) else ()
        return IntensityBank(
            angles_deg=columns.angles_deg, intensities=columns.intensities, started_s=started_s, facts=facts
        )
    array = element_row(path, file, elements=frames[0])
    return IpascBank(
        angles_deg=columns.angles_deg,
        intensities=columns.intensities if any(map(math.isfinite, columns.intensities)) else (),
        facts=read_facts(file, pitch_m=array.pitch_m),
        dark_frames=_dark_frames(file, frames),
        started_s=columns.started_s,
        pulses=columns.pulses,
        energies=columns.energies,
        path=path,
        file=file,
        rows=columns.rows,
        falling=array.falling,
        checked=bool(file.dataset(fields.FRAMES).fletcher32),
    )


def arrays_of_others(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Frames or intensities of another program's file, named as `markerseek.records.banks.arrays` reads them.

    Nothing for a file of ours, or one with neither. Pulse energies that differ come as ``energy``.
    """
    if _is_ours(path, file) or not (file.has(fields.FRAMES) or file.has(fields.INTENSITIES)):
        return {}
    arrays: dict[str, object] = {}
    pitch_m = None
    if file.has(fields.FRAMES):
        data = file.dataset(fields.FRAMES)
        # Pacfish drops the last axes where they have the length 1.
        shape = (*data.shape, 1, 1)[: max(4, data.ndim)]
        if len(shape) != 4 or shape[2] != 1 or 0 in shape:
            raise RecordError(
                f"{path}: {fields.FRAMES} has the shape {data.shape}, (elements, samples, 1, measurements) is "
                "expected; save the measurements of one wavelength alone"
            )
        file.require_room(math.prod(shape) * data.dtype.itemsize, name=fields.FRAMES)
        array = element_row(path, file, elements=shape[0])
        pitch_m, count = array.pitch_m, shape[3]
        frames = np.asarray(data[()]).reshape(shape)[:, :, 0, :].transpose(2, 0, 1)
        arrays["frames"] = frames[:, ::-1] if array.falling else frames
    else:
        arrays["intensity"] = intensities = file.numbers(fields.INTENSITIES)
        count = intensities.size
    if file.has(fields.ANGLES):
        arrays["angle_deg"] = file.numbers(fields.ANGLES)
    if numbers_of(file, fields.TIMES).size:
        # Seconds since 1970.
        arrays |= {"started_s": one_each(file, fields.TIMES, count), "clock_zero_unix_s": np.array(0.0)}
    facts = read_facts(file, pitch_m=pitch_m)
    known = {name: getattr(facts, name) for name in NUMERIC_FACTS} | _energies(path, file, count) | arrays
    return {name: np.asarray(value) for name, value in known.items() if value is not None}


def _energies(path: Path, file: CheckedHdf5, count: int) -> dict[str, object]:
    """Usual energy of a pulse, and ``energy`` of each measurement where they differ, NaN where it was not measured."""
    joules = numbers_of(file, fields.PULSE_ENERGY)
    joules = np.where(np.isfinite(joules) & (joules > 0), joules, np.nan)
    known = joules[np.isfinite(joules)]
    if not known.size or np.ptp(known) == 0:
        return {"pulse_energy_j": known[0] if known.size else None}
    if joules.size != count:
        warnings.warn(
            f"{path}: {fields.PULSE_ENERGY} holds {joules.size} energies for {count} measurements, and only their mean "
            "is used; give one for each",
            stacklevel=4,
        )
    return {"pulse_energy_j": known.mean(), "energy": joules if joules.size == count else None}


def walk_bank(path: Path) -> None:
    """Read a bank's metadata, the index of its chunks and its first frame."""
    # A missing library must not be reported as damage of the file.
    require_h5py()
    bank = read_probed(path)
    if isinstance(bank, IpascBank):
        with as_bank_error(path):
            for name in (fields.FRAMES, fields.DARK_FRAMES)[: 2 if bank.dark_frames else 1]:
                data = bank.file.dataset(name)
                if data.chunks is not None:
                    data.id.chunk_iter(lambda _place: None)
        bank.frame(0)


def as_bank_error(path: Path) -> AbstractContextManager[None]:
    """Errors of the library as those of a bank."""
    cure = "it is damaged, or of another kind: take it from a backup or scan again"
    return as_record_error(path, what="bank in HDF5", cure=cure)


def _is_ours(path: Path, file: CheckedHdf5) -> bool:
    """Whether markerseek wrote the file; refuses a newer version."""
    version = file.number(fields.VERSION)
    if version is not None and version != fields.BANK_VERSION:
        raise RecordError(
            f"{path}: it was written by a newer markerseek: the bank has version {version:g}, this one reads "
            f"{fields.BANK_VERSION}; install a newer one"
        )
    return version is not None


def _frame_shape(path: Path, file: CheckedHdf5, count: int) -> tuple[int, int] | None:
    """Elements and samples of the frames; None if there are none."""
    if not file.has(fields.FRAMES):
        return None
    shape = file.dataset(fields.FRAMES).shape
    if len(shape) != 4 or shape[2:] != (1, count):
        raise RecordError(
            f"{path}: {fields.FRAMES} has the shape {shape}, (elements, samples, 1, {count}) is expected: "
            "one wavelength, and one measurement for each angle"
        )
    return None if 0 in shape else (shape[0], shape[1])


def _dark_frames(file: CheckedHdf5, frames: tuple[int, int]) -> int:
    """Number of dark frames that can be read."""
    if not file.has(fields.DARK_FRAMES):
        return 0
    shape: tuple[int, ...] = file.dataset(fields.DARK_FRAMES).shape
    if shape[:2] != frames or not 2 <= len(shape) <= 3:
        raise ValueError(f"{fields.DARK_FRAMES} has the shape {shape}")
    return 1 if len(shape) == 2 else shape[2]


def _numbers(file: CheckedHdf5, name: str, row: int) -> Int16[np.ndarray, "channels samples"]:
    """One frame."""
    data = file.dataset(name)
    elements, samples = data.shape[:2]
    if data.dtype.newbyteorder("=") != np.int16:
        raise ValueError(f"{name} is {data.dtype}, int16 is expected")
    file.require_room(elements * samples * data.dtype.itemsize, name=name)
    place = {2: np.s_[:, :], 3: np.s_[:, :, row], 4: np.s_[:, :, 0, row]}[data.ndim]
    return np.ascontiguousarray(data[place], dtype=np.int16)
