"""Truncated, bit-flipped and random journals: one kind of error, or exactly what was written."""

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


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0, 1))
def test_a_torn_file_is_noticed(share: float, closed: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    data = closed.read_bytes()
    size = round(share * len(data))
    path = tmp_path_factory.mktemp("torn") / "run.journal"
    path.write_bytes(data[:size])
    entries = looked_at(path)
    assert (entries == 25) == (size == len(data))


@settings(max_examples=120, deadline=None)
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


@settings(max_examples=60, deadline=None)
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


def test_every_flipped_bit_of_a_frame_is_noticed(closed: Path, tmp_path: Path) -> None:
    """Bits of the samples themselves, one at a time."""
    wanted = measured(6, channels=8).sample.frame
    assert isinstance(wanted, ChannelFrame)
    data = closed.read_bytes()
    start = data.index(wanted.samples.tobytes()[1000:1100])
    path = tmp_path / "run.journal"
    for bit in range(0, 800, 37):
        flipped = bytearray(data)
        flipped[start + bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        held, damage = salvage(path)
        assert len(held.entries) == 12
        assert damage is not None
        assert "entry 13: it does not agree with its checksum" in str(damage)


@pytest.mark.parametrize(("name", "whole", "read"), JOURNALS.values(), ids=JOURNALS.keys())
def test_what_is_fuzzed_is_read_while_it_is_whole(
    name: str, whole: Callable[[], bytes], read: Callable[[Path], object], tmp_path: Path
) -> None:
    assert outcome(read, tmp_path / name, whole()) == "read"
