"""The paper's searches: a long one contains the shorter ones, and offline ones go to encoder counts."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import PAPER_RANGE, Reading, Sample, SearchPlan
from markerseek.sim import StageMotion
from markerseek.studies.paper.methods import QuantisedPolicy, policy_of
from markerseek.studies.trial import SearchTrace, searched


@pytest.mark.parametrize("name", ["TS", "GSS"])
def test_a_long_search_contains_the_shorter_ones(name: str) -> None:
    def ended(acquisitions: int, *counts: int) -> SearchTrace:
        rig = rigs.simulated(seed=5, marker_deg=-7.0)
        policy = policy_of(name, acquisitions=acquisitions)  # type: ignore[arg-type]
        return searched(policy, rig, SearchPlan(method="ternary", stay=True), counts=counts)

    counts = (2, 8, 12)
    answers = ended(12, *counts).answers
    assert answers == {count: ended(count).finished.estimate for count in counts}


def test_requested_angles_lie_on_encoder_counts_and_inside_the_bank() -> None:
    policy = QuantisedPolicy(policy=policy_of("WA", acquisitions=8), limits=PAPER_RANGE)
    asked: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(Sample(angle_deg=angle_deg, reading=Reading(intensity=1.0)))
    assert all(angle_deg in PAPER_RANGE for angle_deg in asked)
    # At an end the nearest count may lie outside.
    counts = np.array(asked[1:-1]) * StageMotion().counts_per_deg
    assert counts == pytest.approx(np.round(counts), rel=0, abs=1e-6)
