"""The record of a registration session: a folder with `session.jsonl` and the journal of each search beside it.

`session.jsonl` is a file of lines as a journal is: each is numbered, has a check sum, and is on the disk before the
session goes on. The first says what is registered; the others are the steps of the session, the markers that were taken
among them. A line that was not finished, because the process was killed, is cut off when the session is continued;
anything else that does not agree is named. `registration.json` is there while there is a registration that holds.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol, Self

import msgspec
import numpy as np

from markerseek.core import ConfigError, RecordError, StereoPair, UInt8
from markerseek.files import MIB, as_read_error, data_folder, open_input, read_input, replace_file
from markerseek.records.journal import (
    MAGIC,
    LineFile,
    LineReader,
    await_file,
    is_written,
    line_of,
    lock,
    make_folder,
    yield_new,
)
from markerseek.registration.steps import Begun, RecordedStep
from markerseek.registration.stereo_files import StereoSettings
from markerseek.registration.view import SessionView
from markerseek.vision import decoded_image, opencv

NAME = "session.jsonl"
"""Name of the file with the steps of a session, in its folder."""

CAMERA_IMAGES = ("left.jpg", "right.jpg")
"""Names of the newest images of both cameras, in its folder."""

SPOT_IS_SET = "spot-is-set"
"""Name of the file in its folder by which another program says that the spot is set; the session removes it."""

POINTED_AT = "pointed-at"
"""Name of the file in its folder by which another program says at which pixel of the left image somebody points, as two
numbers; a run that follows removes it."""

REGISTRATION_FILE = "registration.json"
"""Name of the file of a registration."""

_VERSION = 2
"""Version of the record; newer ones are refused, and those of version 1 (markerseek 0.4) are read, and converted when
they are continued."""

_MOST_BYTES = 64 * MIB

_FORMER_HEAD = re.compile(rb"[0-9a-f]{8} \{")
"""First bytes of a record of version 1."""


class SessionRecord:
    """The record of a session, open for writing; made by `create` or `reopen`."""

    def __init__(self, folder: Path, lines: LineFile, view: SessionView, *, count: int) -> None:
        self.folder = folder
        self.view = view
        """The session after all steps that are on the disk."""
        self._lines = lines
        self._count = count

    @classmethod
    def create(cls, folder: Path, begun: Begun) -> Self:
        """Make a new record in a folder that does not exist, or holds no session."""
        path = folder / NAME
        with _as_write_error(folder):
            make_folder(folder)
            _require_new(path)
            lines = LineFile.create(path, _first_line(begun), mode=0o600)
        return cls(folder, lines, SessionView(source=folder).after(begun), count=1)

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """Open the record of a session to continue it; ``path``: its folder, or a file in it."""
        folder = session_folder(path) or path
        path = folder / NAME
        # Refuses what is no session before it is opened for writing.
        read_session(folder)
        with _as_write_error(folder):
            _convert(path)
            lines, reader = LineFile.reopen(path, lambda descriptor: _ReadSteps(path, descriptor))
        try:
            record = cls(folder, lines, view_of(reader.steps, folder), count=len(reader.steps))
            # The program may have been killed between a step and its file.
            record._hand_on()
        except BaseException:
            lines.close()
            raise
        return record

    def add(self, step: RecordedStep) -> None:
        """Record a step, which is on the disk when this returns, and then the file of the registration.

        Raises `RecordError` if it cannot be written; if the disk is full, the partial line is removed.
        """
        if self._lines.is_changed():
            raise RecordError(
                f"{self._lines.path}: it was changed, removed or replaced while the session was written; what it holds "
                "is not known any more"
            )
        view = self.view.after(step)
        before = self.view.registration
        if view.registration is None and before is not None:
            # First, so that a program that is killed here leaves no file of what is withdrawn.
            with _as_write_error(self.folder):
                (self.folder / REGISTRATION_FILE).unlink(missing_ok=True)
        end = self._lines.end
        try:
            with _as_write_error(self.folder):
                self._lines.append(_step_line(step, self._count))
        finally:
            # A signal can arrive when all of it is written: then it stays.
            if self._lines.end > end:
                self.view = view
                self._count += 1
            elif view.registration is None and before is not None:
                with suppress(RecordError):
                    self._hand_on()
        if view.registration is not before:
            self._hand_on()

    def _hand_on(self) -> None:
        """Write the registration that holds for other programs; remove the file if none does."""
        path = self.folder / REGISTRATION_FILE
        known = self.view.registration
        with _as_write_error(self.folder):
            try:
                if known is not None:
                    values = msgspec.to_builtins(known.report) | self._simulation
                    with replace_file(path) as part:
                        part.write_bytes(msgspec.json.format(msgspec.json.encode(values)))
            except OSError:
                # The former registration does not hold any more, whether or not there is room for the new one.
                path.unlink(missing_ok=True)
                raise
            if known is None:
                path.unlink(missing_ok=True)

    @property
    def begun(self) -> Begun:
        """What the session registers."""
        assert self.view.begun is not None  # noqa: S101  the first step, as it was written or read
        return self.view.begun

    @property
    def _simulation(self) -> dict[str, object]:
        """What the file of a simulated registration has more."""
        return {"simulation": {"simulated": True, "seed": self.begun.seed}} if self.begun.simulated else {}

    def show(self, pair: StereoPair) -> None:
        """Put the newest images into the folder, as `CAMERA_IMAGES`, for those who look on."""
        show_pair(self.folder, pair)

    def keep_pair(self, name: str, pair: StereoPair) -> None:
        """Keep the images without light of a marker, with which those of later markers are compared."""
        for path, image in zip(_kept(self.folder, name), (pair.left, pair.right), strict=True):
            # Without loss: fine texture is compared.
            _, coded = opencv("images of a session").imencode(".png", image)
            with _as_write_error(self.folder), replace_file(path) as part:
                part.write_bytes(coded.tobytes())

    def kept_pair(self, name: str) -> StereoPair | None:
        """Return the images without light of a marker; None if they were not kept, or cannot be read."""
        return kept_pair(self.folder, name)

    def journal_path(self, name: str) -> Path:
        """Return the path of a journal for the search of a marker; another one for each try."""
        tries = 1
        while (path := self.folder / f"{name}{'' if tries == 1 else f'-{tries}'}.journal").exists():
            tries += 1
        return path

    def close(self) -> None:
        """Close it; allowed twice."""
        self._lines.close()


def show_pair(folder: Path, pair: StereoPair) -> None:
    """Put the newest images into the folder of a session, as `CAMERA_IMAGES`, for those who look on."""
    for name, image in zip(CAMERA_IMAGES, (pair.left, pair.right), strict=True):
        _, coded = opencv("images of a session").imencode(".jpg", image)
        with _as_write_error(folder), replace_file(folder / name) as part:
            part.write_bytes(coded.tobytes())


def kept_pair(folder: Path, name: str) -> StereoPair | None:
    """Return the images without light of a marker of a session; None if they were not kept, or cannot be read."""
    return _pair(*_kept(folder, name))


def newest_pair(folder: Path) -> StereoPair | None:
    """Return the newest images of a session; None if there are none that can be read."""
    left, right = (folder / name for name in CAMERA_IMAGES)
    return _pair(left, right)


def _kept(folder: Path, name: str) -> tuple[Path, Path]:
    return folder / f"{name}-left.png", folder / f"{name}-right.png"


def _pair(left: Path, right: Path) -> StereoPair | None:
    left_image = _image(left)
    right_image = _image(right)
    if left_image is None or right_image is None:
        return None
    return StereoPair(left=left_image, right=right_image, at_s=0.0)


def _image(path: Path) -> UInt8[np.ndarray, "rows columns"] | None:
    """Return an image of the record; None if there is none that can be read."""
    try:
        return decoded_image(read_input(path, most_bytes=_MOST_BYTES))
    except (ConfigError, RecordError, OSError):
        return None


def _first_line(begun: Begun) -> bytes:
    """Return line 0 of a record."""
    return line_of({"session": _VERSION, "begun": begun})


def _step_line(step: RecordedStep, number: int) -> bytes:
    """Return the line of a step."""
    return line_of({"number": number, "written": datetime.now(UTC).isoformat(), "body": step})


def _require_new(path: Path) -> None:
    """Refuse to begin a session where there is a file already."""
    if not (path.exists() or path.is_symlink()):
        return
    with open_input(path, most_bytes=_MOST_BYTES) as file:
        head = file.read(len(b"00000000 {"))
    if head and not head.startswith(MAGIC) and not _FORMER_HEAD.match(head):
        raise RecordError(f"{path}: it is a file of another program; name another folder")
    raise RecordError(f"{path.parent}: it holds a session already; continue that session, or name another folder")


def _convert(path: Path) -> None:
    """Write a record of version 1 as one of today, with all its steps."""
    with open_input(path, most_bytes=_MOST_BYTES) as file:
        reader = _reader(path, file.fileno())
        if not isinstance(reader, _FormerSteps):
            return
        # Nobody else may continue it meanwhile.
        lock(file.fileno())
        first, *steps = _all_steps(reader)
        assert isinstance(first, Begun)  # noqa: S101  as it was read
        lines = [_first_line(first), *(_step_line(step, number) for number, step in enumerate(steps, start=1))]
        with replace_file(path) as part:
            part.write_bytes(b"".join(lines))
            part.chmod(0o600)


@contextmanager
def _as_write_error(folder: Path) -> Iterator[None]:
    """Turn errors of the file system into a `RecordError` that names the session and the cure."""
    try:
        yield
    except BlockingIOError as problem:
        raise RecordError(f"{folder}: another markerseek runs this session; wait until it ends") from problem
    except OSError as problem:
        raise RecordError(
            f"{folder}: the session cannot be recorded: {problem.strerror or problem}; make room on the disk or check "
            "the rights, then continue that session, or name another folder"
        ) from problem


def session_folder(path: Path) -> Path | None:
    """Return the folder of a session that is named by its folder, or by its record or registration; else None.

    The registration in the folder of a session holds no longer than the session says.
    """
    if path.name == NAME or (path.name == REGISTRATION_FILE and (path.parent / NAME).exists()):
        return path.parent
    return path if path.is_dir() else None


def is_running(folder: Path) -> bool:
    """Return whether a program runs the session: it has its record open for writing."""
    path = folder / NAME
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        return is_written(file.fileno())


class _Steps(Protocol):
    """Reads the steps of a session one by one, `Begun` first; `RecordError` at the first damage."""

    def next(self) -> RecordedStep | None:
        """Read the next step; None if there is none yet, or it was never finished."""


class _NumberedSteps(LineReader):
    """`_Steps` of a record of today."""

    def next(self) -> RecordedStep | None:
        _require_there(self.path, self.descriptor, self.end)
        if self._number == 0:
            return self._next_begun()
        found = self._next_line()
        if found is None:
            return None
        line, _ = found
        number = self._number
        self._number += 1
        if line.number != number:
            raise RecordError(f"{self.path}: entry {number} is missing, entry {line.number} follows; it is damaged")
        return _decoded(self.path, line.body, number)

    def _next_begun(self) -> RecordedStep | None:
        first = self._next_first()
        if first is None:
            return None
        self._number += 1
        if first.session > _VERSION:
            raise RecordError(
                f"{self.path}: it was written by a newer markerseek: the record has version {first.session}, this "
                f"one reads up to {_VERSION}; install a newer one"
            )
        return _decoded(self.path, first.begun, 0)


class _ReadSteps(_NumberedSteps):
    """All steps of a record that is opened to be continued."""

    def __init__(self, path: Path, descriptor: int) -> None:
        super().__init__(path, descriptor)
        self.steps = _all_steps(self)


class _FormerSteps:
    """`_Steps` of a record of version 1, which no program of today writes: a check sum, a space, and the step."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        content = os.pread(descriptor, _MOST_BYTES, 0)
        self._end = content.rfind(b"\n") + 1
        tail = content[self._end :]
        if tail[:-1] and _agrees(tail[:-1]):
            raise RecordError(f"{path}: the end of its last line was changed; another program changed the file")
        self._lines = enumerate(content[: self._end].splitlines())

    def next(self) -> RecordedStep | None:
        _require_there(self._path, self._descriptor, self._end)
        number, line = next(self._lines, (0, None))
        if line is None:
            return None
        if not _agrees(line):
            raise RecordError(
                f"{self._path}, line {number + 1}: it does not agree with its check sum; the file was changed"
            )
        return _decoded(self._path, line[len("00000000 ") :], number)


def _agrees(line: bytes) -> bool:
    """Return whether a line of version 1, without its end, agrees with its check sum."""
    prefix, _, text = line.partition(b" ")
    return prefix == b"%08x" % zlib.crc32(text + b"\n")


def _require_there(path: Path, descriptor: int, end: int) -> None:
    """Refuse a record that was deleted or cut while it is read: what the session says is not known any more."""
    status = os.fstat(descriptor)
    if status.st_nlink == 0:
        raise RecordError(f"{path}: it was deleted while it was followed; what the session says is not known any more")
    if status.st_size < end:
        raise RecordError(f"{path}: steps that were read are not in it any more; another program changed the file")


def _decoded(path: Path, body: bytes | msgspec.Raw, number: int) -> RecordedStep:
    """Return the step of a line."""
    try:
        step: RecordedStep = msgspec.json.decode(body, type=RecordedStep)
    except msgspec.MsgspecError as problem:
        raise RecordError(f"{path}: {problem}; another version of markerseek wrote it: use that one") from problem
    if isinstance(step, Begun) != (number == 0):
        raise RecordError(f"{path}: it does not begin as the record of a session does; check the name")
    return step


def _reader(path: Path, descriptor: int) -> _Steps:
    """Return the reader of a record, by its first bytes."""
    head = os.pread(descriptor, len(b"00000000 {"), 0)
    if _FORMER_HEAD.match(head):
        return _FormerSteps(path, descriptor)
    if not MAGIC.startswith(head[: len(MAGIC)]):
        raise RecordError(f"{path}: it does not begin as the record of a session does, or it was changed")
    return _NumberedSteps(path, descriptor)


def _all_steps(reader: _Steps) -> list[RecordedStep]:
    return list(iter(reader.next, None))


def read_session(folder: Path) -> list[RecordedStep]:
    """Return the steps of a session, `Begun` first."""
    path = folder / NAME
    if not path.is_file():
        raise RecordError(
            f"{folder}: there is no {NAME} in it, so that no session has begun; name the folder of a session, as "
            "was printed when it began"
        )
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        steps = _all_steps(_reader(path, file.fileno()))
    if not steps:
        raise RecordError(
            f"{path}: its first line is not finished, so that no session has begun; begin a new one in another folder"
        )
    return steps


def read_view(folder: Path) -> SessionView:
    """Return the session in this folder as its record has it; `RecordError` if it cannot be read."""
    return view_of(read_session(folder), folder)


def view_of(steps: Iterable[RecordedStep], folder: Path) -> SessionView:
    """Return the view of a session after its steps; `RecordError` if they cannot follow one another."""
    view = SessionView(source=folder)
    for step in steps:
        view = next_view(view, step)
    return view


def next_view(view: SessionView, step: RecordedStep) -> SessionView:
    """Return the view after a step that was read; `RecordError` with the file if it cannot follow."""
    try:
        return view.after(step)
    except RecordError as problem:
        raise RecordError(f"{(view.source or Path()) / NAME}: {problem}") from problem


def follow_session(
    folder: Path, *, is_over: Callable[[], bool] | None = None, wait: Callable[[], object]
) -> Iterator[RecordedStep]:
    """Yield the steps of a session, `Begun` first, each as soon as it is written, to the last one.

    The writer is not delayed, and nothing is lost however slowly the steps are taken. A session that is continued
    while it is followed goes on here.

    ``is_over``: whether no more will be written; None: once no program has the session open for writing. Where it is
    given, the folder need not exist yet. ``wait``: called where nothing new is there. Raises `RecordError` at the
    first line that does not agree with its check sum, and if the file is deleted or steps are cut off.
    """
    path = folder / NAME
    if is_over is not None and not await_file(path, is_over=is_over, wait=wait):
        return
    with as_read_error(path), open_input(path, most_bytes=_MOST_BYTES) as file:
        reader = _reader(path, file.fileno())
        steps: Iterator[RecordedStep] = yield_new(
            reader.next, is_over=is_over or (lambda: not is_written(file.fileno())), wait=wait
        )
        yield from steps


def sessions_folder() -> Path:
    """Return the folder of sessions whose folder nobody named, in the user's data folder."""
    return data_folder() / "registrations"


def default_folder() -> Path:
    """Return the folder of a new session in the user's data folder; its name begins with the time, UTC."""
    return sessions_folder() / f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"


def camera_text(stereo: StereoSettings) -> str:
    """Return a calibration as text, by which two are compared."""
    return msgspec.json.encode(stereo).decode()
