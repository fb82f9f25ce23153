"""Element positions in IPASC HDF5 banks: straight rows along x1, in either direction, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import RecordError
from markerseek.records.banks import FrameBank
from markerseek.records.banks.ipasc import TOLERANCE, element_row, read_probed
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, changed, counts, write

PITCH_M = FACTS.pitch_m
ROW_M = np.column_stack(((np.arange(8) - 3.5) * PITCH_M, np.zeros(8), np.zeros(8)))


class Positions:
    """The part of a file that holds the positions of the elements."""

    def __init__(self, positions_m):
        self.positions_m = positions_m

    def names(self, _group):
        return [f"{number:010d}" for number in range(len(self.positions_m))]

    def has(self, name):
        return self.positions_m[int(name.split("/")[-2])] is not None

    def numbers(self, name):
        return np.asarray(self.positions_m[int(name.split("/")[-2])], float)


def row_of(positions_m, *, elements=8):
    return element_row("a.hdf5", Positions(positions_m), elements=elements)


def placed(positions_m):
    """Change a bank's elements."""

    def change(file):
        detectors = file["meta_data_device/detectors"]
        for name, position in zip(sorted(detectors), positions_m, strict=True):
            detectors[name]["detector_position"][:] = position

    return change


def test_the_rows_of_an_array_whose_elements_fall_are_turned_round(tmp_path):
    bank = read_probed(changed(write(tmp_path / "a.hdf5"), placed(ROW_M[::-1])))
    assert isinstance(bank, FrameBank)
    assert bank.facts.pitch_m == pytest.approx(PITCH_M)
    for index, seed in enumerate((3, 2, 1, 0)):
        np.testing.assert_array_equal(bank.frame(index).samples, counts(seed)[::-1])
    np.testing.assert_array_equal(bank.dark_frame(0).samples, counts(8)[::-1])
    assert bank.angles_deg == ANGLES[::-1]


CURVED_M = np.column_stack((0.04 * np.sin(ROW_M[:, 0] / 0.04), np.zeros(8), 0.04 * np.cos(ROW_M[:, 0] / 0.04)))


@pytest.mark.parametrize(
    ("positions_m", "message"),
    [
        (ROW_M[[0, 1, 2, 4, 3, 5, 6, 7]], r"element 4 of 8 is 0.43 mm from its place"),
        (ROW_M[[1, 0, 2, 3, 4, 5, 6, 7]], r"element [12] of 8 is 0.43 mm"),
        (
            CURVED_M,
            r"element 1 of 8 is 0.0\d+ mm from its place in a straight row of pitch 0.4\d* mm along",
        ),
        (ROW_M[:, [1, 0, 2]], "of pitch 0 mm along x1"),
        (np.zeros((8, 3)), "of pitch 0 mm along x1"),
        (np.where(np.arange(8)[:, None] == 2, np.nan, ROW_M), "0000000002/detector_position is .nan, nan, nan., three"),
    ],
)
def test_other_arrays_are_refused_with_the_element_that_is_off(tmp_path, positions_m, message):
    with pytest.raises(RecordError, match=message):
        read_probed(changed(write(tmp_path / "a.hdf5"), placed(positions_m)))


def test_elements_of_which_some_have_no_position_are_refused_and_without_any_the_pitch_is_unknown():
    with pytest.raises(RecordError, match="positions of 7 elements for 8 channels"):
        row_of([None, *ROW_M[1:]])
    for positions_m in ([], [None] * 8):
        assert (row_of(positions_m).pitch_m, row_of(positions_m).falling) == (None, False)
    assert row_of(ROW_M[:1], elements=1).pitch_m is None
    with pytest.raises(RecordError, match="three finite coordinates"):
        row_of([*ROW_M[:7], (0.0, 1.0)])


@given(
    elements=st.integers(2, 300),
    pitch_m=st.floats(1e-5, 1e-2),
    falling=st.booleans(),
    start_m=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    off=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda each: np.linalg.norm(each) > 0.1),
    data=st.data(),
)
def test_a_row_is_taken_up_to_the_tolerance_and_not_beyond(elements, pitch_m, falling, start_m, off, data):
    step_m = -pitch_m if falling else pitch_m
    positions_m = np.array(start_m) + np.outer(np.arange(elements), (step_m, 0, 0))
    row = row_of(positions_m, elements=elements)
    assert (row.pitch_m, row.falling) == (pytest.approx(pitch_m), falling)
    if elements < 3:
        return
    which = data.draw(st.integers(1, elements - 2))
    direction = np.array(off) / np.linalg.norm(off)
    positions_m[which] += 0.9 * TOLERANCE * pitch_m * direction
    assert row_of(positions_m, elements=elements).pitch_m == pytest.approx(pitch_m)
    positions_m[which] += 0.2 * TOLERANCE * pitch_m * direction
    with pytest.raises(RecordError, match=f"element {which + 1} of {elements} is "):
        row_of(positions_m, elements=elements)
