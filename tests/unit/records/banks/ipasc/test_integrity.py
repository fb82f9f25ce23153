"""IPASC HDF5 banks detect changes, and are whole or absent."""

from __future__ import annotations

import os
from dataclasses import replace

import h5py
import numpy as np
import pacfish
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from markerseek.core import RecordError
from markerseek.files import create_atomically
from markerseek.records.banks import BankFacts, FrameBank, read_bank
from markerseek.records.banks.ipasc import whole_bank
from markerseek.records.banks.ipasc.reading import read_probed
from markerseek.records.banks.ipasc.writer import probe_poses
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
    with pytest.raises(RecordError, match=f"the {what} has changed since it was written.* from a backup or scan again"):
        every_frame(bank)


@pytest.mark.long
@pytest.mark.parametrize("name", ["trus_angle_deg", "intensity", "pulses", "rig_clock_s", "energy_over_usual"])
@pytest.mark.parametrize("bit", range(8))
def test_no_changed_number_goes_unnoticed(tmp_path, name, bit):
    path = write(tmp_path / "a.hdf5", energies=(1.1, 1.2, 0.9, 1.05))
    with h5py.File(path) as file:
        item = file["meta_data"][name]
        chunk = item.id.get_chunk_info(0)
    raw = bytearray(path.read_bytes())
    for place in range(chunk.byte_offset, chunk.byte_offset + 8 * 4):
        raw[place] ^= 1 << bit
        path.write_bytes(raw)
        with pytest.raises(RecordError, match="no bank in HDF5 that can be read"):
            read_probed(path)
        raw[place] ^= 1 << bit


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


def imported(path, *, planned=3, then=lambda: None):
    with whole_bank(path, angles=planned, facts=FACTS) as writer:
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
    with pytest.raises(RecordError, match=r"a\.hdf5: 3 of 4 angles and 0 of 0 dark frames came; nothing was kept"):
        imported(path, planned=4)
    with pytest.raises(RecordError, match=r"a\.hdf5: 2 acquisitions were announced and one more came"):
        imported(path, planned=2)
    assert list(path.parent.iterdir()) == []
    imported(path)
    assert list(path.parent.iterdir()) == [path]
    assert read_bank(path).angles_deg == (1.0, 2.0, 3.0)


def test_an_error_of_reading_is_none_of_writing(tmp_path):
    def unreadable():
        raise OSError(5, "Input/output error", "source.npy")

    with pytest.raises(OSError, match=r"source\.npy"):
        imported(tmp_path / "a.hdf5", then=unreadable)
    assert list(tmp_path.iterdir()) == []


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


def test_only_a_checksum_that_differs_is_reported_as_one(tmp_path, monkeypatch):
    bank = read_probed(write(tmp_path / "a.hdf5"))

    def broken(*_place):
        # HDF5 names the file, whose folder may be of filters.
        where = "filename = '/filter-tests/a.hdf5', errno = 5"
        raise OSError(f"Can't read data (file read failed: {where}, error message = 'Input/output error')")

    monkeypatch.setattr(h5py.Dataset, "__getitem__", broken)
    for read in (lambda: bank.frame(0), lambda: bank.dark_frame(0)):
        with pytest.raises(RecordError, match=r"a\.hdf5: no bank .*error message = 'Input/output error'") as said:
            read()
        assert "its checksum differs" not in str(said.value)


def test_an_import_replaces_no_file_that_came_meanwhile(tmp_path):
    path = tmp_path / "a.hdf5"
    with pytest.raises(RecordError, match="there is a file already"):
        imported(path, then=lambda: path.write_text("mine"))
    with pytest.raises(RecordError, match="there is a file already"):
        imported(path)
    assert (path.read_text(), list(tmp_path.iterdir())) == ("mine", [path])


@pytest.mark.parametrize(("folder", "said"), [("file", "file is no folder"), ("new", "there is no folder .*new")])
def test_a_path_that_is_not_a_folder_is_reported(tmp_path, folder, said):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(RecordError, match=rf"a\.hdf5: it cannot be written: .*{said}.*name another"),
        whole_bank(tmp_path / folder / "a.hdf5", angles=3, facts=BankFacts()),
    ):
        raise AssertionError
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_disk_without_second_names_gets_the_file_all_the_same(tmp_path, monkeypatch):
    def no_links(*_names):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "a"
    with create_atomically(path) as part:
        part.write_text("1")
    with pytest.raises(RecordError, match="there is a file already"), create_atomically(path) as part:
        part.write_text("2")
    assert (path.read_text(), list(tmp_path.iterdir())) == ("1", [path])


def test_a_bank_is_readable_by_whom_the_system_lets_read(tmp_path):
    (tmp_path / "plain").write_text("")
    path = write(tmp_path / "a.hdf5")
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode
