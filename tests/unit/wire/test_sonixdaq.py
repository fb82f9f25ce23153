"""Channel files of a SonixDAQ: the order of the elements, and headers."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.wire import sonixdaq


def test_elements_are_a_permutation_with_the_published_first_ones():
    elements = [sonixdaq.element_of_file(number) for number in range(128)]
    assert sorted(elements) == list(range(128))
    assert elements[:10] == [0, 16, 32, 48, 64, 80, 96, 112, 1, 17]


def test_where_both_layouts_fit_the_name_decides():
    """Sizes 12 + 2 f s and 8 + 2 f' s' meet at channel 2, one frame of 2 samples."""
    neither = struct.pack("<3i", 4, 1, 0)
    with pytest.raises(RecordError):
        sonixdaq.decode_header(neither, size=999, name="x")
    both = struct.pack("<3i", 2, 2, 1)
    assert sonixdaq.decode_header(both, size=16, name="CH002.daq").length == 12
    assert sonixdaq.decode_header(both, size=16, name="CH007-0000.daq").length == 8


def test_a_file_without_a_header_is_named_as_such() -> None:
    """Samples alone: their first twelve bytes are no numbers of channels, frames and samples."""
    body = np.full(2080, -7, np.int16).tobytes()
    with pytest.raises(RecordError, match=r"CH000\.daq: its first bytes are no header of a SonixDAQ channel file"):
        sonixdaq.decode_header(body[:12], size=len(body), name="CH000.daq")
