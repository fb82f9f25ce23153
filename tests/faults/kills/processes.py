"""Work in child processes that are killed, and the events that they acknowledged before."""

from __future__ import annotations

import math
import os
import random
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from unittest import mock

from markerseek.cli import main
from markerseek.records.result import Recorder

from .searches import arming_watched


class MismatchError(AssertionError):
    """A required property does not hold."""


@dataclass(frozen=True)
class End:
    """How a process ended.

    Attributes
    ----------
    acknowledged
        Events that it acknowledged before: bytes that those outside had read.
    place
        Where a fuse killed it; empty for any other death.
    killed
        Whether it was killed.
    code
        Its exit code otherwise.
    first_s, took_s
        Seconds from its beginning to the first event that it acknowledged, and to its end.
    """

    acknowledged: int
    place: str
    killed: bool
    code: int
    first_s: float
    took_s: float


@dataclass(frozen=True)
class Death:
    """When a process is killed: `then_s` seconds after it has acknowledged `events` events."""

    events: int
    then_s: float


@dataclass(frozen=True)
class Lifetime:
    """How long a process lives that is not killed, and how many events it acknowledges."""

    events: int
    first_s: float
    took_s: float

    def death(self, chance: random.Random) -> Death:
        """A random moment of it: before the first event, or at any time between two."""
        events = chance.randrange(self.events)
        between_s = (self.took_s - self.first_s) / self.events
        then_s = chance.uniform(0.7, 1.0) * self.first_s if events == 0 else chance.uniform(0.0, 1.2) * between_s
        return Death(events, then_s)


def forked(work: Callable[..., object]) -> tuple[int, int, float]:
    """Do work in a forked process; its number, the pipe with what it acknowledges, and when it began come back."""
    receiving, ack_fd = os.pipe()
    began_s = time.monotonic()
    child = os.fork()
    if child == 0:
        os.close(receiving)
        _work_and_exit(work, ack_fd)
    os.close(ack_fd)
    return child, receiving, began_s


def in_a_process(work: Callable[..., object], *, death: Death | None = None) -> End:
    """Do work in a forked process, and kill it from outside, if it lives that long."""
    child, receiving, began_s = forked(work)
    received, first_s = listen(receiving, child, death)
    _, status = os.waitpid(child, 0)
    return ended(received, status, first_s=first_s, took_s=time.monotonic() - began_s)


def listen(receiving: int, child: int, death: Death | None) -> tuple[bytes, float]:
    """Bytes that a process writes until its end, and the seconds to the first; it is killed when its time has come."""
    began_s = time.monotonic()
    received, first_s, due_s = b"", math.inf, math.inf
    while True:
        if death is not None and due_s == math.inf and len(received) >= death.events:
            due_s = time.monotonic() + death.then_s
        left_s = None if due_s == math.inf else max(due_s - time.monotonic(), 0.0)
        if not select.select([receiving], [], [], left_s)[0]:
            os.kill(child, signal.SIGKILL)
            death, due_s = None, math.inf
        elif data := os.read(receiving, 65536):
            received += data
            first_s = min(first_s, time.monotonic() - began_s)
        else:
            os.close(receiving)
            return received, first_s


def ended(received: bytes, status: int, *, first_s: float = math.inf, took_s: float) -> End:
    """How a process ended, from the bytes that it wrote and its exit status."""
    return End(
        acknowledged=received.count(b"."),
        place=received.replace(b".", b"").decode(),
        killed=os.WIFSIGNALED(status),
        code=os.WEXITSTATUS(status) if os.WIFEXITED(status) else -1,
        first_s=first_s,
        took_s=took_s,
    )


def _work_and_exit(work: Callable[..., object], ack_fd: int) -> None:
    code = 99
    try:
        work(ack_fd=ack_fd)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    except BaseException:  # noqa: BLE001  a forked process must not run on in its parent's work
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def require_well(end: End, *codes: int) -> None:
    """Refuse a process that ended by itself, with another exit code than these."""
    if not end.killed and end.code not in codes:
        raise MismatchError(f"a process ended by itself with exit code {end.code}")


def acknowledge_events(ack_fd: int) -> None:
    """Have every command in this process write a byte for each event that the journal has handed on."""
    add = Recorder.add

    def acknowledging(self: Recorder, event: object) -> None:
        os.write(ack_fd, b".")
        add(self, event)  # type: ignore[arg-type]

    mock.patch.object(Recorder, "add", acknowledging).start()


def _watching_arming() -> None:
    from markerseek import runs

    rebuild_rig = runs.rebuild_rig

    def watched(*args: object, **named: object) -> object:
        rig = rebuild_rig(*args, **named)  # type: ignore[arg-type]
        arming_watched(rig).__enter__()
        return rig

    mock.patch.object(runs, "rebuild_rig", watched).start()


def _command(words: Sequence[str], out: Path, *, ack_fd: int) -> None:
    sys.argv = ["markerseek", *words]
    # Under nohup it would be ignored, and so would Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for stream, name in ((sys.stdout, "out"), (sys.stderr, "err")):
        place = os.open(f"{out}.{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        stream.flush()
        os.dup2(place, {"out": 1, "err": 2}[name])
    acknowledge_events(ack_fd)
    _watching_arming()
    main()


def warm(*words: object) -> None:
    """Run a command once in this process, so that forked ones find its modules already imported."""
    with (
        mock.patch.object(sys, "argv", ["markerseek", *map(str, words)]),
        redirect_stdout(StringIO()),
        redirect_stderr(StringIO()),
        suppress(SystemExit),
    ):
        main()


def command(*words: object, out: Path, death: Death | None = None, before: Callable[[int], None] | None = None) -> End:
    """`markerseek` in a process of its own; what it prints lies at OUT.out and OUT.err.

    The process is forked from this one, which has imported everything: what is killed is the command, not the start of
    Python. `before` is called in it, with the pipe to those outside.
    """

    def work(*, ack_fd: int) -> None:
        if before is not None:
            before(ack_fd)
        _command([str(word) for word in words], out, ack_fd=ack_fd)

    return in_a_process(work, death=death)
