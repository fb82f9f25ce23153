"""IPASC HDF5 banks detect changes, are on the disk when acknowledged, and are whole or absent."""

from __future__ import annotations

import math
import os
import shutil
import zlib
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
from markerseek.records.banks.ipasc import BankWriter
from markerseek.records.banks.ipasc.reading import read_probed
from markerseek.records.banks.ipasc.rows import frame_sum, probe_pose, row_sum
from markerseek.records.banks.ipasc.writer import whole_bank
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, changed, counts, put, sample, write


def every_frame(bank):
    if isinstance(bank, FrameBank):
        for index in range(len(bank.angles_deg)):
            bank.frame(index)
        for index in range(bank.dark_frames):
            bank.dark_frame(index)


def on_disk(path):
    """What another process would see of a file that the library has open here."""
    shutil.copy(path, path.with_name("seen.h5"))
    return h5py.File(path.with_name("seen.h5"))


@settings(max_examples=30)
@given(data=st.data())
def test_no_changed_byte_of_a_frame_goes_unnoticed(tmp_path_factory, data):
    path = write(tmp_path_factory.mktemp("a") / "a.hdf5")
    seed = data.draw(st.sampled_from((0, 1, 2, 3, 8, 9)))
    flips = data.draw(st.dictionaries(st.integers(0, 799), st.integers(1, 255), min_size=1, max_size=3))
    raw = bytearray(path.read_bytes())
    start = raw.find(counts(seed).tobytes())
    assert start > 0
    for place, bits in flips.items():
        raw[start + place] ^= bits
    path.write_bytes(raw)
    bank = read_probed(path)
    what = f"dark frame {seed - 7}" if seed >= 8 else f"the frame at {ANGLES[seed]:g} deg"
    with pytest.raises(RecordError, match=f"{what} has changed since it was written.* from a backup or scan again"):
        every_frame(bank)


@pytest.mark.parametrize("frame", [True, False])
@pytest.mark.parametrize(
    ("name", "value"),
    [("trus_angle_deg", 2.5), ("intensity", 102.0), ("pulses", 15), ("rig_clock_s", 2.25), ("rig_clock_s", math.nan)],
)
def test_no_changed_number_goes_unnoticed(tmp_path, frame, name, value):
    if not frame and name in {"pulses", "rig_clock_s"} and value != 15:
        value = 1.0

    def change(file):
        assert file["meta_data"][name][1] != value
        file["meta_data"][name][1] = value

    path = changed(write(tmp_path / "a.hdf5", frame=frame), change)
    angle = "2.5" if name == "trus_angle_deg" else "2"
    with pytest.raises(RecordError, match=f"what is written of the angle {angle} deg has changed"):
        read_probed(path)
    changed(path, lambda _file: None, sums=False)
    every_frame(read_probed(path))


def test_frames_that_changed_places_are_noticed(tmp_path):
    def change(file):
        frames = file["binary_time_series_data"]
        frames[..., 0], frames[..., 1] = frames[..., 1], frames[..., 0]

    with pytest.raises(RecordError, match="has changed"):
        every_frame(read_probed(changed(write(tmp_path / "a.hdf5"), change)))


def test_checksums_of_another_number_are_refused(tmp_path):
    path = changed(write(tmp_path / "a.hdf5"), put("meta_data/frame_crc32", np.zeros(3, np.uint32)))
    with pytest.raises(RecordError, match="frame_crc32 holds 3 checksums for 4 frames"):
        read_probed(path)


def test_checksums_are_those_of_zlib_over_the_numbers_and_then_the_counts(tmp_path):
    numbers = np.array([2.0, 101.0, 2.0]).astype("<f8").tobytes() + np.array([16]).astype("<i8").tobytes()
    with h5py.File(write(tmp_path / "a.hdf5")) as file:
        assert file["meta_data/row_crc32"][1] == zlib.crc32(numbers)
        assert file["meta_data/frame_crc32"][1] == zlib.crc32(numbers + counts(1).astype("<i2").tobytes())
        assert file["meta_data/dark_frame_crc32"][1] == zlib.crc32(counts(9).astype("<i2").tobytes())
    assert row_sum(angle_deg=0.0, intensity=-math.nan, pulses=1, started_s=math.nan, energy=math.nan) == row_sum(
        angle_deg=0.0, intensity=math.nan, pulses=1, started_s=-math.nan, energy=math.nan
    )
    assert frame_sum(np.asfortranarray(counts(3))) == frame_sum(counts(3)) == frame_sum(counts(3).astype(">i2"))


def test_an_acquisition_is_on_the_disk_when_add_returns_and_its_angle_after_all_else(tmp_path, monkeypatch):
    path = tmp_path / "a.hdf5"
    seen = []

    def synced(descriptor):
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            with on_disk(path) as file:
                seen.append((np.isfinite(file["meta_data/trus_angle_deg"][()]).sum(), file["meta_data/row_crc32"][0]))

    with BankWriter(path, angles=3, facts=FACTS) as writer:
        writer.add(sample(1.0, seed=1))
        monkeypatch.setattr(os, "fsync", synced)
        writer.add(sample(2.0, seed=2))
        assert [angles for angles, _ in seen] == [1, 2]
        writer.add(sample(3.0, seed=3))
        assert [angles for angles, _ in seen] == [1, 2, 2, 3]
        monkeypatch.undo()


@given(
    angles=st.tuples(*[st.floats(-360, 360)] * 2),
    radius_m=st.floats(1e-3, 0.1),
    point_m=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
)
def test_a_pose_moves_points_as_the_probe_turns(angles, radius_m, point_m):
    """A point of the array's own coordinates, at both angles, in the TRUS home frame: turned about y by SciPy."""
    angle_deg, first_deg = angles
    pose = probe_pose(angle_deg, first_deg=first_deg, face_radius_m=radius_m)
    moved_m = Rotation.from_euler("xyz", pose[3:]).apply(point_m) + pose[:3]

    def home_m(of_array_m, at_deg):
        along_m, across_m, out_m = of_array_m
        return Rotation.from_euler("y", at_deg, degrees=True).apply((-across_m, along_m, radius_m + out_m))

    np.testing.assert_allclose(home_m(moved_m, first_deg), home_m(point_m, angle_deg), atol=1e-15)


def test_poses_are_those_of_the_rows_and_there_where_the_radius_is_known(tmp_path):
    with BankWriter(tmp_path / "a.hdf5", angles=4, facts=FACTS) as writer:
        for angle in ANGLES[:2]:
            writer.add(sample(angle))
        with on_disk(tmp_path / "a.hdf5") as file:
            growing = file["meta_data/measurement_spatial_poses"][()]
        assert np.isfinite(growing[:2]).all()
        assert np.isnan(growing[2:]).all()
        writer.add(sample(ANGLES[2]))
    poses = pacfish.load_data(str(tmp_path / "a.hdf5")).get_measurement_spatial_poses()
    turned = np.radians(ANGLES[0] - np.array(ANGLES[:3]))
    np.testing.assert_allclose(poses[:, 3], -turned)
    np.testing.assert_allclose(poses[:, 1], 10e-3 * np.sin(turned))
    np.testing.assert_allclose(poses[:, 2], 10e-3 * (np.cos(turned) - 1), atol=1e-18)
    assert not poses[:, (0, 4, 5)].any()
    path = write(tmp_path / "b.hdf5", facts=replace(FACTS, face_radius_m=None))
    assert pacfish.load_data(str(path)).get_measurement_spatial_poses() is None


def test_a_copy_that_cannot_be_made_leaves_the_rows_that_were_not_taken(tmp_path, monkeypatch):
    path = tmp_path / "a.hdf5"
    writer = BankWriter(path, angles=9, facts=FACTS)
    for seed, angle in enumerate(ANGLES):
        writer.add(sample(angle, seed=seed))
    monkeypatch.setattr("shutil.disk_usage", lambda _path: type("", (), {"free": 1000}))
    writer.close()
    bank = read_bank(path)
    assert (bank.angles_deg, bank.planned) == (ANGLES[::-1], 9)
    every_frame(bank)
    assert list(tmp_path.iterdir()) == [path]


def test_all_that_a_bank_says_is_in_its_smaller_copy(tmp_path):
    whole, cut = write(tmp_path / "a.hdf5", planned=4), write(tmp_path / "b.hdf5", planned=9)
    ours, theirs = pacfish.load_data(str(whole)), pacfish.load_data(str(cut))
    np.testing.assert_array_equal(ours.binary_time_series_data, theirs.binary_time_series_data)
    for name in {*ours.meta_data_acquisition, *theirs.meta_data_acquisition} - {"uuid"}:
        np.testing.assert_array_equal(ours.meta_data_acquisition[name], theirs.meta_data_acquisition[name])
    np.testing.assert_equal(ours.meta_data_device, theirs.meta_data_device)


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
    path = write(tmp_path / "a.hdf5", planned=9)
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode
