"""Means, shares and intervals against scipy.stats, for any partition of the sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from markerseek.studies import Mean, Share
from markerseek.studies.summary import clopper_pearson


@pytest.mark.parametrize("count", [2, 3, 30, 1000])
def test_the_interval_of_a_mean_is_students(count: int) -> None:
    values = np.random.default_rng(count).exponential(size=count).tolist()
    expected = stats.t.interval(0.95, count - 1, loc=np.mean(values), scale=stats.sem(values))
    mean = Mean.of(values)
    assert mean.interval95 == pytest.approx(expected)
    assert mean.sd == pytest.approx(stats.tstd(values))


@pytest.mark.parametrize(("hits", "count"), [(0, 10), (10, 10), (3, 10), (1, 1000), (999, 1000), (0, 1)])
def test_the_interval_of_a_share_is_the_exact_one(hits: int, count: int) -> None:
    expected = stats.binomtest(hits, count).proportion_ci(confidence_level=0.95, method="exact")
    assert clopper_pearson(hits, count) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert Share.of(hits, count).share == hits / count


def test_too_few_values_have_no_interval_and_none_have_no_mean() -> None:
    assert Mean.of([]) == Mean(count=0, mean=None, interval95=None, sd=None)
    assert Mean.of([2.0]) == Mean(count=1, mean=2.0, interval95=None, sd=None)
    assert Share.of(0, 0) == Share(hits=0, count=0, share=None, interval95=None)
