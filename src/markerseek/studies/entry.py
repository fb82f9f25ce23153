"""A search method of somebody else as a child process: one line of JSON goes to it, one comes back.

It needs nothing of this package, and may be written in any language. To the line of a search, and to that of each
sample, it replies with the next angle (``{"angle_deg": -12.5}``) or with its answer. It is not trusted: silence,
anything but such a line, and an angle out of range end the entry with an `EntryError`, in the words of the fault. It
begins in an empty folder, with the variables `ENVIRONMENT` and no others.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import weakref
from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import IO, Any, Literal

import msgspec
import numpy as np

from markerseek.core import ChannelFrame, Estimate, Found, Interval, NotFound, Sample, SearchError, Tolerance, is_finite
from markerseek.search import SearchPolicy

REPLY_S = 30.0
"""Longest time for one reply in seconds."""

START_S = 180.0
"""Longest time for the first one: MATLAB takes a minute to start."""

ENVIRONMENT = ("PATH", "HOME", "USER", "LANG", "LC_ALL", "TZ", "LD_LIBRARY_PATH", "OPENBLAS_NUM_THREADS")
"""Variables of the environment that an entry is given; others by ``env NAME=VALUE`` in its command."""

_MOST_BYTES = 1 << 16
"""Longest line that it may write."""

_LAST_BYTES = 2000
"""Bytes of standard error in which the last line is looked for."""

_SIGMAS_OF_95 = 3.92
"""Width of the 95 % interval of a normal distribution over its standard deviation."""


class EntryError(SearchError):
    """An entry did not keep to the contract; the message says in what."""


class _Reply(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The next angle, or, with ``answer``, the answer."""

    answer: Literal["found", "unsure", "not found"] | None = None
    angle_deg: float | None = None
    low_deg: float | None = None
    high_deg: float | None = None


class EntryPolicy(SearchPolicy):
    """The policy of one search that asks a child process, which is kept for the searches that follow.

    ``command``: its words. ``acquisitions``: most that it may ask for. ``start_deg``: present angle of the probe.
    ``channels``: whether it receives the channel data.
    """

    name = "entry"

    def __init__(
        self,
        command: Sequence[str],
        *,
        limits: Interval,
        acquisitions: int,
        start_deg: float | None = None,
        tolerance: Tolerance,
        channels: bool = True,
    ) -> None:
        super().__init__()
        self._child = _child(tuple(command))
        self._limits, self._acquisitions, self._channels = limits, acquisitions, channels
        ends = {"low_deg": limits.low_deg, "high_deg": limits.high_deg, "start_deg": start_deg}
        self._search = {"type": "search", **ends, "acquisitions": acquisitions, "tolerance_mm": tolerance.mm}
        self._answer: Estimate | None = None

    def _next_deg(self) -> float | None:
        """Next angle in degrees; None once it has answered."""
        if self._answer is not None:
            return None
        if self._lit:
            message = {"type": "sample", **self._message(self._lit[-1])}
        else:
            message = {**self._search, "dark": [self._message(sample) for sample in self._dark]}
        reply = self._child.reply_to(message)
        if reply.answer is not None:
            self._answer = self._estimate_of(reply)
            return None
        if len(self._lit) >= self._acquisitions:
            raise EntryError(f"it asked for more than the {self._acquisitions} acquisitions that it may make")
        return self._within(reply.angle_deg)

    def estimate(self) -> Estimate:
        """The answer; `NotFound` before there is one."""
        return self._answer or NotFound(mean_deg=self._limits.centre_deg, reason="the entry has not answered yet")

    def _estimate_of(self, reply: _Reply) -> Estimate:
        if reply.answer == "not found":
            return NotFound(mean_deg=self._limits.centre_deg, reason="the entry says so")
        angle_deg, widest_deg = self._within(reply.angle_deg), 2 * self._limits.width_deg
        low_deg, high_deg = reply.low_deg, reply.high_deg
        # An interval of any width holds the marker: a wide one must not count as one that does.
        if (
            not (is_finite(low_deg) and is_finite(high_deg) and low_deg <= angle_deg <= high_deg)
            or not 0 < high_deg - low_deg <= widest_deg
        ):
            raise EntryError(
                f"it answered {reply.answer!r} at {angle_deg:g} deg with an interval from {low_deg} to {high_deg} deg; "
                f"low_deg and high_deg must be finite, hold the angle between them, and be at most {widest_deg:g} deg "
                "apart: state how certain the angle is, or answer 'not found'"
            )
        found = Found(
            mean_deg=angle_deg,
            sigma_deg=(high_deg - low_deg) / _SIGMAS_OF_95,
            interval95_deg=Interval(low_deg=low_deg, high_deg=high_deg),
            interval_kind="propagated",
        )
        return found if reply.answer == "found" else found.as_unsure("source", "the entry says so")

    def _message(self, sample: Sample) -> dict[str, Any]:
        """What an entry receives of a sample: all that its tier has."""
        reading, frame = sample.reading, sample.frame
        message: dict[str, Any] = {"angle_deg": sample.angle_deg, "intensity": reading.intensity}
        if reading.noise_sigma is not None:
            message["noise_sigma"] = reading.noise_sigma
        blocks = reading.local_maxima
        if blocks is not None:
            message["blocks"] = {name: getattr(blocks, name) for name in _BLOCKS}
            message["blocks"]["intensities"] = np.frombuffer(blocks.intensities, "<f4").tolist()
        if self._channels and isinstance(frame, ChannelFrame):
            message["channels"] = {
                "shape": list(frame.samples.shape),
                "sampling_hz": frame.sampling_hz,
                "int16": b64encode(frame.samples.astype("<i2").tobytes()).decode("ascii"),
            }
        return message

    def _within(self, angle_deg: float | None) -> float:
        if angle_deg is None or not is_finite(angle_deg) or angle_deg not in self._limits:
            raise EntryError(f"angle_deg is {angle_deg} deg, it must be a finite number in the range {self._limits}")
        return angle_deg


_BLOCKS = ("first_lateral_m", "first_depth_m", "lateral_step_m", "depth_step_m", "columns")


class EntryProcess:
    """A child process that replies to lines; after its first fault it is not asked again."""

    def __init__(self, command: tuple[str, ...]) -> None:
        self._fault, self._replies = "", 0
        folder = tempfile.mkdtemp(prefix="entry-")
        kept = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
        # It appends, wherever the last of it is read meanwhile.
        self._errors = tempfile.TemporaryFile("a+b")  # noqa: SIM115  as long as the child
        try:
            self._child = subprocess.Popen(  # noqa: S603  the user's own command
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                # Unbuffered: what has come, and no more, is read without waiting.
                bufsize=0,
                env={**kept, "TMPDIR": folder},
                cwd=folder,
                # A group of its own, which is ended as a whole.
                start_new_session=True,
            )
        except OSError as problem:
            shutil.rmtree(folder)
            self._errors.close()
            raise EntryError(f"{command[0]}: it cannot be started: {problem.strerror}; check the command") from problem
        self._end = weakref.finalize(self, _end, self._child, folder, self._errors)

    def reply_to(self, message: dict[str, Any]) -> _Reply:
        """The reply to one message; `EntryError` where there is none, or it is not one."""
        if self._fault:
            raise EntryError(self._fault)
        try:
            return self._exchange(msgspec.json.encode(message) + b"\n")
        except EntryError as problem:
            self._fault = str(problem)
            self._end()
            raise

    def _exchange(self, line: bytes) -> _Reply:
        child = self._child
        assert child.stdin is not None  # noqa: S101  a pipe, as it was started
        assert child.stdout is not None  # noqa: S101
        # Else the angle of one sample would be taken for that of the next.
        if select.select([child.stdout], [], [], 0)[0] and child.stdout.read(_MOST_BYTES):
            raise EntryError("it wrote a line that nobody asked for; write one for each line that comes")
        limit_s, began_s = REPLY_S if self._replies else START_S, time.monotonic()
        # At its end a read and a write return.
        late = threading.Timer(limit_s, _kill, (child.pid,))
        late.start()
        try:
            with suppress(BrokenPipeError):
                while line:
                    line = line[os.write(child.stdin.fileno(), line) :]
            reply = child.stdout.readline(_MOST_BYTES)
        finally:
            late.cancel()
        if not reply.endswith(b"\n"):
            if time.monotonic() - began_s >= limit_s:
                raise EntryError(f"it did not reply within {limit_s:g} s{self._last_words()}")
            ended = "it ended where a reply was due" if len(reply) < _MOST_BYTES else f"it replied {reply[:60]!r}…"
            raise EntryError(f"{ended}{self._last_words()}")
        self._replies += 1
        try:
            return msgspec.json.decode(reply, type=_Reply)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
            raise EntryError(
                f"it replied {reply[:60].rstrip()!r}, which is no JSON of a reply: {problem}; "
                'write {"angle_deg": -12.5}, or an answer'
            ) from problem

    def _last_words(self) -> str:
        """The last line that it wrote to standard error."""
        self._child.kill()
        self._child.wait()
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - _LAST_BYTES))
        lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return f"; its last words: {lines[-1][:200]}" if lines else ""


@lru_cache(maxsize=4)
def _child(command: tuple[str, ...]) -> EntryProcess:
    """The child of a command, one in each worker."""
    return EntryProcess(command)


def _end(child: subprocess.Popen[bytes], folder: str, errors: IO[bytes]) -> None:
    _kill(child.pid)
    child.wait()
    for file in (child.stdin, child.stdout, errors):
        if file is not None:
            file.close()
    shutil.rmtree(folder, ignore_errors=True)


def _kill(group: int) -> None:
    with suppress(OSError):
        os.killpg(group, signal.SIGKILL)
