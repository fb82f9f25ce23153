"""HDF5 of other programs: what its attributes and links say is read, or refused by its name."""

from __future__ import annotations

import subprocess
import sys

import h5py
import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.records.banks import TableFormat, read_bank
from tests.notes import noted

ANGLES_DEG = np.arange(-12.0, 18.0, 0.75)
PEAK = np.exp(-(((ANGLES_DEG - 3.75) / 3) ** 2))
FRAMES = np.random.default_rng(4).integers(-900, 900, (len(ANGLES_DEG), 8, 50)).astype(np.int16)


def written(path, variables, attributes=()):
    """A file with these variables, and attributes by variable and name."""
    with h5py.File(path, "w") as file:
        for name, value in variables.items():
            file[name] = value
        for name, attribute, value in attributes:
            file[name].attrs[attribute] = value
    return path


def test_packed_numbers_are_unpacked_as_the_cf_conventions_say(tmp_path):
    packed = np.round((ANGLES_DEG + 12) / 0.25).astype(np.int16)
    path = written(
        tmp_path / "scan.h5",
        {"angle_deg": packed, "intensity": np.round(PEAK / 1e-4).astype(np.uint16)},
        [
            ("angle_deg", "scale_factor", 0.25),
            ("angle_deg", "add_offset", np.array([-12.0])),
            ("intensity", "scale_factor", 1e-4),
            ("intensity", "_FillValue", np.uint16(65535)),
        ],
    )
    bank = read_bank(path)
    np.testing.assert_allclose(bank.angles_deg, ANGLES_DEG)
    np.testing.assert_allclose(bank.intensities, PEAK, atol=1e-4)


@pytest.mark.parametrize("attribute", ["_FillValue", "missing_value"])
def test_a_number_that_marks_a_missing_one_is_none(tmp_path, attribute):
    values = np.where(np.arange(len(PEAK)) == 7, -9999.0, PEAK)
    path = written(
        tmp_path / "scan.h5", {"angle_deg": ANGLES_DEG, "intensity": values}, [("intensity", attribute, -9999.0)]
    )
    with pytest.raises(RecordError, match="1 of 40 angles hold a number that is not finite"):
        read_bank(path)
    with noted("angle number 8"):
        assert len(read_bank(path, TableFormat(skip_invalid=True)).angles_deg) == 39


@pytest.mark.parametrize(
    ("name", "unit", "values"),
    [
        ("angle", "degrees", ANGLES_DEG),
        ("angle", "mrad", np.radians(ANGLES_DEG) * 1e3),
        ("angle_rad", "radians", np.radians(ANGLES_DEG)),
        ("angle", "gon", ANGLES_DEG / 0.9),
        ("yaw_of_probe", "arcmin", ANGLES_DEG * 60),
        ("rotor", "degrees_east", ANGLES_DEG),
    ],
)
def test_the_unit_of_the_angles_is_read(tmp_path, name, unit, values):
    path = written(tmp_path / "scan.h5", {name: values, "intensity": PEAK}, [(name, "units", unit)])
    np.testing.assert_allclose(read_bank(path).angles_deg, ANGLES_DEG, atol=1e-4)


def test_a_stated_unit_counts_before_that_of_the_file(tmp_path):
    variables = {"angle_deg": ANGLES_DEG / 0.18 + 40, "intensity": PEAK, "power": np.ones_like(PEAK)}
    path = written(tmp_path / "scan.h5", variables, [("angle_deg", "units", "encoder ticks"), ("power", "units", "mW")])
    table = TableFormat(deg_per_unit=0.18, offset_deg=-7.2)
    np.testing.assert_allclose(read_bank(path, table).angles_deg, ANGLES_DEG, atol=1e-4)


def test_decibels_are_read(tmp_path):
    level = 20 * np.log10(PEAK)
    path = written(
        tmp_path / "scan.h5", {"angle_deg": ANGLES_DEG, "intensity": level}, [("intensity", "Units", np.bytes_("dBV"))]
    )
    np.testing.assert_allclose(read_bank(path).intensities, PEAK)


@pytest.mark.parametrize(
    ("name", "attribute", "value", "message"),
    [
        ("angle_deg", "units", "encoder ticks", r"'encoder ticks' is no unit of an angle; say how .*`deg_per_unit`"),
        ("angle_deg", "unit", "rad", r"in 'angle_deg \[rad\]', and 'deg and rad' is no unit of an angle"),
        ("angle_deg", "slope", 0.36, r"angle_deg has the attribute slope = 0\.36.*apply it, and take it out"),
        ("angle_deg", "Offset", -4.0, r"angle_deg has the attribute Offset = -4"),
        ("angle_deg", "scale_factor", np.ones(40), r"the attribute scale_factor of angle_deg is float64 of shape"),
        ("frames", "_Unsigned", "true", r"frames has the attribute _Unsigned; save it in an unsigned type"),
        ("frames", "units", "dB", r"frames has the unit 'dB'; save the frames as they were sampled"),
        ("sampling_hz", "units", "MHz", r"sampling_hz has the unit 'MHz', hz is expected; convert it"),
        ("first_sample_s", "units", "us", r"first_sample_s has the unit 'us', s is expected"),
    ],
)
def test_an_attribute_that_would_change_the_numbers_is_refused_by_its_name(tmp_path, name, attribute, value, message):
    held = {"angle_deg": ANGLES_DEG, "frames": FRAMES, "sampling_hz": 40e6, "first_sample_s": 1e-7}
    with pytest.raises(RecordError, match=message):
        read_bank(written(tmp_path / "scan.h5", held, [(name, attribute, value)]))


def test_attributes_that_change_nothing_are_no_matter(tmp_path):
    attributes = [("frames", "slope", 1.0), ("frames", "units", "mV"), ("frames", "gain_db", 40.0)]
    attributes += [("angle_deg", "long_name", "angle of the probe"), ("intensity", "_FillValue", np.nan)]
    held = {"angle_deg": ANGLES_DEG, "frames": FRAMES, "intensity": PEAK}
    bank = read_bank(written(tmp_path / "scan.h5", held, attributes))
    np.testing.assert_array_equal(bank.frame(5).samples, FRAMES[5])


def test_an_ipasc_field_with_another_unit_is_refused(tmp_path):
    held = {"meta_data/trus_angle_deg": ANGLES_DEG, "meta_data/intensity": PEAK, "meta_data/speed_of_sound": 1.54}
    attribute = ("meta_data/trus_angle_deg", "units", "rad")
    with pytest.raises(RecordError, match=r"trus_angle_deg has the unit 'rad', degrees is expected; convert"):
        read_bank(written(tmp_path / "scan.hdf5", held, [attribute]))
    with pytest.raises(
        RecordError,
        match=r"meta_data/speed_of_sound has the unit 'mm/us', a unit without a prefix .* is expected; conv",
    ):
        read_bank(written(tmp_path / "scan.hdf5", held, [("meta_data/speed_of_sound", "units", "mm/us")]))


def test_arrays_in_a_group_are_found(tmp_path):
    held = {"version": 3, "run_2/scan/angle_deg": ANGLES_DEG, "run_2/scan/frames": FRAMES, "run_2/sampling_hz": 31e6}
    bank = read_bank(written(tmp_path / "scan.h5", held))
    assert bank.facts.sampling_hz == 31e6
    np.testing.assert_array_equal(bank.frame(9).samples, FRAMES[9])


def test_of_two_groups_with_the_same_names_a_person_chooses(tmp_path):
    held = {f"{run}/angle_deg": ANGLES_DEG for run in "ab"} | {"a/intensity": PEAK, "b/intensity": PEAK[::-1]}
    path = written(tmp_path / "scan.h5", held)
    with pytest.raises(
        RecordError, match=r"it holds a/angle_deg float64 \(40,\), a/intensity .*`columns=ANGLE,INTENSITY`"
    ):
        read_bank(path)
    bank = read_bank(path, TableFormat(columns=("b/angle_deg", "b/intensity")))
    np.testing.assert_allclose(bank.intensities, PEAK[::-1])


def test_links_within_the_file_are_followed(tmp_path):
    path = written(tmp_path / "scan.h5", {"raw/day/data": FRAMES, "raw/day/where": ANGLES_DEG})
    with h5py.File(path, "r+") as file:
        file["latest"] = h5py.SoftLink("/raw/day")
        file["frames"] = h5py.SoftLink("latest/data")
        file["raw/angle_deg"] = h5py.SoftLink("day/where")
        file["angle_deg"] = h5py.SoftLink("/raw/angle_deg")
    bank = read_bank(path)
    assert bank.angles_deg == tuple(ANGLES_DEG)
    np.testing.assert_array_equal(bank.frame(2).samples, FRAMES[2])


def test_links_in_a_circle_to_nothing_and_to_other_files_are_named(tmp_path):
    path = written(tmp_path / "scan.h5", {"angle_deg": ANGLES_DEG})
    with h5py.File(path, "r+") as file:
        file["intensity"] = h5py.SoftLink("/intensity")
        file["gone"] = h5py.SoftLink("/nowhere")
        file["frames"] = h5py.ExternalLink("other.h5", "/frames")
        file["self"] = file["/"]
    with pytest.raises(RecordError, match=r"cannot be read: frames is a link to another place, intensity is one of mo"):
        read_bank(path)


@pytest.mark.parametrize("name", ["frames", "binary_time_series_data", "data/raw_data"])
def test_numbers_in_other_files_are_refused_and_the_program_ends_in_order(tmp_path, name):
    """HDF5 2.0 crashes at the end of a program that keeps a virtual dataset in an exception."""
    source = written(tmp_path / "source.h5", {"x": FRAMES})
    layout = h5py.VirtualLayout(shape=FRAMES.shape, dtype=FRAMES.dtype)
    layout[:] = h5py.VirtualSource(source, "x", shape=FRAMES.shape)
    path = written(tmp_path / "scan.h5", {"angle_deg": ANGLES_DEG})
    with h5py.File(path, "r+") as file:
        file.create_virtual_dataset(name, layout)
    # This program alone shows how it ends.
    words = [sys.executable, "-m", "markerseek", "bank", "info", path]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert "is a virtual or external dataset, whose numbers lie in other files; copy the numbers into" in done.stderr
    assert done.returncode == 2
