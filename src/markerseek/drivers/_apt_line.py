"""Requests to a Thorlabs controller and their answers, with a deadline."""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TypeVar

from markerseek.core import Clock, DeviceError, DeviceTimeoutError
from markerseek.drivers._unread import Unread
from markerseek.wire import AptFramer, Port, apt

_AnswerT = TypeVar(
    "_AnswerT",
    apt.Info,
    apt.Velocity,
    apt.SoftLimits,
    apt.Status,
    apt.Counts,
    apt.TriggerPorts,
    apt.TriggerPositions,
    apt.Channel,
)

_POLL_S = 1e-3
_READ_BYTES = 4096
_LOST_AGES = 2
"""Multiple of the age allowed after which a question counts as lost."""


class AptLine:
    """A line to one controller.

    APT numbers neither requests nor answers. What arrived before a request is dropped; a later answer may still answer
    an earlier request, which was repeated because this computer or the line was slow. Answers keep the order of their
    requests, so each is at most as old as the first request that was open when it came. Where none comes within the age
    allowed, a late one is not waited for.

    ``clock``: all waiting is done on it. ``answer_s``: how long an answer may take before the request is repeated.
    ``age_s``: how old an answer may be: after that, silence is an error. ``since_s``: earliest time at which the
    request of the last answer can have been sent.
    """

    def __init__(self, *, port: Port, clock: Clock, answer_s: float, age_s: float) -> None:
        self._port = port
        self._clock = clock
        self.since_s = clock.now_s()
        self._answer_s = answer_s
        self._age_s = age_s
        self._framer = AptFramer()
        self._open: defaultdict[int, deque[float]] = defaultdict(deque)
        self._garbled = False
        self._unread = Unread()

    def send(self, message: bytes) -> float:
        """Send a message that has no answer, and return the time just before, in seconds."""
        now_s = self._clock.now_s()
        self._port.write(message)
        return now_s

    def ask(self, question: bytes, ident: int, kind: type[_AnswerT]) -> _AnswerT:
        """Send a request and return its answer.

        ``ident``: identity of the message that answers. Raises `DeviceTimeoutError` if no answer comes in time.
        """
        self._take(ident)
        self._unread.clear()
        first_s = self._clock.now_s()
        while (asked_s := self._clock.now_s()) - first_s < self._age_s:
            self._open[ident].append(asked_s)
            self._port.write(question)
            again_s = min(asked_s + self._answer_s, first_s + self._age_s)
            while True:
                answer = self._take(ident)
                if isinstance(answer, kind):
                    return answer
                if not self._clock.now_s() < again_s:
                    break
                self._clock.wait(_POLL_S)
            # A message that began and did not end is garbled: its missing bytes would be taken from the next answer.
            self._framer.forget()
            if self._garbled and self._open[ident]:
                self._open[ident].popleft()
            self._garbled = False
        raise DeviceTimeoutError(
            f"the stage's controller gave no answer in {self._age_s:g} s: "
            + self._unread.said(cure="check its cable and its power, and that stage.port is its port")
        )

    def close(self) -> None:
        """Close the line; allowed twice."""
        self._port.close()

    def _take(self, ident: int) -> apt.Answer | None:
        """Last answer of that kind among the bytes that have arrived; None if there is none."""
        taken = None
        now_s = self._clock.now_s()
        data = self._port.read(_READ_BYTES, timeout_s=0.0)
        self._garbled = self._garbled or bool(data)
        self._unread.add(data)
        for message in self._framer.feed(data):
            self._garbled = False
            asked_s = self._open[message.ident].popleft() if self._open[message.ident] else now_s - self._age_s
            if message.ident == ident:
                try:
                    taken = apt.decode(message)
                except DeviceError:
                    # APT has no checksum: a damaged answer is dropped, and the request is repeated.
                    continue
                self.since_s = asked_s
        # A question this old was lost on the line.
        while self._open[ident] and now_s - self._open[ident][0] > _LOST_AGES * self._age_s:
            self._open[ident].popleft()
        return taken
