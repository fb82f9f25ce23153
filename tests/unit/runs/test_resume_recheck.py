"""Before a run is resumed, its strongest angle is measured again: significant changes are refused."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import AcquisitionError, Measured, Policy, Reading
from markerseek.guard import State
from markerseek.records.journal import Checked, Configuration, Journal, Resuming, read_journal, run_state
from markerseek.rigs import Rig
from markerseek.runs import rebuild_policy
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import change_of, resumed
from tests.unit.runs.journalled_runs import MARKER_DEG, begin, configured, live, resume_run, times_and_events


def test_the_strongest_angle_is_measured_again_before_anything_else(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, until=20)
    strongest = max(
        (event.sample for event in events if isinstance(event, Measured) and not event.sample.dark),
        key=lambda sample: sample.reading.intensity,
    )
    policy, rig, _ = begin()
    targets: list[float] = []
    move_to = rig.stage.move_to
    rig.stage.move_to = lambda angle_deg: (targets.append(angle_deg), move_to(angle_deg))[1]  # type: ignore[method-assign]
    journal, held = Journal.reopen(path)
    with journal:
        list(resumed(policy, rig, journal, held, by="a person"))
    assert strongest.frame is not None
    assert targets[0] == strongest.frame.header.commanded_deg
    note, checked, flank = [e.event for e in read_journal(path).entries if isinstance(e.event, Resuming | Checked)]
    assert isinstance(note, Resuming)
    assert (note.by, note.fault_reset) == ("a person", False)
    assert note.check_deg == pytest.approx(strongest.angle_deg, abs=0.01)
    assert note.flank_deg == targets[1]
    for check in (checked, flank):
        assert isinstance(check, Checked)
        assert check.difference is None
    assert checked.reading.intensity > flank.reading.intensity > 0.2 * checked.reading.intensity


@pytest.mark.parametrize("moved_deg", [-6.0, 6.0])
def test_a_marker_that_moved_is_noticed_and_the_run_is_unchanged(moved_deg: float, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    before = times_and_events(read_journal(path))
    _, other, _ = begin(marker_deg=MARKER_DEG + moved_deg)
    with pytest.raises(AcquisitionError, match=r"the intensity is .* and was .*begin a new search"):
        resume_run(path, rig=other)
    assert other.scanner.guard.state is State.DISARMED
    held = read_journal(path)
    assert times_and_events(held) == before
    checked = held.entries[-1].event
    assert isinstance(checked, Checked)
    assert checked.difference is not None
    assert run_state(held.entries).state == "open"
    resume_run(path)
    assert run_state(read_journal(path).entries).state == "finished"


@pytest.mark.parametrize("moved_deg", [-2.0, -0.7, 0.7, 2.0])
def test_a_small_rotation_is_noticed_on_a_flank(moved_deg: float, tmp_path: Path) -> None:
    """The intensity near the top does not resolve a degree, and two of them do not change the strongest."""
    path = tmp_path / "run.journal"

    def rig_and_policy(marker_deg: float) -> tuple[Policy, Rig, Configuration]:
        # As real devices do, this world outlives the program: no state of it is kept.
        rig = replace(rigs.simulated(seed=5, marker_deg=marker_deg), world=None)
        begun_with = configured(rig, method="posterior", acquisitions=None)
        return rebuild_policy(begun_with), rig, begun_with

    policy, rig, begun_with = rig_and_policy(6.3)
    with Journal.create(path, begun_with) as journal, closing(journalled(policy, rig, journal)) as events:
        for event in events:
            if isinstance(event, Measured) and (event.role, event.index) == ("search", 8):
                break
    policy, rig, _ = rig_and_policy(6.3 + moved_deg)
    journal, held = Journal.reopen(path)
    with journal, pytest.raises(AcquisitionError, match=r"the intensity is .* and was .*begin a new search"):
        list(resumed(policy, rig, journal, held, by="a person"))


STRONG = Reading(intensity=100.0, noise_sigma=1.0, lateral_m=0.010, depth_m=0.050)


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (STRONG, STRONG, None),
        (STRONG, replace(STRONG, intensity=115.0), None),
        (STRONG, replace(STRONG, intensity=85.0), None),
        (STRONG, replace(STRONG, intensity=120.0), "intensity"),
        (STRONG, replace(STRONG, intensity=80.0), "intensity"),
        (STRONG, replace(STRONG, lateral_m=0.0116), "lateral_m"),
        (STRONG, replace(STRONG, depth_m=0.0484), "depth_m"),
        (STRONG, replace(STRONG, depth_m=None), None),
        (replace(STRONG, intensity=5.0), replace(STRONG, intensity=6.0, depth_m=0.02), None),
        (replace(STRONG, intensity=5.0), replace(STRONG, intensity=14.0), "intensity"),
        (Reading(intensity=100.0), Reading(intensity=91.0), None),
        (Reading(intensity=100.0), Reading(intensity=89.0), "intensity"),
    ],
)
def test_what_chance_can_explain_and_what_it_cannot(before: Reading, now: Reading, said: str | None) -> None:
    for first, second in ((before, now), (now, before)):
        change = change_of(first, second)
        assert (change is None) if said is None else (change is not None and said in change)


def test_an_unchanged_rig_is_rarely_refused() -> None:
    """500 pairs of readings at peak and flank, as noisy as a search still finds: none seems changed."""
    _, rig, _ = begin(snr_db=20.0)
    rig.arm(by="a person")
    rig.scanner._reader = rig.scanner._reader._reader
    for flank_deg in (0.0, 6.0):
        readings = [rig.scanner.measure(MARKER_DEG + flank_deg).reading for _ in range(1000)]
        assert [change_of(*pair) for pair in zip(readings[::2], readings[1::2], strict=True)] == [None] * 500
