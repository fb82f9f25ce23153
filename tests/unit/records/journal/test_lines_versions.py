"""Journals of both versions hold every kind of entry; newer versions are refused."""

from __future__ import annotations

import shutil
import zlib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ChannelFrame, Failed, Measured, RecordError, Refused
from markerseek.records.journal import Checked, Journal, JournalEvent, RecordedError, lines, read_journal, salvage
from markerseek.records.journal.lines import VERSION
from markerseek.runs.rebuild import rebuild_reader, rebuild_rig
from markerseek.signals import ImageReader
from tests.unit.records.journal.every_kind_of_entry import MARKER_DEG, METHOD, SEED, journal_events, rig
from tests.unit.records.journal.synthetic_journals import configuration

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
        kept, wanted = frame_of(entry.event), frame_of(event)
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
    plan, facts = begun_with.plan, begun_with.facts
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


@pytest.mark.parametrize("version", [VERSION + 1, 1000])
def test_a_newer_version_is_refused_with_a_sentence(version: int, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    of_version(path, version)
    before = path.read_bytes()
    sentence = f"newer markerseek: the journal has version {version}, this one reads up to {VERSION}; install a newer"
    for look in (read_journal, salvage, Journal.reopen):
        with pytest.raises(RecordError, match=sentence):
            look(path)
    assert path.read_bytes() == before
