"""P19: following stops in time, says why, and goes on only as it may, in runs with something injected."""

from __future__ import annotations

import pytest

from markerseek.following import BY_A_PERSON
from tests.faults.followed_runs import SPOT_KINDS, TIP_KINDS, draw_plan, perform
from tests.sizes import LONG

RUNS = 1000 if LONG else 60


def test_no_run_breaks_the_promise_and_every_cause_is_named() -> None:
    broken = [(seed, said) for seed in range(RUNS) for said in perform(seed).broken]
    assert broken == []


@pytest.mark.parametrize("kind", sorted({*TIP_KINDS, *SPOT_KINDS} - {"nothing", "fault"}))
def test_each_cause_is_said_by_its_name(kind: str) -> None:
    run = perform(_first(lambda plan: plan.kind == kind))
    assert run.broken == []
    said = [step for step in run.steps if step.word == kind]
    assert said
    assert all(step.said for step in said)
    # A registration that tissue or endoscope contradict is not handed on.
    withdrawn = kind in ("tissue", "endoscope")
    assert all((step.davinci_to_trus is None) == withdrawn for step in said)
    if kind in BY_A_PERSON and not run.plan.person_comes:
        assert run.steps[-1].word == kind


def test_a_target_that_moves_is_followed() -> None:
    run = perform(_first(lambda plan: plan.kind == "nothing" and not plan.lit and plan.amplitude_deg > 4))
    assert run.steps[-1].word in ("there", "turning", "resting")
    settled = [step for step in run.steps if step.at_s > run.plan.begins_s]
    assert settled
    for step in settled:
        assert step.target_deg is not None
        assert step.target_deg == pytest.approx(run.room.angle_deg(step.at_s), abs=0.5)
    assert {step.turning for step in run.steps} == {True, False}


def _first(wanted: object) -> int:
    """The first seed whose plan is wanted."""
    assert callable(wanted)
    return next(seed for seed in range(10_000) if wanted(draw_plan(seed)))
