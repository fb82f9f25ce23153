"""Reads frames of channel data: a folder of SonixDAQ files, an ``.npy``, or a ``.mat`` of the public data set.

A bank is a folder with one of these for each angle. Ultrasonix ``.b8`` and ``.rf`` are read one frame at a time.
Any file gives a frame or a `RecordError`; reading needs at most some tens of times the file's size in memory. How
numbers of other types become int16 counts: `foreign_frames`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, Float64, FrameHeader, Int16, RecordError, UInt8, counted
from markerseek.files import (
    MIB,
    NamedAngle,
    angle_in,
    as_read_error,
    in_natural_order,
    open_input,
    quoted,
    read_input,
    series_indices,
)
from markerseek.records.banks.arrays import ArrayBank
from markerseek.records.banks.bank import (
    HDF5_SUFFIXES,
    USUAL_SAMPLING_HZ,
    BankFacts,
    FrameBank,
    chosen_channels,
    first_of,
    in_rising_order,
    silenced,
)
from markerseek.records.banks.foreign_frames import (
    EXACT,
    Scaling,
    as_counts,
    broken_channels,
    loudness,
    said_of_broken,
    scaling_of,
    unpadded,
)
from markerseek.records.banks.repeats import merged
from markerseek.records.banks.table_angles import stated_deg
from markerseek.records.banks.table_format import TableFormat
from markerseek.records.journal import is_journal
from markerseek.records.named_arrays import arrays_in, content, try_arrays
from markerseek.records.notes import note
from markerseek.wire import sonixdaq, ultrasonix

MAT_PROBE = "L3-8"
"""Preset of the probe of the public data set."""

_FRAME = "AdcData_frame000"
_COUNT = "SampleNum"
_MAX_FRAME_BYTES = 256 * MIB
"""Largest file of one frame: 16 MiB of channel data, and whatever else was saved with them."""

_MAX_CHANNEL_BYTES = 64 * MIB
"""Largest file of one channel: 800 pulses of 40,000 samples."""


def load_frame(
    path: Path | str,
    *,
    sampling_hz: float = 40e6,
    angle_deg: float = 0.0,
    scaling: Scaling | None = None,
    blanked: int = 0,
    left_out: tuple[int, ...] | None = None,
) -> ChannelFrame:
    """Return the frame of channel data in a file, or in a folder of SonixDAQ channel files.

    - ``path``: a folder with 128 ``.daq`` files (repeated pulses are averaged), an ``.npy`` of (channels, samples), or
      a ``.mat`` with ``AdcData_frame000`` and ``SampleNum``.
    - ``sampling_hz``: sampling frequency; none of the files holds it.
    - ``angle_deg``: angle of the probe, for the frame's header.
    - ``scaling``: how numbers of an ``.npy`` become counts; None: as the frame itself says, with a warning where it is
      scaled.
    - ``blanked``: samples at the start that are not imaged, and do not count for the scale.
    - ``left_out``: channels, counted from 0, that become zeros; None: those of an ``.npy`` that hold NaN or infinity,
      where they are few, with a warning.
    """
    place = Path(path)
    with as_read_error(place):
        samples, pulses = _load(place, scaling, blanked, left_out)
    samples = silenced(samples, left_out or ())
    header = FrameHeader(
        sequence=1, token=place.name, pulses=pulses, commanded_deg=angle_deg, started_s=math.nan, ended_s=math.nan
    )
    return ChannelFrame(header=header, samples=samples, sampling_hz=sampling_hz)


def npy_samples(path: Path) -> np.ndarray:
    """Return the channel data of an ``.npy`` in the type that it has, shape (channels, samples).

    Raises `OSError` if it cannot be opened.
    """
    samples = arrays_in(path, most_bytes=_MAX_FRAME_BYTES)[""]
    # More channels than samples is a transposed array.
    if samples.ndim != 2 or not 1 <= samples.shape[0] <= samples.shape[1]:
        raise RecordError(
            f"{path}: {samples.dtype} of shape {samples.shape} found, (channels, samples) expected, with one row per "
            "channel (of samples × channels, save the transpose)"
            + (f"; of many angles, see `read_bank({quoted(path)})`" if samples.ndim == 3 else "")
        )
    frames, _ = unpadded(samples[None])
    return np.asarray(frames[0])


def _load(
    path: Path, scaling: Scaling | None, blanked: int, left_out: tuple[int, ...] | None
) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    if not path.exists():
        raise RecordError(f"{path}: there is no such file or folder; check the name")
    if path.is_dir():
        return _load_daq_folder(path)
    suffix = path.suffix.lower()
    if suffix not in (".mat", ".npy"):
        raise RecordError(f"{path}: {_otherwise(path)}")
    if suffix == ".mat":
        return _mat_frame(path, arrays_in(path, most_bytes=_MAX_FRAME_BYTES)), 1
    samples = npy_samples(path)
    if left_out is None:
        left_out = _left_out(path, [path], ())
    samples = silenced(samples, left_out)
    return as_counts(path, samples, scaling or scaling_of(path, [samples], blanked=blanked)), 1


def _otherwise(path: Path) -> str:
    """Return the advice for a file of another kind: the command that reads it."""
    suffix = path.suffix.lower()
    if path.is_file() and is_journal(path):
        return f"it is the journal of a search, not one frame; see `read_journal({quoted(path)})`"
    if suffix in (*HDF5_SUFFIXES, ".csv", ".npz"):
        return f"it would be a scan of many angles, not one frame; see `read_bank({quoted(path)})`"
    return (
        f"{suffix or 'a file without suffix'} is no format of frames; give a .mat, an .npy, or a folder of SonixDAQ "
        "files, for `load_frame()` also an Ultrasonix .rf; B-mode images (.b8) are for `sensitive_range()`"
    )


def _mat_frame(path: Path, arrays: Mapping[str, np.ndarray]) -> Int16[np.ndarray, "channels samples"]:
    """Return the channels of a ``.mat``, shape (128, samples), without the padding at their end."""
    # Layout of Allman, Reiter and Bell's data set (IEEE TMI 2018): ``AdcData_frame000`` is (32, AlignedSampleNum, 4),
    # and channel c is in row c mod 32 of bank c div 32.
    frame = arrays.get(_FRAME)
    count = arrays.get(_COUNT)
    if frame is None or frame.dtype != np.int16 or frame.ndim != 3 or frame.shape[::2] != (32, 4) or count is None:
        raise RecordError(
            f"{path}: {_FRAME}, int16 of shape (32, samples, 4), and {_COUNT} expected, found {content(arrays)}; "
            "save channel data as an .npy of int16 (channels, samples) instead, or, if it holds a scan of many angles, "
            f"see `read_bank({quoted(path)})`"
        )
    aligned = frame.shape[1]
    if count.size != 1 or not 1 <= count.flat[0] <= aligned or count.flat[0] != int(count.flat[0]):
        raise RecordError(
            f"{path}: {_COUNT} is {count.ravel()[:4].tolist()}, expected a number from 1 to AlignedSampleNum, "
            f"{aligned}; the file is damaged: fetch or save it again"
        )
    # Fortran order: the row runs fastest, so that channel c = row + 32 * bank.
    channels = frame.transpose(0, 2, 1).reshape((128, aligned), order="F")[:, : int(count.flat[0])]
    return np.ascontiguousarray(channels, dtype=np.int16)


def _load_daq_folder(folder: Path) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    try:
        files = sonixdaq.by_number(sorted(path.name for path in folder.iterdir()))
        _require_complete(folder, files)
        read = ((name, read_input(folder / name, most_bytes=_MAX_CHANNEL_BYTES)) for name in files.values())
        return sonixdaq.averaged(read)
    except RecordError as error:
        raise RecordError(f"{folder}: {error}") from error


def _require_complete(folder: Path, files: Mapping[int, str]) -> None:
    """Refuse a folder without the files of all channels."""
    if len(files) == sonixdaq.CHANNEL_COUNT:
        return
    missing = next(number for number in range(sonixdaq.CHANNEL_COUNT) if number not in files)
    raise RecordError(
        f"{len(files)} channel files (.daq) found, {sonixdaq.CHANNEL_COUNT} expected; the first that is "
        f"missing is CH{missing:03d}: wait until the acquisition is complete, or acquire it again"
        + ("" if files else f"; if it holds a scan of many angles, see `read_bank({quoted(folder)})`")
    )


_FRAME_FILES = (".mat", ".npy")


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderBank(FrameBank):
    """One acquisition for each angle, in a folder or file of its own."""

    places: tuple[Path, ...] = field(repr=False)
    """Path of each, in the order of the angles."""
    scaling: Scaling = EXACT
    """How the numbers of files of NumPy become counts, alike at all angles."""

    def frame(self, index: int) -> ChannelFrame:
        """Return the channel data of one angle, from the disk.

        Raises `RecordError` if they cannot be read.
        """
        sampling_hz = self.facts.sampling_hz or USUAL_SAMPLING_HZ
        angle_deg = self.angles_deg[index]
        return load_frame(
            self.places[index],
            sampling_hz=sampling_hz,
            angle_deg=angle_deg,
            scaling=self.scaling,
            left_out=self.left_out,
        )


def read_folder(path: Path, table: TableFormat, *, blanked: int) -> FrameBank:
    """Return the bank in a folder, from the names of its sub-folders and files of channel data.

    A name is the angle, such as ``-12.5``, optionally with a word before it, the same in the whole folder, and a unit
    after it: ``angle_-12.5deg``. Where a person states the angles, the files follow in the order of the numbers in
    their names, and a folder of SonixDAQ files may be one triggered acquisition, a pulse at each angle.

    ``table``: angles that are stated, and channels that are left out of files of NumPy; those that hold NaN are left
    out unasked. ``blanked``: as of `read_bank`.
    """
    files = sonixdaq.by_number(sorted(place.name for place in path.iterdir()))
    if files:
        return _burst(path, files, table)
    # Hidden files such as .DS_Store are none, but an angle such as .5 is.
    found = [
        place
        for place in in_natural_order(path.iterdir())
        if not re.match(r"\.\D", place.name) and (place.is_dir() or place.suffix.lower() in _FRAME_FILES)
    ]
    if not found:
        raise RecordError(
            f"{path}: there is no scan in this folder; it must hold one folder or file of channel data for each angle, "
            "with the angle in its name, as in 'angle_-12.5deg'"
        )
    named = _stated_angles(path, found, table) if table.states_angles else _named_angles(found)
    angles, order = in_rising_order(path, named)
    ordered = [found[index] for index in order.tolist()]
    facts = BankFacts(probe=MAT_PROBE if all(place.suffix.lower() == ".mat" for place in ordered) else None)
    try_arrays((place for place in ordered if place.is_file()), most_bytes=_MAX_FRAME_BYTES)
    arrays = [each for each in ordered if each.suffix.lower() == ".npy"]
    left_out = _left_out(path, arrays, table.without_channels)
    scaling = _common_scaling(path, arrays, blanked, left_out)
    return FolderBank(angles_deg=angles, places=tuple(ordered), facts=facts, scaling=scaling, left_out=left_out)


def _burst(path: Path, files: Mapping[int, str], table: TableFormat) -> ArrayBank:
    """Return the bank of one acquisition whose pulses were triggered at an angle each."""
    with open_input(path / next(iter(files.values())), most_bytes=sonixdaq.MAX_BURST_BYTES) as file:
        head = file.read(sonixdaq.HEADER_BYTES)
        size = os.fstat(file.fileno()).st_size
    pulses = sonixdaq.decode_header(head, size=size, name=next(iter(files.values()))).frames
    if not table.states_angles:
        raise RecordError(
            f"{path}: it is one acquisition of SonixDAQ files with {counted(pulses, 'pulse')}; if each pulse was "
            "triggered at an angle of its own, state the angles: `first_and_step_deg=(-35, 0.5)`, or `angles_deg`; if "
            f"all are of one angle, it is a frame: `load_frame({quoted(path)})`"
        )
    angles_deg = stated_deg(table, path, pulses, what="pulses")
    try:
        _require_complete(path, files)
        read = ((name, read_input(path / name, most_bytes=_MAX_CHANNEL_BYTES)) for name in files.values())
        samples = sonixdaq.singles(read, pulses=pulses)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    scan = merged(path, angles_deg, lambda: np.array([loudness(each, 0) for each in samples]))
    bank = ArrayBank(
        path=path,
        angles_deg=scan.angles_deg,
        samples=scan.mean(samples),
        pulses=tuple(scan.total(np.ones(pulses, dtype=np.int64)).tolist()),
    )
    chosen = chosen_channels(path, table.without_channels, count=sonixdaq.CHANNEL_COUNT)
    return replace(bank, samples=silenced(bank.samples, np.flatnonzero(chosen).tolist()))


def _stated_angles(path: Path, frames: list[Path], table: TableFormat) -> Float64[np.ndarray, " angles"]:
    """Return the angle that a person states for each file, in the order of the numbers in their names."""
    named = [_angle_of(place) for place in frames]
    if all(each is not None for each in named) and any(each is not None and each.stated for each in named):
        raise ConfigError(
            f"{path}: the names of its frames are angles, such as {frames[0].name}; leave `first_and_step_deg` "
            "and `angles_deg` out"
        )
    if table.angles_deg is not None:
        return stated_deg(table, path, len(frames), what="frames")
    at, missing = series_indices([_name(place) for place in frames])
    if missing:
        note(path, f"the frames numbered {first_of(list(map(str, missing)))} are missing; the others keep their angles")
    return stated_deg(table, path, at[-1] + 1, what="frames")[at]


def _named_angles(frames: list[Path]) -> Float64[np.ndarray, " angles"]:
    """Return the angle in the name of each file; refused where no word, sign, decimal or unit says that it is one."""
    by_angle: dict[float, Path] = {}
    words: dict[str, Path] = {}
    stated = False
    for place in frames:
        found = _angle_of(place)
        if found is None:
            raise RecordError(
                f"{place}: the angle cannot be read from this name; in the folder of a scan each frame is named by its "
                "angle in degrees, -12.5 or, with a word before it, angle_-12.5deg: digits, a point, a hyphen for "
                "minus; or state the angles: `first_and_step_deg=(-35, 0.5)`, or `angles_deg`"
            )
        if found.word:
            words.setdefault(found.word, place)
        # "left_10" and "right_10" would become one angle: two words may stand for two signs.
        if len(words) > 1:
            first = next(iter(words.values()))
            raise RecordError(
                f"{place}: its name has another word than {first.name}; if the words are the two sides, write "
                "negative angles with a sign, as in 'angle_-12.5deg', and the same word everywhere; if they are two "
                "passes, keep each in a folder of its own"
            )
        if found.angle_deg in by_angle:
            raise RecordError(f"{place}: the angle {found.angle_deg:g} deg is that of {by_angle[found.angle_deg].name}")
        by_angle[found.angle_deg] = place
        stated |= found.stated
    if not stated:
        raise RecordError(
            f"{frames[0]}: its number may count the frames or be an angle, and no word, sign, decimal or unit in this "
            "folder says which; name each frame as in angle_12.5deg, or state the angles: "
            "`first_and_step_deg=(-35, 0.5)`, or `angles_deg`"
        )
    return np.array([*by_angle])


def _angle_of(place: Path) -> NamedAngle | None:
    return angle_in(_name(place))


def _name(place: Path) -> str:
    """Return the name without the suffix of a file: a folder's may end in the decimals of its angle."""
    return place.name if place.is_dir() else place.stem


def _left_out(path: Path, places: list[Path], stated: tuple[int, ...]) -> tuple[int, ...]:
    """Return the channels of files of NumPy, counted from 0, that are stated, or hold NaN or infinity."""
    if not places:
        return ()
    first = npy_samples(places[0])
    left_out = chosen_channels(path, stated, count=len(first))
    if first.dtype.kind == "f":
        broken = broken_channels(map(npy_samples, places), left_out)
        left_out |= broken
        if broken.any():
            note(path, "; ".join(said_of_broken(broken)))
    return tuple(np.flatnonzero(left_out).tolist())


def _common_scaling(path: Path, places: list[Path], blanked: int, left_out: tuple[int, ...]) -> Scaling:
    """Return how all files of NumPy become counts; they are all read only if the first holds no int16 about zero."""
    if not places:
        return EXACT
    first = npy_samples(places[0])
    if first.dtype == np.int16 and first.min() < 0:
        return EXACT
    silent = (silenced(each, left_out) for each in map(npy_samples, places))
    return scaling_of(path, silent, blanked=blanked)


# 64 GiB: hours of frames, which are read one at a time.
_LARGEST_BYTES = 1 << 36

_MAX_RF_BYTES = 64 * MIB
"""Largest frame: 512 lines of 65,536 samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UltrasonixFile:
    """An Ultrasonix file with its decoded header."""

    path: Path
    header: ultrasonix.UltrasonixHeader

    def b_mode(self, index: int) -> UInt8[np.ndarray, "rows columns"]:
        """Return the B-mode image, counted from 0."""
        return ultrasonix.decode_b_mode(self._body(index, kind="b-mode"), self.header)

    def rf(self, index: int) -> Int16[np.ndarray, "lines samples"]:
        """Return the radio-frequency lines of one frame, counted from 0; errors as of `b_mode`."""
        return ultrasonix.decode_rf(self._body(index, kind="rf"), self.header)

    def _body(self, index: int, *, kind: str) -> bytes:
        header = self.header
        if header.kind != kind:
            raise RecordError(f"{self.path}: it holds {header.kind} frames, {kind} was asked for")
        if not 0 <= index < header.frames:
            raise RecordError(f"{self.path}: there is no frame {index + 1}, it holds {header.frames}; count from 1")
        with as_read_error(self.path), open_input(self.path, most_bytes=_LARGEST_BYTES) as file:
            file.seek(ultrasonix.HEADER_BYTES + index * header.stride)
            body = file.read(header.stride)
        if len(body) != header.stride:
            raise RecordError(f"{self.path}: it became shorter while it was read; wait until it is written")
        return body


def open_ultrasonix(path: Path) -> UltrasonixFile:
    """Return the file with its header, checked against its size."""
    with as_read_error(path), open_input(path, most_bytes=_LARGEST_BYTES) as file:
        head = file.read(ultrasonix.HEADER_BYTES)
        size = os.fstat(file.fileno()).st_size
    header = ultrasonix.decode_header(head, size=size, name=str(path))
    if header.stride > _MAX_RF_BYTES:
        raise RecordError(
            f"{path}: a frame has {header.stride} bytes, at most {_MAX_RF_BYTES} are read; the header is damaged: "
            "export it again"
        )
    return UltrasonixFile(path=path, header=header)
