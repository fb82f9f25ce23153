"""The stream of a run's events: what is written is read back, and no reader can hold up a run."""

from __future__ import annotations

import contextlib
import json
import os
import threading
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek import rigs
from markerseek.core import (
    BModeFrame,
    ChannelFrame,
    Finished,
    FrameHeader,
    Measured,
    Reading,
    RecordError,
    Refused,
    Sample,
    ScanGeometry,
    SearchPlan,
)
from markerseek.records.journal import Checked, Configuration, Entry, Journal, JournalEvent, read_journal
from markerseek.records.stream import EventStream, StreamDecoder, StreamEnd, StreamEvent, StreamHead, StreamItem
from markerseek.runs import new_session, plan_on, resumed_session
from markerseek.sim import GaussianCurve
from tests.unit.records.journal.every_kind_of_entry import VERSIONS, journal_events
from tests.unit.records.journal.every_kind_of_entry import rig as entries_rig


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    rig = entries_rig()
    session = new_session(rig, plan_on(rig, SearchPlan(method="ternary", acquisitions=8, start_deg=0.0)))
    return msgspec.structs.replace(session.configuration, versions=VERSIONS)


def written(path: Path, configuration: Configuration, events: list[JournalEvent], *, frames: bool) -> bytes:
    with EventStream(path, configuration, frames=frames) as stream:
        for number, event in enumerate(events):
            stream.add(event, clock_s=number / 10)
    return path.read_bytes()


def frame_of(event: JournalEvent) -> ChannelFrame | None:
    match event:
        case Measured(sample=sample):
            return sample.frame if isinstance(sample.frame, ChannelFrame) else None
        case Refused(frame=frame) | Checked(frame=frame):
            return frame if isinstance(frame, ChannelFrame) else None
    return None


def same(one: JournalEvent, other: JournalEvent) -> bool:
    if hasattr(one, "error"):
        return str(one.error) == str(other.error)
    if isinstance(one, Checked) and isinstance(other, Checked):
        # Unlike `Measured`, it compares its frame, and frames do not compare.
        return replace(one, frame=None) == replace(other, frame=None)
    return one == other


def lit(sequence: int, *, samples: int) -> Measured:
    header = FrameHeader(
        sequence=sequence, token=f"permit-{sequence}", pulses=16, commanded_deg=1.5, started_s=1.0, ended_s=2.0
    )
    counts = np.full((128, samples), sequence, dtype=np.int16)
    frame = ChannelFrame(header=header, samples=counts, sampling_hz=40e6)
    return Measured(
        role="search", index=sequence, sample=Sample(angle_deg=1.5, reading=Reading(intensity=2.0), frame=frame)
    )


@pytest.mark.parametrize("frames", [True, False])
def test_every_kind_of_event_comes_back_as_it_was_sent(
    tmp_path: Path, configuration: Configuration, frames: bool
) -> None:
    events = journal_events()
    head, *items, end = StreamDecoder().feed(written(tmp_path / "e", configuration, events, frames=frames))
    assert head == StreamHead(configuration=configuration, frames=frames)
    assert end == StreamEnd(lost_lines=0, lost_frames=0)
    assert [item.number for item in items] == list(range(1, len(events) + 1))
    assert [item.clock_s for item in items] == [number / 10 for number in range(len(events))]
    for item, sent in zip(items, events, strict=True):
        assert same(item.event, sent)
        held = frame_of(sent)
        received = frame_of(item.event)
        if held is None:
            continue
        assert item.header == held.header
        if frames:
            assert np.array_equal(received.samples, held.samples)
        else:
            assert received is None


@pytest.mark.parametrize("frames", [True, False])
def test_b_mode_images_are_sent_with_frames_and_left_out_without(
    tmp_path: Path, configuration: Configuration, frames: bool
) -> None:
    event = lit(1, samples=64)
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    geometry = ScanGeometry(first_lateral_m=0.0, lateral_step_m=1e-4, first_depth_m=0.0, depth_step_m=1e-4)
    frame = BModeFrame(header=event.sample.frame.header, pixels=pixels, geometry=geometry)
    sent = replace(event, sample=replace(event.sample, frame=frame))
    item = StreamDecoder().feed(written(tmp_path / "e", configuration, [sent], frames=frames))[1]
    assert item.header == frame.header
    received = item.event.sample.frame
    assert received is None if not frames else np.array_equal(received.pixels, pixels)


@settings(max_examples=30)
@given(cuts=st.lists(st.integers(0, 12_000), max_size=12))
def test_a_stream_may_be_cut_anywhere_on_its_way(tmp_path_factory: pytest.TempPathFactory, cuts: list[int]) -> None:
    data = _whole_stream(tmp_path_factory)
    whole = StreamDecoder().feed(data)
    decoder, items = StreamDecoder(), list[StreamItem]()
    ends = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for low, high in pairwise(ends):
        items += decoder.feed(data[low:high])
    assert [kind(item) for item in items] == [kind(item) for item in whole]


@settings(max_examples=300)
@given(
    changes=st.lists(st.tuples(st.integers(0, 12_000), st.integers(0, 255)), min_size=1, max_size=6),
    end=st.integers(0, 12_000),
)
def test_a_damaged_stream_is_read_or_refused_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, int]], end: int
) -> None:
    data = bytearray(_whole_stream(tmp_path_factory))
    for at, byte in changes:
        data[at % len(data)] = byte
    decoder = StreamDecoder()
    # Any other exception fails the test.
    with contextlib.suppress(RecordError):
        decoder.feed(bytes(data[: end % len(data)]))
        decoder.feed(bytes(data[end % len(data) :]))


_WHOLE: list[bytes] = []


def _whole_stream(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    if not _WHOLE:
        rig = entries_rig()
        session = new_session(rig, plan_on(rig, SearchPlan(method="ternary", acquisitions=8, start_deg=0.0)))
        path = tmp_path_factory.mktemp("stream") / "e"
        _WHOLE.append(written(path, session.configuration, journal_events(), frames=True))
    return _WHOLE[0]


def kind(item: StreamItem) -> tuple[str, int]:
    return (type(item.event).__name__, item.number) if isinstance(item, StreamEvent) else (type(item).__name__, 0)


@pytest.mark.parametrize(
    "data",
    [
        b"[1,2]\n",
        b'{"stream":2,"frames":false,"configuration":{}}\n',
        b"GET / HTTP/1.1\r\n",
        b"x" * (1 << 22) + b"x",
    ],
    ids=["a list", "a newer version", "another protocol", "no end of line"],
)
def test_bytes_that_are_no_stream_are_refused(data: bytes) -> None:
    with pytest.raises(RecordError, match="stream: "):
        StreamDecoder().feed(data)


def test_a_frame_of_an_impossible_size_is_refused_before_it_is_stored(
    tmp_path: Path, configuration: Configuration
) -> None:
    decoder = StreamDecoder()
    decoder.feed(written(tmp_path / "e", configuration, [], frames=True).splitlines(keepends=True)[0])
    line = {"number": 1, "kind": "measured", "written": "", "clock_s": 0.0, "body": {}, "frame_bytes": 1 << 40}
    with pytest.raises(RecordError, match="a frame of 1099511627776 bytes"):
        decoder.feed(json.dumps(line).encode() + b"\n")


def test_a_pipe_that_nobody_reads_loses_frames_and_then_lines_and_the_next_line_counts_them(
    tmp_path: Path, configuration: Configuration
) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    decoder = StreamDecoder()
    sent = 3000
    with EventStream(fifo, configuration, frames=True) as stream:
        for number in range(1, sent + 1):
            stream.add(lit(number, samples=1000), clock_s=0.0)
        # A reader that comes late: what fitted into the pipe waits for it.
        reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
        items = [item for data in _available(reader) for item in decoder.feed(data)]
        stream.add(lit(sent + 1, samples=1000), clock_s=0.0)
        items += [item for data in _available(reader) for item in decoder.feed(data)]
    items += [item for data in _available(reader) for item in decoder.feed(data)]
    os.close(reader)
    events = [item for item in items if isinstance(item, StreamEvent)]
    with_frames = [item.number for item in events if frame_of(item.event) is not None]
    # 1 MiB holds four frames of 256 kB less their lines; the lines went on for as long as there was room.
    assert with_frames[:3] == [1, 2, 3]
    assert events[10].number == 11
    assert len(events) < sent
    assert events[-1].number == sent + 1
    assert len(events) + sum(item.lost_lines for item in events) == sent + 1
    assert len(with_frames) + sum(item.lost_frames for item in events) == sent + 1
    assert isinstance(items[-1], StreamEnd)


def _available(descriptor: int) -> list[bytes]:
    pieces = []
    while True:
        try:
            piece = os.read(descriptor, 1 << 20)
        except BlockingIOError:
            return pieces
        if not piece:
            return pieces
        pieces.append(piece)


def test_a_reader_that_ends_ends_the_stream_with_a_warning_and_not_the_run(
    configuration: Configuration, tmp_path: Path
) -> None:
    reading, writing = os.pipe()
    rig = rigs.of_intensities(seed=4, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=7.5)
    session = new_session(rig, plan_on(rig, SearchPlan(method="golden-section", acquisitions=8, start_deg=0.0)))
    alone = new_session(
        rigs.of_intensities(seed=4, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=7.5), session.configuration.plan
    )
    list(alone.events())
    with EventStream(Path(f"/dev/fd/{writing}"), session.configuration) as stream:
        os.close(writing)
        session = replace(session, stream=stream)
        with closing(session.events()) as events:
            next(event for event in events if isinstance(event, Measured))
            os.close(reading)
            with pytest.warns(UserWarning, match="nobody reads it any more; the stream of events ends here"):
                list(events)
    assert session.result() == alone.result()


def test_a_slow_reader_gets_whole_lines_and_the_answer(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    rig = rigs.of_intensities(seed=4, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=7.5)
    session = new_session(rig, plan_on(rig, SearchPlan(method="golden-section", acquisitions=8, start_deg=0.0)))
    received = bytearray()

    def read() -> None:
        while piece := os.read(reading, 97):
            received.extend(piece)

    thread = threading.Thread(target=read)
    with EventStream(Path(f"/dev/fd/{writing}"), session.configuration) as stream:
        os.close(writing)
        thread.start()
        list(replace(session, stream=stream).events())
    thread.join()
    os.close(reading)
    items = StreamDecoder().feed(bytes(received))
    assert isinstance(items[-2].event, Finished)


def test_the_stream_of_a_stopped_and_resumed_run_has_the_entries_of_its_journal(tmp_path: Path) -> None:
    def rig() -> rigs.Rig:
        return rigs.of_intensities(seed=4, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=7.5)

    assembled = rig()
    begun = new_session(
        assembled, plan_on(assembled, SearchPlan(method="golden-section", acquisitions=8, start_deg=0.0))
    )
    path = tmp_path / "run.journal"
    first, second = tmp_path / "first", tmp_path / "second"
    with Journal.create(path, begun.configuration) as journal, EventStream(first, begun.configuration) as stream:
        begun = replace(begun, journal=journal, stream=stream)
        with closing(begun.events()) as events:
            next(event for event in events if isinstance(event, Measured) and event.index == 4)
        begun.interrupt("a test")
    assert entries_of(first) == journal_entries(path)
    assembled = rig()
    kept, held = Journal.reopen(path)
    with kept, EventStream(second, held.configuration) as stream:
        resumed = replace(resumed_session(assembled, kept, held, by="a person", reset_fault=False), stream=stream)
        list(resumed.events())
    assert entries_of(second) == journal_entries(path)
    assert len(entries_of(second)) > len(entries_of(first)) + 5


def entries_of(stream: Path) -> list[tuple[int, str, float, JournalEvent]]:
    items = [item for item in StreamDecoder().feed(stream.read_bytes()) if isinstance(item, StreamEvent)]
    return [(item.number, item.written, item.clock_s, item.event) for item in items]


def journal_entries(path: Path) -> list[tuple[int, str, float, JournalEvent]]:
    def row(entry: Entry) -> tuple[int, str, float, JournalEvent]:
        return entry.number, entry.written, entry.clock_s, entry.event

    return [row(entry) for entry in read_journal(path).entries]


def test_an_existing_file_is_not_written_over(tmp_path: Path, configuration: Configuration) -> None:
    (tmp_path / "e").write_text("mine")
    with pytest.raises(RecordError, match=r"--events .*File exists"):
        EventStream(tmp_path / "e", configuration)
    assert (tmp_path / "e").read_text() == "mine"
