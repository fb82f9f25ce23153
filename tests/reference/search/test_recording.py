"""All of a recording is its answer: scans and tables that the package did not simulate (`whole_scans`, in short)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from markerseek import replayed
from markerseek.core import Ambiguous, Estimate, Found, Reading, Sample, SearchPlan, Unsure
from markerseek.search import build
from markerseek.show import answer_reason
from tests.reference.search.independent_scans import ANGLES_DEG, TWO_PEAKS_ANGLES_DEG, scan_of, two_peaks_of
from tests.reference.search.whole_scans import bank_of, counted_scans, counted_two_peaks, whole


@pytest.mark.long
def test_one_marker_among_clutter_is_found_from_all_angles_also_as_a_single_source(tmp_path: Path) -> None:
    usual, single = counted_scans(range(5), tmp_path)
    for count in (usual, single):
        assert dict(count.names) == {"found": 5}
        assert (count.wrong, count.covered) == (0, 5)


def test_with_little_clutter_too(tmp_path: Path) -> None:
    scan = scan_of(1001, clutter=1)
    answer = whole(bank_of(scan, tmp_path))
    assert isinstance(answer, Found)
    assert answer.interval95_deg.low_deg < scan.marker_deg < answer.interval95_deg.high_deg


def test_two_peaks_are_ambiguous_from_all_angles(tmp_path: Path) -> None:
    count = counted_two_peaks(range(8), tmp_path)
    assert dict(count.names) == {"ambiguous": 8}
    assert count.covered == 8


@pytest.mark.parametrize(("apart_deg", "relative"), [(6.0, 0.8), (8.0, 1.0), (12.0, 0.8), (25.0, 0.9)])
def test_the_answer_names_both_peaks_and_how_strong_the_weaker_is(
    tmp_path: Path, apart_deg: float, relative: float
) -> None:
    two_peaks = two_peaks_of(7, apart_deg=apart_deg, relative=relative)
    two_peaks.write(tmp_path / "two-peaks.csv")
    answer = whole(tmp_path / "two-peaks.csv")
    assert isinstance(answer, Ambiguous)
    assert sorted(answer.modes_deg) == pytest.approx(sorted([two_peaks.stronger_deg, two_peaks.weaker_deg]), abs=0.4)
    (db,) = (each.relative_db for each in answer.others if each.angle_deg in answer.modes_deg)
    assert db == pytest.approx(20 * np.log10(relative), abs=0.5)
    reason = answer_reason(answer)
    assert reason is not None
    assert f"({db:+.1f} dB)" in reason
    assert "equally" not in reason


def test_a_single_source_is_the_stronger_peak_and_never_ambiguous(tmp_path: Path) -> None:
    two_peaks = two_peaks_of(3, apart_deg=11.0, relative=0.8)
    two_peaks.write(tmp_path / "two-peaks.csv")
    answer = whole(tmp_path / "two-peaks.csv", others=0.0)
    assert isinstance(answer, (Found, Unsure))
    assert answer.mean_deg == pytest.approx(two_peaks.stronger_deg, abs=0.3)


def _searched(at: dict[float, Sample], *, others: float | None) -> Iterator[tuple[list[float], Estimate]]:
    """Angles and answer after each acquisition of a search that is given recorded samples."""
    policy = build(SearchPlan(method="posterior", acquisitions=len(at), others=others, angles_deg=tuple(at)))
    taken: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        taken.append(angle_deg)
        policy.tell(at[angle_deg])
        yield taken, policy.estimate()


def _require_measured(taken: list[float], answer: Estimate) -> None:
    """Each place that is named has been measured, to half the width of the widest curve; each `Unsure` says why."""
    named = [each.angle_deg for each in answer.others if abs(each.angle_deg) <= 35]
    if isinstance(answer, Ambiguous | Found):
        named += [answer.mean_deg, *(answer.modes_deg if isinstance(answer, Ambiguous) else ())]
    assert all(min(abs(each - angle_deg) for angle_deg in taken) < 5.5 for each in named)
    if isinstance(answer, Unsure):
        assert answer.reason


@pytest.mark.long
@pytest.mark.parametrize("others", [0.0, None])
@pytest.mark.parametrize("seed", [2, 5, 43])
def test_a_search_among_clutter_names_what_it_has_measured_and_finds_the_loudest(
    tmp_path: Path, seed: int, others: float | None
) -> None:
    """By an earlier state these were ambiguous between places 10 to 17° from the marker, or named weaker ones first."""
    scan = scan_of(seed)
    rig = replayed(bank_of(scan, tmp_path))
    at = {float(angle_deg): rig.scanner.measure(angle_deg) for angle_deg in ANGLES_DEG}
    for taken, answer in _searched(at, others=others):
        _require_measured(taken, answer)
        assert others is None or not isinstance(answer, Ambiguous)
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(scan.marker_deg, abs=0.5)


@pytest.mark.parametrize("others", [0.0, None])
def test_a_search_of_two_peaks_names_what_it_has_measured(others: float | None) -> None:
    two_peaks = two_peaks_of(5)
    at = {
        float(angle_deg): Sample(angle_deg=float(angle_deg), reading=Reading(intensity=float(height)))
        for angle_deg, height in zip(TWO_PEAKS_ANGLES_DEG, two_peaks.intensities, strict=True)
    }
    for taken, answer in _searched(at, others=others):
        _require_measured(taken, answer)
        assert others is None or not isinstance(answer, Ambiguous)
