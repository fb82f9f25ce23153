"""Reads the channel files of a SonixDAQ, of a folder that was stored as well as of one that a device writes."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from markerseek.core import Int16, RecordError
from markerseek.files.inputs import MIB, open_input, read_input
from markerseek.wire import sonixdaq

_MAX_BYTES = 64 * MIB
"""Largest channel file that is read: 800 pulses of 40,000 samples."""


def channel_files(folder: Path, names: Iterable[str]) -> dict[int, Path]:
    """Channel files among these names, by number; `RecordError` if two are of one channel."""
    files: dict[int, Path] = {}
    for name in names:
        number = sonixdaq.file_number(name)
        if number is None:
            continue
        if number in files:
            raise RecordError(
                f"{folder}: {files[number].name} and {name} are both channel {number}; keep one acquisition per "
                "folder, and let one program of one SDK write there"
            )
        files[number] = folder / name
    return files


def is_complete(path: Path) -> bool:
    """Whether a channel file has the size that its header gives; a pipe or folder in its place is not one.

    Raises `OSError` if it cannot be read.
    """
    try:
        # Of any size: one that is too large is complete, and reading it says what is wrong with it.
        with open_input(path, most_bytes=sys.maxsize) as file:
            size = os.fstat(file.fileno()).st_size
            sonixdaq.decode_header(file.read(sonixdaq.HEADER_BYTES), size=size, name=path.name)
    except (RecordError, FileNotFoundError):
        return False
    return True


def read_channels(files: Mapping[int, Path]) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    """Samples of all channels by element, averaged over the pulses, and the number of pulses.

    ``files``: all of them, by number. Raises `RecordError` if they are not of one acquisition, `OSError` if one cannot
    be read.
    """
    first: sonixdaq.DaqHeader | None = None
    averaged = np.empty((sonixdaq.CHANNELS, 0), np.int16)
    for number, path in sorted(files.items()):
        header, body = _read_file(path)
        if first is None:
            first, averaged = header, np.empty((sonixdaq.CHANNELS, header.samples), np.int16)
        # Files of two acquisitions would give a frame whose channels belong to different shots.
        if header != first:
            raise RecordError(
                f"{path}: {header.frames} pulses of {header.samples} samples under a header of {header.length} bytes "
                f"found, {first.frames} of {first.samples} under {first.length} expected as in the files before it; "
                "the folder mixes acquisitions: acquire it again"
            )
        if header.channel is not None and header.channel != number:
            raise RecordError(
                f"{path}: channel {header.channel} is in its header; the files are out of order: acquire them again"
            )
        pulses = sonixdaq.decode_samples(body, header)
        # The connector permutes the channels: file numbers are not element numbers.
        # In float64: the sum of many int16 pulses overflows int16.
        averaged[sonixdaq.element_of_file(number)] = np.rint(pulses.mean(axis=0, dtype=np.float64))
    return averaged, 0 if first is None else first.frames


def _read_file(path: Path) -> tuple[sonixdaq.DaqHeader, bytes]:
    data = read_input(path, most_bytes=_MAX_BYTES)
    try:
        header = sonixdaq.decode_header(data[: sonixdaq.HEADER_BYTES], size=len(data), name=path.name)
    except RecordError as error:
        raise RecordError(f"{path.parent}: {error}") from error
    if header.samples > sonixdaq.MAX_SAMPLES:
        raise RecordError(
            f"{path}: it holds {header.samples} samples of each pulse, at most {sonixdaq.MAX_SAMPLES} are read; "
            "record a shorter time"
        )
    return header, data[header.length :]
