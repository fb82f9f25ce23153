"""Formatting of the numbers in a study's summary."""

from __future__ import annotations

import pytest

from markerseek.cli.study import _mean, _rare
from markerseek.studies import Mean, Share


@pytest.mark.parametrize(
    ("hits", "count", "text"),
    [(100, 100, "100 % ≤100"), (999, 1000, "100 % ≤100"), (0, 100, "0 % ≤3.6"), (36, 100, "36 % ≤46"), (0, 0, "–")],
)
def test_shares_have_no_exponent(hits: int, count: int, text: str) -> None:
    assert _rare(Share.of(hits, count)) == text


def test_the_interval_of_a_magnitude_does_not_begin_below_zero_and_that_of_a_difference_does() -> None:
    mean = Mean(count=5, mean=0.241, interval95=(-0.00262, 0.485), sd=0.2)
    assert _mean(mean) == "0.241° [0, 0.485]"
    assert _mean(mean, least=-1.0) == "0.241° [-0.00262, 0.485]"
