"""Resumed runs: nothing is measured twice but one angle, the answer is as good, and nothing moves without arming."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.core import (
    AnyPolicy,
    DeviceError,
    Failed,
    Finished,
    LimitError,
    Measured,
    MoveError,
    Reading,
    RecordError,
    Refused,
    Started,
)
from markerseek.guard import FiringLimits, State
from markerseek.records.journal import (
    Checked,
    Configuration,
    Journal,
    RecordedRun,
    Resuming,
    RunView,
    read_journal,
    salvage,
    since_started,
)
from markerseek.rigs import Rig
from markerseek.runs import answer_again, rebuild_policy, rebuild_rig, resumed_run
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import change_of, pulses_before, resumed
from markerseek.show import SearchResult
from markerseek.sim import GaussianCurve
from tests.unit.runs.journalled_runs import ACQUISITIONS, MARKER_DEG, begin, configured, live, resume_run

METHODS = {
    "posterior": None,
    "weighted-average": 24,
    "golden-section": 16,
    "exhaustive": 31,
}


def begin_method(method: str, *, resumed_after: int = 0) -> tuple[AnyPolicy, Rig, Configuration]:
    rig = rigs.of_intensities(seed=5 + resumed_after, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=MARKER_DEG)
    configuration = configured(rig, method=method, acquisitions=METHODS[method])
    return rebuild_policy(configuration), rig, configuration


@pytest.mark.parametrize("method", METHODS)
def test_stopped_after_any_acquisition_a_search_ends_with_an_answer_as_good(method: str, tmp_path: Path) -> None:
    unbroken = tmp_path / "whole.journal"
    live(unbroken, begun=lambda: begin_method(method))
    wanted = SearchResult.of(RunView.of(read_journal(unbroken)))
    count = len(read_journal(unbroken).entries)
    for until in (2, count // 2, count - 2):
        path = tmp_path / f"{until}.journal"
        live(path, until=until, begun=lambda: begin_method(method))
        before = [entry.event for entry in read_journal(path).entries if isinstance(entry.event, Measured)]
        events = resume_run(path, begun=lambda: begin_method(method, resumed_after=100))
        assert isinstance(events[-1], Finished)
        held = read_journal(path)
        measured = [entry.event for entry in held.entries if isinstance(entry.event, Measured)]
        # Each acquisition is there once, those of before the stop first; the one that is compared is `Checked`.
        assert measured[: len(before)] == before
        assert [event.index for event in measured if event.role == "search"] == list(
            range(1, events[-1].acquisitions + 1)
        )
        assert sum(isinstance(entry.event, Checked) for entry in held.entries) == any(e.role != "dark" for e in before)
        result = SearchResult.of(RunView.of(held))
        assert result.answer == wanted.answer
        assert result.sigma_deg is not None
        assert wanted.sigma_deg is not None
        assert abs(result.angle_deg - wanted.angle_deg) < 3 * max(result.sigma_deg, wanted.sigma_deg) + 0.02
        assert len(result.samples) == result.acquisitions
        assert salvage(path)[1] is None


def test_a_run_that_never_started_begins_when_it_is_armed(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    Journal.create(path, begin()[2]).close()
    assert [type(event) for event in resume_run(path)[:2]] == [Resuming, Started]
    assert RunView.of(read_journal(path)).state == "finished"


def test_a_run_that_is_over_is_not_resumed(whole: Path) -> None:
    with pytest.raises(RecordError, match="the run is over"):
        resume_run(whole)


def test_a_confirmation_that_was_kept_is_not_taken_again(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, begun=lambda: begin_method("posterior"))
    at = next(index for index, each in enumerate(events) if isinstance(each, Measured) and each.role == "confirmation")
    again = tmp_path / "again.journal"
    live(again, until=at + 1, begun=lambda: begin_method("posterior"))
    resume_run(again, begun=lambda: begin_method("posterior", resumed_after=1))
    held = read_journal(again)
    roles = [entry.event.role for entry in held.entries if isinstance(entry.event, Measured)]
    assert roles.count("confirmation") == 1
    assert SearchResult.of(RunView.of(held)).confirmation is not None


@pytest.mark.parametrize("moved_deg", [-6.0, 6.0])
def test_where_the_marker_has_moved_that_is_said_and_the_search_begins_anew(moved_deg: float, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    _, other, _ = begin(marker_deg=MARKER_DEG + moved_deg)
    events = resume_run(path, rig=other)
    resuming, checked, started = events[:3]
    assert isinstance(resuming, Resuming)
    assert isinstance(checked, Checked)
    assert "the intensity is" in str(checked.difference)
    assert isinstance(started, Started)
    held = read_journal(path)
    result = SearchResult.of(RunView.of(held))
    assert result.angle_deg == pytest.approx(MARKER_DEG + moved_deg, abs=2.5)
    assert len(result.samples) == result.acquisitions == ACQUISITIONS
    assert answer_again(held, read_frames=True).mean_deg == pytest.approx(result.angle_deg, abs=1e-9)
    assert len(since_started(held.entries)) < len(held.entries)


def test_the_strongest_angle_is_measured_again_before_anything_else(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, until=20)
    lit = [event.sample for event in events if isinstance(event, Measured) and not event.sample.dark]
    strongest = max(lit, key=lambda sample: sample.reading.intensity)
    policy, rig, _ = begin()
    targets: list[float] = []
    move_to = rig.stage.move_to
    rig.stage.move_to = lambda angle_deg: (targets.append(angle_deg), move_to(angle_deg))[1]  # type: ignore[method-assign]
    journal, held = Journal.reopen(path)
    with journal:
        list(resumed(policy, rig, journal, held, by="a person", anew=pytest.fail))
    assert strongest.frame is not None
    assert targets[0] == strongest.frame.header.commanded_deg
    note = next(each.event for each in read_journal(path).entries if isinstance(each.event, Resuming))
    assert (note.by, note.fault_reset, note.check_deg) == ("a person", False, targets[0])


STRONG = Reading(intensity=100.0, noise_sigma=1.0, lateral_m=0.010, depth_m=0.050)


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (STRONG, STRONG, None),
        (STRONG, structs.replace(STRONG, intensity=115.0), None),
        (STRONG, structs.replace(STRONG, intensity=120.0), "intensity"),
        (STRONG, structs.replace(STRONG, intensity=80.0), "intensity"),
        (STRONG, structs.replace(STRONG, lateral_m=0.0116), "lateral_m"),
        (STRONG, structs.replace(STRONG, depth_m=0.0484), "depth_m"),
        (STRONG, structs.replace(STRONG, depth_m=None), None),
        (structs.replace(STRONG, intensity=5.0), structs.replace(STRONG, intensity=6.0, depth_m=0.02), None),
        (structs.replace(STRONG, intensity=5.0), structs.replace(STRONG, intensity=14.0), "intensity"),
        (Reading(intensity=100.0), Reading(intensity=91.0), None),
        (Reading(intensity=100.0), Reading(intensity=89.0), "intensity"),
    ],
)
def test_what_chance_can_explain_and_what_it_cannot(before: Reading, now: Reading, said: str | None) -> None:
    change = change_of(before, now)
    assert (change is None) if said is None else (change is not None and said in change)


def test_an_unchanged_rig_seldom_seems_changed() -> None:
    """500 pairs of readings at peak and flank, as noisy as a search still finds: none seems changed."""
    _, rig, _ = begin(snr_db=20.0)
    rig.arm(by="a person")
    rig.scanner._reader = rig.scanner._reader._reader
    for flank_deg in (0.0, 6.0):
        readings = [rig.scanner.measure(MARKER_DEG + flank_deg).reading for _ in range(1000)]
        assert [change_of(*pair) for pair in zip(readings[::2], readings[1::2], strict=True)] == [None] * 500


def sticking(rig: Rig, *, at_move: int) -> None:
    sound = rig.stage.move_to
    moves = iter(range(1, 1000))
    rig.stage.move_to = lambda angle_deg: sound(angle_deg) + (next(moves) == at_move)  # type: ignore[method-assign]


@pytest.mark.parametrize("when", ["in the run", "in the check", "at the stop"])
def test_a_fault_is_kept_and_left_by_a_reset_only(when: str, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    if when == "in the run":
        sticking(rig, at_move=4)
        with Journal.create(path, configuration) as journal, pytest.raises(MoveError):
            list(journalled(policy, rig, journal))
    else:
        live(path, until=20)
        if when == "in the check":
            sticking(rig, at_move=1)
        else:
            rig.stage.stop = _no_stop  # type: ignore[method-assign]
        with pytest.raises(MoveError):
            resume_run(path, rig=rig)
    held = read_journal(path)
    assert isinstance(held.entries[-1].event, Failed) or RunView.of(held).state == "finished"
    if when == "at the stop":
        return
    with pytest.raises(DeviceError, match=r"ended with a fault: the stage was sent .* `reset_fault`"):
        resume_run(path)
    assert len(read_journal(path).entries) == len(held.entries)
    assert isinstance(resume_run(path, reset_fault=True)[-1], Finished)


def _no_stop() -> None:
    raise MoveError("the stage does not stop")


def test_the_view_of_a_resumed_run_is_that_of_its_journal(tmp_path: Path) -> None:
    """Also where the clock of the rig has begun anew, and where a person has reset a fault."""
    path = tmp_path / "run.journal"
    _, rig, configuration = begin_method("posterior")
    sticking(rig, at_move=4)
    with Journal.create(path, configuration) as journal, pytest.raises(MoveError):
        list(journalled(rebuild_policy(configuration), rig, journal))
    _, again, _ = begin_method("posterior", resumed_after=1)
    journal, held = Journal.reopen(path)
    assert again.scanner.clock.now_s() < held.entries[-1].clock_s
    with journal:
        run = resumed_run(again, journal, held, by="a person", reset_fault=True)
        list(run.events())
    kept = RunView.of(read_journal(path))
    for name in ("number", "phase", "fault", "elapsed_s", "known_s", "travel_deg", "pulses", "acquisitions"):
        assert getattr(run.view, name) == getattr(kept, name), name
    assert kept.known_s is not None
    assert kept.fault is None


def test_the_clock_of_a_journal_goes_on_where_a_resumed_run_cannot_be_stopped(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    policy, rig, _ = begin()
    journal, held = Journal.reopen(path)
    with journal:
        events = resumed(policy, rig, journal, held, by="a person", anew=pytest.fail)
        for event in events:
            if isinstance(event, Measured):
                break
        rig.stage.stop = _no_stop  # type: ignore[method-assign]
        with pytest.raises(MoveError):
            events.close()
    entries = read_journal(path).entries
    assert isinstance(entries[-1].event, Failed)
    assert entries[-1].clock_s >= entries[-2].clock_s


def test_a_run_killed_after_its_confirmation_has_a_weight_for_each_acquisition_of_the_search(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, begun=lambda: begin_method("weighted-average"))
    at = next(index for index, each in enumerate(events) if isinstance(each, Measured) and each.role == "confirmation")
    again = tmp_path / "again.journal"
    live(again, until=at + 1, begun=lambda: begin_method("weighted-average"))
    finished = resume_run(again, begun=lambda: begin_method("weighted-average", resumed_after=1))[-1]
    assert isinstance(finished, Finished)
    assert finished.belief is not None
    assert len(finished.belief.weights) == finished.acquisitions


def test_nothing_moves_or_fires_before_the_rig_is_armed(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=16)
    policy, rig, _ = begin()
    order: list[str] = []

    def noted(name: str, call: Callable[..., object]) -> Callable[..., object]:
        return lambda *args: (order.append(name), call(*args))[1]

    rig.laser.fire = noted("fire", rig.laser.fire)  # type: ignore[method-assign]
    rig.stage.move_to = noted("move", rig.stage.move_to)  # type: ignore[method-assign]
    rig.scanner.guard.arm = lambda *, by: order.append(f"armed by {by}")  # type: ignore[method-assign]
    journal, held = Journal.reopen(path)
    with journal, pytest.raises(Exception, match=r"DISARMED|disarmed|armed"):
        list(resumed(policy, rig, journal, held, by="a person", anew=pytest.fail))
    assert order[0] == "armed by a person"
    assert "fire" not in order
    assert rig.scanner.guard.state is State.DISARMED


def test_a_receiver_that_repeats_a_frame_of_before_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, until=12, begun=lambda: begin_method("golden-section"))
    last = [event.sample.frame for event in events if isinstance(event, Measured)][-1]
    _, rig, _ = begin_method("golden-section", resumed_after=1)
    acquire = rig.scanner._receiver.acquire
    calls = iter(range(99))

    def stuck(permit: object) -> object:
        frame = acquire(permit)  # type: ignore[arg-type]
        return structs.replace(frame, intensity=last.intensity) if next(calls) == 0 else frame  # type: ignore[union-attr]

    rig.scanner._receiver.acquire = stuck  # type: ignore[assignment, method-assign]
    policy, _, _ = begin_method("golden-section")
    journal, held = Journal.reopen(path)
    taken: list[object] = []
    measure = rig.scanner.measure
    rig.scanner.measure = lambda angle_deg, **given: (taken.append(angle_deg), measure(angle_deg, **given))[1]  # type: ignore[method-assign]
    with journal:
        list(resumed(policy, rig, journal, held, by="a person", anew=pytest.fail))
    # The check was taken twice: the guard had refused the first frame.
    assert taken[0] == taken[1] != taken[2]


def test_the_pulses_of_all_sessions_are_counted_together(tmp_path: Path, whole: Path) -> None:
    events = [entry.event for entry in read_journal(whole).entries]
    lit = sum(isinstance(event, Measured) and not event.sample.dark for event in events)
    refused = [event for event in events if isinstance(event, Refused)]
    dark = sum(event.frame is not None and event.frame.header.pulses == 0 for event in refused)
    assert pulses_before(read_journal(whole).entries, pulses=16, attempts=3, pulses_per_sweep=1) == 16 * (
        lit + len(refused) - dark
    )
    path = tmp_path / "run.journal"
    live(path, until=20)
    _, rig, _ = begin()
    spent = pulses_before(read_journal(path).entries, pulses=rig.scanner.pulses, attempts=3, pulses_per_sweep=1)
    rig.scanner.guard._permits._limits = FiringLimits(pulses_per_session=spent + rig.scanner.pulses)
    with pytest.raises(LimitError, match=f"{spent + rig.scanner.pulses} pulses were permitted in this session"):
        resume_run(path, rig=rig)


def test_a_replay_and_a_rig_of_python_are_not_resumed(tmp_path: Path) -> None:
    def recorded(rig: Rig) -> RecordedRun:
        return RecordedRun(path=Path("run.journal"), configuration=configured(rig), entries=())

    scan = tmp_path / "scan.csv"
    rows = [f"{angle},{1 + 90 * 2.0 ** -((angle - 8) ** 2 / 9)}" for angle in range(-35, 36)]
    scan.write_text("angle_deg,intensity\n" + "\n".join(rows) + "\n")
    with pytest.raises(RecordError, match=f"it is of a recorded scan, which takes seconds: replay {scan} again"):
        rebuild_rig(recorded(rigs.replayed(scan)))
    with pytest.raises(RecordError, match="from Python, with the rig"):
        rebuild_rig(recorded(rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)))
