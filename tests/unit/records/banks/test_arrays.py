"""Banks saved by NumPy and MATLAB: read in the order of the angles, or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from markerseek.core import RecordError
from markerseek.records.banks import IntensityBank, TableFormat
from markerseek.records.banks.arrays import ArrayBank, read_arrays

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
        ({"angle_deg": ANGLES[[0, 1, 1, 2]], "intensity": INTENSITIES}, "-1 deg appears twice"),
        ({"angle_deg": ANGLES * np.nan, "intensity": INTENSITIES}, "4 of 4 angles hold a number that is not finite"),
        ({"angle_deg": ANGLES * 1e4, "intensity": INTENSITIES}, "within one turn"),
        ({"angle_deg": ANGLES, "intensity": INTENSITIES[:3]}, "for 4 angles"),
        ({"angle_deg": ANGLES, "intensity": -INTENSITIES}, "angle 2 deg: .* must not be negative; are these dB"),
        ({"angle_deg": ANGLES, "frames": FRAMES * np.nan}, "4 of 4 angles hold .*: --skip-invalid"),
        ({"angle": ANGLES / 57, "intensity": INTENSITIES}, "are these radians. Say so: --unit rad"),
        ({"winkel": ANGLES, "frames": FRAMES}, "angle_deg is missing, .* --first-deg -35 --step-deg 0.5"),
        ({"angle_deg": ANGLES, "peak": INTENSITIES}, "intensity or frames expected, .* --columns ANGLE,INTENSITY"),
        ({"angle_deg": ANGLES, "frames": FRAMES[:3]}, "for 4 angles"),
        (
            {"angle_deg": ANGLES, "frames": FRAMES.transpose(0, 2, 1)},
            "30 channels would have 8 samples each: .* --axes angles,samples,channels",
        ),
        (
            {"angle_deg": ANGLES, "frames": FRAMES.transpose(1, 2, 0)},
            "state their order: --axes channels,samples,angles",
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
    frames = read_arrays(path, TableFormat(columns=("theta", "rf"), unit="rad"))
    np.testing.assert_array_equal(frames.frame(1).samples, FRAMES[ORDER[1]])
    with pytest.raises(RecordError, match=r"there is no variable phi, it holds .*theta float64"):
        read_arrays(path, TableFormat(columns=("phi", "peak")))


@pytest.mark.parametrize("values", [INTENSITIES, FRAMES.astype(float)], ids=["intensities", "frames"])
def test_angles_without_numbers_are_left_out_and_named(tmp_path, values):
    values = values.copy()
    values[2] = np.nan
    path = save(tmp_path / "a.npz", angle_deg=ANGLES, **{"intensity" if values.ndim == 1 else "frames": values})
    with pytest.warns(UserWarning, match=r"1 without a finite number left out \(--skip-invalid\): angle number 3"):
        bank = read_arrays(path, TableFormat(skip_invalid=True))
    assert bank.angles_deg == (-1.0, 2.0, 7.0)


def test_intensities_alone_take_a_first_angle_and_a_step(tmp_path):
    np.save(tmp_path / "a.npy", INTENSITIES)
    bank = read_arrays(tmp_path / "a.npy", table=TableFormat(first_and_step_deg=(3.0, -0.5)))
    assert (bank.angles_deg, bank.intensities) == ((1.5, 2.0, 2.5, 3.0), tuple(INTENSITIES[::-1]))
    np.save(tmp_path / "b.npy", np.stack([ANGLES, INTENSITIES]))
    with pytest.raises(RecordError, match=r"shape \(2, 4\); .* is it transposed. Save array.T"):
        read_arrays(tmp_path / "b.npy")
