"""Reads banks in IPASC HDF5, ours and other people's, one frame at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int16

from markerseek.core import ChannelFrame, FrameHeader, RecordError
from markerseek.records import ipasc_fields as fields
from markerseek.records._hdf5 import CarefulFile, opened
from markerseek.records._ordinary import ordinary_size
from markerseek.records._vetting import vet
from markerseek.records.banks import BankFacts, FrameBank, IntensityBank, require_angles

_LARGEST_BYTES = 1 << 42
_MOST_ANGLES = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class IpascBank(FrameBank):
    """Frames in an IPASC HDF5 file.

    Attributes
    ----------
    path
        The file.
    rows
        Number of the measurement in the file for each angle.
    room
        Measurements that the file has room for.
    pulses
        Laser pulses averaged in each; 1 where the file does not say.
    started_s
        When each began, on the rig's clock in seconds; 0 where the file does not say.
    """

    path: Path
    rows: tuple[int, ...] = field(repr=False)
    room: int
    pulses: tuple[int, ...] = field(repr=False)
    started_s: tuple[float, ...] = field(repr=False)

    @property
    def planned(self) -> int:
        """Angles that the scan was to have: more than there are where its process was killed."""
        return self.room

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, from the disk.

        Raises
        ------
        RecordError
            If they cannot be read, or are no ADC counts.
        """
        return self._frame(
            fields.FRAMES,
            self.rows[index],
            angle_deg=self.angles_deg[index],
            pulses=self.pulses[index],
            started_s=self.started_s[index],
        )

    def dark_frame(self, index: int) -> ChannelFrame:
        """One frame without laser, from the disk; `RecordError` where it cannot be read."""
        if not 0 <= index < self.dark_frames:
            raise RecordError(f"{self.path}: there is no dark frame {index + 1}, it holds {self.dark_frames}")
        return self._frame(fields.DARK_FRAMES, index, angle_deg=0.0, pulses=0, started_s=0.0)

    def _frame(self, name: str, row: int, *, angle_deg: float, pulses: int, started_s: float) -> ChannelFrame:
        if self.facts.sampling_hz is None:
            raise RecordError(f"{self.path}: {fields.SAMPLING} is missing; its frames cannot be read without it")
        with opened(self.path) as file:
            samples = _counts(file, name, row)
        header = FrameHeader(
            sequence=row + 1,
            token=self.path.name,
            pulses=pulses,
            commanded_deg=angle_deg,
            started_s=started_s,
            ended_s=started_s,
        )
        return ChannelFrame(header=header, samples=samples, sampling_hz=self.facts.sampling_hz)


def read_ipasc(path: Path) -> IntensityBank | IpascBank:
    """Bank in an IPASC HDF5 file that holds ``trus_angle_deg``; its frames stay on disk.

    Measurements of a scan that was cut short are passed over where they were not taken. A file without
    ``markerseek_bank_version`` is taken as somebody else's, and read if it has the angles.

    Raises
    ------
    RecordError
        If it is damaged, of a newer version, or no bank.
    MissingExtraError
        If h5py is not installed.
    """
    try:
        ordinary_size(path, most=_LARGEST_BYTES)
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror or problem}") from problem
    vet(path)
    return read_unvetted(path)


def read_unvetted(path: Path) -> IntensityBank | IpascBank:
    """The same of a file that is known to do no harm."""
    with opened(path) as file:
        _require_version(path, file)
        if not file.has(fields.ANGLES):
            raise RecordError(f"{path}: {fields.ANGLES} is missing; without the angles it is no bank of a scan")
        angles = file.numbers(fields.ANGLES)
        if angles.size > _MOST_ANGLES:
            raise RecordError(f"{path}: it has room for {angles.size} angles, at most {_MOST_ANGLES} are expected")
        taken = np.flatnonzero(np.isfinite(angles))
        rows = taken[np.argsort(angles[taken], kind="stable")]
        ordered = angles[rows]
        require_angles(path, ordered.tolist())
        intensities = _intensities(path, file, angles.size)[rows]
        facts = _facts(file)
        frames = _frame_shape(path, file, angles.size)
        if frames is None:
            if not np.isfinite(intensities).all():
                raise RecordError(f"{path}: it holds neither frames nor an intensity for each angle")
            return IntensityBank(
                angles_deg=tuple(ordered.tolist()), intensities=tuple(intensities.tolist()), facts=facts
            )
        return IpascBank(
            angles_deg=tuple(ordered.tolist()),
            intensities=tuple(intensities.tolist()) if np.isfinite(intensities).any() else (),
            facts=facts,
            dark_frames=_dark_frames(file, frames),
            path=path,
            rows=tuple(rows.tolist()),
            room=angles.size,
            pulses=tuple(int(each) for each in _known(file, fields.PULSES, angles.size, otherwise=1.0)[rows]),
            started_s=tuple(_known(file, fields.TIMES, angles.size, otherwise=0.0)[rows].tolist()),
        )


def walk_frames(bank: IntensityBank | IpascBank) -> None:
    """Go through the places of all frames in the file without reading them."""
    if isinstance(bank, IpascBank):
        with opened(bank.path) as file:
            for name in (fields.FRAMES, fields.DARK_FRAMES)[: 2 if bank.dark_frames else 1]:
                data = file.dataset(name)
                if data.chunks is not None:
                    data.id.chunk_iter(lambda _place: None)
        bank.frame(0)


def _require_version(path: Path, file: CarefulFile) -> None:
    version = file.number(fields.VERSION)
    if version is not None and not 1 <= version <= fields.BANK_VERSION:
        raise RecordError(
            f"{path}: it is a bank of version {version:g}, this markerseek reads up to {fields.BANK_VERSION}; "
            "install a newer markerseek"
        )


def _intensities(path: Path, file: CarefulFile, count: int) -> Float64[np.ndarray, " planned"]:
    if not file.has(fields.INTENSITIES):
        return np.full(count, np.nan)
    values = file.numbers(fields.INTENSITIES)
    if values.size != count:
        raise RecordError(f"{path}: {values.size} intensities for {count} angles; the file is damaged: scan again")
    if not (values[np.isfinite(values)] >= 0).all():
        raise RecordError(f"{path}: an intensity is negative; the file is damaged: scan again")
    return np.where(np.isfinite(values), values, np.nan)


def _known(file: CarefulFile, name: str, count: int, *, otherwise: float) -> Float64[np.ndarray, " planned"]:
    """One number for each measurement, with another in the place of those that are missing."""
    values = file.numbers(name) if file.has(name) and file.text(name) is None else np.empty(0)
    if values.size not in (0, count):
        raise ValueError(f"{name} holds {values.size} numbers for {count} angles")
    values = values if values.size else np.full(count, otherwise)
    return np.where(np.isfinite(values) & (values >= 0), values, otherwise)


def _frame_shape(path: Path, file: CarefulFile, count: int) -> tuple[int, int] | None:
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


def _dark_frames(file: CarefulFile, frames: tuple[int, int]) -> int:
    """Number of dark frames that can be read."""
    if not file.has(fields.DARK_FRAMES):
        return 0
    shape: tuple[int, ...] = file.dataset(fields.DARK_FRAMES).shape
    if shape[:2] != frames or not 2 <= len(shape) <= 3:
        raise ValueError(f"{fields.DARK_FRAMES} has the shape {shape}")
    room = 1 if len(shape) == 2 else shape[2]
    taken = file.number(fields.DARK_TAKEN)
    return room if taken is None else max(0, min(int(taken), room))


def _counts(file: CarefulFile, name: str, row: int) -> Int16[np.ndarray, "channels samples"]:
    """One frame as ADC counts."""
    data = file.dataset(name)
    elements, samples = data.shape[:2]
    if data.dtype.kind not in "iuf" or data.dtype.itemsize > 8:
        raise ValueError(f"{name} is {data.dtype}, ADC counts are expected")
    file.require_room(elements * samples * data.dtype.itemsize, name=name)
    place = {2: np.s_[:, :], 3: np.s_[:, :, row], 4: np.s_[:, :, 0, row]}[data.ndim]
    values = np.asarray(data[place])
    with np.errstate(invalid="ignore"):
        counts = values.astype(np.int16)
    if not np.array_equal(counts, values):
        raise ValueError(f"{name} holds numbers that are no int16 counts")
    return counts


def _facts(file: CarefulFile) -> BankFacts:
    return BankFacts(
        description=file.text(fields.DESCRIPTION) or "",
        probe=file.text(fields.PROBE),
        sampling_hz=_positive(file, fields.SAMPLING),
        sound_speed_m_s=_positive(file, fields.SOUND_SPEED),
        pitch_m=_pitch_m(file),
        wavelength_m=_first(file, fields.WAVELENGTH),
        pulse_energy_j=_first(file, fields.PULSE_ENERGY),
        face_radius_m=_positive(file, fields.FACE_RADIUS),
        reference_angle_deg=file.number(fields.REFERENCE),
    )


def _positive(file: CarefulFile, name: str) -> float | None:
    value = file.number(name)
    if value is not None and value <= 0:
        raise ValueError(f"{name} is {value:g}, it must be positive")
    return value


def _first(file: CarefulFile, name: str) -> float | None:
    """The first of the numbers; None where there is none, or pacfish wrote that there is none."""
    if not file.has(name) or file.text(name) == "None":
        return None
    values = file.numbers(name)
    return float(values[0]) if values.size and math.isfinite(values[0]) else None


def _pitch_m(file: CarefulFile) -> float | None:
    """Distance of the first two elements, where the file says where they are."""
    names = [f"{fields.DETECTORS}/{number:010d}/detector_position" for number in (0, 1)]
    if not all(file.has(name) for name in names):
        return None
    first, second = (file.numbers(name) for name in names)
    if first.size != 3 or second.size != 3:
        raise ValueError(f"{fields.DETECTORS} holds positions of {first.size} numbers, three are expected")
    distance = float(np.linalg.norm(second - first))
    return distance if math.isfinite(distance) and distance > 0 else None
