"""Tries an open device by those rules of its contract that need no light and no move.

A rig does this with each foreign driver before a person is asked to arm it. What would reach the device if the
rule were broken (a move beyond the limits, a shot under an expired permit) is tried with its line held dry, or not.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TypeAlias

from markerseek.core import Interval, Laser, Receiver, Stage
from markerseek.testing.devices import MAX_RESOLUTION_DEG, LaserContract, ReceiverContract, StageContract, is_resolution

Dry: TypeAlias = Callable[[], AbstractContextManager[None]]
"""Keeps what is written to the device from it, for the time of a block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleCheck:
    """What came of one rule."""

    rule: str
    """The rule in a sentence."""
    problem: str | None = None
    """How it was broken; None if it was kept, or not tried."""
    tried: bool = True
    """False where it could not be tried without light, or without a move."""


def check_stage(stage: Stage, *, search: Interval, dry: Dry | None) -> tuple[RuleCheck, ...]:
    """Try a stage that is open and at rest; it is told to stop, and not to move.

    Parameters
    ----------
    stage
        The stage; its ``resolution_deg`` is used where it has one, else 0.1 degrees, which is also the most.
    search
        Angles that the rig will send it to.
    dry
        Holds its line dry; None where it has none: what it refuses is then not tried.
    """

    class Opened(StageContract):
        resolution_deg = _resolution_deg(stage)
        reaches = search

        def make(self) -> Stage:
            return stage

    return _checked(Opened(), dry)


def _resolution_deg(stage: Stage) -> float:
    """That of the stage; the usual where it says none, or none that is one, by which the first rule is broken."""
    says = getattr(stage, "resolution_deg", None)
    return says if is_resolution(says) else MAX_RESOLUTION_DEG


def check_laser(laser: Laser, *, dry: Dry | None) -> tuple[RuleCheck, ...]:
    """Try a laser that is open; it is told to disarm, and to fire only while its line is held dry.

    Parameters
    ----------
    laser
        The laser.
    dry
        As of `check_stage`.
    """

    class Opened(LaserContract):
        def make(self) -> Laser:
            return laser

    return _checked(Opened(), dry)


def check_receiver(receiver: Receiver) -> tuple[RuleCheck, ...]:
    """Try a receiver that is open; nothing is triggered.

    Parameters
    ----------
    receiver
        The receiver.
    """

    class Opened(ReceiverContract):
        def make_receiver(self) -> Receiver:
            return receiver

    return _checked(Opened(), None)


def _checked(contract: StageContract | LaserContract | ReceiverContract, dry: Dry | None) -> tuple[RuleCheck, ...]:
    checks = [_tried(contract, name, nullcontext) for name in contract.at_rest]
    if dry is None:
        return (*checks, *(RuleCheck(rule=_rule(contract, name), tried=False) for name in contract.held_dry))
    return (*checks, *(_tried(contract, name, dry) for name in contract.held_dry))


def _tried(contract: object, name: str, held: Dry) -> RuleCheck:
    try:
        with held():
            getattr(contract, name)()
    # Code of somebody else: whatever it raises, the rule was not kept.
    except (Exception, SystemExit) as problem:  # noqa: BLE001
        said = " ".join(str(problem).split()) or "it does not"
        broken = said if isinstance(problem, AssertionError) else f"{type(problem).__name__}: {said}"
        return RuleCheck(rule=_rule(contract, name), problem=f"({broken})")
    return RuleCheck(rule=_rule(contract, name))


def _rule(contract: object, name: str) -> str:
    """The first line of a test's docstring, without its full stop."""
    return (getattr(type(contract), name).__doc__ or name).splitlines()[0].removesuffix(".")
