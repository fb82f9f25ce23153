"""Writing banks in IPASC HDF5: round trips, also by pacfish; whole or absent; what no bank can hold is refused."""

from __future__ import annotations

import math
import tracemalloc
import uuid

import h5py
import numpy as np
import pacfish
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import ChannelFrame, ConfigError, Permit, RecordError
from markerseek.records.banks import IntensityBank, read_bank, require_whole, whole_bank
from markerseek.records.banks.ipasc import IpascBank, read_probed
from markerseek.records.banks.ipasc_writer import DEVICE_IDENTIFIERS, probe_poses
from markerseek.rigs.replay_devices import ReplayReceiver, ReplayStage
from markerseek.signals.presets import PRESET_NAMES
from tests.sizes import examples
from tests.unit.core.damaged import damaged
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, changed, counts, put, sample, write


def test_what_was_written_comes_back_in_the_order_of_the_angles(tmp_path):
    bank = read_bank(write(tmp_path / "a.hdf5"))
    assert isinstance(bank, IpascBank)
    assert bank.angles_deg == ANGLES[::-1]
    assert bank.intensities == (103.0, 102.0, 101.0, 100.0)
    assert structs.replace(bank.facts, pitch_m=FACTS.pitch_m) == FACTS
    assert bank.facts.pitch_m == pytest.approx(FACTS.pitch_m)
    assert (bank.started_s, bank.pulses) == ((6.0, 4.0, 2.0, 0.0), (16,) * 4)
    for index, seed in enumerate((3, 2, 1, 0)):
        frame = bank.frame(index)
        np.testing.assert_array_equal(frame.samples, counts(seed))
        assert frame.sampling_hz == 40e6
        assert (frame.header.pulses, frame.header.started_s) == (16, seed * 2.0)
    for index, seed in enumerate((8, 9)):
        np.testing.assert_array_equal(bank.dark_frame(index).samples, counts(seed))
        assert math.isnan(bank.dark_frame(index).header.started_s)
    with pytest.raises(RecordError, match="no dark frame 3"):
        bank.dark_frame(2)


def test_pacfish_reads_the_standard_fields_and_finds_them_consistent(tmp_path):
    data = pacfish.load_data(str(write(tmp_path / "a.hdf5")))
    assert data.binary_time_series_data.shape == (8, 50, 1, 4)
    np.testing.assert_array_equal(data.binary_time_series_data[:, :, 0, 2], counts(2))
    np.testing.assert_allclose(data.get_custom_meta_datum("trus_angle_deg"), ANGLES)
    np.testing.assert_allclose(data.get_custom_meta_datum("intensity"), (100, 101, 102, 103))
    assert data.get_custom_meta_datum("reference_angle_deg") == 1.25
    assert data.get_sampling_rate() == 40e6
    assert data.get_speed_of_sound() == 1540.0
    np.testing.assert_allclose(data.get_measurement_time_stamps(), 1.7e9 + np.array((0, 2, 4, 6)), rtol=0)
    np.testing.assert_allclose(data.get_acquisition_wavelengths(), 760e-9)
    np.testing.assert_allclose(data.get_pulse_energy(), 2e-3)
    lateral = np.array([data.get_detector_position(each)[0] for each in data.get_detector_ids()])
    np.testing.assert_allclose(lateral, (np.arange(8) - 3.5) * 0.43e-3)
    mandatory = {each.tag for each in pacfish.MetadataAcquisitionTags.TAGS if each.mandatory}
    assert mandatory <= set(data.meta_data_acquisition)
    assert pacfish.ConsistencyChecker().check_acquisition_meta_data(data.meta_data_acquisition)
    assert data.get_scanning_method() in {"composite_scan", "full_scan"}
    assert data.get_dimensionality() == "time and space"
    device = data.get_device_uuid()
    assert device == str(uuid.UUID(device, version=4))
    assert data.meta_data_acquisition["photoacoustic_imaging_device_reference"] == device
    assert data.meta_data_acquisition["measurement_spatial_poses"].shape == (4, 6)


def test_the_file_is_the_one_that_pacfish_would_write(tmp_path):
    """Read by pacfish and written by it again: the same names, types and values; its reader drops axes of length 1."""

    def datasets(path):
        with h5py.File(path) as file:
            items = []
            file.visititems(lambda name, item: items.append((name, item)))
            return {
                name: (item.dtype, item[()] if item.dtype.kind == "O" else np.squeeze(item[()]).tolist())
                for name, item in items
                if isinstance(item, h5py.Dataset)
            }

    ours = write(tmp_path / "a.hdf5")
    pacfish.write_data(str(tmp_path / "b.hdf5"), pacfish.load_data(str(ours)))
    theirs = datasets(tmp_path / "b.hdf5")
    assert repr(datasets(ours)) == repr(theirs)  # NaN is NaN here
    assert len([name for name in theirs if name.endswith("detector_position")]) == 8


def test_the_energy_of_each_measurement_comes_back_and_is_ipasc_s_pulse_energy(tmp_path):
    path = write(tmp_path / "a.hdf5", energies=(1.1, None, 0.9, 1.05))
    np.testing.assert_allclose(pacfish.load_data(str(path)).get_pulse_energy(), 2e-3 * np.array((1.1, 1, 0.9, 1.05)))
    bank = read_bank(path)
    assert [bank.frame(index).header.energy for index in range(4)] == [1.05, 0.9, None, 1.1]
    assert bank.dark_frame(0).header.energy is None
    assert bank.facts.pulse_energy_j == pytest.approx(2e-3)
    stage = ReplayStage(bank)
    receiver = ReplayReceiver(stage=stage, bank=bank)
    stage.move_to(0.5)
    permit = Permit(token="a", angle_deg=0.5, pulses=16, expires_s=math.inf)
    receiver.arm(permit)
    assert receiver.acquire(permit).header.energy == 0.9


def test_the_usual_energy_comes_back_where_the_first_was_not_measured(tmp_path):
    """It was the mean of all, here 8 % more."""
    bank = read_bank(write(tmp_path / "a.hdf5", energies=(None, 1.1, 1.2, 1.05)))
    assert bank.facts.pulse_energy_j == pytest.approx(2e-3)


def test_each_preset_has_its_own_identifier_and_an_unknown_probe_a_new_one(tmp_path):
    assert set(DEVICE_IDENTIFIERS) == set(PRESET_NAMES)

    def identifier(number, probe):
        path = write(tmp_path / f"{number}.hdf5", facts=structs.replace(FACTS, probe=probe))
        return pacfish.load_data(str(path)).get_device_uuid()

    known = {identifier(number, name) for number, name in enumerate(PRESET_NAMES)}
    unknown = {identifier(10 + number, name) for number, name in enumerate((None, None, "mine", "mine"))}
    assert (len(known), len(unknown), known & unknown) == (len(PRESET_NAMES), 4, set())
    assert {uuid.UUID(each).version for each in known | unknown} == {4}


def test_frames_are_read_one_at_a_time(tmp_path):
    shape = (64, 2000)
    with whole_bank(tmp_path / "a.hdf5", facts=FACTS) as writer:
        for seed in range(60):
            writer.add(sample(float(seed), shape=shape))
    tracemalloc.start()
    bank = read_bank(tmp_path / "a.hdf5")
    for index in range(60):
        bank.frame(index)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    one = 2 * shape[0] * shape[1]
    assert most < 8 * one < 60 * one / 4


def test_a_bank_of_intensities_has_no_frames(tmp_path):
    bank = read_bank(write(tmp_path / "a.hdf5", frame=False))
    assert isinstance(bank, IntensityBank)
    assert (bank.angles_deg, bank.intensities) == (ANGLES[::-1], (103.0, 102.0, 101.0, 100.0))
    data = pacfish.load_data(str(tmp_path / "a.hdf5"))
    assert (data.binary_time_series_data.size, data.get_number_of_detectors()) == (0, 0)
    assert data.get_detector_position() is None


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
    with pytest.raises(RecordError, match=f"no {what} that can be read: .*; it has changed since it was written"):
        require_whole(bank)


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
    path = write(tmp_path / "b.hdf5", facts=structs.replace(FACTS, face_radius_m=None))
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.pop("meta_data/trus_angle_deg"), "trus_angle_deg is missing"),
        (put("meta_data/trus_angle_deg", np.zeros(4)), "0 deg appears twice"),
        (put("meta_data/trus_angle_deg", np.array([1.0, 2.0, 3.0, np.inf])), "inf deg, it must be finite"),
        (
            put("meta_data/trus_angle_deg", np.array([1.0, 2.0, 3.0, 4e9])),
            "4e.09 deg, it must be finite and within one turn",
        ),
        (put("meta_data/trus_angle_deg", "many"), "numbers are expected"),
        (put("meta_data/intensity", np.array([1.0, 2.0, 3.0])), "intensity holds 3 numbers for 4 angles"),
        (put("meta_data/intensity", np.array([1.0, 2.0, 3.0, -4.0])), "negative"),
        (put("binary_time_series_data", np.zeros((8, 50, 2, 4), np.int16)), "one wavelength"),
        (put("meta_data/ad_sampling_rate", -1.0), "it must lie between 100000"),
        (put("meta_data/ad_sampling_rate", 31.25), r"is 31\.25 Hz, it must .* 1e\+09 Hz; write it in Hz$"),
        (
            put("meta_data/speed_of_sound", 1.54),
            r"is 1\.54 m/s, it must lie between 300 and 7000 m/s; write it in m/s$",
        ),
    ],
)
def test_a_bank_with_a_fault_is_refused(tmp_path, change, message):
    with pytest.raises(RecordError, match=message):
        read_probed(changed(write(tmp_path / "a.hdf5"), change))


def of_another_program(path, frames):
    """The same bank without what says that it is ours."""

    def change(file):
        del file["meta_data/markerseek_bank_version"]
        put("binary_time_series_data", frames)(file)

    return changed(write(path), change)


def test_frames_that_are_no_counts_are_refused(tmp_path):
    value = np.full((8, 50, 1, 4), np.nan)
    with pytest.raises(RecordError, match="4 of 4 angles hold a number that is not finite"):
        read_bank(of_another_program(tmp_path / "a.hdf5", value))
    with pytest.raises(RecordError, match="int16 is expected"):
        read_probed(changed(write(tmp_path / "b.hdf5"), put("binary_time_series_data", value))).frame(0)


def test_a_writer_refuses_what_it_cannot_keep(tmp_path):
    path = write(tmp_path / "a.hdf5")
    with pytest.raises(RecordError, match="there is a file already"), whole_bank(path, facts=FACTS):
        raise AssertionError
    with pytest.raises(ConfigError, match=r"must end in \.hdf5 or \.h5"), whole_bank(tmp_path / "a.txt", facts=FACTS):
        raise AssertionError


def invalid(**changes):
    taken = sample(1.0, seed=1)
    return structs.replace(taken, **changes)


@pytest.mark.parametrize(
    ("taken", "message"),
    [
        (sample(1.0, shape=(8, 51)), "keep one probe"),
        (sample(1.0, shape=(8, 51), dark=True), "keep one probe"),
        (sample(1.0, frame=False), "keep one probe"),
        (invalid(frame=ChannelFrame(header=sample(1.0).frame.header, samples=counts(0), sampling_hz=20e6)), "2e.07 Hz"),
        (invalid(angle_deg=math.nan), "the angle is nan deg, it must be finite and within one turn, -360 to 360 deg"),
        (invalid(angle_deg=-360.1), "the angle is -360.1 deg"),
        (invalid(reading=damaged(intensity=-1.0)), "the intensity at 1 deg is -1, it must be finite and not negative"),
        (invalid(reading=damaged(intensity=math.inf)), "is inf"),
    ],
)
def test_an_acquisition_that_could_not_be_read_again_is_refused_and_the_others_kept(tmp_path, taken, message):
    path = tmp_path / "a.hdf5"
    with whole_bank(path, facts=FACTS) as writer:
        writer.add(sample(0.0))
        with pytest.raises(RecordError, match=message):
            writer.add(taken)
        if taken.dark:
            writer.add(sample(0.0, seed=8, dark=True))
        for angle in (2.0, 3.0, 4.0):
            writer.add(sample(angle))
    assert read_bank(path).angles_deg == (0.0, 2.0, 3.0, 4.0)


def test_an_unknown_intensity_is_kept_with_a_frame_and_refused_without_one(tmp_path):
    unknown = damaged(intensity=math.nan)
    with whole_bank(tmp_path / "a.hdf5", facts=FACTS) as writer:
        for angle in (0.0, 2.0, 3.0):
            writer.add(structs.replace(sample(angle), reading=unknown))
    assert read_bank(tmp_path / "a.hdf5").intensities == ()
    with (
        pytest.raises(RecordError, match="the intensity at 0 deg is nan"),
        whole_bank(tmp_path / "b.hdf5", facts=FACTS) as writer,
    ):
        writer.add(structs.replace(sample(0.0, frame=False), reading=unknown))
    assert not (tmp_path / "b.hdf5").exists()
