"""Files of Ultrasonix: their frames as RPread.m reads them, and files that are damaged."""

from __future__ import annotations

import os
import struct

import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.records.banks.frames import open_ultrasonix

RNG = np.random.default_rng(3)


CORNERS = (82, 5, 545, 5, 545, 448, 82, 448)


def file_bytes(kind, *, frames=2, width=5, height=7, bits=None, tagged=False, cut=None):
    """As RPread.m expects: 19 int32, then per frame an optional number and the values."""
    dtype = "<u1" if kind == 4 else "<i2"
    head = struct.pack("<19i", kind, frames, width, height, bits or 8 * int(dtype[-1]), *CORNERS, 2, 5, 40, 30, 128, 0)
    values = RNG.integers(0, 200, (frames, width * height)).astype(dtype)
    body = b"".join(struct.pack("<i", n) * tagged + values[n].tobytes() for n in range(frames))
    return (head + body)[:cut], values


@pytest.mark.parametrize("tagged", [False, True])
def test_b_mode_is_row_after_row(tmp_path, tagged):
    data, values = file_bytes(4, tagged=tagged)
    (tmp_path / "a.b8").write_bytes(data)
    file = open_ultrasonix(tmp_path / "a.b8")
    assert (file.header.kind, file.header.tagged, file.header.frames) == ("b-mode", tagged, 2)
    for n in range(2):
        # reshape(v, w, h) of MATLAB, transposed.
        np.testing.assert_array_equal(file.b_mode(n), values[n].reshape((5, 7), order="F").T)


@pytest.mark.parametrize("tagged", [False, True])
def test_rf_is_line_after_line(tmp_path, tagged):
    data, values = file_bytes(16, tagged=tagged)
    (tmp_path / "a.rf").write_bytes(data)
    file = open_ultrasonix(tmp_path / "a.rf")
    assert (file.header.kind, file.header.sampling_hz, file.header.line_density) == ("rf", 40, 128)
    for n in range(2):
        # reshape(v, h, w) of MATLAB has a line in each column.
        np.testing.assert_array_equal(file.rf(n).T, values[n].reshape((7, 5), order="F"))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "0 bytes, too short for a header"),
        (file_bytes(16, cut=75)[0], "75 bytes, too short"),
        (file_bytes(16, cut=-1)[0], "bytes, 216 expected, or 224 with numbered frames"),
        (file_bytes(16)[0] + b"\0", "cut off or damaged"),
        (struct.pack("<19i", 3, *[1] * 18) + bytes(2), "type 3 found, and 4 .* are read; export one of these"),
        (file_bytes(16, bits=32)[0], r"it holds rf frames of 32 bits, and only frames of 16 bits are read"),
        (struct.pack("<19i", 16, 2**31 - 1, 2**31 - 1, 2**31 - 1, 16, *[0] * 14), "expected"),
        (struct.pack("<19i", 16, -1, -1, 1, 16, *[0] * 14) + bytes(2), "header is damaged"),
        (file_bytes(4, bits=16)[0], "only frames of 8 bits are read"),
    ],
)
def test_damaged_files_are_refused_with_their_sizes(tmp_path, data, message):
    (tmp_path / "a.rf").write_bytes(data)
    with pytest.raises(RecordError, match=message):
        open_ultrasonix(tmp_path / "a.rf")


def test_what_is_not_in_the_file_is_refused(tmp_path):
    (tmp_path / "a.rf").write_bytes(file_bytes(16)[0])
    file = open_ultrasonix(tmp_path / "a.rf")
    with pytest.raises(RecordError, match="there is no frame 3, it holds 2"):
        file.rf(2)
    with pytest.raises(RecordError, match="there is no frame 0"):
        file.rf(-1)
    with pytest.raises(RecordError, match="it holds rf frames, b-mode was asked for"):
        file.b_mode(0)
    os.truncate(tmp_path / "a.rf", 100)
    with pytest.raises(RecordError, match="became shorter"):
        file.rf(1)
    with pytest.raises(RecordError, match="check the name"):
        open_ultrasonix(tmp_path / "b.rf")
