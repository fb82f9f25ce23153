"""Journals of both versions; torn ends, flipped bits, zeros after a loss of power: damage is named."""

from __future__ import annotations

import json
import os
import re
import shutil
import zlib
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from markerseek.core import ChannelFrame, Failed, Measured, RecordError, Refused
from markerseek.records.journal import (
    Checked,
    Interrupted,
    Journal,
    JournalEntry,
    JournalEvent,
    RecordedError,
    RecordedRun,
    lines,
    read_journal,
    salvage,
)
from markerseek.records.journal.lines import FORMAT_VERSION, MAX_LINE_BYTES
from markerseek.runs import rebuild_reader, rebuild_rig
from markerseek.signals import ImageReader
from tests.sizes import LONG
from tests.unit.records.journal.synthetic_journals import (
    MARKER_DEG,
    METHOD,
    SEED,
    configuration,
    counts,
    journal_events,
    rig,
    whole_run,
)

ACQUISITIONS = 1
ENTRIES = 2 * ACQUISITIONS + 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small run with frames; its last entry has none."""
    path = tmp_path_factory.mktemp("whole") / "run.journal"
    whole_run(path, acquisitions=ACQUISITIONS, counts_of=lambda index: counts(2, 4, seed=index))
    return path.read_bytes()


@pytest.fixture(scope="module")
def ends(whole: bytes) -> list[int]:
    """Bytes up to the end of each line, the configuration first."""
    found = []
    place = 0
    while place < len(whole):
        line = whole[place : whole.index(b"\n", place) + 1]
        block = json.loads(line).get("block", 0)
        place += len(line) + block + (block > 0)
        found.append(place)
    assert len(found) == ENTRIES + 1
    return found


def of(held: RecordedRun) -> list[tuple[object, ...]]:
    def row(entry: JournalEntry) -> tuple[object, ...]:
        return entry.number, entry.event, entry.clock_s

    return [row(entry) for entry in held.entries]


def test_a_tail_torn_at_every_byte_is_read_and_continued(whole: bytes, ends: list[int], tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(whole)
    wanted = of(read_journal(path))
    for size in range(ends[0], len(whole) + 1, 1 if LONG else 7):
        path.write_bytes(whole[:size])
        kept = sum(end <= size for end in ends[1:])
        assert of(read_journal(path)) == wanted[:kept]
        assert path.stat().st_size == size
        # Each commit costs a flush: those near an end, and some between.
        if size % 97 and min(abs(end - size) for end in ends) > 4:
            continue
        journal, held = Journal.reopen(path)
        with journal:
            journal.commit(Interrupted(reason="made up"), clock_s=9.0)
        assert len(held.entries) == kept
        assert of(read_journal(path))[:kept] == wanted[:kept]
        assert len(read_journal(path).entries) == kept + 1


def test_each_flipped_bit_is_found_and_its_entry_named(whole: bytes, ends: list[int], tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(whole)
    wanted = of(read_journal(path))
    for place in (*range(0, len(whole), 1 if LONG else 11), len(whole) - 1):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        number = sum(end <= place for end in ends)
        if number == 0:
            with pytest.raises(RecordError, match=r"does not begin as a journal does|the configuration"):
                salvage(path)
            continue
        held, damage = salvage(path)
        assert of(held) == wanted[: number - 1]
        assert re.search(f"entry {number}(:| )", str(damage)), (place, damage)


@pytest.mark.parametrize("kept", [0, 5, 20, 40])
def test_zeros_in_the_place_of_the_last_entry_are_an_entry_that_was_never_finished(
    kept: int, whole: bytes, ends: list[int], tmp_path: Path
) -> None:
    """As some file systems leave them after a loss of power: the length is on the disk, the data are not."""
    path = tmp_path / "run.journal"
    path.write_bytes(whole[: ends[-2] + kept].ljust(len(whole), b"\0"))
    assert len(read_journal(path).entries) == ENTRIES - 1
    journal, _ = Journal.reopen(path)
    with journal:
        journal.commit(Interrupted(reason="made up"), clock_s=9.0)
    assert len(read_journal(path).entries) == ENTRIES


def test_entries_that_are_missing_or_exchanged_are_found(whole: bytes, ends: list[int], tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    lines = [whole[low:high] for low, high in zip([0, *ends], ends, strict=False)]
    for mixed in (
        [*lines[:2], *lines[3:]],
        [*lines[:2], lines[3], lines[2], *lines[4:]],
        [*lines[:2], lines[1], *lines[2:]],
        [*lines[:2], bytes(len(lines[2])), *lines[3:]],
    ):
        path.write_bytes(b"".join(mixed))
        held, damage = salvage(path)
        assert len(held.entries) == 1
        assert damage is not None
        with pytest.raises(RecordError):
            Journal.reopen(path)


def test_a_tail_longer_than_one_entry_is_damage_and_read_at_once(whole: bytes, tmp_path: Path) -> None:
    """As of a sparse file of many gigabytes."""
    path = tmp_path / "run.journal"
    path.write_bytes(whole)
    os.truncate(path, 1 << 34)
    held, damage = salvage(path)
    assert len(held.entries) == ENTRIES
    assert f"a line of more than {MAX_LINE_BYTES} bytes; it is damaged" in str(damage)


FORMATS = [Path(__file__).parents[3] / "data" / f"format-{version}.journal" for version in (1, 2)]


def frame_of(event: JournalEvent) -> ChannelFrame | None:
    match event:
        case Measured(sample=sample):
            frame = sample.frame
        case Refused(frame=frame) | Checked(frame=frame):
            pass
        case _:
            return None
    return frame if isinstance(frame, ChannelFrame) else None


def without_frame(event: JournalEvent) -> JournalEvent:
    """An event without the frame, whose counts are no value that can be compared."""
    return replace(event, frame=None) if isinstance(event, Refused | Checked) else event


@pytest.mark.parametrize("path", FORMATS, ids=["1", "2"])
def test_every_kind_of_entry_is_read_as_it_was_written(path: Path) -> None:
    expected = journal_events()
    held = read_journal(path)
    assert [type(entry.event) for entry in held.entries] == [type(event) for event in expected]
    for number, (entry, event) in enumerate(zip(held.entries, expected, strict=True), start=1):
        assert (entry.number, entry.clock_s) == (number, 0.1 * number)
        assert datetime.fromisoformat(entry.written).year == 2026
        if isinstance(event, Failed):
            assert isinstance(entry.event, Failed)
            assert isinstance(entry.event.error, RecordedError)
            assert (entry.event.error.kind, str(entry.event.error)) == ("MoveError", str(event.error))
            continue
        assert without_frame(entry.event) == without_frame(event)
        kept = frame_of(entry.event)
        wanted = frame_of(event)
        assert (kept is None) == (wanted is None)
        if kept is not None and wanted is not None:
            assert (kept.header, kept.sampling_hz) == (wanted.header, wanted.sampling_hz)
            np.testing.assert_array_equal(kept.samples, wanted.samples)
        if isinstance(event, Measured) and wanted is None:
            assert isinstance(entry.event, Measured)
            assert entry.event.sample.frame == event.sample.frame
    assert salvage(path)[1] is None


@pytest.mark.parametrize("path", FORMATS, ids=["1", "2"])
def test_the_rig_of_a_journal_is_built_again(path: Path) -> None:
    held = read_journal(path)
    begun_with = held.configuration
    plan = begun_with.plan
    facts = begun_with.facts
    assert (plan.method, facts.seed, facts.truth_deg) == (METHOD, SEED, MARKER_DEG)
    assert (plan.acquisitions, plan.as_published, plan.dark_frames) == (3, True, 1)
    reader = rebuild_reader(begun_with)
    now = rig()
    assert isinstance(reader, ImageReader)
    assert now.imaging is not None
    assert reader.preset == now.imaging.preset
    assert rebuild_rig(held).facts == now.facts


def of_version(path: Path, version: int) -> None:
    """A journal whose first line says so, with the checksum that it then has."""
    first = lines.first_line(configuration())
    rest = first[first.index(b'"record"') :].replace(b'"record":2,', b'"record":%d,' % version)
    path.write_bytes(b'{"crc":"%08x",' % zlib.crc32(rest) + rest)


def test_an_older_version_is_read_and_not_resumed(tmp_path: Path) -> None:
    path = Path(shutil.copy(FORMATS[0], tmp_path))
    before = path.read_bytes()
    with pytest.raises(RecordError, match=r"written by an older markerseek: .*begin a new search"):
        Journal.reopen(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("place", [0.1, 0.5, 0.99])
def test_damage_in_an_older_version_is_named(place: float, tmp_path: Path) -> None:
    path = Path(shutil.copy(FORMATS[0], tmp_path))
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 4
    path.write_bytes(data)
    with pytest.raises(RecordError, match=r"(entry \d+|the configuration)\b.*damaged"):
        read_journal(path)


@pytest.mark.parametrize("version", [FORMAT_VERSION + 1, 1000])
def test_a_newer_version_is_refused_with_a_sentence(version: int, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    of_version(path, version)
    before = path.read_bytes()
    sentence = (
        f"newer markerseek: the journal has version {version}, this one reads up to {FORMAT_VERSION}; install a newer"
    )
    for look in (read_journal, salvage, Journal.reopen):
        with pytest.raises(RecordError, match=sentence):
            look(path)
    assert path.read_bytes() == before
