"""Rotation travel and time: closed forms, the physics notes, and the simulated stage as second opinions."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import PAPER_RANGE, Reading, Sample
from markerseek.sim import NoiseSettings, SimulatedSettings, StageMotion
from markerseek.studies.paper import RunOptions
from markerseek.studies.paper.methods import QuantisedPolicy, noise_free_track, policy_of
from markerseek.studies.paper.travel import rotation_s, shortest_order, travel, travel_deg
from markerseek.studies.trial import SearchTrace, searched

MARKERS = np.random.default_rng(11).uniform(-35, 35, 1500)


@pytest.mark.parametrize(("name", "ratio"), [("TS", 2 / 3), ("GSS", (math.sqrt(5) - 1) / 2)])
def test_after_two_acquisitions_the_error_is_that_of_two_known_angles(name: str, ratio: float) -> None:
    """The answer is the middle of the part kept, ∓35°(1 − r): its error for markers spread evenly is an integral."""
    errors = [abs(noise_free_track(name, float(at), acquisitions=2)[1] - at) for at in MARKERS]  # type: ignore[arg-type]
    middle = 35 * (1 - ratio)
    expected = ((35 - middle) ** 2 + middle**2) / 2 / 35
    assert np.mean(errors) == pytest.approx(expected, abs=4 * np.std(errors) / math.sqrt(MARKERS.size))
    answers = {round(noise_free_track(name, at, acquisitions=2)[1], 9) for at in (-20.0, 20.0)}  # type: ignore[arg-type]
    assert answers == {round(-middle, 9), round(middle, 9)}


@pytest.mark.parametrize(
    ("name", "from_first_deg", "from_low_end_deg"), [("TS", 122, 145), ("GSS", 76, 103)], ids=["TS", "GSS"]
)
def test_travel_is_that_of_the_physics_notes(name: str, from_first_deg: float, from_low_end_deg: float) -> None:
    tracks = [noise_free_track(name, float(at), acquisitions=16)[0] for at in MARKERS]  # type: ignore[arg-type]
    assert np.mean([travel_deg(track) for track in tracks]) == pytest.approx(from_first_deg, abs=2)
    assert np.mean([travel_deg([-35.0, *track]) for track in tracks]) == pytest.approx(from_low_end_deg, abs=2)


def test_a_full_scan_travels_the_whole_range() -> None:
    track, _ = noise_free_track("WA", 3.0, acquisitions=16)
    assert travel_deg(track) == pytest.approx(70)


def test_the_shortest_order_is_that_of_all_orders_tried() -> None:
    for at in MARKERS[:20]:
        track, _ = noise_free_track("TS", float(at), acquisitions=10)
        pairs = list(zip(track[::2], track[1::2], strict=True))
        tried = [
            travel_deg([-35.0, *(angle for pair, turned in zip(pairs, turns, strict=True) for angle in pair[::turned])])
            for turns in itertools.product((1, -1), repeat=len(pairs))
        ]
        ordered = shortest_order(track, start_deg=-35.0)
        assert sorted(ordered) == sorted(track)
        assert travel_deg([-35.0, *ordered]) == pytest.approx(min(tried))


def test_rotation_takes_as_long_as_on_the_simulated_rig() -> None:
    settings = SimulatedSettings(start_deg=-35.0, noise=NoiseSettings(peak_snr_db=60))
    rig = rigs.simulated(seed=2, marker_deg=4.0, settings=settings)
    samples, finished, *_ = searched(policy_of("TS", acquisitions=6), rig.scanner)
    acquiring_s = 6 * (settings.receiver.readout_s + settings.laser.pulses / settings.laser.rate_hz)
    track = [-35.0, *(sample.angle_deg for sample in samples)]
    assert finished.elapsed_s - acquiring_s == pytest.approx(rotation_s(track, motion=settings.stage), abs=2e-3)
    assert finished.travel_deg == pytest.approx(travel_deg(track), abs=2e-3)


def test_a_single_long_move_takes_a_trapezoid() -> None:
    motion = StageMotion(speed_deg_s=10, acceleration_deg_s2=10, settle_s=0.0)
    assert rotation_s([0.0, 36.0], motion=motion) == pytest.approx(36 / 10 + 1)
    assert rotation_s([0.0, 0.1], motion=motion) == pytest.approx(2 * math.sqrt(0.1 / 10))


@pytest.mark.parametrize("name", ["TS", "GSS", "posterior"])
def test_a_long_search_contains_the_shorter_ones(name: str) -> None:
    def ended(acquisitions: int, *counts: int) -> SearchTrace:
        rig = rigs.simulated(seed=5, marker_deg=-7.0)
        policy = policy_of(name, acquisitions=acquisitions, start_deg=rig.stage.angle_deg)  # type: ignore[arg-type]
        return searched(policy, rig.scanner, counts=counts)

    counts = (2, 8, 12)
    answers = ended(12, *counts).answers
    assert answers == {count: ended(count).finished.estimate for count in counts}


def test_requested_angles_lie_on_encoder_counts_and_inside_the_bank() -> None:
    policy = QuantisedPolicy(policy_of("WA", acquisitions=8), limits=PAPER_RANGE)
    asked: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(Sample(angle_deg=angle_deg, reading=Reading(intensity=1.0)))
    assert all(angle_deg in PAPER_RANGE for angle_deg in asked)
    # At an end the nearest count may lie outside.
    counts = np.array(asked[1:-1]) * StageMotion().counts_per_deg
    assert counts == pytest.approx(np.round(counts), rel=0, abs=1e-6)


def test_the_section_lists_what_cannot_be_reproduced() -> None:
    section = travel(RunOptions(markers=60))
    by_condition = {each.condition: each for each in section.comparisons}
    printed = by_condition["TS"]
    assert printed.paper.value == 36
    assert printed.difference == pytest.approx(printed.ours - 36)
    assert printed.ours == pytest.approx(122, abs=10)
    assert "cannot be reproduced" in section.remarks[0]
    assert "1.4 s and 1.0 s" in section.remarks[1]
