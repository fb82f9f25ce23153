"""The record of a run that follows: a file of lines; the first says what is followed, the others are its steps.

It grows by ten steps a second at most, and by each that says something new. A line is not flushed to the disk, because
the loop does not wait for it: a loss of power costs the last seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Self, TypeAlias

import msgspec

from markerseek._version import __version__
from markerseek.core import RecordError
from markerseek.files import as_read_error, open_input
from markerseek.following.follower import FollowStep
from markerseek.following.plan import FollowPlan
from markerseek.records.journal import LineFile, LineReader, await_file, line_of, yield_new

WRITTEN_S = 0.1
"""Least time between two steps that say the same."""

_VERSION = 1
_MOST_BYTES = 1 << 30


class FollowBegun(msgspec.Struct, frozen=True, kw_only=True, tag="begun"):
    """What is followed, and with what."""

    what: str
    """The target in words."""
    rig: str
    """The rig in words."""
    simulated: bool
    registration: str
    """Folder of its session, or its file; empty: it is simulated."""
    plan: FollowPlan
    lit: bool
    """Whether the target is a laser spot."""
    by: str
    """Who permits it."""
    begun: str
    """When it began, UTC."""
    version: str = __version__


class FollowEnded(msgspec.Struct, frozen=True, kw_only=True, tag="ended"):
    """The run is over."""

    said: str
    """Why, in a sentence; empty: at the time that was asked for."""


FollowLine: TypeAlias = FollowBegun | FollowStep | FollowEnded
"""Any line of a record."""


class FollowRecord:
    """The record of a run, open for writing; made by `create`."""

    def __init__(self, lines: LineFile) -> None:
        self._lines = lines
        self._count = 1
        self._last: FollowStep | None = None

    @classmethod
    def create(cls, path: Path, begun: FollowBegun) -> Self:
        """Make a new file; `RecordError` if there is one, or it cannot be written."""
        if path.exists() or path.is_symlink():
            raise RecordError(f"{path}: it is there already; name a new file")
        try:
            lines = LineFile.create(path, line_of({"following": _VERSION, "begun": begun}), kept=False, mode=0o600)
        except OSError as problem:
            raise RecordError(f"{path}: it cannot be written: {problem.strerror or problem}; name another") from problem
        return cls(lines)

    def add(self, step: FollowStep) -> None:
        """Take a step, which is written if it says something new or the last one is `WRITTEN_S` old."""
        last = self._last
        since_s = math.inf if last is None else step.at_s - last.at_s
        if last is not None and since_s < WRITTEN_S and _says_the_same(last, step):
            return
        self._last = step
        self._write(step)

    def end(self, said: str) -> None:
        """Say why the run is over."""
        self._write(FollowEnded(said=said))

    def close(self) -> None:
        """Close it; allowed twice."""
        self._lines.close()

    def _write(self, line: FollowStep | FollowEnded) -> None:
        try:
            self._lines.append(line_of({"number": self._count, "written": datetime.now(UTC).isoformat(), "body": line}))
        except OSError as problem:
            raise RecordError(
                f"{self._lines.path}: it cannot be written: {problem.strerror or problem}; make room on the disk"
            ) from problem
        self._count += 1


def _says_the_same(before: FollowStep, after: FollowStep) -> bool:
    return (before.word, before.turning, before.refused, before.confirmed) == (
        after.word,
        after.turning,
        after.refused,
        after.confirmed,
    )


class _Lines(LineReader):
    """Reads the lines of a record one by one."""

    def next(self) -> FollowLine | None:
        """Read the next line; None if there is none yet, or it was never finished."""
        if self._number == 0:
            first = self._next_first()
            if first is None:
                return None
            if not first.following:
                raise RecordError(f"{self.path}: it is no record of a run that follows; check the name")
            self._number = 1
            return self._read(first.begun)
        found = self._next_line()
        if found is None:
            return None
        self._number += 1
        return self._read(found[0].body)

    def _read(self, body: bytes | msgspec.Raw) -> FollowLine:
        try:
            line: FollowLine = msgspec.json.decode(body, type=FollowLine)
        except msgspec.MsgspecError as problem:
            raise RecordError(
                f"{self.path}: {problem}; another version of markerseek wrote it: use that one"
            ) from problem
        return line


def follow_record(path: Path, *, is_over: Callable[[], bool], wait: Callable[[], object]) -> Iterator[FollowLine]:
    """Yield the lines of a record, each as soon as it is written; the file need not exist yet.

    ``is_over``: whether no more will be written. ``wait``: called where nothing new is there. Raises `RecordError` at
    the first line that does not agree with its check sum.
    """
    if not await_file(path, is_over=is_over, wait=wait):
        return
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        lines: Iterator[FollowLine] = yield_new(_Lines(path, file.fileno()).next, is_over=is_over, wait=wait)
        yield from lines
