"""Journals with several flipped bits, or with rubbish in them: one kind of error, or exactly what was written.

Each single bit, and a tail torn at every byte: `tests/unit/records/journal/test_lines.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ChannelFrame, Measured, RecordError, Started
from markerseek.records.journal import Journal, read_journal, salvage, verify
from tests.faults.decoders import outcome
from tests.faults.journal_decoders import JOURNALS
from tests.faults.journal_runs import RANGE, commit, configuration, measured
from tests.sizes import examples


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal of 25 entries, closed properly."""
    path = tmp_path_factory.mktemp("closed") / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        for index in range(1, 13):
            commit(journal, index, channels=8)
    return path


def looked_at(path: Path) -> int:
    """Number of entries that can be read, each of which is what was written."""
    try:
        held, damage = salvage(path)
        faults = verify(path).faults
    except RecordError:
        with pytest.raises(RecordError):
            read_journal(path)
        with pytest.raises(RecordError):
            Journal.reopen(path)
        return 0
    if damage is not None:
        assert faults
        with pytest.raises(RecordError):
            read_journal(path)
        with pytest.raises(RecordError):
            Journal.reopen(path)
    for index, entry in enumerate(held.entries[2::2], start=1):
        assert isinstance(entry.event, Measured)
        assert isinstance(entry.event.sample.frame, ChannelFrame)
        wanted = measured(index, channels=8).sample.frame
        assert isinstance(wanted, ChannelFrame)
        np.testing.assert_array_equal(entry.event.sample.frame.samples, wanted.samples)
    return len(held.entries)


@settings(max_examples=examples(120), deadline=None)
@given(places=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=3))
def test_flipped_bits_never_change_what_is_read(
    places: list[tuple[float, int]], closed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(closed.read_bytes())
    for share, bit in places:
        data[int(share * len(data))] ^= 1 << bit
    path = tmp_path_factory.mktemp("flipped") / "run.journal"
    path.write_bytes(data)
    assert 0 <= looked_at(path) <= 25


@settings(max_examples=examples(60), deadline=None)
@given(rubbish=st.binary(min_size=1, max_size=300), share=st.floats(0, 1, exclude_max=True))
def test_rubbish_in_a_journal_is_one_kind_of_error(
    rubbish: bytes, share: float, closed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(closed.read_bytes())
    place = int(share * (len(data) - len(rubbish)))
    data[place : place + len(rubbish)] = rubbish
    path = tmp_path_factory.mktemp("rubbish") / "run.journal"
    path.write_bytes(data)
    assert 0 <= looked_at(path) <= 25


@pytest.mark.parametrize(("name", "whole", "read"), JOURNALS.values(), ids=JOURNALS.keys())
def test_what_is_fuzzed_is_read_while_it_is_whole(
    name: str, whole: Callable[[], bytes], read: Callable[[Path], object], tmp_path: Path
) -> None:
    assert outcome(read, tmp_path / name, whole()) == "read"
