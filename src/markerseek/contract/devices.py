"""Contract tests of stages, lasers and receivers; those that need no light and no move are tried on an open device.

A rig tries each foreign driver before a person is asked to arm it.
"""

# ruff: noqa: S101 - the rules are tests, and tests assert

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar

from msgspec.structs import replace

from markerseek.core import (
    MAX_RESOLUTION_DEG,
    AcquisitionError,
    Frame,
    Interval,
    Laser,
    LaserError,
    LimitError,
    Permit,
    Receiver,
    Stage,
    is_finite,
)


@contextmanager
def refused(error: type[Exception], otherwise: str) -> Iterator[None]:
    """Fail with a sentence unless the block raises that error.

    Not pytest.raises: the contracts are part of the package, and pytest is not one of its needs.
    """
    try:
        yield
    except error:
        return
    raise AssertionError(otherwise)


def _permit(token: str, *, pulses: int = 4) -> Permit:
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=math.inf)


def _require_call(method: Callable[..., object], *arguments: object) -> None:
    """Fail unless a method can be called with these arguments."""
    try:
        inspect.signature(method).bind(*arguments)
    except TypeError as problem:
        raise AssertionError(f"{getattr(method, '__name__', method)} cannot be called so: {problem}") from None
    # Written in C, and without a signature that Python could read.
    except ValueError:
        return


def _require_flag(device: object) -> None:
    """Fail where it says something else of being an emulator than yes or no."""
    says = getattr(device, "emulated", False)
    assert isinstance(says, bool), f"emulated is {says!r}, it must be True or False"


class StageContract:
    """Contract of a stage; a subclass makes one.

    Attributes
    ----------
    resolution_deg
        Most that the readback may differ from an angle asked for, in degrees.
    reaches
        Angles that its limits must hold; None: any.
    at_rest
        Names of the tests that neither move it nor need anything of it but a stop: what a rig tries before it is armed.
    """

    resolution_deg: float = 1e-3
    reaches: Interval | None = None
    at_rest: ClassVar[tuple[str, ...]] = (
        "test_it_has_what_a_stage_has",
        "test_its_readback_at_rest_is_an_angle_inside_its_limits",
        "test_stopping_is_allowed_at_any_time_and_twice",
    )

    def make(self) -> Stage:
        """Return a stage at rest."""
        raise AssertionError("say how the stage is made: override make()")

    def test_it_arrives_where_it_is_sent_and_says_so(self) -> None:
        """The readback after a move is the angle asked for, within the resolution."""
        stage = self.make()
        low = stage.limits.low_deg
        high = stage.limits.high_deg
        # From both sides, to both ends, and twice to one place: backlash and rounding show in these.
        for share in (0.5, 0.1, 0.9, 0.9, 0.0, 1.0, 0.3):
            target = low + share * (high - low)
            reached = stage.move_to(target)
            assert abs(reached - target) <= self.resolution_deg
            assert stage.angle_deg == reached

    def test_it_has_what_a_stage_has(self) -> None:
        """It has angle_deg, limits, move_to(angle_deg) and stop()."""
        stage = self.make()
        assert isinstance(stage, Stage), "one of them is missing"
        _require_flag(stage)
        _require_call(stage.move_to, 0.0)
        _require_call(stage.stop)
        assert isinstance(stage.limits, Interval), f"limits is {stage.limits!r}, not a markerseek.core.Interval"
        reaches = self.reaches or stage.limits
        for end_deg in (reaches.low_deg, reaches.high_deg):
            assert end_deg in stage.limits, f"its limits {stage.limits} do not hold the search range {reaches}"

    def test_its_readback_at_rest_is_an_angle_inside_its_limits(self) -> None:
        """Its readback at rest is a finite number of degrees inside its limits, and stays."""
        stage = self.make()
        first = stage.angle_deg
        for angle_deg in (first, stage.angle_deg, stage.angle_deg):
            assert is_finite(angle_deg), f"angle_deg is {angle_deg!r}"
            assert angle_deg in stage.limits, f"angle_deg is {angle_deg} deg, outside {stage.limits}"
            assert abs(angle_deg - first) <= self.resolution_deg, f"angle_deg is {first}, then {angle_deg} deg"

    def test_it_refuses_what_is_no_angle_inside_its_limits_and_stays_where_it_is(self) -> None:
        """It refuses an angle beyond its limits, and NaN, by LimitError, and nothing moves."""
        stage = self.make()
        stage.move_to(stage.limits.centre_deg)
        before = stage.angle_deg
        for target in (stage.limits.low_deg - 0.5, stage.limits.high_deg + 0.5, math.nan, math.inf, -math.inf):
            with refused(LimitError, f"the stage accepted {target} deg outside of {stage.limits}"):
                stage.move_to(target)
            assert stage.angle_deg == before

    def test_stopping_is_allowed_at_any_time_and_twice(self) -> None:
        """A stop at rest is allowed, also twice, and changes nothing."""
        stage = self.make()
        before = stage.angle_deg
        stage.stop()
        stage.stop()
        after = stage.angle_deg
        assert abs(after - before) <= self.resolution_deg, f"angle_deg was {before}, and is {after} deg"

    def test_it_moves_again_after_a_stop(self) -> None:
        """A stop at rest does not block the next move."""
        stage = self.make()
        stage.stop()
        target = stage.limits.centre_deg
        assert abs(stage.move_to(target) - target) <= self.resolution_deg


class LaserContract:
    """Contract of a laser; a subclass makes one.

    Attributes
    ----------
    at_rest
        As of `StageContract`: tests without light.
    """

    at_rest: ClassVar[tuple[str, ...]] = (
        "test_it_has_what_a_laser_has",
        "test_disarming_is_allowed_at_any_time_and_twice",
    )

    def make(self) -> Laser:
        """Return a laser that has fired nothing."""
        raise AssertionError("say how the laser is made: override make()")

    def test_it_has_what_a_laser_has(self) -> None:
        """It has fire(permit) and disarm()."""
        laser = self.make()
        assert isinstance(laser, Laser), "one of them is missing"
        _require_flag(laser)
        _require_call(laser.fire, _permit("none"))
        _require_call(laser.disarm)

    def test_it_fires_what_is_permitted_and_no_more(self) -> None:
        """The pulses reported are those permitted, also when there are none."""
        laser = self.make()
        assert laser.fire(_permit("one", pulses=4)) == 4
        assert laser.fire(_permit("none", pulses=0)) == 0

    def test_a_permit_is_good_once(self) -> None:
        """A second firing under one permit is refused."""
        laser = self.make()
        laser.fire(_permit("once"))
        with refused(LaserError, "the laser fired twice under one permit"):
            laser.fire(_permit("once"))

    def test_an_expired_permit_fires_nothing(self) -> None:
        """It refuses a permit that has expired by LaserError."""
        laser = self.make()
        with refused(LaserError, "the laser fired under an expired permit"):
            laser.fire(replace(_permit("late"), expires_s=-math.inf))

    def test_disarming_is_allowed_at_any_time_and_twice(self) -> None:
        """It can be disarmed without a permit, also twice."""
        laser = self.make()
        laser.disarm()
        laser.disarm()


class ReceiverContract:
    """Contract of a receiver; a subclass makes one, with the laser that triggers it.

    Attributes
    ----------
    at_rest
        As of `StageContract`: tests that need no trigger.
    """

    at_rest: ClassVar[tuple[str, ...]] = ("test_it_has_what_a_receiver_has", "test_without_arming_there_is_no_frame")

    def make(self) -> tuple[Receiver, Laser]:
        """Return a receiver and the laser that triggers it."""
        raise AssertionError("say how the receiver and its laser are made: override make()")

    def make_receiver(self) -> Receiver:
        """Return a receiver alone, for the tests that need no trigger."""
        return self.make()[0]

    def test_it_has_what_a_receiver_has(self) -> None:
        """It has settle(), arm(permit) and acquire(permit)."""
        receiver = self.make_receiver()
        assert isinstance(receiver, Receiver), "one of them is missing"
        _require_flag(receiver)
        _require_call(receiver.settle)
        _require_call(receiver.arm, _permit("none"))
        _require_call(receiver.acquire, _permit("none"))

    def test_a_frame_answers_its_permit_in_order(self) -> None:
        """Token, pulses and angle are those of the permit; sequence numbers rise."""
        receiver, laser = self.make()
        # Three in a row: a receiver that answers with the frame before passes the first.
        previous = -1
        for token in ("a", "b", "c"):
            permit = _permit(token)
            receiver.arm(permit)
            laser.fire(permit)
            frame = receiver.acquire(permit)
            assert isinstance(frame, Frame)
            header = frame.header
            assert (header.token, header.pulses, header.commanded_deg) == (token, permit.pulses, permit.angle_deg)
            assert header.sequence > previous
            assert header.started_s <= header.ended_s
            previous = header.sequence

    def test_without_arming_there_is_no_frame(self) -> None:
        """It returns no frame without being armed, but raises AcquisitionError."""
        receiver = self.make_receiver()
        with refused(AcquisitionError, "the receiver returned a frame without being armed"):
            receiver.acquire(_permit("never armed"))

    def test_a_frame_is_handed_over_once(self) -> None:
        """The same acquisition asked for again is refused: it would be a duplicate."""
        receiver, laser = self.make()
        permit = _permit("once")
        receiver.arm(permit)
        laser.fire(permit)
        receiver.acquire(permit)
        with refused(AcquisitionError, "the receiver handed over one acquisition twice"):
            receiver.acquire(permit)

    def test_arming_again_forgets_what_it_was_armed_for(self) -> None:
        """Only the permit that it was armed for last has a frame."""
        receiver, _laser = self.make()
        receiver.arm(_permit("first"))
        receiver.arm(_permit("second"))
        with refused(AcquisitionError, "the receiver gave a frame for a permit that a later one had replaced"):
            receiver.acquire(_permit("first"))


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
