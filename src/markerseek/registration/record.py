"""The record of a registration session: a folder with `session.jsonl` and the journal of each search beside it.

A line of `session.jsonl` is on the disk before the session goes on, and begins with the CRC-32 of the rest. The first
line says what is registered; the others are the steps of the session, the markers that were taken among them. A line
that was not finished, because the process was killed, is cut off when the session is continued; anything else that
does not agree is named. `registration.json` is there while there is a registration that holds.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import msgspec

from markerseek.core import RecordError, StereoPair
from markerseek.files import (
    MIB,
    as_read_error,
    data_folder,
    open_for_writing,
    open_input,
    read_input,
    replace_file,
    sync_folder,
)
from markerseek.records.journal import is_written, lock, make_folder
from markerseek.registration.report import RegistrationReport
from markerseek.registration.steps import Begun, MovedMarker, RecordedStep, Registered, TakenMarker
from markerseek.registration.stereo_files import StereoSettings
from markerseek.vision import opencv

NAME, CAMERA_IMAGES = "session.jsonl", ("left.jpg", "right.jpg")
"""Names of the files in the folder of a session: its steps, and the newest images of both cameras."""

REGISTRATION = "registration.json"
"""Name of the file of a registration."""

_MOST_BYTES = 64 * MIB

_HEAD_BYTES = 10
_UNFINISHED = re.compile(rb"[0-9a-f]{0,8}|[0-9a-f]{8} \{?")
"""How a record begins, whose first line may have been cut off anywhere, and how many bytes show it."""


class SessionRecord:
    """The record of a session, open for writing; made by `create` or `reopen`."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        """Take a record that is open; `RecordError` if another program writes it."""
        self.folder, self._descriptor = folder, descriptor
        self.begun: Begun
        self.taken: list[TakenMarker] = []
        """Markers that were taken; not those that are one of them, measured again."""
        try:
            lock(descriptor)
        except BlockingIOError as problem:
            self.close()
            raise RecordError(f"{folder}: another markerseek runs this session; wait until it ends") from problem

    @classmethod
    def create(cls, folder: Path, begun: Begun) -> Self:
        """A new record in a folder that does not exist, or holds no session."""
        with _as_write_error(folder):
            make_folder(folder)
            record = cls(folder, open_for_writing(folder / NAME, os.O_RDWR | os.O_CREAT | os.O_APPEND, mode=0o600))
        try:
            record._begin(begun)
        except BaseException:
            record.close()
            raise
        return record

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Open the record of a session to continue it; ``path``: its folder, or the file in it."""
        folder = session_folder(path) or path
        # Refuses what is no session before it is opened for writing.
        read_session(folder)
        with _as_write_error(folder):
            record = cls(folder, open_for_writing(folder / NAME, os.O_RDWR | os.O_APPEND))
        try:
            # Read again, now that nobody else writes.
            (begun, *steps), end = read_session(folder)
            assert isinstance(begun, Begun)  # noqa: S101  as it was read
            with _as_write_error(folder):
                os.ftruncate(record._descriptor, end)
        except BaseException:
            record.close()
            raise
        record.begun = begun
        record.taken += [step for step in steps if isinstance(step, TakenMarker) and step.again is None]
        return record

    def add(self, step: RecordedStep) -> None:
        """Record a step; it is on the disk when this returns, and nothing of it is read if this fails for want of room.

        Raises `RecordError` if it cannot be written.
        """
        self._write(step)
        match step:
            case TakenMarker(again=None):
                self.taken.append(step)
            case Registered():
                self._keep(step.report if step.decided else None)
            case MovedMarker(moved=True):
                self._keep(None)
            case _:
                pass

    def _keep(self, report: RegistrationReport | None) -> None:
        """Write the registration for other programs; None takes it away."""
        path = self.folder / REGISTRATION
        with _as_write_error(self.folder):
            if report is None:
                path.unlink(missing_ok=True)
                return
            simulation = {"simulation": {"simulated": True, "seed": self.begun.seed}} if self.begun.simulated else {}
            with replace_file(path) as part:
                part.write_bytes(msgspec.json.format(msgspec.json.encode(msgspec.to_builtins(report) | simulation)))

    def show(self, pair: StereoPair) -> None:
        """Put the newest images into the folder, as `CAMERA_IMAGES`, for those who look on."""
        for name, image in zip(CAMERA_IMAGES, (pair.left, pair.right), strict=True):
            _, coded = opencv("images of a session").imencode(".jpg", image)
            with _as_write_error(self.folder), replace_file(self.folder / name) as part:
                part.write_bytes(coded.tobytes())

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

    def _begin(self, begun: Begun) -> None:
        path = self.folder / NAME
        # A first line that was never finished is no session.
        if _whole_lines(self._descriptor, 0, path):
            raise RecordError(
                f"{self.folder}: it holds a session already; continue it by --continue, or name another folder"
            )
        with _as_write_error(self.folder):
            if not _UNFINISHED.fullmatch(os.pread(self._descriptor, _HEAD_BYTES, 0)):
                raise RecordError(f"{path}: it is a file of another program; name another folder")
            os.ftruncate(self._descriptor, 0)
            sync_folder(self.folder)
        self.begun = begun
        self._write(begun)

    def _write(self, value: RecordedStep) -> None:
        text = msgspec.json.encode(value) + b"\n"
        left = memoryview(b"%08x " % zlib.crc32(text) + text)
        with _as_write_error(self.folder):
            end = os.fstat(self._descriptor).st_size
            try:
                # The system may take less than it is given.
                while left:
                    left = left[os.write(self._descriptor, left) :]
            except OSError:
                # The next line must not begin within this one.
                os.ftruncate(self._descriptor, end)
                raise
            os.fdatasync(self._descriptor)


@contextmanager
def _as_write_error(folder: Path) -> Iterator[None]:
    """Turn errors of the file system into a `RecordError` that names the session and the cure."""
    try:
        yield
    except OSError as problem:
        raise RecordError(
            f"{folder}: the session cannot be recorded: {problem.strerror or problem}; make room on the disk or check "
            "the rights, then continue the session by --continue, or name another folder"
        ) from problem


def session_folder(path: Path) -> Path | None:
    """Folder of a session that is named by its folder, or by the record in it; None for another file."""
    if path.name == NAME:
        return path.parent
    return path if path.is_dir() else None


def is_running(folder: Path) -> bool:
    """Whether a program runs the session: it has its record open for writing."""
    path = folder / NAME
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        return is_written(file.fileno())


def read_session(folder: Path) -> tuple[list[RecordedStep], int]:
    """The steps of a session, `Begun` first, and the bytes up to the end of its last whole line."""
    path = folder / NAME
    if not path.is_file():
        raise RecordError(
            f"{folder}: there is no {NAME} in it, so that no session has begun; name the folder of a session, as "
            "`register` prints it"
        )
    with as_read_error(path):
        content = read_input(path, most_bytes=_MOST_BYTES)
    end = content.rfind(b"\n") + 1
    tail = content[end:]
    if tail[:-1] and _agrees(tail[:-1]):
        raise RecordError(f"{path}: the end of its last line was changed; another program changed the file")
    steps = [_step(line, path, number) for number, line in enumerate(content[:end].splitlines(), start=1)]
    if not steps:
        raise RecordError(
            f"{path}: its first line is not finished, so that no session has begun; try again, or begin a new one"
        )
    return steps, end


def follow_session(
    folder: Path, *, is_over: Callable[[], bool] | None = None, wait: Callable[[], object]
) -> Iterator[RecordedStep]:
    """The steps of a session, `Begun` first, each as soon as it is written, to the last one.

    The writer is not delayed, and nothing is lost however slowly the steps are taken. A session that is continued
    while it is followed goes on here.

    ``is_over``: whether no more will be written; None: once no program has the session open for writing. Where it is
    given, the folder need not exist yet. ``wait``: called where nothing new is there. Raises `RecordError` at the
    first line that does not agree with its check sum, and if the file is deleted or steps are cut off.
    """
    path = folder / NAME
    while is_over is not None and not path.exists():
        if is_over() and not path.exists():
            return
        wait()
    end = number = 0
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        while True:
            # Asked before the file is read: what was written before the end is read after it.
            over = not is_written(file.fileno()) if is_over is None else is_over()
            lines = _whole_lines(file.fileno(), end, path)
            for line in lines.splitlines():
                number += 1
                yield _step(line, path, number)
            end += len(lines)
            if over:
                return
            wait()


def _whole_lines(descriptor: int, begin: int, path: Path) -> bytes:
    """What is written behind a place, up to the last line that is finished.

    The rest is read again from its beginning: it may be cut off meanwhile.
    """
    status = os.fstat(descriptor)
    if status.st_nlink == 0:
        raise RecordError(f"{path}: it was deleted while it was followed; what the session says is not known any more")
    if status.st_size < begin:
        raise RecordError(f"{path}: steps that were read are not in it any more; another program changed the file")
    content = os.pread(descriptor, min(status.st_size - begin, _MOST_BYTES), begin)
    return content[: content.rfind(b"\n") + 1]


def _agrees(line: bytes) -> bool:
    """Whether a line, without its end, agrees with its check sum."""
    prefix, _, text = line.partition(b" ")
    return prefix == b"%08x" % zlib.crc32(text + b"\n")


def _step(line: bytes, path: Path, number: int) -> RecordedStep:
    """The step in a line without its end."""
    _, _, text = line.partition(b" ")
    if not _agrees(line):
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
