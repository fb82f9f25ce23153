"""The record of a registration session: a folder with `session.jsonl` and the journal of each search beside it.

A line of `session.jsonl` is on the disk before the session goes on, and begins with the CRC-32 of the rest. The first
line says what is registered; the others are the steps of the session, the markers that were taken among them. A line
that was not finished, because the process was killed, is cut off when the session is continued; anything else that
does not agree is named.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import msgspec
import numpy as np

from markerseek.core import RecordError, UInt8
from markerseek.files import MIB, as_read_error, data_folder, read_input
from markerseek.records.journal import is_written, make_folder
from markerseek.registration.steps import Begun, RecordedStep, TakenMarker
from markerseek.registration.stereo_files import StereoSettings
from markerseek.vision import opencv

NAME, CAMERA_IMAGES = "session.jsonl", ("left.jpg", "right.jpg")
"""Names of the files in the folder of a session: its steps, and the newest images of both cameras."""

_MOST_BYTES = 64 * MIB


class SessionRecord:
    """The record of a session, open for writing; made by `create` or `reopen`."""

    def __init__(self, folder: Path, begun: Begun, taken: Sequence[TakenMarker], descriptor: int) -> None:
        self.folder, self.begun = folder, begun
        self.taken: list[TakenMarker] = list(taken)
        self._descriptor = descriptor

    @classmethod
    def create(cls, folder: Path, begun: Begun) -> Self:
        """A new record in a folder that does not exist, or is empty."""
        try:
            make_folder(folder)
            path = folder / NAME
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o600)
        except FileExistsError as problem:
            raise RecordError(
                f"{folder}: it holds a session already; continue it by --continue, or name another folder"
            ) from problem
        except OSError as problem:
            raise RecordError(f"{folder}: no session can be recorded there: {problem.strerror}") from problem
        record = cls(folder, begun, [], descriptor)
        record._lock()
        record._write(begun)
        return record

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Open the record of a session to continue it; ``path``: its folder, or the file in it."""
        folder = path.parent if path.name == NAME else path
        (begun, *steps), end = read_session(folder)
        assert isinstance(begun, Begun)  # noqa: S101  as it was read
        taken = [step for step in steps if isinstance(step, TakenMarker)]
        try:
            descriptor = os.open(folder / NAME, os.O_RDWR | os.O_APPEND)
        except OSError as problem:
            raise RecordError(f"{folder / NAME}: it cannot be written: {problem.strerror}") from problem
        record = cls(folder, begun, taken, descriptor)
        record._lock()
        os.ftruncate(descriptor, end)
        return record

    def add(self, step: RecordedStep) -> None:
        """Record a step; it is on the disk when this returns."""
        self._write(step)
        if isinstance(step, TakenMarker):
            self.taken.append(step)

    def show(self, left: UInt8[np.ndarray, "rows columns"], right: UInt8[np.ndarray, "rows columns"]) -> None:
        """Put the newest images into the folder, as `CAMERA_IMAGES`, for those who look on."""
        for name, image in zip(CAMERA_IMAGES, (left, right), strict=True):
            _, coded = opencv("images of a session").imencode(".jpg", image)
            part = self.folder / f".{name}"
            part.write_bytes(coded.tobytes())
            part.replace(self.folder / name)

    def journal_path(self, name: str) -> Path:
        """Path of a journal for the search of a marker; another one for each try."""
        tries = 1
        while (path := self.folder / f"{name}{'' if tries == 1 else f'-{tries}'}.journal").exists():
            tries += 1
        return path

    def close(self) -> None:
        """Close it; allowed twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _lock(self) -> None:
        import fcntl

        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as problem:
            raise RecordError(
                f"{self.folder}: another markerseek continues this session; wait until it ends"
            ) from problem

    def _write(self, value: RecordedStep) -> None:
        text = msgspec.json.encode(value) + b"\n"
        try:
            os.write(self._descriptor, b"%08x " % zlib.crc32(text) + text)
            os.fdatasync(self._descriptor)
        except OSError as problem:
            raise RecordError(
                f"{self.folder / NAME}: it cannot be written: {problem.strerror}; make room on the disk, and continue "
                "the session by --continue"
            ) from problem


def read_session(folder: Path) -> tuple[list[RecordedStep], int]:
    """The steps of a session, `Begun` first, and the bytes up to the end of its last whole line."""
    path = folder / NAME
    if not path.is_file():
        raise RecordError(f"{folder}: there is no {NAME} in it; name the folder of a session, as `register` prints it")
    with as_read_error(path):
        content = read_input(path, most_bytes=_MOST_BYTES)
    end = content.rfind(b"\n") + 1
    steps = [_step(line, path, number) for number, line in enumerate(content[:end].splitlines(), start=1)]
    if not steps:
        raise RecordError(f"{path}: its first line was never finished; begin a new session")
    return steps, end


def follow_session(
    folder: Path, *, is_over: Callable[[], bool] | None = None, wait: Callable[[], object]
) -> Iterator[RecordedStep]:
    """The steps of a session, `Begun` first, each as soon as it is written, to the last one.

    The writer is not delayed, and nothing is lost however slowly the steps are taken. A session that is continued
    while it is followed goes on here.

    ``is_over``: whether no more will be written; None: once no program has the session open for writing. Where it is
    given, the folder need not exist yet. ``wait``: called where nothing new is there. Raises `RecordError` at the
    first line that does not agree with its check sum.
    """
    path = folder / NAME
    while is_over is not None and not path.exists():
        if is_over() and not path.exists():
            return
        wait()
    end = number = 0
    with as_read_error(path), path.open("rb") as file:
        while True:
            # Asked before the file is read: what was written before the end is read after it.
            over = not is_written(file.fileno()) if is_over is None else is_over()
            # A line that is not finished is read again from its beginning: it may be cut off meanwhile.
            file.seek(end)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                end, number = end + len(line), number + 1
                yield _step(line.removesuffix(b"\n"), path, number)
            if over:
                return
            wait()


def _step(line: bytes, path: Path, number: int) -> RecordedStep:
    """The step in a line without its end."""
    prefix, _, text = line.partition(b" ")
    if prefix != b"%08x" % zlib.crc32(text + b"\n"):
        raise RecordError(f"{path}, line {number}: it does not agree with its check sum; the file was changed")
    try:
        step: RecordedStep = msgspec.json.decode(text, type=RecordedStep)
    except msgspec.MsgspecError as problem:
        raise RecordError(f"{path}: {problem}; another version of markerseek wrote it: use that one") from problem
    if number == 1 and not isinstance(step, Begun):
        raise RecordError(f"{path}: it does not begin as the record of a session does; check the name")
    return step


def default_folder() -> Path:
    """Folder of a new session in the user's data folder; its name begins with the time, UTC."""
    return data_folder() / "registrations" / f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"


def camera_text(stereo: StereoSettings) -> str:
    """A calibration as text, by which two are compared."""
    return msgspec.json.encode(stereo).decode()
