"""How a command ended that a bridge ran, and what is read of the JSON object that it printed."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import msgspec

from markerseek.show import flat_line

_NOT_ARMED = 4
"""Exit code of a command whose rig nobody armed."""


class PrintedResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a bridge reads of the result that a search printed (`markerseek.show.flat_result`)."""

    answer: str
    angle_deg: float
    as_published: bool = False
    marker_trus_m: tuple[float, float, float] | None = None

    @property
    def is_claimed(self) -> bool:
        """Whether the search claims its angle; the paper's form of a method always answers, and claims nothing."""
        return self.answer == "found" and not self.as_published


class PrintedError(msgspec.Struct, frozen=True, kw_only=True):
    """What a command printed that ended with an error."""

    error: str
    kind: str = ""
    """Name of its class."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a child ended."""

    exit_code: int
    """That of the command: 0 found, 3 any other answer, 1 a fault, 2 wrong usage, 4 not armed; 128 + the signal's
    number if it was stopped or killed."""
    printed: dict[str, Any] | None = None
    """The JSON object that it printed, as it is handed on; None if it printed none."""
    result: PrintedResult | None = None
    """What is read of it if it is the result of a search."""
    error: PrintedError | None = None
    """What is read of it if it is an error."""

    @classmethod
    def of(cls, exit_code: int, text: bytes) -> Self:
        """Return how a command ended that printed a text."""
        try:
            printed = msgspec.json.decode(text, type=dict[str, Any])
        except (msgspec.MsgspecError, ValueError, RecursionError):
            return cls(exit_code=exit_code)
        return cls(
            exit_code=exit_code,
            printed=printed,
            result=_as(PrintedResult, printed),
            error=_as(PrintedError, printed),
        )

    @property
    def answered(self) -> bool:
        """Whether the search came to its end: with a marker, or with any other answer."""
        return self.exit_code in {0, 3}

    @property
    def stopped(self) -> bool:
        """Whether it was stopped, by a person or a program."""
        return self.exit_code in {128 + signal.SIGINT, 128 + signal.SIGTERM}

    @property
    def failed(self) -> bool:
        """Whether it ended by a fault: not with an answer, not stopped, not left unarmed."""
        return not (self.answered or self.stopped or self.exit_code == _NOT_ARMED)

    @property
    def message(self) -> str:
        """One sentence for whoever asked."""
        if self.error is not None:
            return self.error.error
        if self.exit_code == _NOT_ARMED:
            return (
                "not armed: nothing moved and nothing was fired; a person must arm the rig in the terminal of the "
                "bridge or page"
            )
        if self.result is not None and self.printed is not None:
            return flat_line(self.printed)
        killed = {128 + each: f", by {each.name}" for each in signal.Signals}.get(self.exit_code, "")
        return f"the command ended with exit code {self.exit_code}{killed}"


_Printed = TypeVar("_Printed")


def _as(kind: type[_Printed], printed: dict[str, Any]) -> _Printed | None:
    """Return what a command printed as a value of this kind; None if it is something else."""
    try:
        return msgspec.convert(printed, kind)
    except msgspec.ValidationError:
        return None
