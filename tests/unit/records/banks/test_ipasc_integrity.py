"""IPASC HDF5 banks detect changes, and are whole or absent."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pacfish
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from markerseek.core import RecordError
from markerseek.records.banks import FrameBank, read_bank, whole_bank
from markerseek.records.banks.ipasc import read_probed
from markerseek.records.banks.ipasc_writer import probe_poses
from tests.sizes import examples
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, counts, sample, write


def every_frame(bank):
    if isinstance(bank, FrameBank):
        for index in range(len(bank.angles_deg)):
            bank.frame(index)
        for index in range(bank.dark_frames):
            bank.dark_frame(index)


@settings(max_examples=examples(30))
@given(seed=st.sampled_from((0, 1, 2, 3, 8, 9)), first=st.integers(0, 795), flips=st.binary(min_size=1, max_size=2))
def test_no_changed_byte_of_a_frame_goes_unnoticed(tmp_path_factory, seed, first, flips):
    path = write(tmp_path_factory.mktemp("a") / "a.hdf5")
    raw = bytearray(path.read_bytes())
    start = raw.find(counts(seed).tobytes())
    assert start > 0
    if not any(flips):
        return
    # In one word at the most: sums of Fletcher cannot tell 0 from 65535 in a word.
    place = start + (first // 2) * 2
    before = bytes(raw[place : place + 2])
    for offset, bits in enumerate(flips):
        raw[place + offset] ^= bits
    if {before, bytes(raw[place : place + 2])} == {b"\0\0", b"\xff\xff"}:
        return
    path.write_bytes(raw)
    bank = read_probed(path)
    what = f"dark frame {seed - 7}" if seed >= 8 else f"frame at {ANGLES[seed]:g} deg"
    with pytest.raises(
        RecordError,
        match=f"no {what} that can be read: .*; it has changed since it was written",
    ):
        every_frame(bank)


@given(
    angles=st.tuples(*[st.floats(-360, 360)] * 2),
    radius_m=st.floats(1e-3, 0.1),
    point_m=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
)
def test_a_pose_moves_points_as_the_probe_turns(angles, radius_m, point_m):
    """A point of the array's own coordinates, at both angles, in the TRUS home frame: turned about y by SciPy."""
    angle_deg, first_deg = angles
    pose = probe_poses((first_deg, angle_deg), radius_m)[1]
    moved_m = Rotation.from_euler("xyz", pose[3:]).apply(point_m) + pose[:3]

    def home_m(of_array_m, at_deg):
        along_m, across_m, out_m = of_array_m
        return Rotation.from_euler("y", at_deg, degrees=True).apply((-across_m, along_m, radius_m + out_m))

    np.testing.assert_allclose(home_m(moved_m, first_deg), home_m(point_m, angle_deg), atol=1e-15)


def test_poses_are_those_of_the_rows_and_there_where_the_radius_is_known(tmp_path):
    path = write(tmp_path / "a.hdf5", taken=3)
    poses = pacfish.load_data(str(path)).get_measurement_spatial_poses()
    turned = np.radians(ANGLES[0] - np.array(ANGLES[:3]))
    np.testing.assert_allclose(poses[:, 3], -turned)
    np.testing.assert_allclose(poses[:, 1], 10e-3 * np.sin(turned))
    np.testing.assert_allclose(poses[:, 2], 10e-3 * (np.cos(turned) - 1), atol=1e-18)
    assert not poses[:, (0, 4, 5)].any()
    path = write(tmp_path / "b.hdf5", facts=replace(FACTS, face_radius_m=None))
    assert pacfish.load_data(str(path)).get_measurement_spatial_poses() is None


def imported(path, *, then=lambda: None):
    with whole_bank(path, facts=FACTS) as writer:
        for angle in (1.0, 2.0, 3.0):
            writer.add(sample(angle))
        then()


def test_an_import_that_fails_leaves_nothing_and_can_be_made_again(tmp_path):
    path = tmp_path / "new" / "a.hdf5"
    path.parent.mkdir()
    during = []

    def fail():
        during.extend(each.name for each in path.parent.iterdir())
        raise RecordError("gone")

    with pytest.raises(RecordError, match="gone"):
        imported(path, then=fail)
    assert [each.startswith(".a.hdf5.") for each in during] == [True]
    assert list(path.parent.iterdir()) == []
    imported(path)
    assert list(path.parent.iterdir()) == [path]
    assert read_bank(path).angles_deg == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("call", ["h5py.File", "h5py.File.close", "os.fsync", "os.link"])
def test_a_disk_that_fails_at_any_step_is_reported_as_one(tmp_path, monkeypatch, call):
    made = h5py.File.close

    def full(*names, **_modes):
        if call == "h5py.File.close":
            made(*names)
        raise OSError(28, "No space left on device")

    if call == "os.link":
        # A disk without hard links is no fault: only what replaces them is.
        monkeypatch.setattr("pathlib.Path.replace", full)
    monkeypatch.setattr(call, full)
    with pytest.raises(
        RecordError, match=r"a\.hdf5: the bank cannot be written: .*No space left on device; nothing was"
    ):
        imported(tmp_path / "a.hdf5")
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []
