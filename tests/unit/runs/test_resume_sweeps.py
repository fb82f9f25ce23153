"""Searches by sweeps in a journal: each pulse is kept, a run killed in mid-sweep sweeps again, all is recomputed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from markerseek.records.journal.sequence import order_faults

from markerseek import rigs
from markerseek.core import (
    AnyPolicy,
    Asked,
    Event,
    Finished,
    Found,
    Measured,
    Reading,
    Refused,
    Sample,
    SearchPlan,
    Started,
    Sweep,
    SweepTiming,
    Swept,
)
from markerseek.records.journal import Configuration, Entry, read_journal, result_of, verify
from markerseek.rigs import Rig
from markerseek.runs import configuration_of, rebuild_reader, recompute_differences
from markerseek.runs.resume import commanded_deg, most_pulses, pulses_before
from markerseek.search import build_sweeping
from markerseek.sim import GaussianCurve, SimulatedSettings
from tests.unit.runs import journalled_runs
from tests.unit.runs.journalled_runs import times_and_events

PLAN = SearchPlan(method="posterior", start_deg=-35.0, sweep_speed_deg_s=8.6)


def begin() -> tuple[AnyPolicy, Rig, Configuration]:
    settings = SimulatedSettings(start_deg=-35.0)
    rig = rigs.of_intensities(
        seed=3,
        curve=GaussianCurve(fwhm_deg=5.0),
        marker_deg=-14.0,
        settings=replace(
            settings,
            laser=replace(settings.laser, rate_hz=20.0),
            receiver=replace(settings.receiver, readout_s=0.05),
        ),
    )
    return build_sweeping(PLAN, limits=rig.limits.search), rig, configuration_of(rig, PLAN)


live, resume_run = partial(journalled_runs.live, begun=begin), partial(journalled_runs.resume_run, begun=begin)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.journal"
    live(path)
    return path


def test_a_journal_holds_each_pulse_and_the_end_of_each_sweep(whole: Path) -> None:
    held = read_journal(whole)
    events = [entry.event for entry in held.entries]
    swept = [event for event in events if isinstance(event, Swept)]
    measured = [event for event in events if isinstance(event, Measured) and event.role == "search"]
    assert sum(event.pulses for event in swept) == len(measured) > 30
    assert all(event.sample.sweep is not None and event.sample.angle_sigma_deg > 0 for event in measured)
    finished = events[-1]
    assert isinstance(finished, Finished)
    assert isinstance(finished.estimate, Found)
    assert abs(finished.estimate.mean_deg + 14.0) < 0.5
    assert verify(whole).faults == []
    by_kind = {type(entry.event): entry for entry in held.entries}
    assert by_kind[Swept].checkpoint is not None
    assert result_of(held)[1].answer == "found"


def test_a_journal_of_sweeps_is_recomputed_equal(whole: Path) -> None:
    policy, _, configuration = begin()
    assert recompute_differences(read_journal(whole), policy, rebuild_reader(configuration)) == []


def test_stopped_after_a_sweep_a_run_is_resumed_to_the_same_end(whole: Path, tmp_path: Path) -> None:
    wanted = read_journal(whole)
    kinds = [type(entry.event) for entry in wanted.entries]
    path = tmp_path / "run.journal"
    live(path, until=kinds.index(Swept) + 1)
    resume_run(path)
    assert times_and_events(read_journal(path)) == times_and_events(wanted)
    assert verify(path).faults == []


@pytest.mark.parametrize("until", [2, 3, 25, -1])
def test_stopped_in_mid_sweep_a_run_sweeps_anew_from_its_beginning(whole: Path, tmp_path: Path, until: int) -> None:
    kinds = [type(entry.event) for entry in read_journal(whole).entries]
    path = tmp_path / "run.journal"
    before = live(path, until=until if until > 0 else kinds.index(Swept))
    events = resume_run(path)
    assert events[: len(before)] == before
    asked = [event for event in events if isinstance(event, Asked) and event.sweep is not None]
    # Without `Swept` a sweep is broken off, though all its samples were told.
    in_mid_sweep = until != 2
    assert len(asked) == (2 if in_mid_sweep else 1)
    assert {event.sweep.from_deg for event in asked if event.sweep} == {asked[0].sweep and asked[0].sweep.from_deg}
    numbers = [event.sample.sweep.number for event in events if isinstance(event, Measured) and event.sample.sweep]
    assert sorted(set(numbers)) == ([1, 2] if in_mid_sweep else [1])
    assert isinstance(events[-1], Finished)
    assert isinstance(events[-1].estimate, Found)
    assert verify(path).faults == []
    policy, _, configuration = begin()
    assert recompute_differences(read_journal(path), policy, rebuild_reader(configuration)) == []


def test_pulses_of_a_sweep_count_as_fired_and_of_a_broken_one_as_permitted() -> None:
    sweep = Sweep(from_deg=-35.0, to_deg=35.0, speed_deg_s=10.0, spacing_deg=0.1)
    asked = Asked(role="search", index=1, angle_deg=35.0, sweep=sweep)
    over = Swept(angle_deg=35.0, pulses=77)
    assert most_pulses(sweep) == 1402
    assert most_pulses(replace(sweep, spacing_deg=0.0)) == 10_000
    assert pulses_before(entries(asked, over), pulses=16, attempts=3) == 77
    assert pulses_before(entries(asked, asked, over), pulses=16, attempts=3) == 1402 + 77
    refused = Refused(angle_deg=0.0, reason="a frame")
    assert pulses_before(entries(asked, refused, over), pulses=16, attempts=3) == 77
    assert pulses_before(entries(asked), pulses=16, attempts=3) == 1402


def test_a_sample_of_a_sweep_is_measured_again_where_it_was_taken() -> None:
    timing = SweepTiming(number=1, speed_deg_s=10.0)
    sample = Sample(angle_deg=3.21, reading=Reading(intensity=1.0), sweep=timing)
    assert commanded_deg(sample) == 3.21


def entries(*events: Event) -> tuple[Entry, ...]:
    return tuple(
        Entry(number=number, event=event, clock_s=0.0, written="", checkpoint=None)
        for number, event in enumerate(events, start=1)
    )


def measured(index: int) -> Measured:
    timing = SweepTiming(number=1, speed_deg_s=10.0)
    return Measured(
        role="search", index=index, sample=Sample(angle_deg=0.0, reading=Reading(intensity=1.0), sweep=timing)
    )


STARTED = Started(start_deg=-35.0, limits=SimulatedSettings().limits.search)
ASKED = Asked(role="search", index=1, angle_deg=35.0, sweep=Sweep(to_deg=35.0, speed_deg_s=10.0))
AT_REST = Asked(role="search", index=1, angle_deg=35.0)
SWEPT = Swept(angle_deg=35.0, pulses=2)


@pytest.mark.parametrize(
    ("events", "faults"),
    [
        ((STARTED, ASKED, measured(1), measured(2), SWEPT), []),
        ((STARTED, ASKED, measured(1), Refused(angle_deg=0.0, reason=""), measured(2), SWEPT), []),
        ((STARTED, ASKED, measured(1), replace(ASKED, index=2), measured(2), SWEPT), []),
        ((STARTED, ASKED, Refused(angle_deg=0.0, reason=""), ASKED, measured(1), SWEPT), []),
        ((STARTED, ASKED, measured(1), measured(3)), [4]),
        ((STARTED, ASKED, measured(1), SWEPT, measured(2)), [5]),
        ((STARTED, ASKED, measured(1), SWEPT, SWEPT), [5]),
        ((STARTED, AT_REST, measured(1), SWEPT), [4]),
        ((STARTED, AT_REST, measured(1), measured(2)), [4]),
        ((STARTED, SWEPT), [2]),
    ],
)
def test_the_order_of_the_entries_of_a_sweep(events: tuple[Event, ...], faults: list[int]) -> None:
    assert [number for number, _ in order_faults(entries(*events))] == faults
