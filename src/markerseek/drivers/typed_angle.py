"""A stage whose angle a person reads from a scale, and types into the terminal."""

from __future__ import annotations

import os
import select
import sys
import termios
from collections.abc import Callable, Iterator

from markerseek.core import Clock, DeviceTimeoutError, Interval, NotConnectedError, Turning, is_finite
from markerseek.drivers._approach import require_inside
from markerseek.guard import Limits

_SLICE_S = 0.02
"""Time between two looks at the terminal, in seconds."""

_LINE_BYTES = 4096
"""Longest line of a terminal."""


class TypedStage:
    """A probe that a person turns, and whose angle the same person types in.

    What was typed is all that is known: that the probe stays there during an acquisition is the person's word.

    ``limits``: angles that may be searched, at which the probe must come to rest, and those at which it may be.
    ``reach_deg``: most that the angle reached may differ from the one asked for. ``timeout_s``: longest time for a
    turn. ``asks``: asks the person for an angle in degrees. Raises `NotConnectedError` if there is no terminal.
    """

    emulated = False

    def __init__(
        self, *, clock: Clock, limits: Limits, reach_deg: float, timeout_s: float, asks: Callable[[float], None]
    ) -> None:
        self.limits: Interval = limits.travel
        self._search, self._reach_deg, self._timeout_s = limits.search, reach_deg, timeout_s
        self._clock, self._asks = clock, asks
        if sys.stdin is None or not sys.stdin.isatty():
            raise NotConnectedError(
                "stage: encoder is 'typed', and there is no terminal to type the angle; start it in one"
            )
        self._terminal = sys.stdin.fileno()
        self._target_deg: float | None = None
        self._angle_deg = self._typed(
            "angle of the probe now, in degrees:\n", lambda angle_deg: angle_deg in self.limits
        )

    @property
    def angle_deg(self) -> float:
        """The angle that was typed last, in degrees."""
        return self._angle_deg

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Ask the person, and wait until an angle near the one asked for is typed.

        Nobody is asked again for the angle at which the probe was left. Raises `LimitError` if the angle is NaN or
        outside the travel range. Raises `DeviceTimeoutError` if none is typed in time. Raises `NotConnectedError` if
        the terminal has gone.
        """
        require_inside(self.limits, angle_deg, then="nobody was asked")
        if angle_deg == self._target_deg:
            return
        self._target_deg = None
        self._asks(angle_deg)
        yield Turning(target_deg=angle_deg, angle_deg=None)
        self._angle_deg = self._typed(
            f"angle reached, within {self._reach_deg:g} of {angle_deg:+.1f} and in {self._search}:\n",
            lambda reached_deg: abs(reached_deg - angle_deg) <= self._reach_deg and reached_deg in self._search,
        )
        self._target_deg = angle_deg

    def move_to(self, angle_deg: float) -> float:
        """Let the person turn the probe there, and return the angle typed in degrees; raises as `guide`."""
        for _ in self.guide(angle_deg):
            pass
        return self._angle_deg

    def stop(self) -> None:
        """Nothing to stop: what a person does ends when the person ends it."""

    def _typed(self, prompt: str, fits: Callable[[float], bool]) -> float:
        """The first number typed from now on that fits; the others are asked for again."""
        ends_s = self._clock.now_s() + self._timeout_s
        while True:
            angle_deg = _number(self._line(prompt, ends_s=ends_s))
            # `fits` of NaN is False.
            if angle_deg is not None and fits(angle_deg):
                return angle_deg
            sys.stderr.write("that is no such angle; turn the probe further, or type it again\n")

    def _line(self, prompt: str, *, ends_s: float) -> str:
        line = b""
        try:
            # What was typed before the question is no answer to it.
            termios.tcflush(self._terminal, termios.TCIFLUSH)
            sys.stderr.write(prompt)
            sys.stderr.flush()
            while not line.endswith(b"\n"):
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(f"stage: no angle was typed within {self._timeout_s:g} s; begin again")
                self._clock.wait(_SLICE_S)
                if not select.select([self._terminal], [], [], 0)[0]:
                    continue
                piece = os.read(self._terminal, _LINE_BYTES)
                if not piece:
                    raise NotConnectedError("stage: the terminal has ended; no angle can be typed")
                line += piece
        except (OSError, termios.error) as problem:
            raise NotConnectedError("stage: the terminal has gone; no angle can be typed") from problem
        return line.decode("utf-8", "replace")


def _number(text: str) -> float | None:
    """The angle in a line, with a point or a comma; None if the line holds no angle."""
    try:
        angle_deg = float(text.strip().removesuffix("°").replace("−", "-").replace(",", "."))
    except ValueError:
        return None
    return angle_deg if is_finite(angle_deg) else None
