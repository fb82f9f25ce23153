"""A run from its plan to its result, from Python, as a command, page or bridge uses it."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import pytest

import markerseek
from markerseek import rigs
from markerseek.core import ConfigError, Finished, Measured, SearchError, SearchPlan
from markerseek.guard import State
from markerseek.runs import Run, new_run, plan_on
from markerseek.sim import GaussianCurve, ReceiverSettings, SimulatedSettings


def run_on(rig: rigs.Rig) -> Run:
    return new_run(rig, plan_on(rig, SearchPlan(method="golden-section", acquisitions=8, start_deg=0.0)))


def rig() -> rigs.Rig:
    return rigs.of_intensities(seed=4, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=7.5)


def test_a_session_gives_events_and_then_the_result_of_its_plan_and_facts() -> None:
    run = run_on(rig())
    events = list(run.events())
    result = run.result()
    assert isinstance(events[-1], Finished)
    assert run.most_acquisitions == 8
    assert result.method == "golden-section"
    assert result.run.facts == run.rig.facts
    assert (result.run.facts.seed, result.run.facts.truth_deg) == (4, 7.5)
    assert result.error_deg == pytest.approx(abs(result.angle_deg - 7.5))


@pytest.mark.parametrize(("readout_s", "at_once"), [(0.05, False), (10.0, True)])
def test_a_receiver_that_is_read_once_a_sweep_is_swept_at_once_and_needs_no_dark_frame_at_the_end(
    readout_s: float, at_once: bool
) -> None:
    settings = SimulatedSettings(receiver=ReceiverSettings(readout_s=readout_s, single_pulses=True))
    simulated = replace(rigs.simulated(seed=1, settings=settings), closing_dark=True)
    plan = plan_on(simulated, SearchPlan(method="posterior", start_deg=0.0, sweep_speed_deg_s=8.6))
    assert (plan.sweep_from_end, plan.closing_dark, plan.dark_frames) == (at_once, not at_once, 0)
    at_rest = plan_on(simulated, SearchPlan(method="posterior", start_deg=0.0))
    assert (at_rest.sweep_from_end, at_rest.closing_dark) == (False, True)


def test_a_session_that_is_closed_stops_the_rig_and_has_no_result() -> None:
    run = run_on(rig())
    with closing(run.events()) as events:
        next(event for event in events if isinstance(event, Measured))
        assert run.rig.scanner.guard.state is State.ARMED
    assert run.rig.scanner.guard.state is State.DISARMED
    with pytest.raises(SearchError, match="not over"):
        run.result()


def test_a_plan_that_cannot_be_used_is_refused_before_anything_moves() -> None:
    assembled = rig()
    with pytest.raises(ConfigError, match="posterior: it is markerseek's own"):
        new_run(assembled, plan_on(assembled, SearchPlan(method="posterior", as_published=True, start_deg=0.0)))
    assert assembled.scanner.guard.state is State.DISARMED


def test_the_paper_s_form_takes_no_dark_frames_first() -> None:
    assembled = rig()
    assert plan_on(assembled, SearchPlan(method="ternary", start_deg=0.0)).dark_frames == assembled.dark_frames > 0
    assert plan_on(assembled, SearchPlan(method="ternary", as_published=True, start_deg=0.0)).dark_frames == 0


def test_a_file_in_place_of_a_rig_is_refused_with_what_makes_one_of_it() -> None:
    with pytest.raises(ConfigError, match=r"'scan\.csv', it must be a rig, such as markerseek\.replayed"):
        markerseek.find_marker("scan.csv")  # type: ignore[arg-type]


def test_what_is_printed_of_a_rig_is_a_line_and_does_not_give_the_marker_away() -> None:
    rig = markerseek.simulated(seed=1)
    assert rig.facts.truth_deg is not None
    for printed in (repr(rig), repr(rig.facts)):
        assert f"{rig.facts.truth_deg:.2f}" not in printed
    assert len(repr(rig)) < 150
    assert "simulated" in repr(rig)
    policy = markerseek.build("posterior")
    policy.tell(rig.scanner.measure(0.0))
    assert repr(policy) == "<posterior after 1 acquisitions>"
