"""The journal as a file: what is written is read back equal, and what is wrong with it is said."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import (
    Ambiguous,
    Asked,
    AtBound,
    ChannelFrame,
    Failed,
    Finished,
    Floor,
    Found,
    FrameHeader,
    Interval,
    Measured,
    MoveError,
    NotFound,
    Reading,
    ReadingFrame,
    RecordError,
    Refused,
    Sample,
    Started,
    Unsure,
)
from markerseek.records.banks import read_bank
from markerseek.records.journal import (
    Checked,
    Configuration,
    Interrupted,
    Journal,
    Resuming,
    default_journal,
    read_journal,
    result_of,
    salvage,
    standing,
    verify,
)
from markerseek.records.journal.entries import Happening, RecordedError
from markerseek.records.journal.log import commits
from markerseek.records.journal.rows import from_row, to_row
from markerseek.records.journal.store import is_journal

VERSION_1 = Path(__file__).parents[1] / "data" / "journal-version-1.journal"

RANGE = Interval(low_deg=-35.0, high_deg=35.0)
FLOOR = Floor(level=3.25, source="dark frames")
HEADER = FrameHeader(
    sequence=4,
    token="permit-4",
    pulses=16,
    commanded_deg=1.1,
    started_s=0.1 + 0.2,
    ended_s=10.3,
    angle_before_deg=1.1000000000000003,
    angle_after_deg=1.1,
)
FULL_READING = Reading(
    intensity=1971.0123456789,
    lateral_m=0.018,
    depth_m=0.05,
    arrival_s=3.2e-5,
    noise_sigma=20.1,
    cells=460_000,
    coherence=0.9,
    saturated_fraction=0.0,
    dead_channels=(3, 64),
)


def configuration(**changes: object) -> Configuration:
    plain = Configuration(
        method="golden-section",
        acquisitions=10,
        as_published=False,
        search=RANGE,
        start_deg=0.0,
        dark_frames=3,
        stay=False,
        rig="simulated",
        recipe=msgspec.Raw(b"null"),
        fingerprint="0" * 32,
        description="a test's rig",
        face_radius_m=0.01,
        truth_deg=6.3,
        reference_deg=None,
        seed=7,
    )
    return msgspec.structs.replace(plain, **changes)


def measured(index: int, *, angle_deg: float = 1.1, counts: np.ndarray | None = None) -> Measured:
    frame: ChannelFrame | ReadingFrame
    if counts is None:
        frame = ReadingFrame(header=HEADER, intensity=1971.0123456789, noise_sigma=20.1, cells=460_000)
    else:
        frame = ChannelFrame(header=HEADER, samples=counts, sampling_hz=40e6)
    sample = Sample(angle_deg=angle_deg, reading=FULL_READING, frame=frame)
    return Measured(role="search", index=index, sample=sample)


def counts(channels: int = 8, samples: int = 64, *, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(-2048, 2048, (channels, samples)).astype(np.int16)


def whole_run(path: Path, *, acquisitions: int = 3, counts_of: Callable[[int], np.ndarray] | None = None) -> None:
    """A run with so many acquisitions, made up."""
    with Journal.create(path, configuration()) as journal:
        write(journal, acquisitions, counts_of)


def write(journal: Journal, acquisitions: int, counts_of: Callable[[int], np.ndarray] | None = None) -> None:
    journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0, checkpoint=b'{"state":0}')
    for index in range(1, acquisitions + 1):
        journal.commit(Asked(role="search", index=index, angle_deg=1.1), clock_s=float(index))
        event = measured(index, counts=None if counts_of is None else counts_of(index))
        journal.commit(event, clock_s=index + 0.5, checkpoint=b'{"state":%d}' % index)
    answer = NotFound(mean_deg=1.0, reason="made up", floor=FLOOR)
    over = Finished(estimate=answer, confirmation=None, acquisitions=acquisitions, travel_deg=1.1, elapsed_s=9.0)
    journal.commit(over, clock_s=9.0)


EVENTS: dict[str, Happening] = {
    "started": Started(start_deg=-0.1, limits=RANGE),
    "asked": Asked(role="dark", index=2, angle_deg=1 / 3),
    "measured intensity": measured(1),
    "measured without a frame": Measured(role="search", index=1, sample=Sample(angle_deg=0.0, reading=FULL_READING)),
    "measured channels": measured(2, counts=counts()),
    "refused": Refused(angle_deg=2.0, reason='a "quoted" reason, 5 % \N{DEGREE SIGN}'),
    "failed": Failed(error=MoveError("the stage did not arrive")),
    "interrupted": Interrupted(reason="SIGTERM"),
    "resuming": Resuming(by="a person", check_deg=1.1, fault_reset=True, versions={"markerseek": "0.1.0"}),
    "checked": Checked(reading=FULL_READING, difference=None),
    **{
        type(estimate).__name__: Finished(
            estimate=estimate, confirmation=None, acquisitions=3, travel_deg=70.5, elapsed_s=1 / 7
        )
        for estimate in (
            Found(mean_deg=1.0, sigma_deg=0.1, interval95_deg=RANGE, interval_kind="posterior", floor=FLOOR),
            NotFound(mean_deg=1.0, reason="nothing", floor=Floor(level=None, source="unknown")),
            Ambiguous(mean_deg=1.0, modes_deg=(1.0, -7.25)),
            AtBound(mean_deg=-35.0, side="low"),
            Unsure(mean_deg=1.0, sigma_deg=3.0, interval95_deg=RANGE, interval_kind="bracket", reason="wide"),
        )
    },
}


@pytest.mark.parametrize("event", EVENTS.values(), ids=EVENTS.keys())
def test_every_kind_of_event_is_read_back_equal(event: Happening, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(event, clock_s=0.1 + 0.2, checkpoint=b'{"now_s":0.30000000000000004}')
    (entry,) = read_journal(path).entries
    if isinstance(event, Failed):
        assert isinstance(entry.event, Failed)
        assert isinstance(entry.event.error, RecordedError)
        assert (entry.event.error.kind, str(entry.event.error)) == ("MoveError", "the stage did not arrive")
    else:
        assert entry.event == event
    assert (entry.number, entry.clock_s) == (1, 0.1 + 0.2)
    assert entry.checkpoint == b'{"now_s":0.30000000000000004}'
    if isinstance(event, Measured) and event.sample.frame is not None:
        assert isinstance(entry.event, Measured)
        frame = entry.event.sample.frame
        assert frame is not None
        assert frame.header == HEADER
        if isinstance(event.sample.frame, ChannelFrame):
            assert isinstance(frame, ChannelFrame)
            np.testing.assert_array_equal(frame.samples, event.sample.frame.samples)
            assert frame.samples.dtype == np.int16
            assert frame.sampling_hz == 40e6
        else:
            assert frame == event.sample.frame


def test_samples_lie_in_the_file_as_little_endian_integers_that_any_program_can_read(tmp_path: Path) -> None:
    path, samples = tmp_path / "run.journal", counts(3, 5)
    whole_run(path, acquisitions=1, counts_of=lambda _: samples)
    with closing(sqlite3.connect(path)) as database:
        ((blob, body),) = database.execute("SELECT samples, body FROM events WHERE samples IS NOT NULL").fetchall()
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert msgspec.json.decode(body)["frame"]["shape"] == [3, 5]
    values = [int.from_bytes(blob[2 * k : 2 * k + 2], "little", signed=True) for k in range(15)]
    assert values == samples.ravel().tolist()


def test_the_result_comes_from_the_journal_alone(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path)
    recorder, result = result_of(read_journal(path))
    assert (result.answer, result.acquisitions, result.seed, result.truth_deg) == ("not found", 3, 7, 6.3)
    assert [row.intensity for row in result.samples] == [FULL_READING.intensity] * 3
    assert recorder.start_deg == 0.0


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_number_that_is_not_finite_is_refused_and_nothing_is_written(number: float, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        with pytest.raises(RecordError, match="not finite"):
            journal.commit(Asked(role="search", index=1, angle_deg=number), clock_s=0.0)
        unsure = Unsure(mean_deg=number, sigma_deg=1.0, interval95_deg=RANGE, interval_kind="bracket", reason="made up")
        over = Finished(estimate=unsure, confirmation=None, acquisitions=1, travel_deg=0.0, elapsed_s=0.0)
        with pytest.raises(RecordError, match="not finite"):
            journal.commit(over, clock_s=0.0)
    assert read_journal(path).entries == ()


def test_where_a_run_stands(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        journal.commit(Asked(role="search", index=1, angle_deg=1.1), clock_s=0.0)
        journal.commit(measured(1), clock_s=1.0)
        journal.commit(Asked(role="search", index=2, angle_deg=4.5), clock_s=1.0)
        journal.interrupt("SIGTERM")
        journal.interrupt("SIGTERM")
    entries = read_journal(path).entries
    stands = standing(entries)
    assert (stands.state, stands.acquisitions, stands.asked_deg, stands.fault) == ("open", 1, 4.5, None)
    assert stands.strongest is not None
    assert [type(entry.event).__name__ for entry in entries][-2:] == ["Asked", "Interrupted"]
    journal, held = Journal.reopen(path)
    with journal:
        note = Resuming(by="a person", check_deg=1.1, fault_reset=False, versions={})
        journal.commit(note, clock_s=2.0)
        journal.commit(Failed(error=MoveError("stuck")), clock_s=2.0)
    assert len(held.entries) == 5
    stands = standing(read_journal(path).entries)
    assert (stands.state, stands.fault) == ("fault", "stuck")
    assert verify(path).faults == []


def test_a_file_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    with pytest.raises(RecordError, match="exists already and is no journal; name a new file"):
        Journal.create(path, configuration())
    assert path.read_text() == "mine"


def test_a_journal_that_exists_is_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path)
    before = path.read_bytes()
    with pytest.raises(RecordError, match="the journal exists already; name another file, or go on with it"):
        Journal.create(path, configuration())
    assert path.read_bytes() == before


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="No such file"):
        Journal.create(tmp_path / "nowhere" / "run.journal", configuration())


def test_two_programs_do_not_drive_one_run(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        for look in (Journal.reopen, read_journal, verify):
            with pytest.raises(RecordError, match="another markerseek has it open"):
                look(path)
        journal.commit(Asked(role="search", index=1, angle_deg=1.1), clock_s=0.0)
    assert len(read_journal(path).entries) == 2


def test_a_dead_run_is_read_without_being_touched(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    died(path, lambda journal: write(journal, 2))
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
    assert set(before) == {"run.journal", "run.journal-wal"}
    assert len(read_journal(path).entries) == 6
    assert verify(path).faults == []
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before


def test_a_newer_version_is_refused_with_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA user_version = 2")
    for look in (read_journal, verify, salvage):
        with pytest.raises(RecordError, match="has version 2, this markerseek reads up to 1; install a newer one"):
            look(path)


def test_version_1_is_read() -> None:
    held = read_journal(VERSION_1)
    _, result = result_of(held)
    assert (held.configuration.method, held.configuration.seed) == ("golden-section", 11)
    assert (result.answer, result.acquisitions, result.refused) == ("found", 10, 0)
    assert result.angle_deg == -11.41853617653918
    assert result.confirmation is not None
    assert verify(VERSION_1).faults == []


def foreign_database(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE events (number)")


def hostile_view(path: Path) -> None:
    """A journal whose events are a view that never ends."""
    whole_run(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TABLE events")
        database.execute(
            "CREATE VIEW events AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
            "SELECT i AS number, 'asked', '', 0.0, '', NULL, 0, NULL FROM n"
        )
        database.commit()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda path: path.write_bytes(b""), "no journal of a run"),
        (lambda path: path.write_bytes(b"not a database, and as long as one" * 99), "not a database"),
        (foreign_database, "no journal of a run"),
        (hostile_view, "tables are none of a journal"),
        (lambda path: path.mkdir(), "it is a folder, and a journal is one file"),
        (os.mkfifo, "it is no ordinary file"),
        (lambda _: None, "no such journal"),
    ],
    ids=["empty", "text", "foreign", "view", "folder", "pipe", "missing"],
)
def test_what_is_no_journal_is_said_to_be_none(make: Callable[[Path], object], said: str, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    make(path)
    for look in (read_journal, verify, Journal.reopen):
        with pytest.raises(RecordError, match=said) as refused:
            look(path)
        assert str(refused.value).startswith(f"{path}: ")


def a_file(path: Path) -> Path:
    path.write_bytes(b"mine")
    return path


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (lambda folder: folder, "it is a folder, and a journal is one file; name a new file in it"),
        (lambda folder: folder / "none" / "a.journal", r"there is no folder .*none; make it, or name another place"),
        (lambda folder: a_file(folder / "file") / "a.journal", r"file is no folder; name another place"),
        (lambda folder: a_file(folder / "a.journal"), "exists already and is no journal; name a new file"),
        (lambda folder: folder / ("a" * 300), "name it shorter"),
    ],
    ids=["folder", "no parent", "parent is a file", "another file", "long name"],
)
def test_where_no_journal_can_be_begun_the_cure_is_said(
    place: Callable[[Path], Path], said: str, tmp_path: Path
) -> None:
    path = place(tmp_path)
    with pytest.raises(RecordError, match=said) as refused:
        Journal.create(path, configuration())
    assert str(refused.value).startswith(f"{path}: ")


def test_a_journal_is_known_by_its_beginning_also_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()):
        assert is_journal(path)
    assert is_journal(path)
    foreign_database(tmp_path / "foreign")
    assert not is_journal(tmp_path / "foreign")
    assert not is_journal(a_file(tmp_path / "text"))


@pytest.mark.parametrize("name", ["run.journal", "run.csv", "run.hdf5"])
def test_a_journal_taken_for_a_bank_is_called_a_journal(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    Journal.create(path, configuration()).close()
    with pytest.raises(RecordError, match=f"{name}: it is the journal of a run.*: markerseek journal replay .*{name}"):
        read_bank(path)


def changed(path: Path, sql: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(sql)
        database.commit()


@pytest.mark.parametrize(
    ("sql", "readable", "said"),
    [
        ("DELETE FROM events WHERE number = 4", 3, "entry 4 is missing"),
        ("UPDATE events SET samples = zeroblob(1024) WHERE number = 5", 4, r"entry 5 \(measured\) does not agree"),
        ("UPDATE events SET body = replace(body, '1.1', '1.2') WHERE number = 2", 1, r"entry 2 \(asked\) does not"),
        ("UPDATE events SET clock_s = 0.25 WHERE number = 3", 2, r"entry 3 \(measured\) does not agree"),
        ("UPDATE events SET checkpoint = NULL WHERE number = 3", 2, r"entry 3 \(measured\) does not agree"),
        ("UPDATE events SET kind = 7 WHERE number = 3", 2, r"entry 3 \(7\) does not agree"),
        ("UPDATE events SET body = x'00ff' WHERE number = 3", 2, "entry 3 is damaged"),
    ],
)
def test_a_changed_row_is_noticed_and_those_before_stay_readable(
    sql: str, readable: int, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    whole_run(path, counts_of=lambda index: counts(seed=index))
    changed(path, sql)
    with pytest.raises(RecordError, match=said):
        read_journal(path)
    held, damage = salvage(path)
    assert (len(held.entries), damage is not None) == (readable, True)
    finding = verify(path)
    assert finding.entries == readable
    assert len(finding.faults) == 1


ORDERS = {
    "asked twice": ("started", "asked", "asked"),
    "measured unasked": ("started", "measured"),
    "begun twice": ("started", "started"),
    "begun late": ("asked", "measured"),
    "beyond the end": ("started", "finished", "asked"),
    "on after an interruption": ("started", "asked", "interrupted", "measured"),
    "on after a fault": ("started", "asked", "failed", "measured"),
    "checked without resuming": ("started", "checked"),
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS.keys())
def test_an_impossible_order_is_noticed(order: tuple[str, ...], tmp_path: Path) -> None:
    events: dict[str, Happening] = {
        **EVENTS,
        "asked": Asked(role="search", index=1, angle_deg=1.1),
        "measured": measured(1),
        "finished": EVENTS["NotFound"],
    }
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        for kind in order:
            journal.commit(events[kind], clock_s=0.0)
    faults = verify(path).faults
    assert faults
    assert all(fault.startswith("entry ") for fault in faults)


def test_a_default_journal_lies_in_the_users_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    first, second = default_journal(method="ternary"), default_journal(method="ternary")
    assert first.parent == tmp_path / "markerseek" / "journals"
    assert first != second
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    assert "relative" not in default_journal(method="ternary").parts


def died(path: Path, write_to: Callable[[Journal], object]) -> None:
    """Let another process write a journal and be killed before it can close it."""
    child = os.fork()
    if child == 0:
        try:
            write_to(Journal.create(path, configuration()))
        finally:
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)


@pytest.fixture(scope="module")
def dead_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dead run whose five acquisitions, 12 entries in all, lie in the log."""
    path = tmp_path_factory.mktemp("log") / "run.journal"
    died(path, lambda journal: write(journal, 5, lambda index: counts(32, 1040, seed=index)))
    return path


def with_log(journal: Path, log: bytes, folder: Path) -> Path:
    shutil.copyfile(journal, folder / "run.journal")
    (folder / "run.journal-wal").write_bytes(log)
    return folder / "run.journal"


def by_sqlite(path: Path) -> int:
    """Number of transactions that SQLite itself makes out: one for the tables, one an entry."""
    with closing(sqlite3.connect(path)) as database:
        tables = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        return 1 + database.execute("SELECT count(*) FROM events").fetchone()[0] if tables else 0


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1))
def test_commits_in_a_torn_log_are_those_that_sqlite_takes(
    share: float, dead_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = Path(f"{dead_run}-wal").read_bytes()
    torn = log[: round(share * len(log))]
    good, lost = commits(torn)
    assert lost == 0
    path = with_log(dead_run, torn, tmp_path_factory.mktemp("torn"))
    if good:
        assert len(read_journal(path).entries) == good - 1
    assert by_sqlite(path) == good


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_in_the_log_is_no_silent_loss(
    share: float, bit: int, dead_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    flipped = bytearray(Path(f"{dead_run}-wal").read_bytes())
    place = int(share * len(flipped))
    flipped[place] ^= 1 << bit
    good, _ = commits(bytes(flipped))
    path = with_log(dead_run, bytes(flipped), tmp_path_factory.mktemp("flipped"))
    whole = 13
    if good < whole - 1:
        with pytest.raises(RecordError, match="log is damaged"):
            read_journal(path)
    else:
        # of the last transaction it cannot be told whether it was torn or flipped
        assert len(read_journal(path).entries) == good - 1
    assert by_sqlite(path) == good


@given(st.binary(max_size=400))
def test_any_bytes_are_a_row_or_a_record_error(body: bytes) -> None:
    for kind in ("started", "asked", "measured", "refused", "finished", "failed", "resuming", "checked", "other"):
        try:
            event = from_row(kind, body, None, confirmation=None)
        except RecordError:
            continue
        assert to_row(event)[0] == kind
