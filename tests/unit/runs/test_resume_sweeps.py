"""Searches by sweeps in a journal: each pulse is kept, and a run killed in mid-sweep sweeps again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from msgspec import structs

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
    Sweep,
    SweepTiming,
    Swept,
)
from markerseek.drivers import BenchSettings, Kdc101Settings, LaserBoxSettings, SonixDaqSettings
from markerseek.guard import FiringLimits
from markerseek.records.journal import Configuration, JournalEntry, read_journal, salvage
from markerseek.rigs import Rig
from markerseek.runs import configuration_of
from markerseek.runs.resume import commanded_deg, pulses_before, tell_recorded
from markerseek.search import build_sweeping
from markerseek.sim import GaussianCurve, SimulatedSettings
from tests.unit.runs import journalled_runs

PLAN = SearchPlan(method="posterior", start_deg=-35.0, sweep_speed_deg_s=8.6)


def begin() -> tuple[AnyPolicy, Rig, Configuration]:
    settings = SimulatedSettings(start_deg=-35.0)
    rig = rigs.of_intensities(
        seed=3,
        curve=GaussianCurve(fwhm_deg=5.0),
        marker_deg=-14.0,
        settings=structs.replace(
            settings,
            laser=structs.replace(settings.laser, rate_hz=20.0),
            receiver=structs.replace(settings.receiver, readout_s=0.05),
        ),
    )
    return build_sweeping(PLAN, limits=rig.limits.search), rig, configuration_of(rig, PLAN)


live = partial(journalled_runs.live, begun=begin)
resume_run = partial(journalled_runs.resume_run, begun=begin)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.journal"
    live(path)
    return path


@pytest.mark.parametrize("until", ["2", "in the sweep", "after the sweep"])
def test_stopped_at_any_moment_it_sweeps_on_to_the_same_marker(whole: Path, tmp_path: Path, until: str) -> None:
    kinds = [type(entry.event) for entry in read_journal(whole).entries]
    number = int(until) if until.isdigit() else kinds.index(Swept) + (until == "after the sweep")
    path = tmp_path / "run.journal"
    live(path, until=number)
    events = resume_run(path)
    held = read_journal(path)
    asked = [each.event for each in held.entries if isinstance(each.event, Asked) and each.event.sweep is not None]
    # Without `Swept` a sweep is broken off, though all its samples were told: it is made again from its beginning.
    in_mid_sweep = until not in {"2", "after the sweep"}
    assert len(asked) >= 1 + in_mid_sweep
    if in_mid_sweep:
        assert asked[0].sweep is not None
        assert asked[1].sweep is not None
        assert asked[0].sweep.from_deg == asked[1].sweep.from_deg
    numbers = [each.sample.sweep.number for each in events if isinstance(each, Measured) and each.sample.sweep]
    assert all(each > 1 for each in numbers) if until != "2" else 1 in numbers or 2 in numbers
    over = events[-1]
    assert isinstance(over, Finished)
    assert isinstance(over.estimate, Found)
    assert abs(over.estimate.mean_deg + 14.0) < 0.5
    assert salvage(path)[1] is None


def test_pulses_of_a_sweep_count_as_fired_and_of_a_broken_one_as_permitted() -> None:
    sweep = Sweep(from_deg=-35.0, to_deg=35.0, speed_deg_s=10.0)
    asked = Asked(role="search", index=1, angle_deg=35.0, sweep=sweep)
    over = Swept(angle_deg=35.0, pulses=77)
    refused = Refused(angle_deg=0.0, reason="a frame")
    charged = partial(pulses_before, pulses=16, attempts=3, pulses_per_sweep=600)
    assert charged(entries(asked, over)) == 77
    assert charged(entries(asked, asked, over)) == 600 + 77
    assert charged(entries(asked, refused, over)) == 77
    assert charged(entries(asked)) == 600


@pytest.mark.parametrize("pulses_per_sweep", [None, 700])
def test_a_broken_sweep_is_charged_by_the_limit_of_its_rig(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pulses_per_sweep: int | None
) -> None:
    path = tmp_path / "run.journal"
    live(path, until=25)
    _, rig, _ = begin()
    if pulses_per_sweep is not None:
        bench = BenchSettings(
            stage=Kdc101Settings(port="a", zero_deg=0.0),
            laser=LaserBoxSettings(port="b"),
            receiver=SonixDaqSettings(folder="c"),
            firing=FiringLimits(pulses_per_sweep=pulses_per_sweep),
        )
        rig = replace(rig, bench=bench)
    charged: list[int] = []
    monkeypatch.setattr(rig.scanner.guard, "charge", charged.append)
    resume_run(path, rig=rig)
    assert charged == [pulses_per_sweep or 10_000]


def test_a_sample_of_a_sweep_is_measured_again_where_it_was_taken() -> None:
    timing = SweepTiming(number=1, speed_deg_s=10.0)
    sample = Sample(angle_deg=3.21, reading=Reading(intensity=1.0), sweep=timing)
    assert commanded_deg(sample) == 3.21


def entries(*events: Event) -> tuple[JournalEntry, ...]:
    return tuple(
        JournalEntry(number=number, event=event, clock_s=0.0, written="")
        for number, event in enumerate(events, start=1)
    )


class AsksForSweeps:
    """A policy that asks for a sweep, whatever it is told."""

    name = "sweeps"

    def ask(self) -> Sweep:
        return Sweep(from_deg=-35.0, to_deg=35.0, speed_deg_s=10.0)

    def tell(self, sample: Sample) -> None:
        assert sample.sweep is not None, "it was told a sample at rest, and had asked for a sweep"


def test_a_sample_at_rest_is_left_out_where_a_policy_asks_for_a_sweep_instead() -> None:
    at_rest = Sample(angle_deg=3.0, reading=Reading(intensity=5.0))
    event = Measured(index=0, role="search", sample=at_rest)
    tell_recorded(AsksForSweeps(), [JournalEntry(number=1, written="", clock_s=0.0, event=event)])
