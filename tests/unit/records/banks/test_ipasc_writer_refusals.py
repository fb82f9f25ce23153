"""Content that no bank can hold, and files that are not banks: refused with a sentence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from markerseek.core import ChannelFrame, ConfigError, RecordError
from markerseek.records.banks import read_bank, whole_bank
from markerseek.records.banks.ipasc import read_probed
from tests.unit.core.damaged import damaged
from tests.unit.records.banks.synthetic_banks import FACTS, changed, counts, put, sample, write


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
    with (
        pytest.raises(ConfigError, match=r"must end in \.hdf5 or \.h5"),
        whole_bank(tmp_path / "a.txt", facts=FACTS),
    ):
        raise AssertionError


def invalid(**changes):
    taken = sample(1.0, seed=1)
    return replace(taken, **changes)


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
            writer.add(replace(sample(angle), reading=unknown))
    assert read_bank(tmp_path / "a.hdf5").intensities == ()
    with (
        pytest.raises(RecordError, match="the intensity at 0 deg is nan"),
        whole_bank(tmp_path / "b.hdf5", facts=FACTS) as writer,
    ):
        writer.add(replace(sample(0.0, frame=False), reading=unknown))
    assert not (tmp_path / "b.hdf5").exists()
