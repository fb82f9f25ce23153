"""Searches in which a hand turns the probe: as good as with the motor, recorded and resumed like any other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek import find_marker, rigs
from markerseek.core import AcquisitionError, Asked, DeviceTimeoutError, SearchPlan, Turning
from markerseek.drivers import GuidedStage, GuidedStageSettings
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.records.journal import Journal, read_journal, salvage
from markerseek.rigs import Rig
from markerseek.runs import answer_again, new_run, plan_on
from markerseek.scan import Scanner
from markerseek.signals import IntensityReader
from markerseek.sim import GaussianCurve, HandMotion, SimulatedHand

Shell = Callable[..., tuple[int, str, str]]
SEEDS = range(1, 9)


def in_world(seed: int) -> Rig:
    """A world of intensities, hundreds of times faster than one of frames."""
    marker_deg = float(np.random.default_rng([seed, 61]).uniform(-28, 28))
    return rigs.of_intensities(seed=seed, curve=GaussianCurve(fwhm_deg=14.0), marker_deg=marker_deg)


def by_hand(seed: int, *, motion: HandMotion | None = None) -> Rig:
    """The same world, with a hand in the place of the motor, and without a recipe: it is of no file."""
    rig = in_world(seed)
    clock = rig.scanner.clock
    settings = GuidedStageSettings()
    hand = settings.by_hand
    turner = SimulatedHand(
        world=rig.laser._world,  # type: ignore[attr-defined]
        clock=clock,
        limits=rig.limits.search,
        rng=np.random.default_rng(seed),
        motion=motion,
    )
    stage = GuidedStage(encoder=turner, clock=clock, settings=settings, limits=rig.limits, asks=turner.turn_to)
    # As `markerseek.rigs.bench_rig.guard_of`.
    guard = Guard(
        limits=rig.limits,
        firing=FiringLimits(),
        admission=Admission(settled_deg=hand.drift_deg),
        arrival_deg=hand.reach_deg + hand.drift_deg,
    )
    scanner = Scanner(
        stage=stage,
        laser=rig.laser,
        receiver=rig.receiver,
        reader=IntensityReader(),
        clock=clock,
        guard=guard,
        pulses=rig.scanner.pulses,
        arms_itself=True,
    )
    return replace(rig, stage=stage, scanner=scanner, by_hand=hand, recipe=None)


def test_a_hand_finds_what_the_motor_finds() -> None:
    with_motor, with_hand = ([find_marker(make(seed)) for seed in SEEDS] for make in (in_world, by_hand))
    assert [result.found for result in with_hand] == [result.found for result in with_motor]
    more = [hand.acquisitions - motor.acquisitions for hand, motor in zip(with_hand, with_motor, strict=True)]
    assert np.mean(more) <= 2
    motor_deg, hand_deg = ([result.error_deg for result in results] for results in (with_motor, with_hand))
    # Both are far below the tolerance of a degree.
    assert np.median(hand_deg) <= np.median(motor_deg) + 0.1
    assert max(hand_deg) < 1.0
    # The hand is never exactly there, and the angle that was reached counts.
    reached = [sample.angle_deg for result in with_hand for sample in result.samples]
    assert not any(angle_deg == round(angle_deg) for angle_deg in reached)


def journalled(rig: Rig, path: Path) -> Journal:
    """A search with a journal, to its end."""
    run = new_run(rig, plan_on(rig, SearchPlan(method="posterior")))
    journal = Journal.create(path, run.configuration)
    with closing(replace(run, journal=journal).events()) as events:
        for _ in events:
            pass
    journal.close()
    return journal


def test_its_journal_tells_where_the_probe_was_on_its_way(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "by-hand.journal"
    journalled(by_hand(4), path)
    held = read_journal(path)
    assert salvage(path)[1] is None
    events = [entry.event for entry in held.entries]
    target_deg = next(event.angle_deg for event in events if isinstance(event, Asked) and event.role == "search")
    turning = [event for event in events if isinstance(event, Turning) and event.target_deg == target_deg]
    assert len(turning) > 5
    assert answer_again(held, read_frames=False) == events[-1].estimate
    # One row a turn, and not five a second.
    _, shown, _ = shell("journal", "show", path)
    asked = sum(isinstance(event, Asked) and event.role != "dark" for event in events)
    assert shown.count("turn the probe to") == asked
    _, listed, _ = shell("journal", "show", path, "--json")
    assert listed.count('"kind":"turning"') == sum(isinstance(event, Turning) for event in events)


def test_a_hand_that_does_not_hold_still_is_refused() -> None:
    # A third of a degree in the ten seconds until the frame is read.
    rig = by_hand(6, motion=HandMotion(drift_deg_s=0.05))
    with pytest.raises((AcquisitionError, DeviceTimeoutError), match="moved by"):
        find_marker(rig)
