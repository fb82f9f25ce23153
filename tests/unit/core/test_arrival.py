"""Local maxima of an image: which blocks a window touches, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import Arrival, ConfigError, LocalMaxima
from tests.sizes import examples

ROWS, COLUMNS = 7, 5
HEIGHTS = np.random.default_rng(3).uniform(1, 9, (ROWS, COLUMNS)).astype("<f4")
MAXIMA = LocalMaxima(
    first_lateral_m=-4e-3,
    first_depth_m=5e-3,
    lateral_step_m=2e-3,
    depth_step_m=2.5e-3,
    columns=COLUMNS,
    noise_peaks=12.0,
    intensities=HEIGHTS.tobytes(),
)


@settings(max_examples=examples(200), deadline=None)
@given(lateral_mm=st.floats(-9, 9), low_mm=st.floats(0, 30), deep_mm=st.floats(0, 12), within_mm=st.floats(0.0, 4.0))
def test_the_window_touches_the_blocks_that_overlap_it(
    lateral_mm: float, low_mm: float, deep_mm: float, within_mm: float
) -> None:
    """Against a test of each block by itself; windows that end within a nanometre of a block's edge are left out."""
    sides = (lateral_mm - within_mm, lateral_mm + within_mm, low_mm, low_mm + deep_mm)
    touched = np.zeros((ROWS, COLUMNS), dtype=bool)
    for row, column in np.ndindex(ROWS, COLUMNS):
        left, top = -5 + 2 * column, 3.75 + 2.5 * row
        edges = (left, left + 2, top, top + 2.5)
        if any(abs(side - edge) < 1e-6 for side in sides for edge in edges):
            return
        touched[row, column] = sides[0] < edges[1] and sides[1] > edges[0] and sides[2] < edges[3] and sides[3] > top
    found = MAXIMA.near(
        lateral_m=lateral_mm * 1e-3,
        low_depth_m=low_mm * 1e-3,
        high_depth_m=(low_mm + deep_mm) * 1e-3,
        within_m=within_mm * 1e-3,
    )
    if not touched.any():
        assert found is None
        return
    assert found is not None
    height, cells = found
    assert height == HEIGHTS[touched].max()
    # M is the solution of M = ρ(u² − 1) with M·exp(−u²/2) = ln 2, whatever way it is found.
    u_squared = 2 * math.log(cells / math.log(2))
    assert cells == pytest.approx(12.0 * touched.sum() * (u_squared - 1), rel=0.02)


def test_the_number_of_rows_follows() -> None:
    assert MAXIMA.rows == ROWS
    assert replace(MAXIMA) == MAXIMA
    assert "intensities" in repr(MAXIMA)


@pytest.mark.parametrize(
    "change",
    [
        {"intensities": b""},
        {"intensities": HEIGHTS.tobytes()[:-4]},
        {"intensities": np.full(COLUMNS, np.nan, "<f4").tobytes()},
        {"intensities": np.full(COLUMNS, -1, "<f4").tobytes()},
        {"columns": 0},
        {"noise_peaks": 0.0},
        {"first_lateral_m": math.nan},
        {"first_depth_m": 11.0},
        {"lateral_step_m": 0.0},
    ],
)
def test_impossible_maxima_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="local maxima"):
        replace(MAXIMA, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [{"lateral_m": math.nan}, {"low_depth_m": math.nan}, {"high_depth_m": 1e-3}, {"within_m": -1e-3}],
)
def test_an_impossible_window_is_refused(change: dict[str, float]) -> None:
    window = {"lateral_m": 0.0, "low_depth_m": 5e-3, "high_depth_m": 6e-3, "within_m": 0.0}
    assert MAXIMA.near(**window) is not None
    with pytest.raises(ConfigError, match=next(iter(change))):
        MAXIMA.near(**{**window, **change})


@pytest.mark.parametrize("name", ["lateral_m", "depth_m", "arrival_s", "intensity", "coherence"])
def test_an_arrival_refuses_what_is_no_number(name: str) -> None:
    arrival = Arrival(lateral_m=0.0, depth_m=0.05, arrival_s=3e-5, intensity=7.0, coherence=0.5)
    with pytest.raises(ConfigError, match=name):
        replace(arrival, **{name: math.nan})
