"""Runs that go on after an end: equal to the whole run, never without arming, never on a rig that has changed."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    Asked,
    DeviceError,
    Event,
    Failed,
    Finished,
    Frame,
    Measured,
    MoveError,
    Policy,
    Reader,
    Reading,
    RecordError,
)
from markerseek.guard import State
from markerseek.records.journal import (
    Checked,
    Configuration,
    Journal,
    Recording,
    Resuming,
    read_journal,
    result_of,
    standing,
    verify,
)
from markerseek.rigs import Rig
from markerseek.rigs.again import differences, next_angle, policy_again, reader_again, rig_again
from markerseek.rigs.journalled import configuration_of, journalled
from markerseek.rigs.resemblance import change_of
from markerseek.rigs.resuming import resumed
from markerseek.search import build
from markerseek.sim import GaussianCurve, NoiseSettings, SimulatedSettings

METHOD, ACQUISITIONS, SEED, MARKER_DEG = "golden-section", 8, 5, -9.4


class Refusing:
    """A reader that refuses each fourth frame."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        if frame.header.sequence % 4 == 0:
            raise AcquisitionError("a frame that this test refuses")
        return self._reader.read(frame)


def begin(*, marker_deg: float = MARKER_DEG, snr_db: float = 40.0) -> tuple[Policy, Rig, Configuration]:
    rig = rigs.of_intensities(
        seed=SEED,
        curve=GaussianCurve(fwhm_deg=12.0),
        marker_deg=marker_deg,
        settings=SimulatedSettings(noise=NoiseSettings(peak_snr_db=snr_db)),
    )
    rig.scanner._reader = Refusing(rig.scanner._reader)
    start_deg = rig.stage.angle_deg
    policy = build(METHOD, limits=rig.limits.search, acquisitions=ACQUISITIONS, start_deg=start_deg)
    return policy, rig, configured(rig)


def configured(rig: Rig, **changes: object) -> Configuration:
    plain = configuration_of(
        rig,
        method=METHOD,
        acquisitions=ACQUISITIONS,
        as_published=False,
        start_deg=rig.stage.angle_deg,
        dark_frames=rig.dark_frames,
        stay=False,
        seed=SEED,
    )
    return msgspec.structs.replace(plain, **changes)


def live(path: Path, *, until: int | None = None) -> list[Event]:
    """The events of a run, or as many as there are until it is stopped."""
    policy, rig, configuration = begin()
    heard: list[Event] = []
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for event in events:
            heard.append(event)
            if len(heard) == until:
                break
    return heard


def go_on(path: Path, *, rig: Rig | None = None, reset_fault: bool = False) -> list[Event]:
    policy, same, _ = begin()
    journal, held = Journal.reopen(path)
    with journal:
        return list(resumed(policy, rig or same, journal, held, by="a person", reset_fault=reset_fault))


def times_and_events(held: Recording) -> list[tuple[object, float]]:
    return [(entry.event, entry.clock_s) for entry in held.entries if not isinstance(entry.event, Resuming | Checked)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.journal"
    live(path)
    return path


def test_a_journal_holds_what_run_reports(whole: Path) -> None:
    held = read_journal(whole)
    kinds = [type(entry.event).__name__ for entry in held.entries]
    assert kinds[0] == "Started"
    assert kinds[-1] == "Finished"
    assert kinds.count("Measured") == kinds.count("Asked") == 3 + ACQUISITIONS
    assert kinds.count("Refused") >= 3
    assert verify(whole).faults == []
    by_kind = {type(entry.event): entry for entry in held.entries}
    assert by_kind[Measured].checkpoint is not None
    assert by_kind[Asked].checkpoint is None


def test_stopped_after_any_event_a_run_goes_on_to_the_same_end(whole: Path, tmp_path: Path) -> None:
    wanted = read_journal(whole)
    for until in range(1, len(wanted.entries)):
        path = tmp_path / f"{until}.journal"
        live(path, until=until)
        assert times_and_events(read_journal(path)) == times_and_events(wanted)[:until]
        heard = go_on(path)
        held = read_journal(path)
        assert times_and_events(held) == times_and_events(wanted)
        assert heard == [event for event, _ in times_and_events(wanted)]
        assert msgspec.json.encode(result_of(held)[1]) == msgspec.json.encode(result_of(wanted)[1])
        assert verify(path).faults == []


def test_a_run_may_be_stopped_many_times(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=3)
    total = len(read_journal(whole).entries)
    for until in range(5, total, 3):
        policy, rig, _ = begin()
        journal, held = Journal.reopen(path)
        with journal, closing(resumed(policy, rig, journal, held, by="a person")) as events:
            for _ in range(until):
                next(events)
        assert len(times_and_events(read_journal(path))) == until
    go_on(path)
    assert times_and_events(read_journal(path)) == times_and_events(read_journal(whole))


def test_the_next_angle_is_the_one_that_was_asked_for(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    heard = live(path, until=14)
    asked = [event.angle_deg for event in heard if isinstance(event, Asked)]
    following = [entry.event.angle_deg for entry in read_journal(whole).entries if isinstance(entry.event, Asked)]
    measured = sum(isinstance(event, Measured) for event in heard)
    assert len(asked) in (measured, measured + 1)
    assert next_angle(read_journal(path), begin()[0]) == following[measured]


def test_the_strongest_angle_is_measured_again_before_anything_else(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    heard = live(path, until=20)
    strongest = max(
        (event.sample for event in heard if isinstance(event, Measured) and not event.sample.dark),
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
    note, checked = [e.event for e in read_journal(path).entries if isinstance(e.event, Resuming | Checked)]
    assert isinstance(note, Resuming)
    assert (note.by, note.fault_reset) == ("a person", False)
    assert note.check_deg == pytest.approx(strongest.angle_deg, abs=0.01)
    assert isinstance(checked, Checked)
    assert checked.difference is None


@pytest.mark.parametrize("moved_deg", [-6.0, 6.0])
def test_a_marker_that_moved_is_noticed_and_the_run_stays_as_it_was(moved_deg: float, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    before = times_and_events(read_journal(path))
    _, other, _ = begin(marker_deg=MARKER_DEG + moved_deg)
    with pytest.raises(AcquisitionError, match=r"the intensity is .* and was .*begin a new search"):
        go_on(path, rig=other)
    assert other.scanner.guard.state is State.DISARMED
    held = read_journal(path)
    assert times_and_events(held) == before
    checked = held.entries[-1].event
    assert isinstance(checked, Checked)
    assert checked.difference is not None
    assert standing(held.entries).state == "open"
    go_on(path)
    assert standing(read_journal(path).entries).state == "finished"


def test_a_fault_is_left_by_a_reset_only(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    sound = rig.stage.move_to
    moves = 0

    def sticks(angle_deg: float) -> float:
        nonlocal moves
        moves += 1
        return sound(angle_deg) + (1.0 if moves == 4 else 0.0)

    rig.stage.move_to = sticks  # type: ignore[method-assign]
    with Journal.create(path, configuration) as journal, pytest.raises(MoveError):
        list(journalled(policy, rig, journal))
    held = read_journal(path)
    assert isinstance(held.entries[-1].event, Failed)
    with pytest.raises(DeviceError, match=r"ended with a fault: the stage was sent .* --reset-fault"):
        go_on(path)
    assert len(read_journal(path).entries) == len(held.entries)
    heard = go_on(path, reset_fault=True)
    assert isinstance(heard[-1], Finished)
    assert verify(path).faults == []
    assert differences(read_journal(path), begin()[0], reader_again(configuration)) == []


def test_a_fault_during_the_check_is_kept_as_well(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    _, rig, _ = begin()
    sound = rig.stage.move_to
    rig.stage.move_to = lambda angle_deg: sound(angle_deg) + 1.0  # type: ignore[method-assign]
    with pytest.raises(MoveError):
        go_on(path, rig=rig)
    assert standing(read_journal(path).entries).state == "fault"
    with pytest.raises(DeviceError, match="--reset-fault"):
        go_on(path)


def test_a_run_that_is_over_is_not_gone_on_with(whole: Path) -> None:
    journal, held = Journal.reopen(whole)
    policy, rig, _ = begin()
    with journal, pytest.raises(RecordError, match="the run is over"):
        next(resumed(policy, rig, journal, held, by="a person"))


def test_a_policy_that_decides_otherwise_is_refused_before_it_fires(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=16)
    _, rig, _ = begin()
    journal, held = Journal.reopen(path)
    other = build("ternary", limits=rig.limits.search, acquisitions=ACQUISITIONS)
    with journal, pytest.raises(RecordError, match=r"decides otherwise .* resume with what it was begun with"):
        list(resumed(other, rig, journal, held, by="a person"))
    assert times_and_events(read_journal(path)) == times_and_events(held)
    assert rig.scanner.guard.state is State.DISARMED


def test_a_simulated_world_without_its_state_cannot_go_on(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    worldless = replace(rig, world=None)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, worldless, journal)) as events:
        for _ in range(8):
            next(events)
    with pytest.raises(RecordError, match="no state of the simulated world"):
        go_on(path)


def test_a_world_that_outlives_the_program_is_gone_on_with_as_it_is(tmp_path: Path) -> None:
    """As with real devices: no state is kept, and the clock of another process began at another time."""
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    rig = replace(rig, world=None)
    rig.scanner.clock.wait(1000.0)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in range(16):
            next(events)
    rig.scanner.clock.put_back(5.0)  # type: ignore[attr-defined]
    heard = go_on(path, rig=rig)
    held = read_journal(path)
    times = [at_s for _, at_s in times_and_events(held)]
    assert times == sorted(times)
    assert times[0] == 1000.0
    over = heard[-1]
    assert isinstance(over, Finished)
    assert over.acquisitions == ACQUISITIONS
    assert over.elapsed_s == times[-1] - 1000.0 > 0
    assert verify(path).faults == []
    assert differences(held, begin()[0], reader_again(held.configuration)) == []


def test_a_run_that_never_started_begins_when_it_is_armed(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    Journal.create(path, begin()[2]).close()
    go_on(path)
    assert times_and_events(read_journal(path)) == times_and_events(read_journal(whole))


def test_the_result_is_worked_out_again_from_the_frames(whole: Path) -> None:
    held = read_journal(whole)
    assert differences(held, begin()[0], reader_again(held.configuration)) == []
    assert differences(held, build("ternary", acquisitions=ACQUISITIONS), reader_again(held.configuration)) != []


class Louder:
    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        reading = self._reader.read(frame)
        return replace(reading, intensity=reading.intensity * (1 + 1e-15))


def test_a_last_bit_that_differs_is_said(tmp_path: Path) -> None:
    rig = rigs.simulated(seed=2, marker_deg=4.0)
    path = tmp_path / "run.journal"
    configuration = configured(rig, dark_frames=1)
    policy = policy_again(configuration)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in range(8):
            next(events)
    held = read_journal(path)
    reader = reader_again(configuration)
    assert differences(held, policy_again(configuration), reader) == []
    found = differences(held, policy_again(configuration), Louder(reader))
    assert found
    assert "its frame is read as" in found[0]


def test_a_rig_is_put_together_again_from_its_settings(tmp_path: Path) -> None:
    settings = SimulatedSettings(tissue="liver", start_deg=3.0)
    rig = rigs.simulated(seed=9, settings=settings)
    again = rig_again(configured(rig))
    assert (again.configuration, again.truth_deg, again.description) == (
        rig.configuration,
        rig.truth_deg,
        rig.description,
    )
    assert again.stage.angle_deg == rig.stage.angle_deg
    with pytest.raises(RecordError, match="not the same any more"):
        rig_again(configured(rig, fingerprint="0" * 32))
    with pytest.raises(RecordError, match="from Python, with the rig"):
        rig_again(configured(rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)))


def test_a_recording_is_gone_on_with_and_must_not_have_changed(tmp_path: Path) -> None:
    scan = tmp_path / "scan.csv"
    rows = [f"{angle},{1 + 90 * 2.0 ** -((angle - 8) ** 2 / 9)}" for angle in range(-35, 36)]
    scan.write_text("angle_deg,intensity\n" + "\n".join(rows) + "\n")

    def begin_replay() -> tuple[Policy, Rig, Configuration]:
        rig = rigs.replayed(scan)
        configuration = configured(rig, start_deg=rig.stage.angle_deg)
        return policy_again(configuration), rig, configuration

    def run_until(path: Path, until: int) -> None:
        policy, rig, configuration = begin_replay()
        with Journal.create(path, configuration) as journal:
            events: Generator[Event, None, None] = journalled(policy, rig, journal)
            with closing(events):
                for count, _ in enumerate(events, start=1):
                    if count == until:
                        break

    whole, part = tmp_path / "whole.journal", tmp_path / "part.journal"
    run_until(whole, 1000)
    run_until(part, 7)
    journal, held = Journal.reopen(part)
    with journal:
        rig = rig_again(held.configuration)
        list(resumed(policy_again(held.configuration), rig, journal, held, by="a person"))
    assert times_and_events(read_journal(part)) == times_and_events(read_journal(whole))
    scan.write_text(scan.read_text().replace("0,", "0,1", 1))
    with pytest.raises(RecordError, match="was the recording changed"):
        rig_again(held.configuration)


LOUD = Reading(intensity=100.0, noise_sigma=1.0, lateral_m=0.010, depth_m=0.050)


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (LOUD, LOUD, None),
        (LOUD, replace(LOUD, intensity=115.0), None),
        (LOUD, replace(LOUD, intensity=85.0), None),
        (LOUD, replace(LOUD, intensity=120.0), "intensity"),
        (LOUD, replace(LOUD, intensity=80.0), "intensity"),
        (LOUD, replace(LOUD, lateral_m=0.0115), "lateral_m"),
        (LOUD, replace(LOUD, depth_m=0.0485), "depth_m"),
        (LOUD, replace(LOUD, depth_m=None), None),
        (replace(LOUD, intensity=5.0), replace(LOUD, intensity=6.0, depth_m=0.02), None),
        (replace(LOUD, intensity=5.0), replace(LOUD, intensity=14.0), "intensity"),
        (Reading(intensity=100.0), Reading(intensity=91.0), None),
        (Reading(intensity=100.0), Reading(intensity=89.0), "intensity"),
    ],
)
def test_what_chance_can_explain_and_what_it_cannot(before: Reading, now: Reading, said: str | None) -> None:
    for first, second in ((before, now), (now, before)):
        change = change_of(first, second)
        assert (change is None) if said is None else (change is not None and said in change)


def test_an_unchanged_rig_is_rarely_refused() -> None:
    """500 pairs of readings at the peak of one rig, as noisy as a search still finds: none seems changed."""
    _, rig, _ = begin(snr_db=20.0)
    rig.arm(by="a person")
    rig.scanner._reader = rig.scanner._reader._reader
    readings = [rig.scanner.measure(MARKER_DEG).reading for _ in range(1000)]
    assert [change_of(*pair) for pair in zip(readings[::2], readings[1::2], strict=True)] == [None] * 500
