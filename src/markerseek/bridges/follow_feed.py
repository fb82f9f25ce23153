"""What a run that follows says now, for the threads that send it to other programs."""

from __future__ import annotations

import time
from typing import Protocol

import msgspec

from markerseek.following import FollowStep

SENT_S = 0.08
"""Time from one message to the next, in seconds: more than ten a second."""

SILENT_S = 1.0
"""Time without a step after which the transform is withdrawn: the run hangs, or has ended."""


class StepListener(Protocol):
    """Takes the steps of a run that follows."""

    def show(self, step: FollowStep) -> None:
        """Take a step of the run."""


class FollowFeed:
    """Keeps the newest step of a run; written by the thread that follows, read by another one.

    ``simulated``: whether the registration is.
    """

    def __init__(self, *, simulated: bool) -> None:
        self.simulated = simulated
        self._newest: tuple[float, FollowStep] | None = None

    def show(self, step: FollowStep) -> None:
        """As of `StepListener`."""
        self._newest = (time.monotonic(), step)

    @property
    def step(self) -> FollowStep | None:
        """The newest step; None if there is none, or it is older than `SILENT_S`."""
        if self._newest is None:
            return None
        came_s, step = self._newest
        return step if time.monotonic() - came_s <= SILENT_S else None


def follow_state(step: FollowStep | None, *, simulated: bool) -> dict[str, object]:
    """Return a step for other programs, with whether the registration holds; None: the run is silent."""
    if step is None:
        return {
            "word": "silent",
            "said": f"the run that follows has said nothing for {SILENT_S:g} s, or has ended",
            "holds": False,
            "simulated": simulated,
        }
    values: dict[str, object] = msgspec.to_builtins(step)
    return values | {"holds": step.davinci_to_trus is not None, "simulated": simulated}
