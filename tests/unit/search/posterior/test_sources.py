"""Arrivals of all frames are joined into sources, and each frame is read at the place of one."""

from __future__ import annotations

import math
import struct

import pytest

from markerseek.core import Arrival, Floor, LocalMaxima, Reading, Sample
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.likelihood import TABLE_LOW, TABLE_STEP, log_tables
from markerseek.search.posterior.sources import Source, is_burst, samples_at, sources_of

COLUMNS = 28
ROWS = 40


def arrival(intensity: float, lateral_mm: float, depth_mm: float) -> Arrival:
    return Arrival(
        lateral_m=1e-3 * lateral_mm, depth_m=1e-3 * depth_mm, arrival_s=30e-6, intensity=intensity, coherence=0.9
    )


def blocks(strong: dict[tuple[float, float], float]) -> LocalMaxima:
    """Blocks of 2 mm with an envelope of 3.5, and stronger ones at some places, lateral and depth in mm."""
    values = [3.5] * (COLUMNS * ROWS)
    for (lateral_mm, depth_mm), intensity in strong.items():
        column = int((lateral_mm + 28) // 2)
        row = int(depth_mm // 2)
        values[row * COLUMNS + column] = intensity
    return LocalMaxima(
        first_lateral_m=-27e-3,
        first_depth_m=1e-3,
        lateral_step_m=2e-3,
        depth_step_m=2e-3,
        columns=COLUMNS,
        noise_peaks=10.0,
        intensities=struct.pack(f"<{len(values)}f", *values),
    )


def sample(
    angle_deg: float, *arrivals: Arrival, strong: dict[tuple[float, float], float] | None = None, noise: float = 3.0
) -> Sample:
    """A sample with these arrivals, or with a noise peak; its blocks hold them and what is ``strong``."""
    strongest = max(arrivals, key=lambda each: each.intensity, default=arrival(noise, -20, 70))
    held = {(1e3 * each.lateral_m, 1e3 * each.depth_m): each.intensity for each in arrivals}
    reading = Reading(
        intensity=strongest.intensity,
        lateral_m=strongest.lateral_m,
        depth_m=strongest.depth_m,
        centroid_s=30e-6,
        spread_s=0.1e-6,
        noise_sigma=1.0,
        cells=100_000,
        coherence=strongest.coherence,
        arrivals=arrivals,
        local_maxima=blocks(held | (strong or {})),
    )
    return Sample(angle_deg=angle_deg, reading=reading)


def places(lit: list[Sample], level: float = 6.0) -> list[tuple[float, float]]:
    return [(round(1e3 * each.lateral_m, 3), round(1e3 * each.depth_m, 3)) for each in sources_of(lit, level=level)]


def test_two_sources_are_told_apart_and_the_strongest_comes_first() -> None:
    lit = [
        sample(0.0, arrival(50, 5.0, 40.0), arrival(20, -15.0, 30.0)),
        sample(10.0, arrival(90, -15.2, 30.1), arrival(10, 5.1, 40.3)),
    ]
    assert places(lit) == [(-15.2, 30.1), (5.0, 40.0)]


@pytest.mark.parametrize(("deeper_mm", "count"), [(0.3, 1), (2.5, 1), (6.2, 2)])
def test_moveout_is_the_same_source_and_a_repeat_behind_it_another(deeper_mm: float, count: int) -> None:
    lit = [sample(0.0, arrival(90, 5.0, 40.0)), sample(20.0, arrival(9, 5.2, 40.0 + deeper_mm))]
    assert len(places(lit)) == count


@pytest.mark.parametrize(("angle_deg", "count"), [(2.0, 1), (20.0, 2)])
def test_absorbers_of_one_spot_are_one_and_a_second_marker_as_near_is_not(angle_deg: float, count: int) -> None:
    """2.5 mm apart along the array: of one spot if they are strongest at about the same angle."""
    lit = [sample(0.0, arrival(90, 5.0, 40.0)), sample(angle_deg, arrival(70, 7.5, 40.0))]
    assert len(places(lit)) == count


def test_beside_a_strong_arrival_lie_its_side_lobes() -> None:
    assert places([sample(0.0, arrival(90, 5.0, 40.0), arrival(9, 7.5, 40.5))]) == [(5.0, 40.0)]


def test_what_noise_reaches_is_no_source() -> None:
    assert places([sample(0.0), sample(10.0, noise=5.9)]) == []
    assert places([sample(0.0), sample(10.0, noise=6.1)]) == [(-20.0, 70.0)]


def test_an_arrival_is_read_at_its_source_and_weak_sound_in_the_image() -> None:
    lit = [
        sample(0.0, arrival(90, 5.0, 40.0), arrival(30, -15.0, 30.0)),
        sample(20.0, arrival(50, -15.0, 30.0), strong={(5.0, 41.0): 4.5}),
    ]
    first, second = sources_of(lit, level=6.0)
    assert [each.reading.intensity for each in samples_at(lit, (first, second), first)[0]] == [90.0, 4.5]
    assert [each.reading.intensity for each in samples_at(lit, (first, second), second)[0]] == [30.0, 50.0]
    # Weak sound is the largest of a few hundred cells, not of a hundred thousand, and has no position of its own.
    weak = samples_at(lit, (first, second), first)[0][1].reading
    assert weak.cells is not None
    assert weak.cells < 1000
    assert (weak.lateral_m, weak.coherence) == (None, None)
    # The moments of arrival are those of the largest peak of a frame.
    assert samples_at(lit, (first, second), second)[0][0].reading.centroid_s is None
    assert samples_at(lit, (first, second), second)[0][1].reading.centroid_s == 30e-6


def test_where_another_source_covers_the_place_a_sample_is_an_upper_limit() -> None:
    lit = [sample(0.0, arrival(90, 5.0, 40.0)), sample(20.0, arrival(80, 8.3, 40.0))]
    first, second = sources_of(lit, level=6.0)
    for source, known_deg, covered_deg in ((first, 0.0, 20.0), (second, 20.0, 0.0)):
        own, (bound,) = samples_at(lit, (first, second), source)
        assert [each.angle_deg for each in own] == [known_deg]
        assert bound.angle_deg == covered_deg
        # The limit is as noise whose largest cell is that high: it says nothing against a quieter source.
        table = log_tables(
            noise=bound.reading.noise_sigma / bound.reading.intensity, cells=bound.reading.cells, errors=(0.1,)
        )[0]
        at = [table[round((math.log(ratio) - TABLE_LOW) / TABLE_STEP)] for ratio in (0.01, 0.2, 5.0)]
        assert at[0] == pytest.approx(at[1], abs=0.2)
        assert at[2] < at[0] - 3


def test_of_a_reading_whose_largest_peak_is_elsewhere_only_that_is_known() -> None:
    readings = [
        Reading(intensity=value, lateral_m=place, depth_m=40e-3) for value, place in ((90.0, 5e-3), (40.0, 0.0))
    ]
    lit = [Sample(angle_deg=10.0 * index, reading=reading) for index, reading in enumerate(readings)]
    first, second = sources_of(lit, level=6.0)
    assert [[each.angle_deg for each in part] for part in samples_at(lit, (first, second), second)] == [[10.0], [0.0]]


def test_a_sample_without_positions_is_of_no_place() -> None:
    bare = Sample(angle_deg=3.0, reading=Reading(intensity=7.0))
    place = Source(lateral_m=0.0, depth_m=40e-3, angle_deg=0.0)
    assert samples_at([bare], (place,), place)[0] == []
    assert sources_of([bare], level=1.0) == ()


@pytest.mark.parametrize(("limit", "burst"), [(5.9, True), (6.1, False)])
def test_a_limit_below_the_floor_beside_it_shows_that_a_place_was_loud_once_only(limit: float, burst: bool) -> None:
    place = Source(lateral_m=-15e-3, depth_m=30e-3, angle_deg=10.0)
    noise = SearchNoise(floor=Floor(level=6.0, source="dark frames"), sigma=1.0)
    own = [sample(10.0, arrival(9.0, -15.0, 30.0))]
    bound = [sample(10.9, noise=limit)]
    assert is_burst(own, bound, place, noise) is burst
