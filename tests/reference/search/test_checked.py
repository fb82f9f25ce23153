"""Coverage, false finds and misses of the checked answers, by Monte Carlo with fixed seeds.

Curves: S(t) = (1 + k·(2t/F)²)^(−p/2) with k = 2^(2/p) − 1, so that F is the full width at half maximum and the tails
fall as 1/|t|^p, p uniform in 1–2.5. At 10° they are at 1–45 % of the peak for F of 3–17°, which holds the 4–39 % of the
physics notes. Noise: complex normal on the sample, and the largest of 12,800 Rayleigh cells beside it.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from markerseek.core import Found, NotFound, Reading, Sample, SearchPlan, Tolerance, Unsure
from markerseek.search import build, noise_of

pytestmark = pytest.mark.usefixtures("unchecked_shapes")

CELLS = 12_800
WIDTHS_DEG = (3.0, 5.0, 10.0, 17.0)


def shape(distance_deg, fwhm_deg, tail):
    return (1 + (2 ** (2 / tail) - 1) * (2 * distance_deg / fwhm_deg) ** 2) ** (-tail / 2)


def noise_maximum(rng, sigma, size=None, cells=CELLS):
    """Largest of that many Rayleigh cells, by inversion of its distribution."""
    return sigma * np.sqrt(-2 * np.log(-np.expm1(np.log(rng.random(size)) / cells)))


def search(policy, *, rng, sigma, marker_deg, fwhm_deg=10.0, tail=1.5):
    for _ in range(3):
        reading = Reading(intensity=float(noise_maximum(rng, sigma)), noise_sigma=sigma, cells=CELLS)
        policy.tell(Sample(angle_deg=0.0, reading=reading, dark=True))
    while (angle_deg := policy.ask()) is not None:
        signal = 0.0 if marker_deg is None else shape(angle_deg - marker_deg, fwhm_deg, tail)
        received = abs(signal + sigma * complex(*rng.standard_normal(2)))
        intensity = float(max(received, noise_maximum(rng, sigma)))
        policy.tell(Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity)))
    return policy.estimate()


def campaign(name, *, sigma, searches, seed, acquisitions=None):
    """Estimates with the true angles, for random markers, widths and tails."""
    rng = np.random.default_rng(seed)
    return [
        (
            search(
                build(SearchPlan(method=name, acquisitions=acquisitions)),
                rng=rng,
                sigma=sigma,
                marker_deg=(marker_deg := rng.uniform(-35, 35)),
                fwhm_deg=WIDTHS_DEG[index % 4],
                tail=rng.uniform(1, 2.5),
            ),
            marker_deg,
        )
        for index in range(searches)
    ]


@pytest.mark.long
@pytest.mark.parametrize("sigma", [0.01, 10**-1.5], ids=["40 dB", "30 dB"])
@pytest.mark.parametrize(
    ("name", "acquisitions"),
    [
        ("weighted-average", 15),
        ("weighted-average", None),
        ("weighted-average", 71),
        ("exhaustive", None),
        ("golden-section", None),
        ("golden-section-reuse", None),
        ("ternary", None),
        ("manual", None),
    ],
)
def test_intervals_cover(name, acquisitions, sigma):
    """At least 93 % of all intervals hold the marker; they are wider than a probability would ask, never narrower."""
    answers = campaign(name, sigma=sigma, searches=600, seed=1, acquisitions=acquisitions)
    sure = [(answer, truth) for answer, truth in answers if isinstance(answer, Found | Unsure)]
    assert len(sure) > 250
    covered = np.mean([truth in answer.interval95_deg for answer, truth in sure])
    assert covered > 0.93


@pytest.mark.long
@pytest.mark.parametrize("name", ["weighted-average", "golden-section", "ternary", "exhaustive", "manual"])
def test_found_is_not_far_off(name):
    """Of 1,000 searches at 30 dB none is found and off by more than twice the tolerance (bound at 95 %: 3e-3)."""
    answers = campaign(name, sigma=10**-1.5, searches=1000, seed=2)
    most_deg = 2 * Tolerance().deg
    off = [abs(answer.mean_deg - truth) > most_deg for answer, truth in answers if isinstance(answer, Found)]
    assert len(off) > 250
    assert not any(off)


@pytest.mark.parametrize(("name", "acquisitions"), [("weighted-average", 57), ("exhaustive", 141)])
def test_found_is_accurate_at_40_db(name, acquisitions):
    answers = campaign(name, sigma=0.01, searches=400, seed=3, acquisitions=acquisitions)
    errors = [abs(answer.mean_deg - truth) for answer, truth in answers if isinstance(answer, Found)]
    assert len(errors) > 250
    assert np.mean(errors) < 0.13


@pytest.mark.parametrize("acquisitions", [15, 36])
def test_no_marker_is_not_found(acquisitions):
    """False finds with dark frames: at most 1e-3 of 100,000 sets of N frames, each the largest of M cells."""
    rng = np.random.default_rng(4)
    sets = 100_000
    dark = Sample(angle_deg=0.0, reading=Reading(intensity=4.5, noise_sigma=1.0, cells=CELLS), dark=True)
    lit = [Sample(angle_deg=float(index), reading=Reading(intensity=5.0)) for index in range(acquisitions)]
    level = noise_of(lit, dark=[dark]).floor.level
    assert level == pytest.approx(math.sqrt(2 * math.log(CELLS * acquisitions / 1e-3)))
    above = np.sum(noise_maximum(rng, 1.0, (sets, acquisitions)).max(axis=1) > level)
    # Not zero either: a threshold that nothing ever reaches would hide weak markers.
    assert 0.0003 * sets < above <= 0.0013 * sets


@pytest.mark.parametrize("name", ["weighted-average", "golden-section", "golden-section-reuse", "ternary", "manual"])
def test_guarded_methods_say_not_found_in_noise(name):
    """The same searches of which the published rules answer 86–87 % wrongly; the early end must not stop them."""
    rng = np.random.default_rng(6)
    answers = Counter(type(search(build(name), rng=rng, sigma=1.0, marker_deg=None)).__name__ for _ in range(300))
    # One search of a thousand has a noise peak above the floor; its angle is not found either.
    assert answers["Found"] == 0
    assert answers["NotFound"] >= 299


@pytest.mark.long
@pytest.mark.parametrize("cells", [100, 1_000, 12_800])
@pytest.mark.parametrize("source", ["dark frames", "lower quartile"])
def test_false_finds_where_no_frame_states_its_noise(source, cells):
    """Neither σ nor M is given: three dark intensities, or 15 lit ones alone, still keep false finds to 1e-3."""
    rng = np.random.default_rng(8)
    false_found = 0
    for _ in range(4000):
        lit = [
            Sample(angle_deg=5.0 * index, reading=Reading(intensity=float(value)))
            for index, value in enumerate(noise_maximum(rng, 1.0, 15, cells))
        ]
        dark = [
            Sample(angle_deg=0.0, reading=Reading(intensity=float(value)), dark=True)
            for value in noise_maximum(rng, 1.0, 3, cells)
        ]
        floor = noise_of(lit, dark=dark if source == "dark frames" else ()).floor
        assert floor.source == source
        assert floor.level is not None
        false_found += max(sample.reading.intensity for sample in lit) > floor.level
    assert false_found <= 4


@pytest.mark.parametrize(("sigma", "acquisitions"), [(0.01, 15), (10**-1.5, 36)], ids=["40 dB", "30 dB"])
def test_a_marker_is_seen(sigma, acquisitions):
    """A sweep misses at most 1 % of the markers altogether, curves of 3° and all."""
    answers = campaign("weighted-average", sigma=sigma, searches=500, seed=9, acquisitions=acquisitions)
    assert sum(isinstance(answer, NotFound) for answer, _ in answers) <= 5
