"""Reads banks in IPASC HDF5, our own and those of other programs, one frame at a time."""

from __future__ import annotations

import math
import re
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from markerseek.core import ChannelFrame, FrameHeader, Int16, RecordError
from markerseek.records.banks.bank import FrameBank, IntensityBank
from markerseek.records.banks.counts import EXACT, Scaling, as_counts, scaling_of
from markerseek.records.banks.ipasc import fields
from markerseek.records.banks.ipasc.columns import Columns, element_row, read_columns, read_facts
from markerseek.records.hdf5 import CheckedHdf5, as_record_error, require_h5py


@dataclass(frozen=True, slots=True, kw_only=True)
class IpascBank(FrameBank):
    """Frames in an IPASC HDF5 file."""

    path: Path
    file: CheckedHdf5 = field(repr=False, compare=False)
    columns: Columns = field(repr=False)
    """What the file says of each angle, with its row; ``pulses`` are 1 where it does not."""
    falling: bool = False
    """Whether the elements are in reverse order in the file."""
    checked: bool = False
    """Whether the library compares the frames with checksums in the file."""
    scaling: Scaling = EXACT
    """How the numbers of another program become counts."""

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, from the disk.

        Raises `RecordError` if they cannot be read.
        """
        angle_deg, row = self.angles_deg[index], self.columns.rows[index]
        samples = self._samples(fields.FRAMES, row, what=f"frame at {angle_deg:g} deg")
        energy = self.columns.energies[index]
        return self._frame(
            samples,
            row,
            angle_deg=angle_deg,
            pulses=self.pulses[index],
            started_s=self.started_s[index],
            energy=None if math.isnan(energy) else energy,
        )

    def dark_frame(self, index: int) -> ChannelFrame:
        """One frame without laser, from the disk; `RecordError` where it cannot be read."""
        if not 0 <= index < self.dark_frames:
            raise RecordError(f"{self.path}: there is no dark frame {index + 1}, it holds {self.dark_frames}")
        samples = self._samples(fields.DARK_FRAMES, index, what=f"dark frame {index + 1}")
        return self._frame(samples, index, angle_deg=0.0, pulses=0, started_s=math.nan)

    def _samples(self, name: str, row: int, *, what: str) -> Int16[np.ndarray, "channels samples"]:
        with as_bank_error(self.path):
            try:
                samples = as_counts(self.path, _numbers(self.file, name, row), self.scaling)
            except OSError as problem:
                # HDF5 has no error of its own for a checksum: only its text says that the filter found it.
                if not self.checked or not re.search("(?i)filter returned failure|fletcher32 checksum", str(problem)):
                    raise
                raise RecordError(
                    f"{self.path}: the {what} has changed since it was written, its checksum differs; take the file "
                    "from a backup or scan again"
                ) from problem
        return np.ascontiguousarray(samples[::-1]) if self.falling else samples

    def _frame(
        self,
        samples: Int16[np.ndarray, "channels samples"],
        row: int,
        *,
        angle_deg: float,
        pulses: int,
        started_s: float,
        energy: float | None = None,
    ) -> ChannelFrame:
        if self.facts.sampling_hz is None:
            raise RecordError(f"{self.path}: {fields.SAMPLING} is missing; its frames cannot be read without it")
        header = FrameHeader(
            sequence=row + 1,
            token=self.path.name,
            pulses=pulses,
            commanded_deg=angle_deg,
            started_s=started_s,
            ended_s=started_s,
            energy=energy,
        )
        return ChannelFrame(header=header, samples=samples, sampling_hz=self.facts.sampling_hz)


def read_probed(path: Path, *, blanked: int = 0) -> IntensityBank | IpascBank:
    """Bank in an IPASC HDF5 file that holds ``trus_angle_deg``; its frames stay on disk.

    A file without ``markerseek_bank_version`` was written by another program, and is read if it has the angles. The
    file has been tried in a child before (`walk_bank`). ``blanked``: as of `read_bank`.
    """
    with as_bank_error(path), ExitStack() as closing:
        bank = _bank_of(path, closing.enter_context(CheckedHdf5(path)), blanked)
        # A bank of intensities is in memory by now; one of frames reads them from the open file.
        if isinstance(bank, IpascBank):
            closing.pop_all()
        return bank


def _bank_of(path: Path, file: CheckedHdf5, blanked: int) -> IntensityBank | IpascBank:
    ours = _is_ours(path, file)
    if not file.has(fields.ANGLES):
        raise RecordError(f"{path}: {fields.ANGLES} is missing; without the angles it is no bank of a scan")
    columns = read_columns(path, file, ours=ours)
    frames = _frame_shape(path, file, len(columns.rows))
    if frames is None:
        if not all(map(math.isfinite, columns.intensities)):
            raise RecordError(f"{path}: it holds neither frames nor an intensity for each angle")
        facts = read_facts(file, ours=ours, pitch_m=None)
        started_s = columns.started_s if any(map(math.isfinite, columns.started_s)) else ()
        return IntensityBank(
            angles_deg=columns.angles_deg, intensities=columns.intensities, started_s=started_s, facts=facts
        )
    array = element_row(path, file, elements=frames[0])
    return IpascBank(
        angles_deg=columns.angles_deg,
        intensities=columns.intensities if any(map(math.isfinite, columns.intensities)) else (),
        facts=read_facts(file, ours=ours, pitch_m=array.pitch_m),
        dark_frames=_dark_frames(file, frames),
        started_s=columns.started_s,
        pulses=columns.pulses,
        path=path,
        file=file,
        columns=columns,
        falling=array.falling,
        checked=bool(file.dataset(fields.FRAMES).fletcher32),
        scaling=_scaling(path, file, len(columns.rows), blanked),
    )


def arrays_without_angles(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Frames of another program's file without the angles, named as `markerseek.records.banks.arrays` reads them.

    Nothing for a file that has the angles, or no frames.
    """
    if file.has(fields.ANGLES) or not file.has(fields.FRAMES):
        return {}
    data = file.dataset(fields.FRAMES)
    # Pacfish drops the last axes where they have the length 1.
    shape = (*data.shape, 1, 1)[: max(4, data.ndim)]
    if len(shape) != 4 or shape[2] != 1 or 0 in shape:
        raise RecordError(
            f"{path}: {fields.FRAMES} has the shape {data.shape}, (elements, samples, 1, measurements) is expected; "
            "save the measurements of one wavelength alone"
        )
    file.require_room(math.prod(shape) * data.dtype.itemsize, name=fields.FRAMES)
    array = element_row(path, file, elements=shape[0])
    frames = np.asarray(data[()]).reshape(shape)[:, :, 0, :].transpose(2, 0, 1)
    facts = read_facts(file, ours=False, pitch_m=array.pitch_m)
    known = {
        "sampling_hz": facts.sampling_hz,
        "sound_speed_m_s": facts.sound_speed_m_s,
        "pitch_m": facts.pitch_m,
        "wavelength_m": facts.wavelength_m,
    }
    return {
        "frames": frames[:, ::-1] if array.falling else frames,
        **{name: np.array(value) for name, value in known.items() if value is not None},
    }


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
    """Elements and samples of the frames; None where there are none."""
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


def _scaling(path: Path, file: CheckedHdf5, count: int, blanked: int) -> Scaling:
    """How the frames become counts; all of them are read only if they are not int16."""
    if file.dataset(fields.FRAMES).dtype.newbyteorder("=") == np.int16:
        return EXACT
    return scaling_of(path, (_numbers(file, fields.FRAMES, row) for row in range(count)), blanked=blanked)


def _numbers(file: CheckedHdf5, name: str, row: int) -> np.ndarray:
    """One frame in the type that it has, (channels, samples)."""
    data = file.dataset(name)
    elements, samples = data.shape[:2]
    if data.dtype.kind not in "iuf" or data.dtype.itemsize > 8:
        raise ValueError(f"{name} is {data.dtype}, real numbers are expected")
    file.require_room(elements * samples * data.dtype.itemsize, name=name)
    place = {2: np.s_[:, :], 3: np.s_[:, :, row], 4: np.s_[:, :, 0, row]}[data.ndim]
    return np.asarray(data[place])
