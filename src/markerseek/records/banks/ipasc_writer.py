"""Writes a bank as IPASC HDF5, whole: the file gets its name when everything is in it.

The file is what pacfish would write, but pacfish needs a whole bank in memory, and its installation brings pytest and
Sphinx; the tests compare the two. Frames and the numbers of the measurements have the checksums of HDF5 (Fletcher-32),
which the library compares when it reads them. A bank of intensities has no detection elements and frames of size
zero; PATATO opens it, too.
"""

from __future__ import annotations

import math
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek._version import __version__
from markerseek.core import ChannelFrame, ConfigError, Float64, FrameHeader, LinearArray, RecordError, Sample
from markerseek.files import create_atomically, require_new
from markerseek.records.banks import ipasc
from markerseek.records.banks.bank import HDF5_SUFFIXES, MAX_DEG, BankFacts
from markerseek.records.hdf5 import require_h5py

if TYPE_CHECKING:
    import h5py

_ROOM_BYTES = 1 << 20
"""Space for everything but frames, in bytes."""

DEVICE_IDENTIFIERS = {
    "BPL9-5/55": "a4e26483-0a87-4ae7-8bb2-7ab133bcac32",
    "L3-8": "4462eea9-bcfa-49b0-bfaf-263f86caa10c",
}
"""IPASC wants a random UUID for each device; these were drawn once for each preset, and must not change."""


_UNKNOWN = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=math.nan, ended_s=math.nan)
"""Header of a measurement without a frame."""


def require_new_bank(path: Path) -> None:
    """Refuse a path where no bank can be written, before anything is measured."""
    require_h5py()
    if path.suffix.lower() not in HDF5_SUFFIXES:
        raise ConfigError(f"{path}: the name of a bank must end in {' or '.join(HDF5_SUFFIXES)}")
    require_new(path)


def require_room(path: Path, needed: int) -> None:
    """Refuse a disk without enough space, in bytes: HDF5 can crash on a write that fails."""
    free = shutil.disk_usage(path.parent).free
    if free < needed + _ROOM_BYTES:
        raise RecordError(
            f"{path}: the bank needs {(needed + _ROOM_BYTES) / 1e6:.1f} MB, {free / 1e6:.1f} MB are free; "
            "make room, or name another place"
        )


@contextmanager
def whole_bank(path: Path, *, facts: BankFacts) -> Iterator[BankWriter]:
    """Yield a writer of a bank that is renamed when the block ends, and deleted if the block fails.

    ``path``: where to write; the suffix is .hdf5 or .h5.
    """
    require_new_bank(path)
    import h5py

    try:
        with create_atomically(path) as part, h5py.File(part, "w") as file:
            writer = BankWriter(path, file, facts)
            yield writer
            writer.finish()
    # The library's errors are of both kinds.
    except (OSError, RuntimeError) as problem:
        raise RecordError(
            f"{path}: the bank cannot be written: {problem}; nothing was kept: make room, or name another place"
        ) from problem


class BankWriter:
    """Takes the acquisitions of a bank one at a time, in any order of their angles; made by `whole_bank`.

    Of several acquisitions at one angle the last is kept.
    """

    def __init__(self, path: Path, file: h5py.File, facts: BankFacts) -> None:
        self._path = path
        self._file = file
        self._facts = facts
        self._taken: dict[float, tuple[float, FrameHeader]] = {}
        self._taken_dark = 0
        self._first: ChannelFrame | None = None

    @property
    def taken(self) -> int:
        """Angles that have come."""
        return len(self._taken)

    def add(self, sample: Sample) -> None:
        """Take one acquisition, dark or not; `RecordError` if a bank cannot hold it, or the disk is full."""
        frame = sample.frame if isinstance(sample.frame, ChannelFrame) else None
        if sample.dark and frame is None:
            return
        if self.taken + self._taken_dark:
            _require_same(self._path, frame, self._first)
        else:
            self._begin(frame)
        if sample.dark:
            row = self._taken_dark
            self._taken_dark = self._taken_dark + 1
        else:
            self._require_keepable(sample, frame)
            row = list(self._taken).index(sample.angle_deg) if sample.angle_deg in self._taken else self.taken
            header = _UNKNOWN if sample.frame is None else sample.frame.header
            self._taken[sample.angle_deg] = sample.reading.intensity, header
        if frame is not None:
            require_room(self._path, frame.samples.nbytes)
            data = self._file[ipasc.DARK_FRAMES_PATH if sample.dark else ipasc.FRAMES_PATH]
            data.resize(max(row + 1, data.shape[-1]), axis=data.ndim - 1)
            data[..., row] = frame.samples if sample.dark else frame.samples[..., None]

    def finish(self) -> None:
        """Write everything but the frames."""
        device = DEVICE_IDENTIFIERS.get(self._facts.probe or "") or str(uuid.uuid4())
        if self._first is None:
            self._file.create_dataset(ipasc.FRAMES_PATH, shape=(0, 0, 1, self.taken), dtype="<i2")
        for group in ("general", "illuminators", "detectors"):
            # PATATO opens a file without elements, but not one without their group.
            self._file.create_group(f"{ipasc.DEVICE}/{group}")
        for name, value in (self._acquisition(device) | self._device(device)).items():
            if isinstance(value, np.ndarray) and not name.startswith(ipasc.DEVICE):
                # One chunk, because only chunks have checksums.
                self._file.create_dataset(name, data=value, chunks=value.shape, fletcher32=True)
            else:
                self._file[name] = value

    def _begin(self, frame: ChannelFrame | None) -> None:
        self._first = frame
        if frame is None:
            return
        for name, each in (
            (ipasc.FRAMES_PATH, (*frame.samples.shape, 1)),
            (ipasc.DARK_FRAMES_PATH, frame.samples.shape),
        ):
            # One chunk per frame, so that a frame is written and read in one piece.
            self._file.create_dataset(
                name, shape=(*each, 0), maxshape=(*each, None), dtype="<i2", chunks=(*each, 1), fletcher32=True
            )

    def _require_keepable(self, sample: Sample, frame: ChannelFrame | None) -> None:
        angle_deg = sample.angle_deg
        intensity = sample.reading.intensity
        if not abs(angle_deg) <= MAX_DEG:
            raise RecordError(
                f"{self._path}: the angle is {angle_deg:g} deg, it must be finite and within one turn, -{MAX_DEG:g} to "
                f"{MAX_DEG:g} deg; leave that acquisition out"
            )
        # NaN beside a frame is allowed, because the intensity can be computed from it later.
        if not (0 <= intensity < math.inf or (math.isnan(intensity) and frame is not None)):
            raise RecordError(
                f"{self._path}: the intensity at {angle_deg:g} deg is {intensity:g}, it must be finite and not "
                "negative, or NaN beside a frame; leave that acquisition out"
            )

    def _acquisition(self, device: str) -> dict[str, object]:
        """Return the fields of IPASC and ours by name.

        What is not known is left out, and what is not measured is NaN.
        """
        facts = self._facts
        first = self._first
        angles_deg = list(self._taken)
        headers = [header for _, header in self._taken.values()]
        started_s = np.array([each.started_s if math.isfinite(each.started_s) else math.nan for each in headers])
        energies = np.array([math.nan if each.energy is None else each.energy for each in headers])
        shape = (0, 0) if first is None else first.samples.shape
        known: dict[str, object | None] = {
            "meta_data/uuid": str(uuid.uuid4()),
            "meta_data/encoding": "UTF-8",
            "meta_data/compression": "raw",
            "meta_data/data_type": "short",
            "meta_data/dimensionality": "time and space",
            "meta_data/photoacoustic_imaging_device_reference": device,
            ipasc.SIZES: np.array([*shape, 1, len(angles_deg)]),
            **{name: getattr(facts, fact) or None for fact, name in ipasc.TEXT_PATHS.items()},
            **{name: getattr(facts, fact) for fact, name in ipasc.NUMBER_PATHS.items()},
            ipasc.SAMPLING: facts.sampling_hz if first is None else first.sampling_hz,
            # PATATO does not open a file without this field: NaN where it is not known.
            ipasc.WAVELENGTH: np.array([math.nan if facts.wavelength_m is None else facts.wavelength_m]),
            ipasc.PULSE_ENERGY: None
            if facts.pulse_energy_j is None
            else facts.pulse_energy_j * np.where(np.isnan(energies), 1.0, energies),
            ipasc.TIMES: started_s + (math.nan if facts.clock_zero_unix_s is None else facts.clock_zero_unix_s),
            ipasc.POSES: None if facts.face_radius_m is None else probe_poses(angles_deg, facts.face_radius_m),
            "meta_data/measurements_per_image": 1,
            "meta_data/scanning_method": "full_scan",
            "meta_data/scanning_motion": "rotation of the probe about its long axis",
            ipasc.VERSION_PATH: ipasc.BANK_VERSION,
            ipasc.ANGLES: np.array(angles_deg),
            ipasc.INTENSITIES: np.array([intensity for intensity, _ in self._taken.values()]),
            ipasc.RIG_CLOCK: started_s,
            ipasc.CLOCK_ZERO: math.nan if facts.clock_zero_unix_s is None else facts.clock_zero_unix_s,
            ipasc.PULSES_PATH: np.array([each.pulses for each in headers], np.int64),
            ipasc.ENERGY: energies,
            ipasc.SIMULATED: None if facts.simulated is None else int(facts.simulated),
            # As text: a seed may be larger than any number of HDF5.
            ipasc.SEED: None if facts.seed is None else str(facts.seed),
            ipasc.MADE_WITH: facts.made_with or f"markerseek {__version__}",
        }
        return {name: value for name, value in known.items() if value is not None}

    def _device(self, device: str) -> dict[str, object]:
        """Return the fields of the probe: x1 along the array from its centre, x3 into the tissue.

        Element sizes are not known.
        """
        facts = self._facts
        elements, samples = (0, 0) if self._first is None else self._first.samples.shape
        laterals_m: list[float] = []
        if facts.pitch_m is not None and elements >= 2:
            laterals_m = LinearArray(elements=elements, pitch_m=facts.pitch_m).lateral_m.tolist()
        half_m = 0.0 if facts.pitch_m is None else facts.pitch_m * max(elements - 1, 0) / 2
        depth_m = 0.0
        if facts.sound_speed_m_s is not None and self._first is not None:
            depth_m = samples / self._first.sampling_hz * facts.sound_speed_m_s
        known: dict[str, object] = {
            f"{ipasc.DEVICE}/general/unique_identifier": device,
            f"{ipasc.DEVICE}/general/field_of_view": np.array([-half_m, half_m, 0.0, 0.0, 0.0, depth_m]),
            f"{ipasc.DEVICE}/general/num_detectors": len(laterals_m),
            f"{ipasc.DEVICE}/general/num_illuminators": 0,
        }
        for number, lateral_m in enumerate(laterals_m):
            known[f"{ipasc.DETECTORS}/{number:010d}/detector_position"] = np.array([lateral_m, 0.0, 0.0])
            known[f"{ipasc.DETECTORS}/{number:010d}/detector_orientation"] = np.array([0.0, 0.0, 1.0])
        return known


def probe_poses(angles_deg: Sequence[float], face_radius_m: float) -> Float64[np.ndarray, "angles 6"]:
    """Return, for each angle, the position of the array's centre in metres and its rotation about x1, x2 and x3.

    Coordinates of IPASC, those of the array at the first measurement: x1 along it from its centre (y of the TRUS home
    frame), x3 out of it, and x2 = x3 × x1. The probe turns about an axis parallel to x1, ``face_radius_m`` behind the
    face.
    """
    turned = np.radians(np.array(angles_deg) - angles_deg[0])
    poses = np.zeros((len(angles_deg), 6))
    poses[:, 1] = -face_radius_m * np.sin(turned)
    # 1 - cos in a form that keeps small angles exact.
    poses[:, 2] = -2 * face_radius_m * np.sin(turned / 2) ** 2
    poses[:, 3] = turned
    return poses


def _require_same(path: Path, frame: ChannelFrame | None, first: ChannelFrame | None) -> None:
    shape, before = ((0, 0) if each is None else each.samples.shape for each in (frame, first))
    if shape != before:
        raise RecordError(
            f"{path}: a frame of {shape} follows frames of {before} (channels, samples); "
            "keep one probe and one record length in a bank"
        )
    if frame is not None and first is not None and frame.sampling_hz != first.sampling_hz:
        raise RecordError(
            f"{path}: a frame sampled at {frame.sampling_hz:g} Hz follows one at {first.sampling_hz:g} Hz; "
            "keep one rate in a bank"
        )
