"""Questions to a Thorlabs controller and their answers, each with a deadline and an age."""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TypeVar

from markerseek.core import Clock, DeviceError, DeviceTimeoutError
from markerseek.wire import apt
from markerseek.wire.apt_frames import AptFramer
from markerseek.wire.port import Port

_AnswerT = TypeVar("_AnswerT", apt.Info, apt.Velocity, apt.SoftLimits, apt.Status, apt.Counts)

_POLL_S = 1e-3
_READ_BYTES = 4096
_FORGOTTEN_S = 2.0
"""An answer that has not come by then is not waited for any more."""


class AptLine:
    """A line to one controller.

    APT numbers neither questions nor answers. An answer is therefore taken for that of the oldest question of its kind
    that is open: it is never believed to be younger than it is.

    Parameters
    ----------
    port
        The line.
    clock
        Time; all waiting is done on it.
    answer_s
        How long an answer may take before the question is asked again, in seconds.
    attempts
        How often a question is asked.
    age_s
        How old an answer may be, in seconds.
    """

    def __init__(self, *, port: Port, clock: Clock, answer_s: float, attempts: int, age_s: float) -> None:
        self._port = port
        self._clock = clock
        self._answer_s = answer_s
        self._attempts = attempts
        self._age_s = age_s
        self._framer = AptFramer()
        self._open: dict[int, deque[float]] = defaultdict(deque)

    @property
    def discarded(self) -> int:
        """Bytes that were no part of a message."""
        return self._framer.discarded

    def send(self, message: bytes) -> None:
        """Say something that has no answer."""
        self._port.write(message)

    def ask(self, question: bytes, ident: int, kind: type[_AnswerT]) -> _AnswerT:
        """Answer to a question.

        Parameters
        ----------
        question
            The message that asks.
        ident
            Identity of the message that answers.
        kind
            What that says.

        Raises
        ------
        DeviceTimeoutError
            If no answer comes, or only answers that are too old.
        """
        for _attempt in range(self._attempts):
            self._take(ident)
            asked_s = self._clock.now_s()
            self._port.write(question)
            self._open[ident].append(asked_s)
            while True:
                answer = self._take(ident)
                if isinstance(answer, kind):
                    return answer
                if not self._clock.now_s() - asked_s < self._answer_s:
                    break
                self._clock.wait(_POLL_S)
            # What has begun to arrive and did not end is garbled: its end would swallow the next answer.
            self._framer.forget()
        raise DeviceTimeoutError(
            f"the stage's controller gave no answer in {self._attempts} x {self._answer_s:g} s that was less than "
            f"{self._age_s:g} s old; check its cable and its power"
        )

    def close(self) -> None:
        """Let go of the line; allowed twice."""
        self._port.close()

    def _take(self, ident: int) -> apt.Answer | None:
        """Last answer of that kind among the bytes that have arrived; None if there is none young enough."""
        taken = None
        for message in self._framer.feed(self._port.read(_READ_BYTES, timeout_s=0.0)):
            try:
                answer = apt.decode(message)
            except DeviceError:
                continue
            if answer is not None and self._age_of_answer_s(message.ident) <= self._age_s and message.ident == ident:
                taken = answer
        return taken

    def _age_of_answer_s(self, ident: int) -> float:
        now_s = self._clock.now_s()
        asked = self._open[ident]
        while asked and now_s - asked[0] > _FORGOTTEN_S:
            asked.popleft()
        return now_s - asked.popleft() if asked else float("inf")
