"""Golden-section and ternary search: kept brackets, asked angles, and refusals."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import ConfigError, Interval, Reading, Sample
from markerseek.search import GOLDEN, TERNARY, BracketSearch, ScriptedManual

RATIOS = pytest.mark.parametrize("ratio", [GOLDEN, TERNARY], ids=["golden", "ternary"])
angles = st.floats(-35, 35)


def sample(angle_deg, intensity):
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity))


def run(policy, curve, reach=lambda angle: angle):
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(sample(reach(angle_deg), curve(reach(angle_deg))))
    return asked


def lorentzian(marker_deg):
    return lambda angle_deg: 1 / (1 + ((angle_deg - marker_deg) / 5) ** 2)


@RATIOS
def test_ties_go_left(ratio):
    policy = BracketSearch(ratio=ratio, acquisitions=40)
    run(policy, lambda _: 2.0)
    assert policy.estimate().mean_deg == pytest.approx(-35, abs=0.05)
    assert policy.estimate().mean_deg in Interval(low_deg=-35.0, high_deg=35.0)


@RATIOS
@pytest.mark.parametrize(("allowed", "made"), [(2, 2), (3, 2), (15, 14), (16, 16)])
def test_the_unpaired_acquisition_is_not_made(ratio, allowed, made):
    assert len(run(BracketSearch(ratio=ratio, acquisitions=allowed), lorentzian(1.0))) == made


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"ratio": 1 / 3, "acquisitions": 8}, "2/3"),
        ({"ratio": 1.0, "acquisitions": 8}, "below 1"),
        ({"ratio": math.nan, "acquisitions": 8}, "ratio is nan"),
        ({"ratio": GOLDEN, "acquisitions": 1}, "at least 2"),
        ({"ratio": TERNARY, "acquisitions": 8, "reuse": True}, "golden ratio only"),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(ConfigError, match=message):
        BracketSearch(**arguments)


@given(marker_deg=angles, misses=st.lists(st.floats(-3, 3), min_size=28, max_size=28), reuse=st.booleans())
def test_the_bracket_holds_the_maximum_wherever_the_stage_stops(marker_deg, misses, reuse):
    """Points are put where they were reached, so that even misses of 3° never drop the maximum."""
    left = iter(misses)
    policy = BracketSearch(ratio=GOLDEN, acquisitions=28, reuse=reuse)
    while (angle_deg := policy.ask()) is not None:
        reached_deg = angle_deg + next(left)
        policy.tell(sample(reached_deg, 100 - abs(reached_deg - marker_deg)))
        assert policy.bracket.low_deg - 1e-9 <= marker_deg <= policy.bracket.high_deg + 1e-9


@given(intensities=st.lists(st.floats(0, 1e6), min_size=40, max_size=40), ratio=st.floats(0.51, 0.99))
def test_asks_inside_the_bracket_whatever_it_measures(intensities, ratio):
    measured = iter(intensities)
    policy = BracketSearch(ratio=ratio, acquisitions=40)
    while (angle_deg := policy.ask()) is not None:
        assert angle_deg in policy.bracket
        policy.tell(sample(angle_deg, next(measured)))


def test_noise_widens_the_answer_but_moves_nothing():
    policy = BracketSearch(ratio=GOLDEN, acquisitions=28)
    run(policy, lorentzian(4.0))
    plain = policy.answer(noise_sigma=None)
    noisy = policy.answer(noise_sigma=0.01)
    assert noisy.mean_deg == plain.mean_deg
    # FWHM 10°, 1 % noise: 0.55·10°·sqrt(0.01/(4 ln2)).
    assert noisy.sigma_deg == pytest.approx(0.55 * 10 * math.sqrt(0.01 / (4 * math.log(2))), rel=0.15)


class TestManual:
    def test_eight_turns_then_back_and_forth(self):
        asked = run(ScriptedManual(acquisitions=28), lorentzian(-3.0))
        assert asked[:8] == pytest.approx([-35, -25, -15, -5, 5, 15, 25, 35])
        assert asked[8:11] == pytest.approx([-10, 0, -7.5])
        assert min(abs(angle + 3.0) for angle in asked) < 0.1

    def test_begins_at_the_nearer_end(self):
        asked = run(ScriptedManual(acquisitions=28, start_deg=20.0), lorentzian(-3.0))
        assert asked[:2] == pytest.approx([35, 25])

    @given(marker_deg=angles)
    def test_ends_near_the_maximum_with_it_in_the_bracket(self, marker_deg):
        policy = ScriptedManual(acquisitions=60)
        run(policy, lorentzian(marker_deg))
        estimate = policy.estimate()
        assert abs(estimate.mean_deg - marker_deg) < 0.11
        assert estimate.interval95_deg.low_deg <= marker_deg <= estimate.interval95_deg.high_deg

    def test_flat_curve_keeps_the_first_angle(self):
        policy = ScriptedManual(acquisitions=28)
        run(policy, lambda _: 1.0)
        assert policy.estimate().mean_deg == -35

    def test_refuses_fewer_acquisitions_than_its_turns_need(self):
        with pytest.raises(ConfigError, match="manual"):
            ScriptedManual(acquisitions=9)
