"""Frames read from files: their content comes back, and invalid content is a `RecordError`."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import TableFormat, read_bank
from markerseek.records.banks.frames import load_frame
from markerseek.wire import sonixdaq
from tests.notes import noted

SAMPLES = 160
JOURNAL = Path(__file__).parents[3] / "data/format-2.journal"


def write_daq(folder, pulses, *, new=True):
    """Files of one acquisition; ``pulses`` is (frames, elements, samples) in the order of the elements."""
    folder.mkdir(exist_ok=True)
    for number in range(128):
        name = f"CH{number:03d}.daq" if new else f"CH{number:03d}-0000.daq"
        element = 16 * (number % 8) + number // 8
        rows = pulses[:, element].astype("<i2")
        head = struct.pack("<3i", number, *rows.shape) if new else struct.pack("<2i", *rows.shape)
        (folder / name).write_bytes(head + rows.tobytes())
    return folder


def pulses_of(frames=3, seed=0):
    return np.random.default_rng(seed).integers(-2048, 2048, (frames, 128, SAMPLES)).astype(np.int16)


@pytest.mark.parametrize("new", [True, False])
@pytest.mark.parametrize("frames", [1, 4])
def test_daq_folder_is_averaged_and_in_the_order_of_the_elements(tmp_path, new, frames):
    pulses = pulses_of(frames)
    frame = load_frame(write_daq(tmp_path / "a", pulses, new=new), angle_deg=5.0)
    np.testing.assert_array_equal(frame.samples, np.rint(pulses.mean(axis=0)).astype(np.int16))
    assert (frame.header.pulses, frame.header.commanded_deg, frame.sampling_hz) == (frames, 5.0, 40e6)
    assert np.isnan((frame.header.started_s, frame.header.ended_s)).all()


def test_truncated_daq_names_file_sizes_and_cure(tmp_path):
    folder = write_daq(tmp_path / "a", pulses_of())
    file = folder / "CH042.daq"
    file.write_bytes(file.read_bytes()[:-2])
    size = 12 + 2 * 3 * SAMPLES
    with pytest.raises(RecordError) as error:
        load_frame(folder)
    for word in ("CH042.daq", f"{size - 2} bytes found", f"{size} bytes", "acquire it again"):
        assert word in str(error.value)


def test_missing_daq_is_named(tmp_path):
    folder = write_daq(tmp_path / "a", pulses_of())
    (folder / "CH017.daq").unlink()
    with pytest.raises(RecordError, match=r"127 channel files .* 128 expected.*CH017"):
        load_frame(folder)


def damage_short(folder):
    (folder / "CH003.daq").write_bytes(b"\x03\x00")


def damage_other_length(folder):
    (folder / "CH003.daq").write_bytes(sonixdaq.encode_file(np.zeros((3, SAMPLES + 1), np.int16), number=3))


def damage_twice(folder):
    (folder / "CH003-0000.daq").write_bytes((folder / "CH003.daq").read_bytes())


@pytest.mark.parametrize("damage", [damage_short, damage_other_length, damage_twice])
def test_odd_daq_files_are_refused_by_name(tmp_path, damage):
    folder = write_daq(tmp_path / "a", pulses_of())
    damage(folder)
    with pytest.raises(RecordError, match="CH003"):
        load_frame(folder)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<i2", ">i2"])
def test_npy(tmp_path, order, dtype):
    samples = pulses_of()[0]
    np.save(tmp_path / "a.npy", np.asarray(samples, dtype=dtype, order=order))
    np.testing.assert_array_equal(load_frame(tmp_path / "a.npy").samples, samples)


def mat_bytes(*, compress=False, **changes):
    content = {
        "AdcData_frame000": np.arange(32 * 20 * 4).reshape(32, 20, 4).astype(np.int16),
        "SampleNum": np.int32(15),
        **changes,
    }
    stream = io.BytesIO()
    savemat(stream, {k: v for k, v in content.items() if v is not None}, do_compression=compress)
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        {"AdcData_frame000": None},
        {"SampleNum": None},
        {"SampleNum": np.int32(21)},
        {"SampleNum": np.int32(0)},
        {"SampleNum": np.int32(-1)},
        {"SampleNum": np.array([1, 2])},
        {"SampleNum": "many"},
        {"SampleNum": 7.5},
        {"AdcData_frame000": np.zeros((32, 20, 3), np.int16)},
        {"AdcData_frame000": np.zeros((32, 20, 4))},
        {"AdcData_frame000": np.zeros((128, 20), np.int16)},
    ],
)
def test_odd_mat_is_refused(tmp_path, content):
    (tmp_path / "a.mat").write_bytes(mat_bytes(**content))
    with pytest.raises(RecordError, match=r"a\.mat"):
        load_frame(tmp_path / "a.mat")


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("top", [2, 100, 2047])
def test_mat_is_read_as_scipy_reads_it(tmp_path, compress, top):
    data = np.random.default_rng(2).integers(-top, top, (32, 50, 4)).astype(np.int16)
    savemat(tmp_path / "a.mat", {"AdcData_frame000": data, "SampleNum": 37.0, "x": "text"}, do_compression=compress)
    theirs = loadmat(tmp_path / "a.mat")["AdcData_frame000"].transpose(0, 2, 1).reshape((128, 50), order="F")[:, :37]
    np.testing.assert_array_equal(load_frame(tmp_path / "a.mat").samples, theirs)


def savemat_bytes(**content):
    stream = io.BytesIO()
    savemat(stream, content)
    return stream.getvalue()


def npy_header(text):
    head = text.encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.hdf5", b"", r"a scan of many angles, not one frame; see `read_bank\(.*a.hdf5"),
        ("a.csv", b"angle_deg,intensity", r"see `read_bank\(.*a.csv"),
        ("a.npz", b"", r"see `read_bank\(.*a.npz"),
        ("a.run", JOURNAL.read_bytes(), "journal of a search, not one frame; see `read_journal\\(.*a.run"),
        ("a.txt", b"", "give a .mat, an .npy, or a folder of SonixDAQ files, .* an Ultrasonix .rf; B-mode images"),
        ("a.mat", savemat_bytes(angle_deg=np.arange(3.0)), "see `read_bank\\(.*a.mat"),
    ],
)
def test_another_kind_of_file_names_the_command_for_it(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=message):
        load_frame(tmp_path / name)


@pytest.mark.parametrize("content", [b"text", npy_header("{'descr': '|O', 'fortran_order': False, 'shape': (2,), }\n")])
def test_nobody_is_advised_to_unpickle_a_file(tmp_path, content):
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(RecordError, match="it holds Python objects, or another format; save it again") as refused:
        load_frame(tmp_path / "a.npy")
    assert "pickle" not in str(refused.value)


def test_an_npy_of_many_angles_names_the_command_for_it(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 2, 9), np.int16))
    with pytest.raises(RecordError, match=r"see `read_bank\(.*a.npy\)`"):
        load_frame(tmp_path / "a.npy")


def test_a_folder_of_many_angles_names_the_command_for_it(tmp_path):
    (tmp_path / "angle_-5deg").mkdir()
    with pytest.raises(RecordError, match=r"0 channel files .* see `read_bank\("):
        load_frame(tmp_path)


def counted_folder(folder, frames):
    folder.mkdir()
    for number, samples in frames.items():
        np.save(folder / f"frame_{number:03d}.npy", samples)
    return folder


def test_a_counted_folder_takes_stated_angles_and_keeps_the_places_of_missing_frames(tmp_path):
    frames = dict(enumerate(pulses_of(6), start=8))
    del frames[11]
    folder = counted_folder(tmp_path / "scan", frames)
    with pytest.raises(RecordError, match=r"frame_008\.npy: its number may count the frames .* `first_and"):
        read_bank(folder)
    with noted("the frames numbered 11 are missing; the others keep their angles"):
        bank = read_bank(folder, TableFormat(first_and_step_deg=(-4.0, 2.0)))
    assert bank.angles_deg == (-4.0, -2.0, 0.0, 4.0, 6.0)
    np.testing.assert_array_equal(bank.frame(3).samples, frames[12])
    stated = read_bank(folder, TableFormat(angles_deg=(9.0, 7.0, 5.0, 3.0, 1.0)))
    np.testing.assert_array_equal(stated.frame(0).samples, frames[13])
    with pytest.raises(RecordError, match="4 angles are given for 5 frames"):
        read_bank(folder, TableFormat(angles_deg=(9.0, 7.0, 5.0, 3.0)))


def test_a_folder_of_angles_refuses_stated_ones(tmp_path):
    for name in ("-2deg", "0deg", "2deg"):
        write_daq(tmp_path / name, pulses_of(1))
    with pytest.raises(ConfigError, match=r"the names of its frames are angles, such as -2deg; leave `first_"):
        read_bank(tmp_path, TableFormat(first_and_step_deg=(0.0, 1.0)))


@pytest.mark.parametrize("new", [True, False])
def test_one_triggered_acquisition_holds_a_pulse_at_each_angle(tmp_path, new):
    pulses = pulses_of(5)
    folder = write_daq(tmp_path / "burst", pulses, new=new)
    with pytest.raises(
        RecordError, match=r"with 5 pulses; if each pulse was triggered at an angle .*`first_and_step_deg="
    ):
        read_bank(folder)
    bank = read_bank(folder, TableFormat(first_and_step_deg=(6.0, -3.0), without_channels=(2,)))
    assert bank.angles_deg == (-6.0, -3.0, 0.0, 3.0, 6.0)
    expected = pulses[4].copy()
    expected[1] = 0
    np.testing.assert_array_equal(bank.frame(0).samples, expected)
    with pytest.raises(RecordError, match="3 angles are given for 5 pulses"):
        read_bank(folder, TableFormat(angles_deg=(1.0, 2.0, 3.0)))
    (folder / "CH100.daq" if new else folder / "CH100-0000.daq").unlink()
    with pytest.raises(RecordError, match=r"127 channel files .* missing is CH100"):
        read_bank(folder, TableFormat(first_and_step_deg=(6.0, -3.0)))


def test_nan_behind_the_end_of_a_frame_is_no_sample(tmp_path):
    samples = pulses_of()[0]
    padded = np.full((128, SAMPLES + 9), np.nan)
    padded[:, :SAMPLES] = samples
    np.save(tmp_path / "a.npy", padded)
    np.testing.assert_array_equal(load_frame(tmp_path / "a.npy").samples, samples)
