"""All of a recording is its answer: scans and tables that the package did not simulate (`whole_scans`, in short)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from markerseek.core import Ambiguous, Found, PolicyPlan, Reading, Sample, Unsure
from markerseek.records import answer_reason
from markerseek.search import build
from tests.field.independent_scans import HUMPS_ANGLES_DEG, humps_of, scan_of
from tests.field.whole_scans import bank_of, counted_humps, counted_scans, whole


def test_d_one_marker_among_clutter_is_found_from_all_angles_also_as_a_single_source(tmp_path: Path) -> None:
    usual, single = counted_scans(range(6), tmp_path)
    for count in (usual, single):
        assert dict(count.names) == {"found": 6}
        assert (count.wrong, count.covered) == (0, 6)


@pytest.mark.parametrize("clutter", [0, 1])
def test_d_with_little_clutter_too(tmp_path: Path, clutter: int) -> None:
    scan = scan_of(1000 + clutter, clutter=clutter)
    answer = whole(bank_of(scan, tmp_path))
    assert isinstance(answer, Found)
    assert answer.interval95_deg.low_deg < scan.marker_deg < answer.interval95_deg.high_deg


def test_a3_two_humps_are_ambiguous_from_all_angles(tmp_path: Path) -> None:
    count = counted_humps(range(10), tmp_path)
    assert dict(count.names) == {"ambiguous": 10}
    assert count.covered == 10


@pytest.mark.parametrize(("apart_deg", "relative"), [(6.0, 0.8), (8.0, 1.0), (12.0, 0.8), (25.0, 0.9)])
def test_a3_the_answer_names_both_humps_and_how_loud_the_weaker_is(
    tmp_path: Path, apart_deg: float, relative: float
) -> None:
    humps = humps_of(7, apart_deg=apart_deg, relative=relative)
    humps.write(tmp_path / "humps.csv")
    answer = whole(tmp_path / "humps.csv")
    assert isinstance(answer, Ambiguous)
    assert sorted(answer.modes_deg) == pytest.approx(sorted([humps.louder_deg, humps.weaker_deg]), abs=0.4)
    (db,) = (each.relative_db for each in answer.others if each.angle_deg in answer.modes_deg)
    assert db == pytest.approx(20 * np.log10(relative), abs=0.5)
    reason = answer_reason(answer)
    assert reason is not None
    assert f"({db:+.1f} dB)" in reason
    assert "equally" not in reason


def test_a3_a_single_source_is_the_louder_hump_and_never_ambiguous(tmp_path: Path) -> None:
    humps = humps_of(3, apart_deg=11.0, relative=0.8)
    humps.write(tmp_path / "humps.csv")
    answer = whole(tmp_path / "humps.csv", others=0.0)
    assert isinstance(answer, (Found, Unsure))
    assert answer.mean_deg == pytest.approx(humps.louder_deg, abs=0.3)


def _table(heights: np.ndarray) -> list[Sample]:
    return [
        Sample(angle_deg=float(angle_deg), reading=Reading(intensity=float(each)))
        for angle_deg, each in zip(HUMPS_ANGLES_DEG, heights, strict=True)
    ]


@pytest.mark.parametrize("others", [0.0, None])
def test_d_a_search_names_no_place_that_it_has_not_measured(others: float | None) -> None:
    humps = humps_of(5)
    at = {sample.angle_deg: sample for sample in _table(humps.intensities)}
    policy = build(PolicyPlan(method="posterior", acquisitions=24, others=others, angles_deg=tuple(at)))
    taken: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        taken.append(angle_deg)
        policy.tell(at[angle_deg])
        answer = policy.estimate()
        if others == 0:
            assert not isinstance(answer, Ambiguous)
        if isinstance(answer, Ambiguous | Found):
            named = [answer.mean_deg, *(answer.modes_deg if isinstance(answer, Ambiguous) else ())]
            assert all(min(abs(each - angle) for angle in taken) < 5.0 for each in named)
        if isinstance(answer, Unsure):
            assert answer.reason
