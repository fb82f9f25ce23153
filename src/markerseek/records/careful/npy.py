"""NumPy's own files, read without its trust in them: nothing is unpickled, and no size is believed unseen."""

from __future__ import annotations

import math
import os
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from markerseek.core import RecordError
from markerseek.files import open_input
from markerseek.records.careful.hdf5 import MOST_PER_BYTE

_HEADER_BYTES = 10_000


def read_npy(file: IO[bytes], *, size: int) -> np.ndarray:
    """Array in the ``.npy`` format, from a stream of so many bytes.

    Raises
    ------
    ValueError
        If it is none, holds anything but numbers, or is not as long as it says.
    """
    head = file.read(12)
    if int.from_bytes(head[8:10] if head[6:7] == b"\x01" else head[8:12], "little") > _HEADER_BYTES:
        raise ValueError("no valid .npy header; save it again with numpy.save")
    file.seek(0)
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(file, max_header_size=_HEADER_BYTES)
    # The header is a Python literal, and a hostile one upsets NumPy's parser, and Python's, in many ways.
    except Exception as problem:
        raise ValueError("no valid .npy header; save it again with numpy.save") from problem
    # NumPy lets True pass for a whole number in a shape, and fails on it later.
    whole = all(type(each) is int and each >= 0 for each in shape)
    if dtype.kind not in "biuf" or dtype.subdtype is not None or not whole:
        raise ValueError(f"{dtype} of shape {shape} found, plain numbers expected; convert it")
    expected = file.tell() + dtype.itemsize * math.prod(shape)
    if size != expected:
        raise ValueError(
            f"{size} bytes found, {expected} bytes expected; the file is cut off or damaged: save it again"
        )
    flat = np.frombuffer(file.read(size - file.tell()), dtype=dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def read_npz(path: Path, *, most_bytes: int) -> dict[str, np.ndarray]:
    """Arrays of an ``.npz`` by name, if the file is no larger than ``most_bytes``.

    Raises
    ------
    RecordError
        If it is damaged, or unpacks to far more than it holds.
    """
    try:
        with open_input(path, most_bytes=most_bytes) as file, zipfile.ZipFile(file) as archive:
            members = [each for each in archive.infolist() if each.filename.endswith(".npy")]
            _require_room(path, members, size=os.fstat(file.fileno()).st_size)
            arrays = {}
            for each in members:
                with archive.open(each) as stream:
                    arrays[each.filename.removesuffix(".npy")] = read_npy(stream, size=each.file_size)
            return arrays
    except (RecordError, OSError):
        raise
    # Damaged archives raise errors of many kinds.
    except Exception as problem:
        raise RecordError(f"{path}: no .npz that can be read: {problem}; save it again with numpy.savez") from problem


def _require_room(path: Path, members: list[zipfile.ZipInfo], *, size: int) -> None:
    if sum(each.file_size for each in members) > MOST_PER_BYTE * size:
        raise RecordError(
            f"{path}: it unpacks to more than {MOST_PER_BYTE} times its size; save it with numpy.savez instead of "
            "savez_compressed"
        )
