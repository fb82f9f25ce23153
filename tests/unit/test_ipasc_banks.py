"""Banks in IPASC HDF5: what is written comes back, also by pacfish; versions; and what a cut-off scan leaves."""

from __future__ import annotations

import math
import os
import shutil
import signal
import subprocess
import sys
import tracemalloc
import uuid
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pacfish
import pytest

from markerseek.core import ChannelFrame, ConfigError, FrameHeader, Reading, RecordError, Sample
from markerseek.records.banks import BankFacts, FrameBank, IntensityBank, read_bank
from markerseek.records.ipasc import BankWriter
from markerseek.records.ipasc.fields import DEVICE_IDENTIFIERS, device_identifier
from markerseek.records.ipasc.reading import IpascBank, read_unvetted
from markerseek.signals.presets import PRESET_NAMES

FIXTURES = Path(__file__).parent / "banks"
FACTS = BankFacts(
    description="a simulated scan",
    probe="BPL9-5/55",
    sampling_hz=40e6,
    sound_speed_m_s=1540.0,
    pitch_m=0.43e-3,
    wavelength_m=760e-9,
    pulse_energy_j=2e-3,
    face_radius_m=10e-3,
    reference_angle_deg=1.25,
    clock_zero_unix_s=1.7e9,
    simulated=True,
    configuration="0123456789abcdef",
    seed=1 << 70,
    made_with="markerseek 0.0",
)


def counts(seed, shape=(8, 50)):
    return np.random.default_rng(seed).integers(-2048, 2048, shape).astype(np.int16)


def sample(angle_deg, *, seed=0, dark=False, shape=(8, 50), frame=True):
    header = FrameHeader(
        sequence=seed + 1, token="a", pulses=0 if dark else 16, commanded_deg=angle_deg, started_s=seed * 2.0, ended_s=0
    )
    channel = ChannelFrame(header=header, samples=counts(seed, shape), sampling_hz=40e6) if frame else None
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=100.0 + seed), dark=dark, frame=channel)


ANGLES = (4.0, 2.0, 0.5, -1.0)


def write(path, *, planned=4, taken=4, facts=FACTS, frame=True):
    with BankWriter(path, angles=planned, dark_frames=2, facts=facts) as writer:
        for seed in (8, 9):
            writer.add(sample(0.0, seed=seed, dark=True, frame=frame))
        for seed, angle in enumerate(ANGLES[:taken]):
            writer.add(sample(angle, seed=seed, frame=frame))
    return path


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


def test_each_preset_has_its_own_identifier_and_an_unknown_probe_a_new_one(tmp_path):
    assert set(DEVICE_IDENTIFIERS) == set(PRESET_NAMES)
    known = {device_identifier(name) for name in PRESET_NAMES}
    unknown = {device_identifier(name) for name in (None, None, "mine", "mine")}
    assert (len(known), len(unknown), known & unknown) == (len(PRESET_NAMES), 4, set())
    assert {uuid.UUID(each).version for each in known | unknown} == {4}


@pytest.mark.parametrize("planned", [3, 4, 9])
def test_a_scan_that_ended_early_is_cut_to_what_was_taken(tmp_path, planned):
    path = write(tmp_path / "a.hdf5", planned=planned, taken=3)
    bank = read_bank(path)
    assert (len(bank.angles_deg), bank.planned) == (3, 3)
    assert pacfish.load_data(str(path)).binary_time_series_data.shape == (8, 50, 1, 3)


KILLED = """
import os, signal, sys
sys.path.insert(0, {tests!r})
import test_ipasc_banks as here
from markerseek.records.ipasc import BankWriter
from pathlib import Path
from types import SimpleNamespace
writer = BankWriter(Path({path!r}), angles=40, dark_frames=2, facts=here.FACTS)
writer.add(here.sample(0.0, seed=8, dark=True))
for seed in range(7):
    writer.add(here.sample(float(seed), seed=seed))
    print(seed, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_scan_leaves_what_was_taken(tmp_path):
    path = tmp_path / "a.hdf5"
    program = KILLED.format(tests=str(Path(__file__).parent), path=str(path))
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    bank = read_bank(path)
    assert bank.angles_deg == tuple(float(each) for each in range(7))
    assert (bank.planned, bank.dark_frames) == (40, 1)
    for seed in range(7):
        np.testing.assert_array_equal(bank.frame(seed).samples, counts(seed))


def test_frames_are_read_one_at_a_time(tmp_path):
    shape = (64, 2000)
    with BankWriter(tmp_path / "a.hdf5", angles=60, facts=FACTS) as writer:
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


def test_version_0_is_somebody_elses_and_read():
    bank = read_bank(FIXTURES / "v0.hdf5")
    assert isinstance(bank, FrameBank)
    assert bank.angles_deg == (-1.5, 0.0, 1.5, 3.0)
    np.testing.assert_array_equal(bank.frame(2).samples, counts(2, (2, 6)))
    assert (bank.intensities, bank.dark_frames) == ((), 0)
    assert bank.facts == BankFacts(sampling_hz=40e6)
    assert np.isnan(bank.started_s).all()
    assert np.isnan(bank.frame(0).header.started_s)


def test_version_1_is_read():
    bank = read_bank(FIXTURES / "v1.hdf5")
    assert isinstance(bank, FrameBank)
    assert bank.angles_deg == ANGLES[::-1]
    assert bank.intensities == (103.0, 102.0, 101.0, 100.0)
    np.testing.assert_array_equal(bank.frame(3).samples, counts(0, (2, 6)))
    np.testing.assert_array_equal(bank.dark_frame(0).samples, counts(8, (2, 6)))
    assert bank.facts.reference_angle_deg == 1.25
    assert bank.facts.pitch_m == pytest.approx(0.43e-3)
    assert (bank.facts.wavelength_m, bank.facts.face_radius_m) == (760e-9, 10e-3)
    assert (bank.started_s, bank.facts.clock_zero_unix_s) == ((6.0, 4.0, 2.0, 0.0), None)


def test_version_2_is_read():
    bank = read_bank(FIXTURES / "v2.hdf5")
    assert isinstance(bank, FrameBank)
    assert bank.angles_deg == ANGLES[::-1]
    assert bank.intensities == (103.0, 102.0, 101.0, 100.0)
    np.testing.assert_array_equal(bank.frame(3).samples, counts(0, (2, 6)))
    for index, seed in enumerate((8, 9)):
        np.testing.assert_array_equal(bank.dark_frame(index).samples, counts(seed, (2, 6)))
    # The fixture was written before a bank said whether it was simulated.
    assert replace(bank.facts, pitch_m=FACTS.pitch_m, simulated=True) == FACTS
    assert (bank.started_s, bank.pulses) == ((6.0, 4.0, 2.0, 0.0), (16,) * 4)


def test_times_of_version_1_that_nobody_told_are_not_made_up(tmp_path):
    shutil.copy(FIXTURES / "v1.hdf5", tmp_path / "a.hdf5")
    bank = read_unvetted(changed(tmp_path / "a.hdf5", put("meta_data/measurement_timestamps", np.zeros(4))))
    assert isinstance(bank, FrameBank)
    assert np.isnan(bank.started_s).all()
    assert np.isnan(bank.frame(0).header.started_s)


def test_times_of_somebody_else_count_from_1970(tmp_path):
    shutil.copy(FIXTURES / "v0.hdf5", tmp_path / "a.hdf5")

    def change(file):
        file["meta_data/measurement_timestamps"] = np.array([1.7e9, 1.7e9 + 1, np.nan, 1.7e9 + 3])

    bank = read_unvetted(changed(tmp_path / "a.hdf5", change))
    assert isinstance(bank, FrameBank)
    assert bank.facts.clock_zero_unix_s == 0.0
    np.testing.assert_array_equal(np.sort(bank.started_s), (1.7e9, 1.7e9 + 1, 1.7e9 + 3, np.nan))


def test_times_that_nobody_knows_stay_unknown(tmp_path):
    path = tmp_path / "a.hdf5"
    with BankWriter(path, angles=3, facts=BankFacts(clock_zero_unix_s=None)) as writer:
        for seed, started_s in enumerate((1.0, math.nan, math.inf)):
            frame = sample(float(seed), seed=seed).frame
            frame = replace(frame, header=replace(frame.header, started_s=started_s))
            writer.add(replace(sample(float(seed)), frame=frame))
    bank = read_bank(path)
    assert isinstance(bank, FrameBank)
    np.testing.assert_array_equal(bank.started_s, (1.0, np.nan, np.nan))
    assert (bank.facts.clock_zero_unix_s, bank.facts.pitch_m) == (None, None)
    assert np.isnan(pacfish.load_data(str(path)).get_measurement_time_stamps()).all()


def changed(path, change, *, sums=True):
    """The same bank, changed, and without its checksums if need be."""
    with h5py.File(path, "r+") as file:
        change(file)
        for name in () if sums else [each for each in file["meta_data"] if each.endswith("_crc32")]:
            del file["meta_data"][name]
    return path


def put(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("meta_data/markerseek_bank_version", 3), "version 3, this markerseek reads up to 2; install a newer"),
        (put("meta_data/markerseek_bank_version", 0.5), "version 0.5"),
        (lambda file: file.pop("meta_data/trus_angle_deg"), "trus_angle_deg is missing"),
        (put("meta_data/trus_angle_deg", np.zeros(4)), "0 deg stands there twice"),
        (put("meta_data/trus_angle_deg", np.array([1.0, 2.0, np.nan, np.nan])), "2 angles, at least 3"),
        (
            put("meta_data/trus_angle_deg", np.array([1.0, 2.0, 3.0, 4e9])),
            "4e.09 deg, it must be finite and within one turn",
        ),
        (put("meta_data/trus_angle_deg", "many"), "numbers are expected"),
        (put("meta_data/intensity", np.array([1.0, 2.0, 3.0])), "3 intensities for 4 angles"),
        (put("meta_data/intensity", np.array([1.0, 2.0, 3.0, -4.0])), "negative"),
        (put("binary_time_series_data", np.zeros((8, 50, 2, 4), np.int16)), "one wavelength"),
        (put("meta_data/ad_sampling_rate", -1.0), "must be positive"),
    ],
)
def test_a_bank_with_a_fault_is_refused(tmp_path, change, message):
    with pytest.raises(RecordError, match=message):
        read_unvetted(changed(write(tmp_path / "a.hdf5"), change, sums=False))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.full((8, 50, 1, 4), 0.5), "no int16 counts"),
        (np.full((8, 50, 1, 4), 1 << 20), "no int16 counts"),
        (np.full((8, 50, 1, 4), np.nan), "no int16 counts"),
        (np.full((8, 50, 1, 4), 1 + 2j), "ADC counts are expected"),
    ],
)
def test_frames_that_are_no_counts_are_refused(tmp_path, value, message):
    path = changed(write(tmp_path / "a.hdf5"), put("binary_time_series_data", value), sums=False)
    with pytest.raises(RecordError, match=message):
        read_unvetted(path).frame(0)


def test_counts_of_another_type_are_read(tmp_path):
    frames = np.arange(8 * 50 * 4).reshape(8, 50, 1, 4)
    path = changed(write(tmp_path / "a.hdf5"), put("binary_time_series_data", frames.astype(np.float64)), sums=False)
    np.testing.assert_array_equal(read_unvetted(path).frame(0).samples, frames[:, :, 0, 3])


def test_a_writer_refuses_what_it_cannot_keep(tmp_path):
    path = write(tmp_path / "a.hdf5")
    with pytest.raises(RecordError, match="there is a file already"):
        BankWriter(path, angles=3, facts=FACTS)
    with pytest.raises(ConfigError, match=r"must end in \.hdf5 or \.h5"):
        BankWriter(tmp_path / "a.txt", angles=3, facts=FACTS)
    with BankWriter(tmp_path / "b.hdf5", angles=1, facts=FACTS) as writer:
        writer.add(sample(0.0))
        with pytest.raises(RecordError, match="1 acquisitions were announced"):
            writer.add(sample(1.0))


def spoilt(**changes):
    taken = sample(1.0, seed=1)
    return replace(taken, **changes)


@pytest.mark.parametrize(
    ("taken", "message"),
    [
        (sample(1.0, shape=(8, 51)), "keep one probe"),
        (sample(1.0, shape=(8, 51), dark=True), "keep one probe"),
        (sample(1.0, frame=False), "keep one probe"),
        (spoilt(frame=ChannelFrame(header=sample(1.0).frame.header, samples=counts(0), sampling_hz=20e6)), "2e.07 Hz"),
        (spoilt(angle_deg=math.nan), "the angle is nan deg, it must be finite and within one turn, -360 to 360 deg"),
        (spoilt(angle_deg=-360.1), "the angle is -360.1 deg"),
        (spoilt(angle_deg=0.0), "the angle 0 deg comes twice"),
        (spoilt(angle_deg=-0.0), "comes twice"),
        (spoilt(reading=Reading(intensity=-1.0)), "the intensity at 1 deg is -1, it must be finite and not negative"),
        (spoilt(reading=Reading(intensity=math.inf)), "is inf"),
    ],
)
def test_an_acquisition_that_could_not_be_read_again_is_refused_before_the_first_byte(tmp_path, taken, message):
    path = tmp_path / "a.hdf5"
    with BankWriter(path, angles=5, dark_frames=1, facts=FACTS) as writer:
        writer.add(sample(0.0))
        before = path.read_bytes()
        with pytest.raises(RecordError, match=message):
            writer.add(taken)
        assert path.read_bytes() == before
        for angle in (2.0, 3.0):
            writer.add(sample(angle))
    assert read_bank(path).angles_deg == (0.0, 2.0, 3.0)


def test_an_intensity_that_nobody_knows_is_kept_beside_a_frame_and_not_without(tmp_path):
    unknown = Reading(intensity=math.nan)
    with BankWriter(tmp_path / "a.hdf5", angles=3, facts=FACTS) as writer:
        for angle in (0.0, 2.0, 3.0):
            writer.add(replace(sample(angle), reading=unknown))
    assert read_bank(tmp_path / "a.hdf5").intensities == ()
    with (
        BankWriter(tmp_path / "b.hdf5", angles=3, facts=FACTS) as writer,
        pytest.raises(RecordError, match="the intensity at 0 deg is nan"),
    ):
        writer.add(replace(sample(0.0, frame=False), reading=unknown))
    assert not (tmp_path / "b.hdf5").exists()


def test_a_folder_that_cannot_be_written_is_said_to_be_so(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(RecordError, match="cannot be written"),
        BankWriter(tmp_path / "file" / "a.hdf5", angles=3, facts=FACTS) as writer,
    ):
        writer.add(sample(0.0))


def test_a_disk_without_room_for_it_all_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=2_000_000))
    with (
        pytest.raises(RecordError, match=r"needs 2\.1 MB, 2\.0 MB are free; nothing was written"),
        BankWriter(tmp_path / "a.hdf5", angles=1300, dark_frames=2, facts=FACTS) as writer,
    ):
        writer.add(sample(0.0))
    assert list(tmp_path.iterdir()) == []


def test_all_the_room_is_taken_with_the_first_frame(tmp_path):
    with BankWriter(tmp_path / "a.hdf5", angles=1300, dark_frames=2, facts=FACTS) as writer:
        writer.add(sample(0.0))
        status = (tmp_path / "a.hdf5").stat()
        assert status.st_blocks * 512 >= status.st_size > 1300 * 2 * 8 * 50


def test_a_pipe_or_a_device_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.hdf5")
    with pytest.raises(RecordError, match="no ordinary file"):
        read_bank(tmp_path / "a.hdf5")
