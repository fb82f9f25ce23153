"""How probable it is that another source is the marker, and in which order an answer names further ones."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.stats import norm

from markerseek.core import PAPER_RANGE, Floor, Found, MarkerMotion, Tolerance
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.analysis import Analysis
from markerseek.search.posterior.answer import answer_of, other_probability
from markerseek.search.posterior.rivals import ranked
from markerseek.search.posterior.survey import Survey
from tests.unit.search.posterior.test_rivals import source

SPREAD = 0.2 * float(np.std(norm.ppf((np.arange(9) + 0.5) / 9)))
"""Standard deviation of ln A of nine particles of a source with a spread of 0.2."""


@pytest.mark.parametrize(
    ("others", "share", "beside", "probability"),
    [
        # Bayes' rule: of 5 % a twentieth is left, beside the 95 % in which there is none.
        (0.05, 0.95, None, 0.0025 / 0.9525),
        (0.5, 0.95, None, 0.025 / 0.525),
        (0.0, 0.2, None, 0.0),
        # As strong, 3 dB and 10 dB weaker, with 0.2 in ln A of each: the normal distribution of their difference.
        (0.05, 1.0, (100.0, 10.0), 0.5),
        (0.05, 1.0, (70.8, 10.0), norm.sf(0.345 / np.hypot(SPREAD, SPREAD))),
        (0.05, 1.0, (31.6, 10.0), norm.sf(1.152 / np.hypot(SPREAD, SPREAD))),
        # At the same angle it does not matter which of the two is the marker.
        (0.05, 1.0, (100.0, -20.0), 0.0),
    ],
)
def test_the_probability_that_another_source_is_the_marker(others, share, beside, probability):
    first = source(-20.0, 100.0, log_sigma=0.2)
    seen = [] if beside is None else [source(beside[1], beside[0], log_sigma=0.2)]
    survey = Survey(surveyed=share, hidden=1 - share, hidden_deg=0.0, next_deg=0.0, gain=0.0)
    known = Mock(spec=Analysis, sources=[first, *seen], survey=survey, unresolved_rival=None)
    assert other_probability(known, others=others) == pytest.approx(probability, rel=0.01, abs=1e-9)


def test_further_sources_are_named_the_strongest_first():
    """One whose angle is not known yet comes last among those that may be the marker, not in the answer."""
    first = source(-20.0, 100.0, samples=[(-20.0, 100.0)])
    weak = source(0.0, 5.0)
    vague = source(20.0, 20.0)
    vague = replace(vague, posterior=replace(vague.posterior, centre_sigma_deg=0.4))
    sources = ranked([vague, weak, first])
    assert sources == [first, weak, vague]
    noise = SearchNoise(floor=Floor(level=1.0, source="dark frames"), sigma=1.0)
    known = Mock(spec=Analysis, noise=noise, sources=sources, survey=None, unresolved_rival=None, outliers=[])
    known.misfit = None
    known.inconsistency = None
    known.motion = MarkerMotion()
    known.measured_deg = [-20.0]
    known.limits = PAPER_RANGE
    answer = answer_of(known, others=0.0, spent=False, tolerance=Tolerance(), weaker_than_predicted=None)
    assert [round(each.angle_deg) for each in answer.others] == [20, 0]
    assert isinstance(answer, Found)
