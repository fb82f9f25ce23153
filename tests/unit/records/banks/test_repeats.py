"""Passes of a scan are compared before repeated angles are averaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit

from markerseek.records.banks.repeats import Merged, merged
from tests.notes import notes_collected

ANGLES_DEG = np.arange(-30, 30.1, 0.8)
PATH = Path("scan.csv")


def curve(angles_deg: np.ndarray, marker_deg: float, *, seed: int, noise: float = 0.02) -> np.ndarray:
    """A marker of 900 on a background of 120, with noise."""
    scatter = 900 * noise * np.random.default_rng(seed).normal(size=angles_deg.size)
    return np.abs(120 + 900 * np.exp(-0.5 * ((angles_deg - marker_deg) / 2.3) ** 2) + scatter)


def passes(kind: str, back_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles and intensities of a marker at 4.2° on the way there, and so much further on the way back."""
    there = curve(ANGLES_DEG, 4.2, seed=1)
    back = curve(ANGLES_DEG, 4.2 + back_deg, seed=2)
    orders = {
        "there and back": (np.r_[ANGLES_DEG, ANGLES_DEG[::-1]], np.r_[there, back[::-1]]),
        "back first": (np.r_[ANGLES_DEG[::-1], ANGLES_DEG], np.r_[there[::-1], back]),
        "twice rising": (np.r_[ANGLES_DEG, ANGLES_DEG], np.r_[there, back]),
        "sorted": (np.repeat(ANGLES_DEG, 2), np.c_[there, back].ravel()),
        "as read": (
            np.r_[ANGLES_DEG + 0.013, ANGLES_DEG[::-1]],
            np.r_[curve(ANGLES_DEG + 0.013, 4.2, seed=1), back[::-1]],
        ),
        "from the middle": (
            np.r_[ANGLES_DEG[30:], ANGLES_DEG[::-1], ANGLES_DEG[:30]],
            np.r_[there[30:], back[::-1], there[:30]],
        ),
    }
    return orders[kind]


def scanned(angles_deg: np.ndarray, intensities: np.ndarray) -> tuple[Merged, str]:
    """The acquisitions by their angles, and what was said."""
    with notes_collected() as said:
        scan = merged(PATH, angles_deg, lambda: intensities)
    return scan, "; ".join(said)


def peak_deg(scan: Merged, intensities: np.ndarray) -> float:
    """Centre of a Gaussian that SciPy fits, which knows nothing of passes."""

    def model(angle_deg: np.ndarray, centre_deg: float, sigma_deg: float, height: float, level: float) -> np.ndarray:
        return level + height * np.exp(-0.5 * ((angle_deg - centre_deg) / sigma_deg) ** 2)

    read = scan.mean(intensities)
    start = (scan.angles_deg[int(read.argmax())], 2.0, float(read.max()), 100.0)
    fitted, _ = curve_fit(model, np.array(scan.angles_deg), read, start)
    return float(fitted[0])


@pytest.mark.parametrize("back_deg", [-1.7, -0.6, 0.9, 5.0])
@pytest.mark.parametrize("kind", ["there and back", "back first", "twice rising", "sorted", "as read"])
def test_a_pass_that_is_shifted_is_left_out_and_the_shift_is_said(kind: str, back_deg: float) -> None:
    angles_deg, intensities = passes(kind, back_deg)
    scan, said = scanned(angles_deg, intensities)
    assert peak_deg(scan, intensities) == pytest.approx(4.2, abs=0.1)
    assert len(scan.angles_deg) == ANGLES_DEG.size
    stated = float(said.split("the same curve ")[1].split(" deg")[0])
    assert stated == pytest.approx(abs(back_deg), abs=0.12)
    assert f"deg {'above' if back_deg > 0 else 'below'} the" in said
    assert f"left out ({ANGLES_DEG.size} of {2 * ANGLES_DEG.size} acquisitions)" in said
    assert "are averaged" not in said


@pytest.mark.parametrize(
    ("kind", "used"),
    [
        ("there and back", "of the pass of rising angles"),
        ("back first", "of the pass of falling angles"),
        ("twice rising", "of the first pass"),
        ("sorted", "of the first acquisition of each angle"),
    ],
)
def test_the_direction_that_is_used_is_said(kind: str, used: str) -> None:
    assert scanned(*passes(kind, 1.2))[1].endswith(f"the answer is an angle {used}")


def test_the_longer_direction_is_used_where_a_pass_lies_in_two_parts() -> None:
    angles_deg, intensities = passes("from the middle", 1.5)
    scan, said = scanned(angles_deg, intensities)
    assert peak_deg(scan, intensities) == pytest.approx(4.2, abs=0.1)
    assert "the pass of falling angles is left out" in said


@pytest.mark.parametrize("kind", ["there and back", "twice rising", "sorted"])
def test_passes_that_agree_are_averaged_and_their_difference_is_said(kind: str) -> None:
    angles_deg, intensities = passes(kind, 0.0)
    scan, said = scanned(angles_deg, intensities)
    assert said.startswith(f"scan.csv: {ANGLES_DEG.size} repeated angles; the acquisitions of each are averaged; they ")
    low = passes("there and back", 0.0)[1][: ANGLES_DEG.size]
    high = passes("there and back", 0.0)[1][ANGLES_DEG.size :]
    np.testing.assert_allclose(scan.mean(intensities), (low + high[::-1]) / 2)
    assert f"differ by at most {np.abs(low - high[::-1]).max():.3g}, at" in said


def test_noise_alone_has_no_shift() -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        angles_deg = np.r_[ANGLES_DEG, ANGLES_DEG[::-1]]
        assert "left out" not in scanned(angles_deg, 100 + 9 * rng.normal(size=angles_deg.size))[1]


def test_repeats_at_rest_and_a_search_are_no_passes() -> None:
    at_rest = np.repeat(ANGLES_DEG, 7)
    scan, said = scanned(at_rest, curve(at_rest, 4.2, seed=3))
    assert "left out" not in said
    assert [group.size for group in scan.groups] == [7] * ANGLES_DEG.size
    order = np.random.default_rng(4).permutation(ANGLES_DEG.size)
    shuffled, said = scanned(ANGLES_DEG[order], curve(ANGLES_DEG[order], 4.2, seed=5))
    assert said == ""
    assert shuffled.angles_deg == tuple(ANGLES_DEG.tolist())


def test_whole_numbers_stay_whole_and_pulses_add_up() -> None:
    counts = np.array([[7, 8], [5, 5], [9, 9], [8, 8]], dtype=np.int16)
    scan, _ = scanned(np.array([1.0, 2.0, 3.0, 1.0]), np.array([1.0, 2.0, 3.0, 1.5]))
    mean = scan.mean(counts)
    assert mean.dtype == np.int16
    assert mean.tolist() == [[8, 8], [5, 5], [9, 9]]
    assert scan.total(np.array([3, 1, 1, 4])).tolist() == [7, 1, 1]


def test_a_shift_that_noise_hides_is_named_and_both_passes_are_used() -> None:
    named = 0
    for seed in range(12):
        there = curve(ANGLES_DEG, 4.2, seed=seed, noise=0.13)
        back = curve(ANGLES_DEG, 5.2, seed=100 + seed, noise=0.13)
        scan, said = scanned(np.r_[ANGLES_DEG, ANGLES_DEG[::-1]], np.r_[there, back[::-1]])
        if "which their noise hides" in said:
            named += 1
            assert "the pass of falling angles may show the curve +" in said
            assert {group.size for group in scan.groups} == {2}
        else:
            assert "left out" in said or "may show" not in said
    assert named >= 4
