"""A search method of somebody else as a child process: one line of JSON goes to it, one comes back.

It needs nothing of this package, and may be written in any language. To the line of a search, and to that of each
sample, it replies with the next angle (``{"angle_deg": -12.5}``) or with its answer. It is not trusted: silence,
anything but such a line, and an angle out of range end the entry with an `EntryError`, in the words of the fault.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
import weakref
from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import IO, Any, Literal

import msgspec
import numpy as np

from markerseek.core import (
    ChannelFrame,
    Estimate,
    Found,
    Interval,
    NotFound,
    Sample,
    SearchError,
    Tolerance,
    is_finite,
)
from markerseek.search import SearchPolicy
from markerseek.studies import entry_group

REPLY_S = 30.0
"""Longest time for one reply in seconds."""

START_S = 180.0
"""Longest time for the first one: MATLAB takes a minute to start."""

_LONGEST_LINE = 1 << 16
_READ_BYTES = 1 << 16
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
    ``channels``: whether it is told the channel data.
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
        self._search = {
            "type": "search",
            "low_deg": limits.low_deg,
            "high_deg": limits.high_deg,
            "start_deg": start_deg,
            "acquisitions": acquisitions,
            "tolerance_mm": tolerance.mm,
        }
        self._answer: Estimate | None = None

    def _next_deg(self) -> float | None:
        """Next angle in degrees; None once it has answered."""
        if self._answer is not None:
            return None
        if self._lit:
            message = {"type": "sample", **self._told(self._lit[-1])}
        else:
            message = {**self._search, "dark": [self._told(sample) for sample in self._dark]}
        reply = self._child.reply_to(message)
        if reply.answer is not None:
            self._answer = self._estimate_of(reply)
            return None
        if len(self._lit) >= self._acquisitions:
            raise EntryError(f"it asked for more than the {self._acquisitions} acquisitions that it may make")
        return self._within(reply.angle_deg, "angle_deg")

    def estimate(self) -> Estimate:
        """The answer; `NotFound` before there is one."""
        return self._answer or NotFound(mean_deg=self._limits.centre_deg, reason="the entry has not answered yet")

    def _estimate_of(self, reply: _Reply) -> Estimate:
        if reply.answer == "not found":
            return NotFound(mean_deg=self._limits.centre_deg, reason="the entry says so")
        angle_deg = self._within(reply.angle_deg, "angle_deg")
        low_deg, high_deg = reply.low_deg, reply.high_deg
        if not (is_finite(low_deg) and is_finite(high_deg) and low_deg <= angle_deg <= high_deg and low_deg < high_deg):
            raise EntryError(
                f"it answered {reply.answer!r} at {angle_deg:g} deg with an interval from {low_deg} to {high_deg} deg; "
                "low_deg and high_deg must be finite, and hold the angle between them"
            )
        widest_deg = 2 * (self._limits.high_deg - self._limits.low_deg)
        if not high_deg - low_deg <= widest_deg:
            raise EntryError(
                f"it answered with an interval of {high_deg - low_deg:g} deg, at most {widest_deg:g} are one: state "
                "how certain the angle is, or answer 'not found'"
            )
        found = Found(
            mean_deg=angle_deg,
            sigma_deg=(high_deg - low_deg) / _SIGMAS_OF_95,
            interval95_deg=Interval(low_deg=low_deg, high_deg=high_deg),
            interval_kind="propagated",
        )
        return found if reply.answer == "found" else found.as_unsure("source", "the entry says so")

    def _told(self, sample: Sample) -> dict[str, Any]:
        """What an entry is told of a sample: all that its tier has."""
        reading = sample.reading
        told: dict[str, Any] = {"angle_deg": sample.angle_deg, "intensity": reading.intensity}
        if reading.noise_sigma is not None:
            told["noise_sigma"] = reading.noise_sigma
        blocks = reading.local_maxima
        if blocks is not None:
            told["blocks"] = {
                "first_lateral_m": blocks.first_lateral_m,
                "first_depth_m": blocks.first_depth_m,
                "lateral_step_m": blocks.lateral_step_m,
                "depth_step_m": blocks.depth_step_m,
                "columns": blocks.columns,
                "intensities": np.frombuffer(blocks.intensities, "<f4").tolist(),
            }
        frame = sample.frame
        if self._channels and isinstance(frame, ChannelFrame):
            told["channels"] = {
                "shape": list(frame.samples.shape),
                "sampling_hz": frame.sampling_hz,
                "int16": b64encode(frame.samples.astype("<i2").tobytes()).decode("ascii"),
            }
        return told

    def _within(self, angle_deg: float | None, name: str) -> float:
        if angle_deg is None or not is_finite(angle_deg) or angle_deg not in self._limits:
            raise EntryError(f"{name} is {angle_deg} deg, it must be a finite number in the range {self._limits}")
        return angle_deg


class EntryProcess:
    """A child process that replies to lines; after its first fault it is not asked again."""

    def __init__(self, command: tuple[str, ...]) -> None:
        self._fault: str | None = None
        self._replies = 0
        self._said = b""
        read, alive = os.pipe()
        try:
            # The user's own command. Isolated: the environment is for that, and not for what runs it.
            self._child = subprocess.Popen(  # noqa: S603
                (sys.executable, "-I", "-S", entry_group.__file__, str(read), *command),
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=(read,),
                # Workers have it; an entry may import what lies beside its file.
                env={name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"},
                # A group of its own, which is ended as a whole.
                start_new_session=True,
            )
        finally:
            os.close(read)
        for pipe in _pipes(self._child):
            # A process that it has started may hold them when it has ended: no wait for one is without a limit.
            os.set_blocking(pipe.fileno(), False)
        self._end = weakref.finalize(self, _end, self._child, alive)

    def reply_to(self, message: dict[str, Any]) -> _Reply:
        """The reply to one message; `EntryError` where there is none, or it is not one."""
        if self._fault is not None:
            raise EntryError(self._fault)
        try:
            return self._exchange(msgspec.json.encode(message) + b"\n")
        except EntryError as problem:
            self._fault = str(problem)
            self._end()
            raise

    def _exchange(self, line: bytes) -> _Reply:
        _, stdout, _ = _pipes(self._child)
        if _read(stdout).strip():
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
        stdin, stdout, stderr = _pipes(self._child)
        received = b""
        heard: list[IO[bytes]] = [stdout, stderr]
        while b"\n" not in received:
            left_s = ends_s - time.monotonic()
            if not left_s > 0:
                raise EntryError(f"it did not reply within {limit_s:g} s{self._last_words()}")
            ready, writable, _ = select.select(heard, [stdin] if line else [], [], left_s)
            if writable:
                try:
                    line = line[os.write(stdin.fileno(), line[:_READ_BYTES]) :]
                except OSError:
                    # It reads no more; what it says last is still read.
                    line = b""
            if stderr in ready:
                said = _read(stderr)
                self._said = (self._said + said)[-_LAST_BYTES:]
                if not said:
                    heard.remove(stderr)
            if stdout in ready:
                piece = _read(stdout)
                received += piece
                if not piece:
                    raise EntryError(f"it ended where a reply was due{self._last_words()}")
                if len(received) > _LONGEST_LINE:
                    raise EntryError(f"it replied with more than {_LONGEST_LINE} bytes{self._last_words()}")
        return received

    def _last_words(self) -> str:
        """The last line that it wrote to standard error."""
        _, _, stderr = _pipes(self._child)
        said = (self._said + _read(stderr))[-_LAST_BYTES:]
        lines = said.decode("utf-8", "replace").strip().splitlines()
        return f"; its last words: {lines[-1][:200]}" if lines else ""


@lru_cache(maxsize=4)
def _child(command: tuple[str, ...]) -> EntryProcess:
    """The child of a command, one in each worker."""
    return EntryProcess(command)


def _pipes(child: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes], IO[bytes]]:
    if child.stdin is None or child.stdout is None or child.stderr is None:
        raise RuntimeError("an entry's process has no pipes")
    return child.stdin, child.stdout, child.stderr


def _read(pipe: IO[bytes]) -> bytes:
    """What has come, without waiting; nothing at its end, too."""
    try:
        return os.read(pipe.fileno(), _READ_BYTES)
    except BlockingIOError:
        return b""


def _end(child: subprocess.Popen[bytes], alive: int) -> None:
    with suppress(OSError):
        os.killpg(child.pid, signal.SIGKILL)
    for pipe in _pipes(child):
        with suppress(OSError):
            pipe.close()
    os.close(alive)
    child.wait()
