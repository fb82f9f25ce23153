"""Every version of ``.mat``: read as other programs read it, or refused with a hint how to save it."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from scipy.io import savemat

from markerseek.core import MissingExtraError, RecordError
from markerseek.records.banks.arrays import read_arrays
from markerseek.records.banks.frames import load_frame
from markerseek.records.named_arrays import arrays_in

DATA = Path(__file__).parents[2] / "data"
MATLABS = Path(scipy.io.__file__).parent / "matlab/tests/data"
COUNTS = np.random.default_rng(73).integers(-2048, 2048, (4, 8, 30)).astype(np.int16)
FRAME = np.random.default_rng(74).integers(-2048, 2048, (32, 20, 4)).astype(np.int16)


"""One child for all files: starting one for each took most of the time of these tests."""


def mat_arrays(path):
    return arrays_in(path, most_bytes=1 << 24)


def write_73(path, variables, *, block=512, classes=True, **options):
    """As MATLAB writes it: axes reversed, each variable with its class, 512 bytes of its own before the HDF5."""
    with h5py.File(path, "w", userblock_size=block) as file:
        for name, value in variables.items():
            array = np.atleast_2d(value)
            item = file.create_dataset(name, data=array.T, **options)
            if classes:
                item.attrs["MATLAB_class"] = np.bytes_(
                    {"f8": "double", "f4": "single"}.get(array.dtype.str[1:], "int16")
                )
    if block:
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def test_a_scan_that_another_program_wrote_as_7_3():
    """``make_mat73.py`` wrote it by hdf5storage, and mat73 read the same values."""
    bank = read_arrays(DATA / "scan-7.3.mat")
    assert bank.angles_deg == (-1.0, 0.5, 2.0, 7.0)
    assert (bank.facts.sampling_hz, bank.facts.reference_angle_deg) == (31.25e6, 0.7)
    for index, row in enumerate((1, 2, 0, 3)):
        np.testing.assert_array_equal(bank.frame(index).samples, COUNTS[row])


def test_a_frame_that_another_program_wrote_as_7_3():
    samples = load_frame(DATA / "frame-7.3.mat").samples
    assert samples.shape == (128, 15)
    for channel in (0, 31, 32, 127):
        np.testing.assert_array_equal(samples[channel], FRAME[channel % 32, :15, channel // 32])


@pytest.mark.parametrize(
    "options", [{}, {"chunks": True, "compression": "gzip"}, {"chunks": True, "compression": "gzip", "shuffle": True}]
)
@pytest.mark.parametrize(("block", "classes"), [(512, True), (0, False)])
def test_version_7_3_reads_the_same_as_version_7(tmp_path, options, block, classes):
    variables = {"angle_deg": np.arange(4.0), "frames": COUNTS, "sampling_hz": np.array([[31.25e6]])}
    savemat(tmp_path / "7.mat", variables)
    theirs = mat_arrays(tmp_path / "7.mat")
    ours = mat_arrays(write_73(tmp_path / "73.mat", variables, block=block, classes=classes, **options))
    assert sorted(ours) == sorted(theirs)
    for name, each in theirs.items():
        assert ours[name].dtype == each.dtype
        np.testing.assert_array_equal(ours[name], each)


@pytest.mark.skipif(not MATLABS.is_dir(), reason="SciPy is installed without the files that MATLAB wrote for its tests")
def test_files_of_matlab_itself():
    """SciPy's collection: versions 4 to 7.4, of three machines; SciPy's reader is the reference."""
    read = 0
    for path in sorted(MATLABS.glob("test*_[4567].*.mat")):
        if "hdf5" in path.name:
            np.testing.assert_array_equal(mat_arrays(path)["testdouble"], [np.linspace(0, 2 * np.pi, 9)])
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                theirs = scipy.io.loadmat(path)
            for name, each in mat_arrays(path).items():
                np.testing.assert_array_equal(each, theirs[name])
                read += 1
    assert read > 10


def test_what_unpacks_too_far_names_the_way_to_save_it(tmp_path):
    """Frames of a receiver that received nothing are valid."""
    angles = np.arange(4.0)
    frames = np.zeros((4, 128, 2000), np.int16)
    savemat(tmp_path / "a.mat", {"angle_deg": angles, "frames": frames}, do_compression=True)
    with pytest.raises(RecordError, match=r"more than 32 times its size; save it with -v6 \(uncompressed\)"):
        read_arrays(tmp_path / "a.mat")
    np.savez_compressed(tmp_path / "a.npz", angle_deg=angles, frames=frames)
    with pytest.raises(RecordError, match=r"more than 32 times its size; save it with numpy\.savez instead of savez_c"):
        read_arrays(tmp_path / "a.npz")
    options = {"chunks": (400, 128, 4), "compression": "gzip"}
    write_73(tmp_path / "b.mat", {"frames": frames}, **options)
    with pytest.raises(RecordError, match=r"more than 32 times its size; save it with '-v7\.3', '-nocompression'"):
        read_arrays(tmp_path / "b.mat")
    savemat(tmp_path / "a.mat", {"angle_deg": angles, "frames": frames})
    np.savez(tmp_path / "a.npz", angle_deg=angles, frames=frames)
    write_73(tmp_path / "b.mat", {"angle_deg": angles, "frames": frames})
    assert [not read_arrays(tmp_path / name).frame(3).samples.any() for name in ("a.mat", "a.npz", "b.mat")]


def test_anything_but_arrays_of_numbers_is_skipped(tmp_path):
    path = write_73(tmp_path / "a.mat", {"frames": COUNTS})
    with h5py.File(path, "r+") as file:
        file.create_group("structure")["x"] = np.arange(3.0)
        file["text"] = np.array([[77, 65, 84]], np.uint16)
        file["text"].attrs["MATLAB_class"] = np.bytes_("char")
        file["complex"] = np.zeros((1, 2), [("real", "f8"), ("imag", "f8")])
        file["nothing"] = h5py.Empty("f8")
        file["shape_of_none"] = np.array([0, 3], np.uint64)
        file["shape_of_none"].attrs.update(MATLAB_class=np.bytes_("double"), MATLAB_empty=np.uint8(1))
    arrays = mat_arrays(path)
    shapes = {"frames": COUNTS.shape, "complex": (2, 1), "shape_of_none": (0,)}
    assert {name: each.shape for name, each in arrays.items()} == shapes
    assert arrays["complex"].dtype == complex


def test_without_h5py_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"version 7\.3 needs the package h5py.*\[records\]"):
        mat_arrays(DATA / "frame-7.3.mat")


def test_a_header_that_makes_no_sense_is_said_without_objects_of_python(tmp_path):
    path = tmp_path / "frame.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00v\x00" + b"x" * 118)
    with pytest.raises(RecordError, match="cut off: its header makes no sense; save it again with"):
        mat_arrays(path)
