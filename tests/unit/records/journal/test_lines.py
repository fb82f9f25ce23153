"""Torn ends, flipped bits, zeros after a loss of power: what was written is read, and damage is named."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.records.journal import Entry, Interrupted, Journal, RecordedRun, read_journal, salvage
from markerseek.records.journal.lines import MAX_LINE_BYTES
from tests.sizes import LONG
from tests.unit.records.journal.synthetic_journals import counts, whole_run

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
    found, place = [], 0
    while place < len(whole):
        line = whole[place : whole.index(b"\n", place) + 1]
        block = json.loads(line).get("block", 0)
        place += len(line) + block + (block > 0)
        found.append(place)
    assert len(found) == ENTRIES + 1
    return found


def of(held: RecordedRun) -> list[tuple[object, ...]]:
    def row(entry: Entry) -> tuple[object, ...]:
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
