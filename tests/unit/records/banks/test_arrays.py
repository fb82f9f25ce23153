"""Banks saved by NumPy and MATLAB: read in the order of the angles, or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from markerseek.core import RecordError
from markerseek.records.banks import IntensityBank, TableFormat
from markerseek.records.banks.arrays import ArrayBank, read_arrays
from tests.notes import noted

ANGLES = np.array([2.0, -1.0, 0.5, 7.0])
INTENSITIES = np.array([5.0, 1.0, 3.0, 2.0])
FRAMES = np.random.default_rng(0).integers(-2048, 2048, (4, 8, 30)).astype(np.int16)
ORDER = (1, 2, 0, 3)


def save(path, **arrays):
    if path.suffix == ".mat":
        savemat(path, arrays)
    else:
        np.savez_compressed(path, **arrays)
    return path


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize("names", [("angle_deg", "intensity"), ("trus_angle_deg", "intensities")])
def test_intensities_come_back(tmp_path, suffix, names):
    bank = read_arrays(save(tmp_path / f"a{suffix}", **dict(zip(names, (ANGLES, INTENSITIES), strict=True))))
    assert isinstance(bank, IntensityBank)
    assert bank.angles_deg == tuple(ANGLES[list(ORDER)])
    assert bank.intensities == tuple(INTENSITIES[list(ORDER)])


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_frames_come_back(tmp_path, suffix):
    path = save(tmp_path / f"a{suffix}", angle_deg=ANGLES, frames=FRAMES, sampling_hz=31.25e6, reference_angle_deg=0.7)
    bank = read_arrays(path)
    assert isinstance(bank, ArrayBank)
    for index, row in enumerate(ORDER):
        np.testing.assert_array_equal(bank.frame(index).samples, FRAMES[row])
        assert bank.frame(index).header.commanded_deg == ANGLES[row]
        assert np.isnan((bank.frame(index).header.started_s, bank.frame(index).header.ended_s)).all()
    assert (bank.facts.sampling_hz, bank.facts.reference_angle_deg) == (31.25e6, 0.7)
    assert bank.frame(0).sampling_hz == 31.25e6


def test_an_npy_of_two_columns_and_one_of_frames(tmp_path):
    np.save(tmp_path / "a.npy", np.c_[ANGLES, INTENSITIES])
    assert read_arrays(tmp_path / "a.npy").intensities == tuple(INTENSITIES[list(ORDER)])
    np.save(tmp_path / "b.npy", FRAMES)
    bank = read_arrays(tmp_path / "b.npy", table=TableFormat(first_and_step_deg=(3.0, -0.5)))
    assert bank.angles_deg == (1.5, 2.0, 2.5, 3.0)
    np.testing.assert_array_equal(bank.frame(0).samples, FRAMES[3])


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"intensity": INTENSITIES}, "angle_deg is missing, it holds intensity float64"),
        ({"angle_deg": ANGLES}, "intensity or frames expected"),
        ({"angle_deg": ANGLES[:2], "intensity": INTENSITIES[:2]}, "2 angles, at least 3"),
        ({"angle_deg": ANGLES * np.nan, "intensity": INTENSITIES}, "4 of 4 angles hold a number that is not finite"),
        ({"angle_deg": ANGLES * 1e4, "intensity": INTENSITIES}, "within one turn"),
        ({"angle_deg": ANGLES, "intensity": INTENSITIES[:3]}, "for 4 angles"),
        ({"angle_deg": ANGLES, "intensity": -INTENSITIES}, "angle 2 deg: .* must not be negative; are these dB"),
        ({"angle_deg": ANGLES, "frames": FRAMES * np.nan}, "4 of 4 angles hold .*: `skip_invalid`"),
        ({"angle": ANGLES / 57, "intensity": INTENSITIES}, "are these radians. Say so: `unit=rad`"),
        ({"winkel": ANGLES, "frames": FRAMES}, "angle_deg is missing, .* `first_and_step_deg=\\(-35, 0.5\\)`"),
        ({"angle_deg": ANGLES, "peak": INTENSITIES}, "intensity or frames expected, .* `columns=ANGLE,INTENSITY`"),
        ({"angle_deg": ANGLES, "frames": FRAMES[:3]}, "for 4 angles"),
        (
            {"angle_deg": ANGLES, "frames": FRAMES.transpose(0, 2, 1)},
            "30 channels would have 8 samples each: .* `axes=angles,samples,channels`",
        ),
        (
            {"angle_deg": ANGLES, "frames": FRAMES.transpose(1, 2, 0)},
            "state their order: `axes=channels,samples,angles",
        ),
        (
            {"angle_deg": ANGLES, "intensity": INTENSITIES, "sampling_hz": INTENSITIES},
            "sampling_hz must be one finite number",
        ),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_what_cannot_be_a_bank_is_refused(tmp_path, suffix, arrays, message):
    with pytest.raises(RecordError, match=message):
        read_arrays(save(tmp_path / f"a{suffix}", **arrays))


@pytest.mark.parametrize("order", ["angles,samples,channels", "channels,samples,angles", "samples,channels,angles"])
def test_frames_are_turned_as_their_axes_say(tmp_path, order):
    ours = ("angles", "channels", "samples")
    axes = tuple(order.split(","))
    path = save(tmp_path / "a.mat", angle_deg=ANGLES, frames=FRAMES.transpose([ours.index(each) for each in axes]))
    bank = read_arrays(path, table=TableFormat(axes=axes))
    np.testing.assert_array_equal(bank.frame(0).samples, FRAMES[ORDER[0]])
    np.testing.assert_array_equal(bank.frame(3).samples, FRAMES[ORDER[3]])


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_variables_and_units_are_named(tmp_path, suffix):
    path = save(tmp_path / f"a{suffix}", theta=np.deg2rad(ANGLES), peak=20 * np.log10(INTENSITIES), rf=FRAMES, n=3.0)
    bank = read_arrays(path, TableFormat(columns=("theta", "peak"), unit="rad", db=True))
    assert bank.angles_deg == pytest.approx(ANGLES[list(ORDER)])
    assert bank.intensities == pytest.approx(INTENSITIES[list(ORDER)])
    with noted(r"n \(3\); a sampling frequency is read under"):
        frames = read_arrays(path, TableFormat(columns=("theta", "rf"), unit="rad"))
    np.testing.assert_array_equal(frames.frame(1).samples, FRAMES[ORDER[1]])
    with pytest.raises(RecordError, match=r"there is no variable phi, it holds .*theta float64"):
        read_arrays(path, TableFormat(columns=("phi", "peak")))


@pytest.mark.parametrize("values", [INTENSITIES, FRAMES.astype(float)], ids=["intensities", "frames"])
def test_angles_without_numbers_are_left_out_and_named(tmp_path, values):
    values = values.copy()
    values[2] = np.nan
    path = save(tmp_path / "a.npz", angle_deg=ANGLES, **{"intensity" if values.ndim == 1 else "frames": values})
    with noted(r"1 without a finite number left out \(`skip_invalid`\): angle number 3"):
        bank = read_arrays(path, TableFormat(skip_invalid=True))
    assert bank.angles_deg == (-1.0, 2.0, 7.0)


def test_intensities_alone_take_a_first_angle_and_a_step(tmp_path):
    np.save(tmp_path / "a.npy", INTENSITIES)
    bank = read_arrays(tmp_path / "a.npy", table=TableFormat(first_and_step_deg=(3.0, -0.5)))
    assert (bank.angles_deg, bank.intensities) == ((1.5, 2.0, 2.5, 3.0), tuple(INTENSITIES[::-1]))
    np.save(tmp_path / "b.npy", np.stack([ANGLES, INTENSITIES]))
    with pytest.raises(RecordError, match=r"shape \(2, 4\); .* is it transposed. Save array.T"):
        read_arrays(tmp_path / "b.npy")


def test_texts_and_objects_beside_the_arrays_are_passed_over(tmp_path):
    np.savez(tmp_path / "a.npz", angle_deg=ANGLES, intensity=INTENSITIES, who="somebody", note=None, keys={"a": 1})
    assert read_arrays(tmp_path / "a.npz").angles_deg == (-1.0, 0.5, 2.0, 7.0)
    np.savez(tmp_path / "b.npz", angle_deg=ANGLES, who="somebody", intensity=np.array([None] * 4))
    left_out = r"what cannot be read: who \(<U8\), intensity \(object\)"
    with pytest.raises(RecordError, match=f"intensity or frames expected, it holds angle_deg .*{left_out}"):
        read_arrays(tmp_path / "b.npz")


@pytest.mark.parametrize("name", ["RF", "p", "sinograms"])
@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_the_only_array_of_three_axes_holds_the_frames(tmp_path, name, suffix):
    path = save(tmp_path / f"a{suffix}", **{name: FRAMES, "angle_deg": ANGLES, "gain": np.ones((8, 2))})
    np.testing.assert_array_equal(read_arrays(path).frame(0).samples, FRAMES[ORDER[0]])
    alone = save(tmp_path / f"b{suffix}", **{name: FRAMES})
    with pytest.raises(RecordError, match=r"angle_deg is missing, .* `first_and_step_deg=\(-35, 0\.5\)`"):
        read_arrays(alone)
    bank = read_arrays(alone, TableFormat(first_and_step_deg=(3.0, -0.5)))
    np.testing.assert_array_equal(bank.frame(0).samples, FRAMES[3])


def test_of_several_arrays_of_three_axes_one_is_named(tmp_path):
    path = save(tmp_path / "a.npz", RF=FRAMES, filtered=FRAMES // 2)
    stated = {"first_and_step_deg": (3.0, 0.5)}
    with pytest.raises(RecordError, match=r"RF, filtered; name one, .* or `columns=RF` with `first_and_step_deg`"):
        read_arrays(path, TableFormat(**stated))
    bank = read_arrays(path, TableFormat(columns=("", "filtered"), **stated))
    np.testing.assert_array_equal(bank.frame(0).samples, FRAMES[0] // 2)


@pytest.mark.parametrize(
    ("name", "per_deg"), [("angle_gon", 1 / 0.9), ("stage [arcmin]", 60), ("theta_rad", np.pi / 180)]
)
def test_a_unit_in_the_name_of_a_variable_is_read(tmp_path, name, per_deg):
    np.savez(tmp_path / "a.npz", **{name: 10 * ANGLES * per_deg, "intensity": INTENSITIES})
    assert read_arrays(tmp_path / "a.npz").angles_deg == pytest.approx((-10.0, 5.0, 20.0, 70.0), abs=1e-4)


def test_counts_are_refused_by_their_name_and_become_degrees_by_a_scale(tmp_path):
    np.savez(tmp_path / "a.npz", encoder_counts=8192 * ANGLES, intensity=INTENSITIES)
    named = {"columns": ("encoder_counts", "intensity")}
    with pytest.raises(RecordError, match=r"'counts' is no unit of an angle; .* `deg_per_unit`"):
        read_arrays(tmp_path / "a.npz", TableFormat(**named))
    bank = read_arrays(tmp_path / "a.npz", TableFormat(**named, deg_per_unit=1 / 8192, offset_deg=-5))
    assert bank.angles_deg == (-6.0, -4.5, -3.0, 2.0)


def test_nan_behind_the_end_of_all_records_is_cut_off(tmp_path):
    padded = np.full((4, 8, 37), np.nan)
    padded[:, :, :30] = FRAMES
    path = save(tmp_path / "a.npz", angle_deg=ANGLES, frames=padded)
    with noted(r"end with NaN in all channels: 30 of 37 samples are read"):
        bank = read_arrays(path)
    np.testing.assert_array_equal(bank.frame(1).samples, FRAMES[ORDER[1]])


def test_a_shorter_record_is_filled_with_its_medians(tmp_path):
    padded = FRAMES.astype(float)
    padded[2, :, 21:] = np.nan
    path = save(tmp_path / "a.npz", angle_deg=ANGLES, frames=padded)
    with noted("1 shorter records are filled with the median of each channel"):
        bank = read_arrays(path)
    shorter = bank.frame(1).samples
    assert np.ptp(shorter[:, 21:], axis=1).max() == 0
    assert np.ptp(shorter[:, :21], axis=1).min() > 0


def test_frames_of_repeated_angles_are_averaged_or_left_out_as_one_direction(tmp_path):
    angles = np.arange(-12.0, 12.5)
    envelope = 60 + 1500 * np.exp(-0.5 * ((angles - 3.3) / 2) ** 2)
    back = 60 + 1500 * np.exp(-0.5 * ((angles - 1.8) / 2) ** 2)
    carrier = np.random.default_rng(2).normal(size=(8, 30))
    scan = [np.rint(carrier * height).astype(np.int16) for height in (*envelope, *back[::-1])]
    path = save(tmp_path / "a.npz", angle_deg=np.r_[angles, angles[::-1]], frames=np.stack(scan))
    with noted(r"1\.50 deg below the pass of rising angles"):
        bank = read_arrays(path)
    np.testing.assert_array_equal(np.stack([bank.frame(each).samples for each in range(25)]), scan[:25])
    twice = save(tmp_path / "b.npz", angle_deg=np.repeat(ANGLES[:3], 2), frames=np.repeat(FRAMES[:3], 2, axis=0))
    with noted("3 repeated angles"):
        bank = read_arrays(twice)
    np.testing.assert_array_equal(bank.frame(0).samples, FRAMES[ORDER[0]])
    assert bank.pulses == (2, 2, 2)


def test_single_numbers_under_names_that_say_nothing_are_named(tmp_path):
    with noted(r"nothing here: fs \(3.125e\+07\), gain \(3\); a sampling frequency is read under the name sampling_hz"):
        read_arrays(save(tmp_path / "a.npz", angle_deg=ANGLES, frames=FRAMES, fs=31.25e6, gain=3))
    # Nothing is said where the sampling frequency is known: files hold numbers of all kinds.
    read_arrays(save(tmp_path / "b.npz", angle_deg=ANGLES, frames=FRAMES, fs=31.25e6, sampling_hz=31.25e6))
