"""Banks in IPASC HDF5, ours and of other programs: read as written, with no invented values; rows of elements."""

from __future__ import annotations

import math
import shutil

import h5py
import numpy as np
import pacfish
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import BankFacts, FrameBank, TableFormat, read_bank, whole_bank
from markerseek.records.banks.ipasc import TOLERANCE, element_row, read_probed
from tests.notes import noted
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, FIXTURES, changed, counts, put, sample, write


def test_a_bank_of_another_program_is_read():
    bank = read_bank(FIXTURES / "foreign.hdf5")
    assert isinstance(bank, FrameBank)
    assert bank.angles_deg == (-1.5, 0.0, 1.5, 3.0)
    np.testing.assert_array_equal(bank.frame(2).samples, counts(2, (2, 6)))
    assert (bank.intensities, bank.dark_frames) == ((), 0)
    assert bank.facts == BankFacts(sampling_hz=40e6)
    assert np.isnan(bank.started_s).all()
    assert np.isnan(bank.frame(0).header.started_s)


def test_todays_version_is_read():
    bank = read_bank(FIXTURES / "bank.hdf5")
    assert isinstance(bank, FrameBank)
    assert bank.angles_deg == ANGLES[::-1]
    assert bank.intensities == (103.0, 102.0, 101.0, 100.0)
    np.testing.assert_array_equal(bank.frame(3).samples, counts(0, (2, 6)))
    for index, seed in enumerate((8, 9)):
        np.testing.assert_array_equal(bank.dark_frame(index).samples, counts(seed, (2, 6)))
    assert structs.replace(bank.facts, pitch_m=FACTS.pitch_m) == FACTS
    assert (bank.started_s, bank.pulses) == ((6.0, 4.0, 2.0, 0.0), (16,) * 4)


def test_a_bank_with_angles_refuses_stated_ones():
    with pytest.raises(ConfigError, match="this recording has its angles; leave `first_and_step_deg"):
        read_bank(FIXTURES / "bank.hdf5", TableFormat(first_and_step_deg=(0.0, 1.0)))


def with_poses(path, about_deg, *, positions_m=0.0):
    """The bank of another program, with poses in place of its angles."""
    shutil.copy(FIXTURES / "foreign.hdf5", path)
    poses = np.column_stack([np.full_like(about_deg, positions_m), np.radians(about_deg)])

    def change(file):
        del file["meta_data/trus_angle_deg"]
        file["meta_data/measurement_spatial_poses"] = poses.astype(np.float32)

    return changed(path, change)


def test_the_poses_of_the_measurements_give_the_angles(tmp_path):
    """Also where the probe moves on the way: a side-fire array turns about an axis behind it."""
    about_deg = np.zeros((4, 3))
    about_deg[:, 0] = (2.5, -4.0, 0.0, 11.25)
    path = with_poses(tmp_path / "a.hdf5", about_deg, positions_m=3e-3)
    with noted("its angles are the rotations about x1 of meta_data/measurement_spatial_poses"):
        bank = read_bank(path)
    assert bank.angles_deg == (-4.0, 0.0, 2.5, 11.25)
    np.testing.assert_array_equal(bank.frame(0).samples, read_bank(FIXTURES / "foreign.hdf5").frame(1).samples)


@pytest.mark.parametrize(
    ("about_deg", "message"),
    [
        (np.zeros((4, 3)), "angle_deg is missing"),
        (np.full((4, 3), np.nan), "angle_deg is missing"),
        (np.outer(np.arange(4.0), (0, 0, 1)), "turns about another axis than x1, that of the array, by up to 3 deg"),
        (np.outer(np.arange(4.0), (1, 0.1, 0)), "turns about another axis than x1"),
        (np.outer(np.arange(4.0), (200, 0, 0)), r"turns by up to 10\.47 rad; write radians, within a turn"),
        (np.zeros((3, 3)), "holds 18 numbers for 4 measurements, 6 for each are expected"),
    ],
)
def test_poses_that_are_no_angles_are_refused(tmp_path, about_deg, message):
    with pytest.raises(RecordError, match=message):
        read_bank(with_poses(tmp_path / "a.hdf5", about_deg))


@pytest.mark.parametrize("version", [2, 1000, 0, 1.5])
def test_another_version_is_refused(tmp_path, version):
    shutil.copy(FIXTURES / "bank.hdf5", tmp_path / "a.hdf5")
    with pytest.raises(RecordError, match=f"newer markerseek: the bank has version {version:g}, this one reads 1"):
        read_bank(changed(tmp_path / "a.hdf5", put("meta_data/markerseek_bank_version", version)))


def test_times_of_another_program_count_from_1970(tmp_path):
    shutil.copy(FIXTURES / "foreign.hdf5", tmp_path / "a.hdf5")

    def change(file):
        file["meta_data/measurement_timestamps"] = np.array([1.7e9, 1.7e9 + 1, np.nan, 1.7e9 + 3])

    bank = read_bank(changed(tmp_path / "a.hdf5", change))
    assert isinstance(bank, FrameBank)
    assert bank.facts.clock_zero_unix_s == 0.0
    np.testing.assert_array_equal(np.sort(bank.started_s), (1.7e9, 1.7e9 + 1, 1.7e9 + 3, np.nan))


def test_unknown_times_stay_unknown(tmp_path):
    path = tmp_path / "a.hdf5"
    with whole_bank(path, facts=BankFacts(clock_zero_unix_s=None)) as writer:
        for seed, started_s in enumerate((1.0, math.nan, math.inf)):
            frame = sample(float(seed), seed=seed).frame
            frame = structs.replace(frame, header=structs.replace(frame.header, started_s=started_s))
            writer.add(structs.replace(sample(float(seed)), frame=frame))
    bank = read_bank(path)
    assert isinstance(bank, FrameBank)
    np.testing.assert_array_equal(bank.started_s, (1.0, np.nan, np.nan))
    assert (bank.facts.clock_zero_unix_s, bank.facts.pitch_m) == (None, None)
    assert np.isnan(pacfish.load_data(str(path)).get_measurement_time_stamps()).all()


def foreign(path, frames, **fields):
    """A file of another program: ``frames`` (angles, channels, samples), and fields of ``meta_data``."""
    with h5py.File(path, "w") as file:
        file["binary_time_series_data"] = frames.transpose(1, 2, 0)[:, :, None]
        angles_deg = np.arange(len(frames)) * 2.0
        for name, value in {"trus_angle_deg": angles_deg, "ad_sampling_rate": 40e6, **fields}.items():
            file[f"meta_data/{name}"] = value
    return path


def test_a_pulse_energy_of_each_measurement_is_that_of_its_frame(tmp_path):
    joules = np.array([1e-3, 3e-3, np.nan, 2e-3])
    frames = np.stack([counts(seed) for seed in range(4)])
    bank = read_bank(foreign(tmp_path / "a.hdf5", frames, pulse_energy=joules))
    assert [bank.frame(index).header.energy for index in range(4)] == [0.5, 1.5, None, 1.0]
    assert bank.facts.pulse_energy_j == pytest.approx(2e-3)
    # One number for all is that of a usual pulse, and says nothing of single measurements.
    for name, joules in (("b", np.full(4, 2e-3)), ("c", np.array([2e-3]))):
        bank = read_bank(foreign(tmp_path / f"{name}.hdf5", frames, pulse_energy=joules))
        assert (bank.frame(1).header.energy, bank.facts.pulse_energy_j) == (None, 2e-3)
    with noted("pulse_energy holds 3 energies for 4 measurements, and only their mean"):
        bank = read_bank(foreign(tmp_path / "d.hdf5", frames, pulse_energy=np.array([1e-3, 2e-3, 3e-3])))
    assert (bank.frame(1).header.energy, bank.facts.pulse_energy_j) == (None, pytest.approx(2e-3))


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
        (CURVED_M, r"element 1 of 8 is 0.0\d+ mm from its place in a straight row of pitch 0.4\d* mm along"),
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
