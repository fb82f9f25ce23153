"""Banks of the current version and of another program: read as written, with no invented values."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pacfish
import pytest

from markerseek.core import RecordError
from markerseek.records.banks import BankFacts, FrameBank, read_bank, whole_bank
from tests.unit.records.banks.synthetic_banks import ANGLES, FACTS, FIXTURES, changed, counts, put, sample


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
    assert replace(bank.facts, pitch_m=FACTS.pitch_m) == FACTS
    assert (bank.started_s, bank.pulses) == ((6.0, 4.0, 2.0, 0.0), (16,) * 4)


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
            frame = replace(frame, header=replace(frame.header, started_s=started_s))
            writer.add(replace(sample(float(seed)), frame=frame))
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
    with pytest.warns(UserWarning, match="pulse_energy holds 3 energies for 4 measurements, and only their mean"):
        bank = read_bank(foreign(tmp_path / "d.hdf5", frames, pulse_energy=np.array([1e-3, 2e-3, 3e-3])))
    assert (bank.frame(1).header.energy, bank.facts.pulse_energy_j) == (None, pytest.approx(2e-3))
