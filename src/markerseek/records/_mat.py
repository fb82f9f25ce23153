"""Frames in the ``.mat`` layout of Allman, Reiter and Bell's photoacoustic data set (IEEE TMI 2018).

SciPy reads the file. Before that, compressed variables are unpacked here with a limit, for a file of some kilobytes
can otherwise ask for gigabytes.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int16

from markerseek.core import RecordError

_FRAME = "AdcData_frame000"
_HEADER_BYTES = 128
_COMPRESSED = 15
_MOST_PER_BYTE = 32


def load_mat(path: Path) -> Int16[np.ndarray, "channels samples"]:
    """Channels of the frame in the file, shape (128, samples), without the padding at their end.

    ``AdcData_frame000`` is (32, AlignedSampleNum, 4): channel c stands in row c mod 32 of bank c div 32.
    """
    try:
        kinds, content = _read(_unpacked(path))
    except RecordError:
        raise
    # The parser is other people's and the bytes are a stranger's: whatever it raises says that it cannot read them.
    except Exception as error:
        raise RecordError(f"{path}: damaged .mat file ({error}); fetch or save it again") from error
    if content is None:
        found = ", ".join(f"{name} {kind} {shape}" for name, (shape, kind) in sorted(kinds.items())[:8]) or "nothing"
        raise RecordError(
            f"{path}: {_FRAME}, int16 of shape (32, samples, 4), and SampleNum expected, found {found}; "
            "save channel data as an .npy of int16 (channels, samples) instead"
        )
    frame, count = content
    shape = kinds[_FRAME][0]
    samples = int(count.flat[0]) if count.size == 1 and count.dtype.kind in "iu" else 0
    if frame.shape != shape or not 1 <= samples <= shape[1]:
        raise RecordError(
            f"{path}: SampleNum is {samples}, expected a number from 1 to AlignedSampleNum, {shape[1]}; "
            "the file is damaged: fetch or save it again"
        )
    channels = frame.transpose(0, 2, 1).reshape((128, shape[1]), order="F")[:, :samples]
    return np.ascontiguousarray(channels, dtype=np.int16)


def _read(stream: Any) -> tuple[dict[str, tuple[tuple[int, ...], str]], tuple[np.ndarray, np.ndarray] | None]:
    """Shapes and kinds of the variables, and the two that make a frame if they are there."""
    # Slow to import, and needed for this format alone. Its stubs know file names only, so the stream is Any.
    from scipy.io import loadmat, whosmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kinds = {name: (tuple(shape), str(kind)) for name, shape, kind in whosmat(stream)}
        shape, kind = kinds.get(_FRAME, ((), ""))
        if kind != "int16" or len(shape) != 3 or (shape[0], shape[2]) != (32, 4) or "SampleNum" not in kinds:
            return kinds, None
        stream.seek(0)
        content = loadmat(stream, variable_names=[_FRAME, "SampleNum"])
    return kinds, (np.asarray(content[_FRAME]), np.asarray(content["SampleNum"]))


def _unpacked(path: Path) -> io.BytesIO:
    """The file with every compressed variable unpacked; at most 32 bytes for each of its bytes."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or data[124:126] not in (b"\x00\x01", b"\x01\x00"):
        raise RecordError(
            f"{path}: no MATLAB 5 file (.mat of version 6 or 7); save it again with the option -v7 or -v6"
        )
    limit = _MOST_PER_BYTE * len(data)
    parts, place = [data[:_HEADER_BYTES]], _HEADER_BYTES
    while place < len(data):
        if place + 8 > len(data):
            raise RecordError(f"{path}: {len(data)} bytes found, the file is cut off; fetch or save it again")
        kind, size = struct.unpack_from(f"{order}2I", data, place)
        end = place + 8 + size
        if end > len(data):
            raise RecordError(
                f"{path}: {len(data)} bytes found, at least {end} expected; the file is cut off: fetch or save it again"
            )
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            try:
                part = unpacker.decompress(data[place + 8 : end], limit + 1)
            except zlib.error as error:
                raise RecordError(f"{path}: damaged compressed variable ({error}); fetch or save it again") from error
            limit -= len(part)
            if limit < 0:
                raise RecordError(
                    f"{path}: {len(data)} bytes unpack to more than {_MOST_PER_BYTE} times as many; this is no "
                    "recording: save it again without compression (-v6)"
                )
        else:
            part = data[place:end]
        parts.append(part)
        place = end
    return io.BytesIO(b"".join(parts))
