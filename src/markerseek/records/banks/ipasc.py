"""Reads banks in IPASC HDF5: our own one frame at a time, and the arrays of files of other programs.

The names of its fields are the standard ones, and our own under ``meta_data``; `ipasc_writer` writes them.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from markerseek.core import ChannelFrame, Float64, FrameHeader, Int16, RecordError
from markerseek.files import DEGREES
from markerseek.records.banks.bank import NUMERIC_FACTS, BankFacts, FrameBank, IntensityBank, in_rising_order, silenced
from markerseek.records.banks.table import amplitudes
from markerseek.records.hdf5 import CheckedHdf5, as_record_error
from markerseek.records.notes import note

BANK_VERSION = 1
"""Version of our own fields; a reader refuses a newer one."""

FRAMES_PATH = "binary_time_series_data"
DARK_FRAMES_PATH = "meta_data/dark_time_series_data"
"""Channel data of (elements, samples, wavelengths, measurements); without laser of (elements, samples, frames).

When it reads, pacfish drops axes of length 1 of every dataset but the first.
"""

VERSION_PATH = "meta_data/markerseek_bank_version"
ANGLES = "meta_data/trus_angle_deg"
INTENSITIES = "meta_data/intensity"
REFERENCE = "meta_data/reference_angle_deg"
PULSES_PATH = "meta_data/pulses"
ENERGY = "meta_data/energy_over_usual"
"""Energy of the pulses of each measurement as in `FrameHeader`, by which its intensity has been divided; NaN where it
was not measured. `PULSE_ENERGY` has it in joules too, where that of a usual pulse is known."""
TIMES = "meta_data/measurement_timestamps"
RIG_CLOCK = "meta_data/rig_clock_s"
CLOCK_ZERO = "meta_data/clock_zero_unix_s"
"""When a measurement began: since 1970, and on the rig's clock; and when that read 0, since 1970. All in seconds."""

POSES = "meta_data/measurement_spatial_poses"
FACE_RADIUS = "meta_data/trus_face_radius_m"
PROBE_PATH = "meta_data/probe_preset"
DESCRIPTION = "meta_data/description"
PROBE_SETTINGS = "meta_data/probe_settings"
SIMULATED = "meta_data/simulated"
CONFIGURATION = "meta_data/configuration_fingerprint"
SEED = "meta_data/seed"
MADE_WITH = "meta_data/made_with"
FIRST_SAMPLE = "meta_data/first_sample_s"
SAMPLING = "meta_data/ad_sampling_rate"
SOUND_SPEED_PATH = "meta_data/speed_of_sound"
WAVELENGTH = "meta_data/acquisition_wavelengths"
PULSE_ENERGY = "meta_data/pulse_energy"
SIZES = "meta_data/sizes"
DEVICE = "meta_data_device"
DETECTORS = f"{DEVICE}/detectors"

TEXT_PATHS = {
    "description": DESCRIPTION,
    "probe": PROBE_PATH,
    "probe_settings": PROBE_SETTINGS,
    "configuration": CONFIGURATION,
    "made_with": MADE_WITH,
}
"""Fields of the facts that are texts."""

NUMBER_PATHS = {
    "sampling_hz": SAMPLING,
    "first_sample_s": FIRST_SAMPLE,
    "sound_speed_m_s": SOUND_SPEED_PATH,
    "face_radius_m": FACE_RADIUS,
    "reference_angle_deg": REFERENCE,
    "clock_zero_unix_s": CLOCK_ZERO,
}
"""Fields of the facts that are numbers."""

_RANGES = {
    SAMPLING: (1e5, 1e9, "Hz"),
    FIRST_SAMPLE: (0.0, 1e-3, "s"),
    SOUND_SPEED_PATH: (300.0, 7000.0, "m/s"),
    FACE_RADIUS: (0.0, 1.0, "m"),
}
"""Physical ranges of such numbers, and the unit in which they are written."""

_OFF_AXIS_RAD = 1e-3
_POSE_DIGITS = 5
"""Largest rotation of a pose about another axis than the array's; decimals of an angle: poses may be float32."""

# In digits: int() of a longer text takes time with the square of its length.
_LONGEST_SEED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class IpascBank(FrameBank):
    """Frames in an IPASC HDF5 file."""

    path: Path
    rows: tuple[int, ...] = field(repr=False)
    """Row in the file of each angle."""
    falling: bool = False
    """Whether the elements are in reverse order in the file."""

    def frame(self, index: int) -> ChannelFrame:
        """Return the channel data of one angle, from the disk.

        Raises `RecordError` if they cannot be read.
        """
        row = self.rows[index]
        header = self.header(index, token=self.path.name, row=row)
        return self._frame(header, FRAMES_PATH, row, what=f"frame at {header.commanded_deg:g} deg")

    def dark_frame(self, index: int) -> ChannelFrame:
        """Return one frame without laser, from the disk; `RecordError` where it cannot be read."""
        if not 0 <= index < self.dark_frames:
            return FrameBank.dark_frame(self, index)
        header = FrameHeader(
            sequence=index + 1, token=self.path.name, pulses=0, commanded_deg=0.0, started_s=math.nan, ended_s=math.nan
        )
        return self._frame(header, DARK_FRAMES_PATH, index, what=f"dark frame {index + 1}")

    def _frame(self, header: FrameHeader, name: str, row: int, *, what: str) -> ChannelFrame:
        cure = "it has changed since it was written: take the file from a backup or scan again"
        with as_record_error(self.path, what=what, cure=cure), CheckedHdf5(self.path) as file:
            samples = _numbers(file, name, row)
        if self.facts.sampling_hz is None:
            raise RecordError(f"{self.path}: {SAMPLING} is missing; its frames cannot be read without it")
        samples = silenced(np.ascontiguousarray(samples[::-1]) if self.falling else samples, self.left_out)
        return ChannelFrame(header=header, samples=samples, sampling_hz=self.facts.sampling_hz)


def read_probed(path: Path) -> IntensityBank | IpascBank:
    """Return the bank of ours in an IPASC HDF5 file; its frames stay on disk.

    The file has been tried in a child before (`walk_bank`).
    """
    with as_bank_error(path), CheckedHdf5(path) as file:
        return _bank_of(path, file)


def _bank_of(path: Path, file: CheckedHdf5) -> IntensityBank | IpascBank:
    if not file.has(ANGLES):
        raise RecordError(f"{path}: {ANGLES} is missing; without the angles it is no bank of a scan")
    angles_deg, order = in_rising_order(path, file.numbers(ANGLES, units=DEGREES))
    count = len(angles_deg)

    def column(name: str, otherwise: float = math.nan) -> tuple[float, ...]:
        return tuple(_one_each(file, name, count, otherwise=otherwise)[order].tolist())

    intensities = column(INTENSITIES)
    started_s = column(RIG_CLOCK)
    known = np.array([each for each in intensities if math.isfinite(each)])
    amplitudes(known, db=False, where=lambda _index: str(path))
    frames = _frame_shape(path, file, count)
    if frames is None:
        if known.size < count:
            raise RecordError(f"{path}: it holds neither frames nor an intensity for each angle")
        return IntensityBank(
            angles_deg=angles_deg,
            intensities=intensities,
            started_s=started_s if any(map(math.isfinite, started_s)) else (),
            facts=_read_facts(path, file, pitch_m=None),
        )
    array = element_row(path, file, elements=frames[0])
    return IpascBank(
        angles_deg=angles_deg,
        intensities=intensities if known.size else (),
        facts=_read_facts(path, file, pitch_m=array.pitch_m),
        dark_frames=_dark_frames(file, frames),
        started_s=started_s,
        pulses=tuple(int(each) if each >= 0 else 1 for each in column(PULSES_PATH, 1.0)),
        energies=column(ENERGY),
        path=path,
        rows=tuple(order.tolist()),
        falling=array.falling,
    )


def _one_each(
    file: CheckedHdf5, name: str, count: int, *, otherwise: float = math.nan
) -> Float64[np.ndarray, " angles"]:
    """Return one number for each measurement, missing ones replaced by `otherwise`."""
    values = _numbers_of(file, name)
    if values.size not in (0, count):
        raise ValueError(f"{name} holds {values.size} numbers for {count} angles")
    values = values if values.size else np.full(count, otherwise)
    return np.where(np.isfinite(values), values, otherwise)


def _read_facts(path: Path, file: CheckedHdf5, *, pitch_m: float | None) -> BankFacts:
    """Return the metadata of a bank.

    Raises `ValueError` if a field does not hold what it should, `RecordError` for a number out of its range.
    """
    known: dict[str, object] = {fact: file.text(name) for fact, name in TEXT_PATHS.items()}
    for fact, name in NUMBER_PATHS.items():
        known[fact] = value = file.number(name)
        low, high, unit = _RANGES.get(name, (-math.inf, math.inf, ""))
        if value is not None and not low <= value <= high:
            # Rarely a flipped bit, as a rule another unit, such as km/s.
            raise RecordError(
                f"{path}: {name} is {value:g} {unit}, it must lie between {low:g} and {high:g} {unit}; write it in "
                f"{unit}"
            )
    simulated = file.number(SIMULATED)
    seed = file.text(SEED)
    wavelength_m = _first(file, WAVELENGTH)
    known |= {
        "description": known["description"] or "",
        "pitch_m": pitch_m,
        # Some programs write nanometres.
        "wavelength_m": wavelength_m and wavelength_m * (1e-9 if wavelength_m >= 1.0 else 1.0),
        "pulse_energy_j": _usual_energy_j(file),
        "simulated": None if simulated is None else simulated != 0,
        "seed": int(seed) if seed is not None and seed.isdecimal() and len(seed) <= _LONGEST_SEED else None,
    }
    return msgspec.convert(known, BankFacts)


def _usual_energy_j(file: CheckedHdf5) -> float | None:
    """Return the energy of a usual pulse in joules: the first, without what it had more or less than a usual one."""
    joules = _first(file, PULSE_ENERGY)
    if joules is None or not joules > 0:
        return None
    # Where the energy over the usual one was not measured, that of a usual pulse is written.
    return joules / (_first(file, ENERGY) or 1.0)


def _numbers_of(file: CheckedHdf5, name: str) -> Float64[np.ndarray, " values"]:
    """Return the numbers of a dataset; none if it is missing, or the text ``None`` that pacfish writes."""
    return file.numbers(name) if file.has(name) and file.text(name) is None else np.empty(0)


def _first(file: CheckedHdf5, name: str) -> float | None:
    """Return the first number of a dataset; None if it has none, or no finite one."""
    values = _numbers_of(file, name)
    return float(values[0]) if values.size and math.isfinite(values[0]) else None


def arrays_of_others(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Return the frames or intensities of another program's file, named as `read_arrays` takes them.

    Nothing for a file of ours, or one with neither. Pulse energies that differ come as ``energy``.
    """
    if _is_ours(path, file) or not (file.has(FRAMES_PATH) or file.has(INTENSITIES)):
        return {}
    arrays: dict[str, object] = {}
    pitch_m = None
    if file.has(FRAMES_PATH):
        data = file.dataset(FRAMES_PATH)
        # Pacfish drops the last axes where they have the length 1.
        shape = (*data.shape, 1, 1)[: max(4, data.ndim)]
        if len(shape) != 4 or shape[2] != 1 or 0 in shape:
            raise RecordError(
                f"{path}: {FRAMES_PATH} has the shape {data.shape}, (elements, samples, 1, measurements) is "
                "expected; save the measurements of one wavelength alone"
            )
        array = element_row(path, file, elements=shape[0])
        pitch_m = array.pitch_m
        count = shape[3]
        frames = file.values(data, name=FRAMES_PATH).reshape(shape)[:, :, 0, :].transpose(2, 0, 1)
        arrays["frames"] = frames[:, ::-1] if array.falling else frames
    else:
        arrays["intensity"] = intensities = file.numbers(INTENSITIES)
        count = intensities.size
    if file.has(ANGLES):
        arrays["angle_deg"] = file.numbers(ANGLES, units=DEGREES)
    else:
        arrays["angle_deg"] = _angles_of_poses(path, file, count)
    if _numbers_of(file, TIMES).size:
        # Seconds since 1970.
        arrays |= {"started_s": _one_each(file, TIMES, count), "clock_zero_unix_s": np.array(0.0)}
    facts = _read_facts(path, file, pitch_m=pitch_m)
    known = {name: getattr(facts, name) for name in NUMERIC_FACTS} | _energies(path, file, count) | arrays
    return {name: np.asarray(value) for name, value in known.items() if value is not None}


def _angles_of_poses(path: Path, file: CheckedHdf5, count: int) -> Float64[np.ndarray, " measurements"] | None:
    """Return the angle of each measurement by its pose, in degrees; None if poses are not stated, or all are alike.

    A pose is a position and the rotations about x1, along the array, x2 and x3, in radians.
    """
    values = _numbers_of(file, POSES)
    if not values.size or not np.isfinite(values).all():
        return None
    if values.size != 6 * count:
        raise RecordError(
            f"{path}: {POSES} holds {values.size} numbers for {count} measurements, 6 for each are expected"
        )
    about_rad = values.reshape(count, 6)[:, 3:]
    if not np.ptp(about_rad):
        return None
    others_rad = float(np.abs(about_rad[:, 1:]).max())
    if others_rad > _OFF_AXIS_RAD:
        raise RecordError(
            f"{path}: {POSES} turns about another axis than x1, that of the array, by up to "
            f"{math.degrees(others_rad):.3g} deg; give poses in the frame of the array at 0 deg, or "
            "meta_data/trus_angle_deg"
        )
    if np.abs(about_rad).max() > 2 * math.pi:
        raise RecordError(
            f"{path}: {POSES} turns by up to {np.abs(about_rad).max():.4g} rad; write radians, within a turn"
        )
    note(path, f"its angles are the rotations about x1 of {POSES}, and count from the pose without rotation")
    return np.asarray(np.round(np.degrees(about_rad[:, 0]), _POSE_DIGITS))


def _energies(path: Path, file: CheckedHdf5, count: int) -> dict[str, object]:
    """Return the usual energy of a pulse, and that of each measurement where they differ; NaN: not measured."""
    joules = _numbers_of(file, PULSE_ENERGY)
    joules = np.where(np.isfinite(joules) & (joules > 0), joules, np.nan)
    known = joules[np.isfinite(joules)]
    if not known.size or np.ptp(known) == 0:
        return {"pulse_energy_j": known[0] if known.size else None}
    if joules.size != count:
        note(
            path,
            f"{PULSE_ENERGY} holds {joules.size} energies for {count} measurements, and only their mean "
            "is used; give one for each",
        )
    return {"pulse_energy_j": known.mean(), "energy": joules if joules.size == count else None}


def walk_bank(path: Path) -> None:
    """Read a bank's metadata, the index of its chunks and its first frame."""
    bank = read_probed(path)
    if isinstance(bank, IpascBank):
        with as_bank_error(path), CheckedHdf5(path) as file:
            for name in (FRAMES_PATH, DARK_FRAMES_PATH)[: 2 if bank.dark_frames else 1]:
                data = file.dataset(name)
                if data.chunks is not None:
                    data.id.chunk_iter(lambda _place: None)
        bank.frame(0)


def as_bank_error(path: Path) -> AbstractContextManager[None]:
    """Return a context in which the errors of the library become those of a bank."""
    cure = "it is damaged, or of another kind: take it from a backup or scan again"
    return as_record_error(path, what="bank in HDF5", cure=cure)


def _is_ours(path: Path, file: CheckedHdf5) -> bool:
    """Return whether markerseek wrote the file; refuses a newer version."""
    version = file.number(VERSION_PATH)
    if version is not None and version != BANK_VERSION:
        raise RecordError(
            f"{path}: it was written by a newer markerseek: the bank has version {version:g}, this one reads "
            f"{BANK_VERSION}; install a newer one"
        )
    return version is not None


def _frame_shape(path: Path, file: CheckedHdf5, count: int) -> tuple[int, int] | None:
    """Return the elements and samples of the frames; None if there are none."""
    if not file.has(FRAMES_PATH):
        return None
    shape = file.dataset(FRAMES_PATH).shape
    if len(shape) != 4 or shape[2:] != (1, count):
        raise RecordError(
            f"{path}: {FRAMES_PATH} has the shape {shape}, (elements, samples, 1, {count}) is expected: "
            "one wavelength, and one measurement for each angle"
        )
    return None if 0 in shape else (shape[0], shape[1])


def _dark_frames(file: CheckedHdf5, frames: tuple[int, int]) -> int:
    """Return the number of dark frames that can be read."""
    if not file.has(DARK_FRAMES_PATH):
        return 0
    shape: tuple[int, ...] = file.dataset(DARK_FRAMES_PATH).shape
    if shape[:2] != frames or not 2 <= len(shape) <= 3:
        raise ValueError(f"{DARK_FRAMES_PATH} has the shape {shape}")
    return 1 if len(shape) == 2 else shape[2]


def _numbers(file: CheckedHdf5, name: str, row: int) -> Int16[np.ndarray, "channels samples"]:
    """Return one frame."""
    data = file.dataset(name)
    if data.dtype.newbyteorder("=") != np.int16:
        raise ValueError(f"{name} is {data.dtype}, int16 is expected")
    place = {2: np.s_[:, :], 3: np.s_[:, :, row], 4: np.s_[:, :, 0, row]}[data.ndim]
    return np.ascontiguousarray(data[place], dtype=np.int16)


TOLERANCE = 0.01
"""Largest distance of an element from its place in the row, in pitches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementRow:
    """A straight row of equally spaced elements."""

    pitch_m: float | None
    """Distance from one element to the next; None if the file does not say where they are."""
    falling: bool
    """Whether the x1 coordinate falls from the first element in the file to the last."""


def element_row(path: Path, file: CheckedHdf5, *, elements: int) -> ElementRow:
    """Return the pitch and direction of the array, from the positions of all its elements."""
    names = [f"{DETECTORS}/{each}/detector_position" for each in file.names(DETECTORS)]
    present = [file.has(name) for name in names]
    if not any(present):
        return ElementRow(pitch_m=None, falling=False)
    if not all(present) or len(names) != elements:
        raise RecordError(
            f"{path}: {DETECTORS} holds positions of {sum(present)} elements for {elements} channels; "
            "each channel must have one"
        )
    positions = [file.numbers(name) for name in names]
    for name, position in zip(names, positions, strict=True):
        if position.size != 3 or not np.isfinite(position).all():
            raise RecordError(f"{path}: {name} is {position.tolist()}, three finite coordinates in metres are expected")
    return row_of(path, np.array(positions))


def row_of(path: Path, positions_m: Float64[np.ndarray, "elements 3"]) -> ElementRow:
    """Return the row that elements at these positions make along the first axis; `RecordError` where they make none."""
    elements = len(positions_m)
    if elements == 1:
        return ElementRow(pitch_m=None, falling=False)
    along_m = positions_m[:, 0]
    numbers = np.arange(elements)
    # The sign of the regression slope: robust against positions that are out of order by rounding.
    falling = bool(np.dot(numbers - numbers.mean(), along_m) < 0)
    pitch_m = float(np.ptp(along_m)) / (elements - 1)
    # The median, so that one wrong element is reported itself and does not shift the row.
    row_m = np.tile(np.median(positions_m, axis=0), (elements, 1))
    row_m[:, 0] = along_m.max() - pitch_m * numbers if falling else along_m.min() + pitch_m * numbers
    off_m = np.linalg.norm(positions_m - row_m, axis=1)
    worst = int(off_m.argmax())
    if not off_m[worst] <= TOLERANCE * pitch_m or pitch_m == 0:
        raise RecordError(
            f"{path}: element {worst + 1} of {elements} is {off_m[worst] * 1e3:.3g} mm from its place in a straight "
            f"row of pitch {pitch_m * 1e3:.4g} mm along x1; only such rows can be imaged"
        )
    return ElementRow(pitch_m=pitch_m, falling=falling)
