"""Who watches a search does not change it: its path and answer are those of the same search unwatched."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import Estimate, Reading, Sample, SearchPlan
from markerseek.search import METHODS, build

MOST = 30
CELLS = 10_000


@dataclass(frozen=True, kw_only=True)
class World:
    """A Lorentzian curve in the noise of an image, in units of the noise; no marker where the angle is None."""

    seed: int
    marker_deg: float | None
    fwhm_deg: float
    snr: float
    stated: bool

    def samples(self, *, dark: int) -> _Samples:
        """Return the samples of one search, the dark ones counted apart."""
        return _Samples(self, dark=dark)


class _Samples:
    def __init__(self, world: World, *, dark: int) -> None:
        self._world = world
        self._rng = np.random.default_rng(world.seed)
        self.dark = [self._sample(0.0, 0.0, dark=True) for _ in range(dark)]

    def at(self, angle_deg: float) -> Sample:
        """Return the next sample, with the laser on."""
        world = self._world
        height = 0.0
        if world.marker_deg is not None:
            height = world.snr / (1 + (2 * (angle_deg - world.marker_deg) / world.fwhm_deg) ** 2)
        return self._sample(angle_deg, height, dark=False)

    def _sample(self, angle_deg: float, height: float, *, dark: bool) -> Sample:
        largest_noise = math.sqrt(2 * math.log(CELLS / self._rng.standard_exponential()))
        along, across = self._rng.standard_normal(2).tolist()
        reading = Reading(
            intensity=max(largest_noise, math.hypot(height + along, across)),
            noise_sigma=1.0 if self._world.stated else None,
            cells=CELLS if self._world.stated else None,
        )
        return Sample(angle_deg=angle_deg, reading=reading, dark=dark)


WORLDS = st.builds(
    World,
    seed=st.integers(0, 2**32 - 1),
    marker_deg=st.none() | st.floats(-40, 40),
    fwhm_deg=st.floats(3, 20),
    snr=st.floats(3, 300),
    stated=st.booleans(),
)


def searched(plan: SearchPlan, world: World, *, dark: int, watched: frozenset[int]) -> tuple[list[float], Estimate]:
    """Return the angles and the answer of a search that is watched after these of its samples."""
    policy = build(plan)
    samples = world.samples(dark=dark)
    for sample in samples.dark:
        policy.tell(sample)
    asked: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(samples.at(angle_deg))
        if len(asked) in watched:
            policy.estimate()
            # As the loop does for its events; the methods of the paper believe nothing.
            getattr(policy, "belief", None)
    return asked, policy.estimate()


PLANS = [
    SearchPlan(method=method.name, acquisitions=MOST if method.name == "exhaustive" else None) for method in METHODS
]


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.method)
@settings(deadline=None, max_examples=12)
@given(world=WORLDS, dark=st.integers(0, 3), watched=st.frozensets(st.integers(1, MOST)))
def test_watching_changes_neither_the_path_nor_the_answer(
    plan: SearchPlan, world: World, dark: int, watched: frozenset[int]
) -> None:
    unwatched = searched(plan, world, dark=dark, watched=frozenset())
    assert searched(plan, world, dark=dark, watched=watched) == unwatched


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("marker_deg", [None, -12.0])
def test_a_search_that_is_watched_after_each_sample_goes_the_same_way(marker_deg: float | None, stated: bool) -> None:
    world = World(seed=1, marker_deg=marker_deg, fwhm_deg=10.0, snr=30.0, stated=stated)
    plan = SearchPlan(method="posterior")
    unwatched = searched(plan, world, dark=2, watched=frozenset())
    assert searched(plan, world, dark=2, watched=frozenset(range(1, MOST + 1))) == unwatched
