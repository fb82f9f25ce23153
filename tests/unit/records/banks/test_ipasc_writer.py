"""IPASC HDF5 banks: round trips, also by pacfish."""

from __future__ import annotations

import math
import tracemalloc
import uuid
from dataclasses import replace

import h5py
import numpy as np
import pacfish
import pytest

from markerseek.core import Permit, RecordError
from markerseek.records.banks import IntensityBank, read_bank, whole_bank
from markerseek.records.banks.ipasc import IpascBank
from markerseek.records.banks.ipasc_writer import DEVICE_IDENTIFIERS
from markerseek.records.replay import ReplayReceiver, ReplayStage
from markerseek.signals.presets import PRESET_NAMES
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, counts, sample, write


def test_what_was_written_comes_back_in_the_order_of_the_angles(tmp_path):
    bank = read_bank(write(tmp_path / "a.hdf5"))
    assert isinstance(bank, IpascBank)
    assert bank.angles_deg == ANGLES[::-1]
    assert bank.intensities == (103.0, 102.0, 101.0, 100.0)
    assert replace(bank.facts, pitch_m=FACTS.pitch_m) == FACTS
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
        path = write(tmp_path / f"{number}.hdf5", facts=replace(FACTS, probe=probe))
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
