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
from markerseek.records.journal import Journal, read_journal, salvage
from markerseek.rigs import Rig
from markerseek.runs import answer_again, new_session, plan_on
from markerseek.signals import IntensityReader
from markerseek.sim import GaussianCurve, HandMotion
from tests.by_hand import compared, turned_by_hand

Shell = Callable[..., tuple[int, str, str]]
SEEDS = range(1, 9)
"""Few, for the time that it takes; decision 61 has 40 worlds of frames."""


def in_world(seed: int) -> Rig:
    """A world of intensities, hundreds of times faster than one of frames."""
    marker_deg = float(np.random.default_rng([seed, 61]).uniform(-28, 28))
    return rigs.of_intensities(seed=seed, curve=GaussianCurve(fwhm_deg=14.0), marker_deg=marker_deg)


def by_hand(seed: int, *, motion: HandMotion | None = None) -> Rig:
    return turned_by_hand(in_world(seed), reader=IntensityReader(), seed=seed, motion=motion)


def test_a_hand_finds_what_the_motor_finds() -> None:
    pairs = [compared(in_world, seed, reader=lambda _rig: IntensityReader()) for seed in SEEDS]
    assert [pair.by_hand.found for pair in pairs] == [pair.motor.found for pair in pairs]
    more = [pair.by_hand.acquisitions - pair.motor.acquisitions for pair in pairs]
    assert np.mean(more) <= 2
    motor_deg, hand_deg = ([getattr(pair, who).error_deg for pair in pairs] for who in ("motor", "by_hand"))
    # Both are far below the tolerance of a degree.
    assert np.median(hand_deg) <= np.median(motor_deg) + 0.1
    assert max(hand_deg) < 1.0
    # The hand is never exactly there, and the angle that was reached counts.
    reached = [sample.angle_deg for pair in pairs for sample in pair.by_hand.samples]
    assert not any(angle_deg == round(angle_deg) for angle_deg in reached)


def journalled(rig: Rig, path: Path) -> Journal:
    """A search with a journal, to its end."""
    session = new_session(rig, plan_on(rig, SearchPlan(method="posterior")))
    journal = Journal.create(path, session.configuration)
    with closing(replace(session, journal=journal).events()) as events:
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
