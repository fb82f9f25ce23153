"""A command of markerseek as a child process, with its stream of events on a pipe.

The child has the bridge's terminal: a rig of devices asks there whether it may be armed, and ends with exit code 4 if
nobody answers. It stops, with the laser off, when the pipe's reader ends, so also when the bridge is killed.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import msgspec

from markerseek.records.stream import StreamDecoder, StreamItem

TERMINATE_S = 2.0
"""Time from SIGINT to SIGTERM when a child is stopped, in seconds: SIGINT is ignored in what a script starts with &."""

_NO_FAULT = frozenset({0, 3, 4, 128 + signal.SIGINT, 128 + signal.SIGTERM})
"""Exit codes of commands that gave an answer, were not armed, or were stopped."""

_READ_BYTES = 1 << 20
_MOST_ANSWER_BYTES = 1 << 24
"""Largest JSON object of a command; the result of 500 acquisitions has 100 kilobytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a child ended.

    Attributes
    ----------
    exit_code
        That of the command: 0 found, 3 any other answer, 1 a fault, 2 wrong usage, 4 not armed; 128 + the signal's
        number if it was stopped or killed.
    answer
        The JSON object that it printed: its result, or an object with ``error`` and ``kind``; None if it printed none.
    """

    exit_code: int
    answer: dict[str, Any] | None

    @property
    def answered(self) -> bool:
        """Whether the search came to its end: with a marker, or with any other answer."""
        return self.exit_code in {0, 3}

    @property
    def failed(self) -> bool:
        """Whether it ended by a fault, neither with an answer nor because somebody stopped it or did not arm it."""
        return self.exit_code not in _NO_FAULT

    @property
    def message(self) -> str:
        """One sentence for whoever asked."""
        if self.exit_code == 4:
            return (
                "not armed: nothing moved and nothing was fired; a person must arm the rig in the terminal of the "
                "bridge or page"
            )
        answer = self.answer or {}
        if "error" in answer:
            return str(answer["error"])
        if answer.get("as_published"):
            return f"angle {answer['angle_deg']:.3f} deg, nothing is claimed: the paper's form always answers"
        if "answer" in answer:
            # Other answers have an angle too, which is for programs: nothing is claimed there.
            angle = f" at {answer['angle_deg']:.3f} deg" if answer["answer"] == "found" else ""
            reason = f": {answer['reason']}" if answer.get("reason") else ""
            return f"{answer['answer']}{angle}{reason}"
        killed = {128 + each: f", by {each.name}" for each in signal.Signals}.get(self.exit_code, "")
        return f"the command ended with exit code {self.exit_code}{killed}"


class ChildRun:
    """A running command. Read `items` to its end, then ask for `outcome`; a context manager stops it at the end.

    Parameters
    ----------
    arguments
        Command and options, such as ``["search", "--seed", "1"]``; ``--json`` and those of the stream are added.
    frames
        Whether the channel data of each acquisition are sent too.
    """

    def __init__(self, arguments: Sequence[str], *, frames: bool = False) -> None:
        self._reading, writing = os.pipe()
        # A file and no pipe: nobody reads the answer before the end, and a pipe would fill up.
        self._answer = tempfile.TemporaryFile()  # noqa: SIM115  closed in `outcome`
        self._decoder = StreamDecoder()
        self._outcome: Outcome | None = None
        self._lock = threading.Lock()
        self._stopped = False
        stream = ["--events", f"/dev/fd/{writing}", "--stop-with-reader", *(["--event-frames"] if frames else [])]
        try:
            # -P: a file in the current folder must not replace a module.
            self._process = subprocess.Popen(  # noqa: S603  no shell; the arguments are ours
                [sys.executable, "-P", "-m", "markerseek", *arguments, *stream, "--json"],
                stdout=self._answer,
                pass_fds=(writing,),
            )
        except BaseException:
            os.close(self._reading)
            self._answer.close()
            raise
        finally:
            # The child's copy must be the last: only then does the pipe end with it.
            os.close(writing)

    def items(self) -> Iterator[StreamItem]:
        """Head, events and end, each as it arrives; waits for the next.

        Raises
        ------
        RecordError
            If the child sends something else.
        """
        while data := os.read(self._reading, _READ_BYTES):
            yield from self._decoder.feed(data)

    def stop(self) -> None:
        """Stop the run; returns at once, and may be called again, and by any thread.

        The child stops the rig, and its stream ends. After `TERMINATE_S` it is sent SIGTERM as well.
        """
        with self._lock:
            again, self._stopped = self._stopped, True
        # Once: a second signal would only disturb how it ends.
        if not again and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            timer = threading.Timer(TERMINATE_S, self._process.terminate)
            timer.daemon = True
            timer.start()

    def kill(self) -> None:
        """Kill it, where it does not stop; its supervisor then stops the rig, and its journal can be resumed."""
        self._process.kill()

    @property
    def running(self) -> bool:
        """Whether the child lives."""
        return self._process.poll() is None

    @property
    def process_id(self) -> int:
        """Its process id."""
        return self._process.pid

    def outcome(self) -> Outcome:
        """How it ended; waits for its end. The stream must have been read to its end, or `stop` been called."""
        code = self._process.wait()
        with self._lock:
            if self._outcome is None:
                self._answer.seek(0)
                text = self._answer.read(_MOST_ANSWER_BYTES)
                self._answer.close()
                os.close(self._reading)
                answer = _object(text)
                if self._stopped and code == 1 and answer is None:
                    # Stopped while Python itself was starting, which knows no other exit code.
                    code = -signal.SIGINT
                self._outcome = Outcome(exit_code=code if code >= 0 else 128 - code, answer=answer)
            return self._outcome

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.stop()
        self.outcome()


def _object(text: bytes) -> dict[str, Any] | None:
    try:
        value = msgspec.json.decode(text)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
