"""Which sources may be the marker beside the strongest, and where the top of one may have been missed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from markerseek.core import PAPER_RANGE, Reading, Sample
from markerseek.search.posterior.rivals import missed_peak_deg, ranked, rivals_of, top_beside_deg, unresolved_rival
from markerseek.search.posterior.sources import Candidate
from tests.reference.search.posterior.test_next_angle import posterior


def source(angle_deg, snr, *, log_sigma=0.02, samples=()):
    """A source of which angle and strength are known, with its samples as (angle, intensity over σ)."""
    near_deg = angle_deg + np.linspace(-0.5, 0.5, 21)
    share = norm.pdf(near_deg, loc=angle_deg, scale=0.1)
    known = posterior(
        np.full(9, angle_deg),
        np.log(snr) + log_sigma * norm.ppf((np.arange(9) + 0.5) / 9),
        np.zeros(9, np.int64),
        angle_deg=near_deg,
        probability=share / share.sum(),
        fwhm_deg=3.0,
        centre_sigma_deg=0.1,
    )
    at = [Sample(angle_deg=place, reading=Reading(intensity=height, noise_sigma=1.0)) for place, height in samples]
    return Candidate(source=None, side=(), samples=at, missing=None, posterior=known, seen=len(at), measured=True)


@pytest.mark.parametrize(("snr", "log_sigma", "rival"), [(60, 0.02, True), (47, 0.02, False), (47, 0.1, True)])
def test_a_source_is_a_rival_where_it_may_be_within_6_db(snr, log_sigma, rival):
    """47 is 6.6 dB below 100: with 0.1 (0.9 dB) in ln A it may be within 6 dB, with 0.02 it is not."""
    assert bool(rivals_of([source(-20.0, 100.0), source(10.0, snr, log_sigma=log_sigma)])) is rival


def test_a_narrow_top_may_be_missed_beyond_a_shoulder():
    """The three samples look like a weak curve about -28.2°; the first of them lies on the flank of a strong one."""
    shoulder = source(-28.3, 16.0, samples=[(-29.5, 15.0), (-28.2, 16.0), (-26.9, 14.0)])
    strongest = source(-22.1, 50.0)
    measured_deg = [-29.5, -28.2, -26.9, -25.6, -21.9, -14.4]
    (found, top_deg) = unresolved_rival([strongest, shoulder], measured_deg, limits=PAPER_RANGE)
    assert found is shoulder
    assert -34 < top_deg < -31.5
    # Once that has been measured without a top, nothing is left to hide it.
    measured_deg += [top_deg, -30.9]
    assert missed_peak_deg(strongest, shoulder, measured_deg, limits=PAPER_RANGE) is None


def test_no_top_is_hidden_in_a_gap_at_whose_far_end_nothing_was_measured_of_it():
    """A curve of 3° that is 15 at -29.5° and hardly seen at -34° is at most 17 high in between, by a fine grid."""
    strongest = source(-22.1, 50.0)
    seen = [(-34.0, 3.0), (-29.5, 15.0), (-28.2, 16.0), (-26.9, 14.0), (-25.6, 6.0)]
    weak = source(-28.3, 16.0, samples=seen)
    measured_deg = [angle_deg for angle_deg, _ in seen] + [-22.1]
    assert missed_peak_deg(strongest, weak, measured_deg, limits=PAPER_RANGE) is None
    strong = source(-28.3, 16.0, samples=[(-34.0, 7.5), *seen[1:]])
    top_deg = missed_peak_deg(strongest, strong, measured_deg, limits=PAPER_RANGE)
    assert top_deg is not None
    assert -32.5 < top_deg < -30.5


def test_a_narrow_top_may_be_missed_between_two_shoulders():
    """The near field of an element without a lens: a peak of 3° stands on a curve of 16°, in a gap of 6.5°."""
    seen = [(9.3, 7.0), (13.7, 8.3), (16.7, 12.1), (23.2, 15.0), (26.5, 11.4), (29.9, 6.0)]
    strongest = source(-25.0, 77.0)
    wide = source(21.0, 16.0, samples=seen)
    measured_deg = [angle_deg for angle_deg, _ in seen]
    top_deg = missed_peak_deg(strongest, wide, measured_deg, limits=PAPER_RANGE)
    assert top_deg is not None
    assert 18.0 < top_deg < 22.0
    # A sample in the gap that is no higher than its neighbours leaves no room.
    measured = source(21.0, 16.0, samples=[*seen, (20.0, 14.5)])
    assert missed_peak_deg(strongest, measured, [*measured_deg, 20.0], limits=PAPER_RANGE) is None


def test_no_top_is_hidden_beside_a_sample_of_nothing():
    """Tables hold zeros where a program has taken the background off, or a frame was lost."""
    strongest = source(-25.0, 50.0)
    nothing = Sample(angle_deg=4.0, reading=Reading(intensity=0.0, noise_sigma=1.0))
    assert top_beside_deg(strongest, strongest, [nothing], [-25.0, 4.0], limits=PAPER_RANGE) is None


@pytest.mark.parametrize(("snr", "comes_first"), [(400.0, True), (130.0, False)])
def test_a_source_of_vague_angle_comes_first_only_if_it_is_far_stronger(snr, comes_first):
    """12 dB above all others it is the marker, wherever it is exactly: no other is "within 6 dB" of it then."""
    weak = source(-20.0, 100.0)
    vague = source(14.0, snr)
    vague = replace(vague, posterior=replace(vague.posterior, centre_sigma_deg=0.6))
    strongest, other = ranked([weak, vague])
    assert (strongest is vague) is comes_first
    assert bool(rivals_of([strongest, other])) is not comes_first
    beyond = replace(vague, beyond=True)
    assert ranked([weak, beyond])[0] is weak
