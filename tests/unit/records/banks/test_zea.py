"""Files of zea: the same frames and angles in each of its layouts, or a sentence that says what is wrong."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.records.banks import read_bank
from markerseek.records.banks.arrays import ArrayBank

ANGLES = np.array([20.0, -10.0, 5.5])
FRAMES = np.random.default_rng(8).integers(-2000, 2000, (3, 6, 40)).astype(np.int16)
GEOMETRY = np.column_stack([np.arange(6) * 0.3e-3, np.zeros((6, 2))])
QUATERNIONS = np.column_stack([np.cos(np.radians(ANGLES) / 2), np.sin(np.radians(ANGLES) / 2), np.zeros((3, 2))])


def fields(track="tracks/track_0/"):
    return {
        f"{track}data/raw_data": FRAMES.transpose(0, 2, 1)[:, None, :, :, None],
        f"{track}scan/sampling_frequency": np.float32(31.25e6),
        f"{track}scan/sound_speed": np.float32(1500.0),
        f"{track}scan/initial_times": np.zeros(1, np.float32),
        f"{track}scan/tx_apodizations": np.zeros((1, 6), np.float32),
        "probe/probe_geometry": GEOMETRY.astype(np.float32),
        "metadata/probe_pose/rotation": np.radians(np.column_stack([ANGLES, np.zeros((3, 2))])).astype(np.float32),
        "metadata/probe_pose/rotation_representation": "euler_xyz",
    }


def write(path, **changes):
    held = fields() | {name.replace("__", "/"): value for name, value in changes.items()}
    with h5py.File(path, "w") as file:
        for name, value in held.items():
            if value is not None:
                file[name] = value
    return path


TRACK = "tracks__track_0__"


def frames_of(bank):
    assert isinstance(bank, ArrayBank)
    return np.stack([bank.frame(index).samples for index in range(len(bank.angles_deg))])


@pytest.mark.parametrize(
    "rotation",
    [
        ("euler_xyz", fields()["metadata/probe_pose/rotation"]),
        ("quaternion_wxyz", QUATERNIONS.astype(np.float32)),
        ("quaternion_wxyz", -QUATERNIONS.astype(np.float32)),
        ("quaternion_xyzw", np.roll(QUATERNIONS, -1, axis=1).astype(np.float32)),
    ],
)
def test_frames_and_angles_come_back(tmp_path, rotation):
    kind, values = rotation
    path = write(
        tmp_path / "a.hdf5", metadata__probe_pose__rotation=values, metadata__probe_pose__rotation_representation=kind
    )
    bank = read_bank(path)
    assert bank.angles_deg == pytest.approx((-10.0, 5.5, 20.0), abs=1e-5)
    np.testing.assert_array_equal(frames_of(bank), FRAMES[[1, 2, 0]])
    assert (bank.facts.sampling_hz, bank.facts.sound_speed_m_s) == (31.25e6, 1500.0)
    assert bank.facts.pitch_m == pytest.approx(0.3e-3)


def test_a_file_without_tracks_is_read(tmp_path):
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        for name, value in fields(track="").items():
            file[name.replace("probe/", "scan/")] = value
    np.testing.assert_array_equal(frames_of(read_bank(tmp_path / "a.hdf5")), FRAMES[[1, 2, 0]])


def test_elements_from_right_to_left_are_turned_round(tmp_path):
    bank = read_bank(write(tmp_path / "a.hdf5", probe__probe_geometry=GEOMETRY[::-1].astype(np.float32)))
    np.testing.assert_array_equal(frames_of(bank), FRAMES[[1, 2, 0], ::-1])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({f"{TRACK}data__raw_data": np.zeros((3, 4, 40, 6, 1), np.int16)}, "one receive without a transmit each"),
        ({f"{TRACK}data__raw_data": np.zeros((3, 1, 40, 6, 3), np.int16)}, "or 2 of IQ data, is"),
        ({f"{TRACK}scan__tx_apodizations": np.ones((1, 6), np.float32)}, "echoes of a transmit"),
        ({f"{TRACK}scan__initial_times": np.array([1.0], np.float32)}, "1e\\+06 µs after the trigger, at most 200 µs"),
        ({"tracks__track_1__data": np.zeros(1)}, "it holds 2 tracks"),
        ({"probe__probe_geometry": GEOMETRY[:4].astype(np.float32)}, "no position for each of 6 elements"),
        ({"metadata__probe_pose__rotation": np.eye(3, dtype=np.float32)}, "turns about another axis than x"),
        ({"metadata__probe_pose__rotation": np.full((3, 3), np.nan, np.float32)}, "turns about another axis"),
        ({"metadata__probe_pose__rotation": np.zeros((9, 3), np.float32)}, "one pose for each frame is expected"),
        ({"metadata__probe_pose__rotation_representation": "matrix"}, "as euler_xyz"),
        ({"metadata__probe_pose__rotation": None}, "angle_deg is missing"),
        ({f"{TRACK}scan__sampling_frequency": np.ones(3)}, "holds 3 numbers, one is expected"),
    ],
)
def test_what_cannot_be_a_scan_is_refused(tmp_path, changes, message):
    with pytest.raises(RecordError, match=message):
        read_bank(write(tmp_path / "a.hdf5", **changes))


def test_a_filter_of_a_plugin_is_refused_with_the_cure(tmp_path):
    path = write(tmp_path / "a.hdf5", **{f"{TRACK}data__raw_data": None})
    with h5py.File(path, "r+") as file:
        shape = (3, 1, 40, 6, 1)
        file.create_dataset("tracks/track_0/data/raw_data", shape, np.int16, chunks=shape, scaleoffset=0)
    with pytest.raises(RecordError, match=r"save it by File.create\(..., compression='gzip'\)"):
        read_bank(path)
