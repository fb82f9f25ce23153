"""Tries an open device by those rules of its contract that need no light and no move.

A rig does this with each foreign driver before a person is asked to arm it.
"""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import MAX_RESOLUTION_DEG, Interval, Laser, Receiver, Stage
from markerseek.testing.devices import LaserContract, ReceiverContract, StageContract


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleCheck:
    """What came of one rule."""

    rule: str
    """The rule in a sentence."""
    problem: str | None = None
    """How it was broken; None if it was kept."""


def check_stage(stage: Stage, *, search: Interval) -> tuple[RuleCheck, ...]:
    """Try a stage that is open and at rest; it gets a stop command, and no move.

    Parameters
    ----------
    stage
        The stage.
    search
        Angles that the rig will send it to.
    """

    class Opened(StageContract):
        resolution_deg = MAX_RESOLUTION_DEG
        reaches = search

        def make(self) -> Stage:
            return stage

    return _checked(Opened())


def check_laser(laser: Laser) -> tuple[RuleCheck, ...]:
    """Try a laser that is open; it gets the command to disarm, and fires nothing.

    Parameters
    ----------
    laser
        The laser.
    """

    class Opened(LaserContract):
        def make(self) -> Laser:
            return laser

    return _checked(Opened())


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

    return _checked(Opened())


def _checked(contract: StageContract | LaserContract | ReceiverContract) -> tuple[RuleCheck, ...]:
    return tuple(_tried(contract, name) for name in contract.at_rest)


def _tried(contract: object, name: str) -> RuleCheck:
    rule = (getattr(type(contract), name).__doc__ or name).splitlines()[0].removesuffix(".")
    try:
        getattr(contract, name)()
    # Code of somebody else: whatever it raises, the rule was not kept.
    except (Exception, SystemExit) as problem:  # noqa: BLE001
        said = " ".join(str(problem).split()) or "it does not"
        broken = said if isinstance(problem, AssertionError) else f"{type(problem).__name__}: {said}"
        return RuleCheck(rule=rule, problem=f"({broken})")
    return RuleCheck(rule=rule)
