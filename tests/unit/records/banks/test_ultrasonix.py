"""Ultrasonix files, against the layout read by the machine's MATLAB reader."""

from __future__ import annotations

import os
import struct

import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.records.banks.ultrasonix import open_ultrasonix

RNG = np.random.default_rng(3)
CORNERS = (82, 5, 545, 5, 545, 448, 82, 448)


def file_bytes(kind, *, frames=2, width=5, height=7, bits=8, tagged=False, cut=None):
    """As RPread.m expects: 19 int32, then per frame an optional number and the values."""
    head = struct.pack("<19i", kind, frames, width, height, bits, *CORNERS, 2, 5, 40, 30, 128, 0)
    values = RNG.integers(0, 200, (frames, width * height)).astype("<u1")
    body = b"".join(struct.pack("<i", n) * tagged + values[n].tobytes() for n in range(frames))
    return (head + body)[:cut], values


@pytest.mark.parametrize("tagged", [False, True])
def test_b_mode_is_row_after_row(tmp_path, tagged):
    data, values = file_bytes(4, tagged=tagged)
    (tmp_path / "a.b8").write_bytes(data)
    file = open_ultrasonix(tmp_path / "a.b8")
    assert (file.header.tagged, file.header.frames) == (tagged, 2)
    for n in range(2):
        # reshape(v, w, h) of MATLAB, transposed.
        np.testing.assert_array_equal(file.b_mode(n), values[n].reshape((5, 7), order="F").T)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "0 bytes, too short for a header"),
        (file_bytes(4, cut=75)[0], "75 bytes, too short"),
        (file_bytes(4, cut=-1)[0], "bytes, 146 expected, or 154 with numbered frames"),
        (file_bytes(4)[0] + b"\0", "cut off or damaged"),
        (struct.pack("<19i", 3, *[1] * 18) + bytes(2), "type 3 found, and 4 .* is read; export that"),
        (file_bytes(16)[0], "type 16 found, and 4"),
        (struct.pack("<19i", 4, 2**31 - 1, 2**31 - 1, 2**31 - 1, 8, *[0] * 14), "expected"),
        (struct.pack("<19i", 4, -1, -1, 1, 8, *[0] * 14) + bytes(2), "header is damaged"),
        (file_bytes(4, bits=16)[0], "only those of 8 bits are read"),
    ],
)
def test_damaged_files_are_refused_with_their_sizes(tmp_path, data, message):
    (tmp_path / "a.b8").write_bytes(data)
    with pytest.raises(RecordError, match=message):
        open_ultrasonix(tmp_path / "a.b8")


def test_what_is_not_in_the_file_is_refused(tmp_path):
    (tmp_path / "a.b8").write_bytes(file_bytes(4)[0])
    file = open_ultrasonix(tmp_path / "a.b8")
    with pytest.raises(RecordError, match="there is no frame 3, it holds 2"):
        file.b_mode(2)
    with pytest.raises(RecordError, match="there is no frame 0"):
        file.b_mode(-1)
    os.truncate(tmp_path / "a.b8", 100)
    with pytest.raises(RecordError, match="became shorter"):
        file.b_mode(1)
    with pytest.raises(RecordError, match="check the name"):
        open_ultrasonix(tmp_path / "b.b8")
