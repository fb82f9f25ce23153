"""Frames of channel data from files: a folder of SonixDAQ channel files, ``.npy``, and ``.mat`` of the public data set.

Whatever is in a file, what comes back is a frame or a `RecordError`, and no more memory is asked for than some tens of
times the file's size.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from jaxtyping import Int16

from markerseek.core import ChannelFrame, FrameHeader, RecordError
from markerseek.files import MIB, open_input
from markerseek.records.banks import HDF5_SUFFIXES
from markerseek.records.careful.mat import MOST_FRAME_BYTES, load_mat
from markerseek.records.careful.npy import read_npy
from markerseek.records.journal import is_journal
from markerseek.wire import sonixdaq

MAT_PROBE = "L3-8"
"""Preset of the probe of that data set."""

_MOST_CHANNEL_BYTES = 64 * MIB
"""Largest file of one channel: 800 pulses of 40,000 samples."""


def load_frame(path: Path | str, *, sampling_hz: float = 40e6, angle_deg: float = 0.0) -> ChannelFrame:
    """Frame of channel data in a file, or in a folder of SonixDAQ channel files.

    Parameters
    ----------
    path
        A folder with 128 ``.daq`` files (repeated pulses are averaged), an ``.npy`` of int16 (channels, samples), or a
        ``.mat`` with ``AdcData_frame000`` and ``SampleNum``.
    sampling_hz
        Sampling frequency in Hz; none of the files holds it.
    angle_deg
        Angle of the probe, for the frame's header, in degrees.

    Raises
    ------
    RecordError
        If there is no frame in it; the message names the file, what was expected, what was found, and the cure.
    """
    place = Path(path)
    try:
        samples, pulses = _load(place)
    except OSError as error:
        raise RecordError(f"{place}: cannot be read ({error.strerror or error}); check the name and the rights") from (
            error
        )
    header = FrameHeader(
        sequence=1, token=place.name, pulses=pulses, commanded_deg=angle_deg, started_s=math.nan, ended_s=math.nan
    )
    return ChannelFrame(header=header, samples=samples, sampling_hz=sampling_hz)


def _load(path: Path) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    if not path.exists():
        raise RecordError(f"{path}: there is no such file or folder; check the name")
    if path.is_dir():
        return _load_daq_folder(path)
    loaders = {".mat": load_mat, ".npy": _load_npy}
    loader = loaders.get(path.suffix.lower())
    if loader is None:
        raise RecordError(f"{path}: {_otherwise(path)}")
    return loader(path), 1


def _otherwise(path: Path) -> str:
    """What else a file could be, and which command is for it."""
    suffix = path.suffix.lower()
    if path.is_file() and is_journal(path):
        return f"it is the journal of a search, not one frame; see 'markerseek journal show {path}'"
    if suffix in (*HDF5_SUFFIXES, ".csv"):
        return f"it would be a scan of many angles, not one frame; see 'markerseek bank info {path}'"
    if suffix == ".npz":
        return f"it would be a scan of many angles, not one frame; see 'markerseek bank import {path} scan.hdf5'"
    return (
        f"{suffix or 'a file without suffix'} is no format of frames; give a .mat, an .npy, or a folder of SonixDAQ "
        "files; 'markerseek frame' also shows what is in an Ultrasonix .b8 or .rf"
    )


def _load_npy(path: Path) -> Int16[np.ndarray, "channels samples"]:
    with open_input(path, most_bytes=MOST_FRAME_BYTES) as file:
        try:
            samples = read_npy(file, size=os.fstat(file.fileno()).st_size)
        except ValueError as problem:
            raise RecordError(f"{path}: {problem}") from problem
    if (
        samples.dtype.newbyteorder("=") != np.int16
        or samples.ndim != 2
        or not 1 <= samples.shape[0] <= samples.shape[1]
    ):
        raise RecordError(
            f"{path}: {samples.dtype} of shape {samples.shape} found, int16 of shape (channels, samples) expected; "
            "convert it to ADC counts with one row per channel (of samples × channels, save the transpose)"
            + (f"; of many angles, see 'markerseek bank import {path} scan.hdf5'" if samples.ndim == 3 else "")
        )
    return np.ascontiguousarray(samples, dtype=np.int16)


def _load_daq_folder(folder: Path) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    files = _daq_files(folder)
    headers = {number: _daq_header(path) for number, path in files.items()}
    first = headers[0]
    for number, header in headers.items():
        if header != first:
            raise RecordError(
                f"{files[number]}: {header.frames} pulses of {header.samples} samples under a header of "
                f"{header.length} bytes found, {first.frames} of {first.samples} under {first.length} expected as in "
                f"{files[0].name}; the folder mixes acquisitions: acquire it again"
            )
    samples = np.empty((sonixdaq.CHANNELS, first.samples), np.int16)
    for number, path in files.items():
        with open_input(path, most_bytes=_MOST_CHANNEL_BYTES) as file:
            file.seek(first.length)
            body = file.read(first.file_bytes - first.length)
        if len(body) != first.file_bytes - first.length:
            raise RecordError(
                f"{path}: {first.length + len(body)} bytes found, {first.file_bytes} bytes expected; it became shorter "
                "while it was read: wait until the acquisition is complete"
            )
        pulses = sonixdaq.decode_samples(body, first)
        samples[sonixdaq.element_of_file(number)] = np.rint(pulses.mean(axis=0, dtype=np.float64))
    return samples, first.frames


def _daq_files(folder: Path) -> dict[int, Path]:
    """Channel files by number, all 128 of them."""
    files: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        number = sonixdaq.file_number(path.name)
        if number is None:
            continue
        if number in files:
            raise RecordError(
                f"{folder}: {files[number].name} and {path.name} are both channel {number}; "
                "keep one acquisition in a folder"
            )
        files[number] = path
    if len(files) != sonixdaq.CHANNELS:
        missing = next(number for number in range(sonixdaq.CHANNELS) if number not in files)
        raise RecordError(
            f"{folder}: {len(files)} channel files (.daq) found, {sonixdaq.CHANNELS} expected; the first that is "
            f"missing is CH{missing:03d}: wait until the acquisition is complete, or acquire it again"
            + ("" if files else f"; if it holds a scan of many angles, see 'markerseek bank info {folder}'")
        )
    return files


def _daq_header(path: Path) -> sonixdaq.DaqHeader:
    with open_input(path, most_bytes=_MOST_CHANNEL_BYTES) as file:
        head, size = file.read(sonixdaq.HEADER_BYTES), os.fstat(file.fileno()).st_size
    try:
        header = sonixdaq.decode_header(head, size=size, name=path.name)
    except RecordError as error:
        raise RecordError(f"{path.parent}: {error}") from error
    if header.samples > sonixdaq.MOST_SAMPLES:
        raise RecordError(
            f"{path}: it holds {header.samples} samples of each pulse, at most {sonixdaq.MOST_SAMPLES} are read; "
            "record a shorter time"
        )
    return header
