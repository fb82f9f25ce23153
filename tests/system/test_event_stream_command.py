"""The stream of events of the commands: what it holds, and that no reader changes the search."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.records.stream import StreamDecoder, StreamEnd, StreamEvent, StreamHead

Shell = Callable[..., tuple[int, str, str]]

SEARCH = ("search", "--seed", 1, "--method", "ternary", "--acquisitions", 5, "--json")


def lines_of(data: bytes) -> list[dict[str, object]]:
    """The lines of a stream as any program could read them: a line, then the bytes that it announces."""
    lines, at = [], 0
    while at < len(data):
        end = data.index(b"\n", at)
        lines.append(json.loads(data[at:end]))
        at = end + 1 + lines[-1].pop("frame_bytes", 0)
    return lines


@pytest.mark.parametrize("frames", [(), ("--event-frames",)], ids=["lines", "frames"])
def test_the_lines_are_the_entries_that_journal_show_prints(
    shell: Shell, tmp_path: Path, frames: tuple[str, ...]
) -> None:
    stream, journal = tmp_path / "events", tmp_path / "run.journal"
    code, _out, _err = shell(*SEARCH, "--journal", journal, "--events", stream, *frames)
    assert code in (0, 3)
    _code, shown, _err = shell("journal", "show", journal, "--json")
    head, *entries, end = lines_of(stream.read_bytes())
    assert entries == json.loads(shown)["entries"]
    assert head["configuration"]["plan"]["method"] == "ternary"
    assert end == {"end": True}


def test_a_search_with_a_stream_that_nobody_reads_gives_the_same_answer(shell: Shell, tmp_path: Path) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    alone = json.loads(shell(*SEARCH, "--no-journal")[1])
    unread = json.loads(shell(*SEARCH, "--no-journal", "--events", fifo, "--event-frames")[1])
    assert unread == alone


def test_a_replay_and_a_scan_send_their_events_too(shell: Shell, tmp_path: Path) -> None:
    bank = tmp_path / "scan.hdf5"
    code, _out, _err = shell("bank", "scan", bank, "--step-deg", 35, "--events", tmp_path / "scan", "--event-frames")
    assert code == 0
    head, *events, end = StreamDecoder().feed((tmp_path / "scan").read_bytes())
    assert isinstance(head, StreamHead)
    assert isinstance(end, StreamEnd)
    measured = [item for item in events if isinstance(item, StreamEvent) and item.header is not None]
    assert [item.event.role for item in measured] == ["dark"] * 3 + ["search"] * 3
    assert all(item.event.sample.frame is not None for item in measured)
    shell("replay", bank, "--method", "golden-section", "--acquisitions", 3, "--events", tmp_path / "replay")
    head, *_events, end = StreamDecoder().feed((tmp_path / "replay").read_bytes())
    assert isinstance(head, StreamHead)
    assert head.configuration.facts.kind == "replayed"
    assert isinstance(end, StreamEnd)


def test_an_inherited_pipe_is_written_to() -> None:
    reading, writing = os.pipe()
    command = [sys.executable, "-m", "markerseek", *map(str, SEARCH), "--no-journal", "--events", f"/dev/fd/{writing}"]
    with subprocess.Popen(command, pass_fds=(writing,), stdout=subprocess.DEVNULL) as process:
        os.close(writing)
        data = b""
        while piece := os.read(reading, 1 << 16):
            data += piece
        os.close(reading)
        assert process.wait() in (0, 3)
    assert lines_of(data)[-1] == {"end": True}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--event-frames",), "--event-frames says how events are sent, and none are"),
        (("--heartbeat", "/dev/null"), "--heartbeat /dev/null: it is no pipe; name one that is open, /dev/fd/N"),
        (("--events", "no/such/folder"), "--events no/such/folder: it cannot be written: No such file"),
    ],
)
def test_options_that_cannot_be_met_are_refused_before_anything_moves(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _err = shell(*SEARCH, "--no-journal", *options)
    assert code == 2
    assert said in json.loads(out)["error"]
