"""Journals of older versions stay readable, are lifted when something is added to them; newer ones are refused."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest

from every_kind_of_entry import MARKER_DEG, METHOD, SEED, checkpoint, happenings, rig
from made_up_journals import configuration, whole_run
from markerseek.core import ChannelFrame, Failed, Measured, RecordError, Refused, Started
from markerseek.records.journal import Checked, Interrupted, Journal, read_journal, result_of, salvage, verify
from markerseek.records.journal.entries import Happening
from markerseek.records.journal.store import SCHEMAS, VERSION, log_of
from markerseek.runs.rebuild import rebuild_reader, rebuild_rig
from markerseek.signals import ImageReader

DATA = Path(__file__).parents[1] / "data"
VERSION_1 = DATA / "journal-version-1.journal"
EVERY_KIND = {version: DATA / f"every-kind-version-{version}.journal" for version in (1, 2)}


def version_of(path: Path) -> int:
    with closing(sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)) as database:
        (version,) = database.execute("PRAGMA user_version").fetchone()
    return int(version)


def test_a_search_of_version_1_is_read() -> None:
    held = read_journal(VERSION_1)
    _, result = result_of(held)
    assert (held.configuration.method, held.configuration.seed) == ("golden-section", 11)
    assert (result.answer, result.acquisitions, result.refused) == ("found", 10, 0)
    assert result.angle_deg == -11.41853617653918
    assert result.confirmation is not None
    assert verify(VERSION_1).faults == []


def frame_of(event: Happening) -> ChannelFrame | None:
    match event:
        case Measured(sample=sample):
            frame = sample.frame
        case Refused(frame=frame) | Checked(frame=frame):
            pass
        case _:
            return None
    return frame if isinstance(frame, ChannelFrame) else None


def bare(event: Happening) -> Happening:
    """An event without the frame, whose counts are no value that can be compared."""
    if isinstance(event, Refused):
        return Refused(angle_deg=event.angle_deg, reason=event.reason)
    return msgspec.structs.replace(event, frame=None) if isinstance(event, Checked) else event


@pytest.mark.parametrize("version", EVERY_KIND)
def test_every_kind_of_entry_that_a_version_holds_is_read_as_it_was_meant(version: int) -> None:
    path = EVERY_KIND[version]
    assert version_of(path) == version
    meant = happenings(version)
    held = read_journal(path)
    assert [type(entry.event) for entry in held.entries] == [type(event) for event in meant]
    for number, (entry, event) in enumerate(zip(held.entries, meant, strict=True), start=1):
        assert (entry.number, entry.clock_s) == (number, 0.1 * number)
        assert datetime.fromisoformat(entry.written).year == 2026
        changed = isinstance(event, Started | Measured)
        assert entry.checkpoint == (checkpoint(number) if changed else None)
        if isinstance(event, Failed):
            assert isinstance(entry.event, Failed)
            assert str(entry.event.error) == str(event.error)
            continue
        assert bare(entry.event) == bare(event)
        kept, wanted = frame_of(entry.event), frame_of(event)
        assert (kept is None) == (wanted is None)
        if kept is not None and wanted is not None:
            assert (kept.header, kept.sampling_hz) == (wanted.header, wanted.sampling_hz)
            np.testing.assert_array_equal(kept.samples, wanted.samples)
        if isinstance(event, Measured) and wanted is None:
            assert isinstance(entry.event, Measured)
            assert entry.event.sample.frame == event.sample.frame
    assert verify(path).faults == []


def test_the_versions_hold_different_things() -> None:
    """Or the second fixture would be no test of what the second version added."""
    one, two = (happenings(version) for version in EVERY_KIND)
    assert sum(frame_of(event) is not None for event in two) == sum(frame_of(event) is not None for event in one) + 2


@pytest.mark.parametrize("version", EVERY_KIND)
def test_the_rig_of_a_journal_of_any_version_is_put_together_again(version: int) -> None:
    begun_with = read_journal(EVERY_KIND[version]).configuration
    assert (begun_with.method, begun_with.seed, begun_with.truth_deg) == (METHOD, SEED, MARKER_DEG)
    assert (begun_with.acquisitions, begun_with.as_published, begun_with.dark_frames) == (3, True, 1)
    assert (begun_with.imaging is msgspec.UNSET) == (version == 1)
    reader = rebuild_reader(begun_with)
    now = rig()
    assert isinstance(reader, ImageReader)
    assert now.imaging is not None
    assert reader.preset == now.imaging.preset
    assert rebuild_rig(begun_with).configuration == now.configuration


@pytest.mark.parametrize("path", [VERSION_1, EVERY_KIND[1]], ids=["search", "every kind"])
def test_an_old_journal_is_lifted_with_the_first_row_that_is_added(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run.journal"
    shutil.copyfile(path, copy)
    before = read_journal(copy).entries
    journal, _ = Journal.reopen(copy)
    journal.close()
    assert version_of(copy) == 1
    journal, _ = Journal.reopen(copy)
    with journal:
        journal.commit(Interrupted(reason="made up"), clock_s=9.0)
        journal.commit(Interrupted(reason="made up"), clock_s=9.0)
    assert version_of(copy) == VERSION
    held = read_journal(copy)
    assert len(held.entries) == len(before) + 2
    assert [entry.written for entry in held.entries[:-2]] == [entry.written for entry in before]


def test_the_version_is_lifted_in_the_transaction_of_the_row(tmp_path: Path) -> None:
    """Where the log ends before that transaction is whole, there is neither."""
    copy = tmp_path / "run.journal"
    shutil.copyfile(VERSION_1, copy)
    before = len(read_journal(copy).entries)
    journal, _ = Journal.reopen(copy)
    with journal:
        journal.commit(Interrupted(reason="made up"), clock_s=9.0)
        log = log_of(copy).read_bytes()
        file = copy.read_bytes()
    seen = set()
    for size in range(0, len(log) + 1, 1024):
        log_of(copy).write_bytes(log[:size])
        copy.write_bytes(file)
        with closing(sqlite3.connect(copy)) as database:
            (version,) = database.execute("PRAGMA user_version").fetchone()
            (rows,) = database.execute("SELECT count(*) FROM events").fetchone()
        seen.add((version, rows - before))
    log_of(copy).unlink(missing_ok=True)
    copy.write_bytes(file)
    log_of(copy).write_bytes(log)
    with closing(sqlite3.connect(copy)) as database:
        (version,) = database.execute("PRAGMA user_version").fetchone()
    assert version == VERSION
    assert seen <= {(1, 0), (VERSION, 1)}
    assert (1, 0) in seen


def test_every_version_up_to_ours_has_its_tables() -> None:
    assert sorted(SCHEMAS) == list(range(1, VERSION + 1))


@pytest.mark.parametrize("version", [VERSION + 1, 1000])
def test_a_newer_version_is_refused_with_a_sentence(version: int, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA user_version = {version}")
    before = path.read_bytes()
    said = f"has version {version}, this markerseek reads up to {VERSION}; install a newer one"
    for look in (read_journal, verify, salvage, Journal.reopen):
        with pytest.raises(RecordError, match=said):
            look(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("version", [0, -1])
def test_a_version_that_never_was_is_called_damaged(version: int, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    Journal.create(path, configuration()).close()
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA user_version = {version}")
    with pytest.raises(RecordError, match=f"none of a journal of version {version}; it is damaged or foreign"):
        read_journal(path)
