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
import sys
import tempfile
import time
import weakref
from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, Literal

import msgspec
import numpy as np

from markerseek.core import ChannelFrame, Estimate, Found, Interval, NotFound, Sample, SearchError, Tolerance, is_finite
from markerseek.search import SearchPolicy
from markerseek.studies import entry_child

REPLY_S = 30.0
"""Longest time for one reply in seconds."""

START_S = 180.0
"""Longest time for the first one: MATLAB takes a minute to start."""

ENVIRONMENT = ("PATH", "HOME", "USER", "LANG", "LC_ALL", "TZ", "LD_LIBRARY_PATH", "OPENBLAS_NUM_THREADS")
"""Variables of the environment that an entry is given; others by ``env NAME=VALUE`` in its command."""

_MOST_BYTES = 1 << 16
"""Longest line, and most bytes that are read or written at once."""

_LAST_BYTES = 2000
"""Bytes of standard error that are kept: an entry can write more than a disk holds."""

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
        self._fault, self._replies, self._last = "", 0, b""
        folder = tempfile.mkdtemp(prefix="entry-")
        kept = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
        read, alive = os.pipe()
        # Unbuffered pipes of our own: what has come, and no more, is read without waiting.
        ends = [os.pipe() for _ in range(3)]
        (stdin, self._stdin), (self._stdout, stdout), (self._stderr, stderr) = ends
        try:
            # The user's own command. Isolated: the environment is for that, and not for what runs it.
            self._child = subprocess.Popen(  # noqa: S603
                (sys.executable, "-I", "-S", entry_child.__file__, str(read), *command),
                stdin=stdin,
                stdout=stdout,
                stderr=stderr,
                pass_fds=(read,),
                env={**kept, "TMPDIR": folder},
                cwd=folder,
                # A group of its own, which is ended as a whole.
                start_new_session=True,
            )
        finally:
            for theirs in (read, stdin, stdout, stderr):
                os.close(theirs)
        ours = (self._stdin, self._stdout, self._stderr)
        for pipe in ours:
            # A process that it has started may hold them when it has ended: no wait for one is without a limit.
            os.set_blocking(pipe, False)
        self._end = weakref.finalize(self, _end, self._child, (alive, *ours), folder)

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
        if _read(self._stdout).strip():
            raise EntryError("it wrote a line that nobody asked for; write one for each line that comes")
        reply, *more = self._line_after(line).split(b"\n")
        if any(more):
            raise EntryError(f"it replied {reply[:60]!r}, and more; write one line for each that comes")
        self._replies += 1
        try:
            return msgspec.json.decode(reply, type=_Reply)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
            raise EntryError(
                f"it replied {reply[:60]!r}, which is no JSON of a reply: {problem}; "
                'write {"angle_deg": -12.5}, or an answer'
            ) from problem

    def _line_after(self, line: bytes) -> bytes:
        """What it writes to standard output after a line, to the end of one or beyond."""
        limit_s = REPLY_S if self._replies else START_S
        ends_s = time.monotonic() + limit_s
        received, heard = b"", [self._stdout, self._stderr]
        while b"\n" not in received:
            left_s = ends_s - time.monotonic()
            if not left_s > 0:
                raise EntryError(f"it did not reply within {limit_s:g} s{self._last_words()}")
            ready, writable, _ = select.select(heard, [self._stdin] if line else [], [], left_s)
            if writable:
                try:
                    line = line[os.write(self._stdin, line[:_MOST_BYTES]) :]
                except OSError:
                    # It reads no more; what it says last is still read.
                    line = b""
            if self._stderr in ready:
                words = _read(self._stderr)
                self._last = (self._last + words)[-_LAST_BYTES:]
                if not words:
                    heard.remove(self._stderr)
            if self._stdout in ready:
                piece = _read(self._stdout)
                received += piece
                if not piece:
                    raise EntryError(f"it ended where a reply was due{self._last_words()}")
                if len(received) > _MOST_BYTES:
                    raise EntryError(f"it replied with more than {_MOST_BYTES} bytes{self._last_words()}")
        return received

    def _last_words(self) -> str:
        """The last line that it wrote to standard error."""
        self._last = (self._last + _read(self._stderr))[-_LAST_BYTES:]
        lines = self._last.decode("utf-8", "replace").strip().splitlines()
        return f"; its last words: {lines[-1][:200]}" if lines else ""


@lru_cache(maxsize=4)
def _child(command: tuple[str, ...]) -> EntryProcess:
    """The child of a command, one in each worker."""
    return EntryProcess(command)


def _read(pipe: int) -> bytes:
    """What has come, without waiting; nothing at its end, too."""
    try:
        return os.read(pipe, _MOST_BYTES)
    except BlockingIOError:
        return b""


def _end(child: subprocess.Popen[bytes], pipes: Sequence[int], folder: str) -> None:
    with suppress(OSError):
        os.killpg(child.pid, signal.SIGKILL)
    for pipe in pipes:
        os.close(pipe)
    child.wait()
    shutil.rmtree(folder, ignore_errors=True)
