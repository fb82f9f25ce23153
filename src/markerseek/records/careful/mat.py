"""Numbers in ``.mat`` files, and frames in the layout of Allman, Reiter and Bell's data set (IEEE TMI 2018).

Written out for the few fields that are needed ("MAT-File Level 5 File Format", The MathWorks), because SciPy's
reader can be made to crash the interpreter by damaged bytes, and to ask for gigabytes by a file of some kilobytes. The
tests hold it against SciPy's on whole files. Version 7.3 is another format, read in `markerseek.records.careful.mat73`.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Int16

from markerseek.core import RecordError
from markerseek.files import MIB, open_input
from markerseek.records.careful.mat73 import HEAD_BYTES, is_mat73, mat73_arrays

_FRAME, _COUNT = "AdcData_frame000", "SampleNum"
_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_INT16_CLASS, _NUMERIC_CLASSES = 10, range(6, 16)
_COMPLEX = 0x800
_MOST_PER_BYTE = 32
MOST_FRAME_BYTES = 256 * MIB
"""Largest file of one frame: 16 MiB of channel data, and whatever else was saved with them."""
_LONGEST_NAME = 64


class _UnpacksTooFarError(Exception):
    """The compressed parts hold more than `_MOST_PER_BYTE` times the file."""


def load_mat(path: Path) -> Int16[np.ndarray, "channels samples"]:
    """Channels of the frame in the file, shape (128, samples), without the padding at their end.

    ``AdcData_frame000`` is (32, AlignedSampleNum, 4): channel c stands in row c mod 32 of bank c div 32.
    """
    arrays = mat_arrays(path, most_bytes=MOST_FRAME_BYTES)
    frame, count = arrays.get(_FRAME), arrays.get(_COUNT)
    if frame is None or frame.dtype != np.int16 or frame.ndim != 3 or frame.shape[::2] != (32, 4) or count is None:
        found = ", ".join(f"{name} {each.dtype} {each.shape}" for name, each in sorted(arrays.items())[:8]) or "nothing"
        raise RecordError(
            f"{path}: {_FRAME}, int16 of shape (32, samples, 4), and {_COUNT} expected, found {found}; "
            "save channel data as an .npy of int16 (channels, samples) instead, or, if it holds a scan of many angles, "
            f"see 'markerseek bank import {path} scan.hdf5'"
        )
    aligned = frame.shape[1]
    if count.size != 1 or not 1 <= count.flat[0] <= aligned or count.flat[0] != int(count.flat[0]):
        raise RecordError(
            f"{path}: {_COUNT} is {count.ravel()[:4].tolist()}, expected a number from 1 to AlignedSampleNum, "
            f"{aligned}; the file is damaged: fetch or save it again"
        )
    channels = frame.transpose(0, 2, 1).reshape((128, aligned), order="F")[:, : int(count.flat[0])]
    return np.ascontiguousarray(channels, dtype=np.int16)


def mat_arrays(path: Path, *, most_bytes: int) -> dict[str, np.ndarray]:
    """Real numeric variables of a ``.mat`` of version 6, 7 or 7.3, by name.

    Parameters
    ----------
    path
        The file.
    most_bytes
        Largest file that is read.

    Raises
    ------
    RecordError
        If it is damaged, of another version, or unpacks to far more than it holds.
    MissingExtraError
        If it is of version 7.3, and h5py is not installed.
    """
    with open_input(path, most_bytes=most_bytes) as file:
        head = file.read(HEAD_BYTES)
        if is_mat73(head):
            return mat73_arrays(path)
        if _is_version_4(head):
            raise RecordError(f"{path}: it was saved with -v4, which is not read; save it with -v7")
        data = head + file.read()
    try:
        return dict(_arrays(data))
    except _UnpacksTooFarError as error:
        raise RecordError(
            f"{path}: it unpacks to more than {_MOST_PER_BYTE} times its size; save it with -v6 (uncompressed)"
        ) from error
    # Lengths that lead out of the data, numbers that are no text, streams that are not compressed.
    except (ValueError, struct.error, zlib.error) as error:
        raise RecordError(f"{path}: {len(data)} bytes, cut off or damaged: {error}; fetch or save it again") from error


def _is_version_4(head: bytes) -> bool:
    """Whether five numbers begin the file as in version 4: type, rows, columns, 0 or 1 if complex, length of a name."""
    if len(head) < 20:
        return False
    for order, machine in (("<", 0), (">", 1000)):
        kind, rows, columns, imaginary, name = struct.unpack_from(f"{order}5i", head)
        numbers, matrix = divmod(kind - machine, 10)
        if numbers in range(6) and matrix in range(3) and imaginary in (0, 1) and min(rows, columns) >= 0:
            return bool(1 < name <= _LONGEST_NAME)
    return False


def _arrays(data: bytes) -> Iterator[tuple[str, np.ndarray]]:
    """Names and values of the real numeric variables in the file."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or struct.unpack_from(f"{order}H", data, 124)[0] != 0x0100:
        raise ValueError("no MATLAB file of version 6, 7 or 7.3")
    left = _MOST_PER_BYTE * len(data)
    place = _HEADER_BYTES
    while place < len(data):
        kind, body, place = _element(data, place, order)
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            unpacked = unpacker.decompress(body, left + 1)
            left -= len(unpacked)
            if left < 0:
                raise _UnpacksTooFarError
            kind, body, _ = _element(unpacked, 0, order)
        if kind == _MATRIX and (array := _array(body, order)) is not None:
            yield array


def _element(data: bytes, place: int, order: str) -> tuple[int, bytes, int]:
    """Kind and body of the data element at a place, and where the next one begins."""
    kind, size = struct.unpack_from(f"{order}2I", data, place)
    if kind >> 16:
        # The short form: kind and size share four bytes, and the body has the other four.
        kind, size, start, after = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if size > 4:
            raise ValueError(f"a short element of {size} bytes, at most 4 expected")
    else:
        start = place + 8
        after = start + (size if kind == _COMPRESSED else -(-size // 8) * 8)
    if start + size > len(data):
        raise ValueError(f"{len(data)} bytes found, at least {start + size} expected")
    return kind, data[start : start + size], after


def _array(body: bytes, order: str) -> tuple[str, np.ndarray] | None:
    """Name and values of a variable; None if it is no array of real numbers."""
    _, flags, place = _element(body, 0, order)
    word = struct.unpack_from(f"{order}I", flags)[0]
    if word & 0xFF not in _NUMERIC_CLASSES or word & _COMPLEX:
        return None
    _, sizes, place = _element(body, place, order)
    shape = tuple(int(each) for each in np.frombuffer(sizes, f"{order}i4"))
    _, name, place = _element(body, place, order)
    kind, numbers, _ = _element(body, place, order)
    if kind not in _NUMBERS:
        raise ValueError(f"numbers of the unknown kind {kind}")
    values = np.frombuffer(numbers, f"{order}{_NUMBERS[kind]}")
    if not shape or min(shape) < 0 or math.prod(shape) != values.size:
        raise ValueError(f"{values.size} numbers found, {shape} expected")
    values = values.reshape(shape, order="F")
    if word & 0xFF == _INT16_CLASS and values.dtype.kind in "iu" and values.dtype.itemsize <= 2:
        # Small numbers may be stored in fewer bytes than their class has.
        values = values.astype(np.int16)
    return name.decode("ascii"), values
