"""Kills a search at its n-th step."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from typing import Any, Literal
from unittest import mock

from markerseek.core import AnyPolicy
from markerseek.records.journal import writer
from markerseek.rigs import Rig

_VERBS = {
    "move_to": "stage moves",
    "stop": "stage stops",
    "fire": "laser fires",
    "disarm": "laser is disarmed",
    "arm": "receiver is armed",
    "acquire": "frame is taken",
    "read": "frame is read",
    "tell": "policy is told",
    "begin_sweep": "sweep begins",
    "read_sweep": "sweep is read",
    "end_sweep": "sweep ends",
    "brake": "stage brakes",
}


class Fuse:
    """Kills this process at the n-th step, and writes the step's name to the parent process.

    Parameters
    ----------
    blows_at
        Number of that step, from 1; None: it never dies.
    ack_fd
        Pipe to the parent process; what is written there has no dot, which stands for an event.
    """

    def __init__(self, blows_at: int | None, *, ack_fd: int) -> None:
        self.steps = 0
        self._blows_at = blows_at
        self._ack_fd = ack_fd

    def step(self, what: str, when: Literal["before", "after"]) -> None:
        """Count one step, and die if it is the one."""
        self.steps += 1
        if self.steps == self._blows_at:
            os.write(self._ack_fd, f"{when}: {what}".encode())
            os.kill(os.getpid(), signal.SIGKILL)

    def around(self, call: Callable[..., Any], what: str) -> Callable[..., Any]:
        """A call with a step before and one after."""

        def fused(*args: Any, **named: Any) -> Any:
            self.step(what, "before")
            answer = call(*args, **named)
            self.step(what, "after")
            return answer

        return fused

    def into(self, policy: AnyPolicy, rig: Rig) -> None:
        """Put it around everything that a search does."""
        for part, verbs in (
            (rig.stage, ("move_to", "stop", "begin_sweep", "read_sweep", "brake")),
            (rig.laser, ("fire", "disarm", "begin_sweep", "end_sweep")),
            (rig.receiver, ("arm", "acquire", "end_sweep")),
            (rig.scanner._reader, ("read",)),
            (policy, ("tell",)),
        ):
            # A recording does not sweep.
            for verb in filter(partial(hasattr, part), verbs):
                setattr(part, verb, self.around(getattr(part, verb), _VERBS[verb]))


def fused_writes(fuse: Fuse) -> AbstractContextManager[object]:
    """Writes and flushes of the journal that are two steps each."""
    stack = ExitStack()
    for where, call, what in (
        (writer, "_write", "journal is written"),
        (writer, "flush", "journal is flushed"),
        (os, "ftruncate", "journal is cut"),
        (os, "link", "journal is named"),
    ):
        stack.enter_context(mock.patch.object(where, call, fuse.around(getattr(where, call), what)))
    return stack
