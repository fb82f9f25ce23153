"""What StandardStage, StandardLaser and StandardReceiver make of the verbs of a device, in virtual time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from markerseek.core import (
    AcquisitionError,
    DeviceError,
    DeviceTimeoutError,
    Interval,
    Laser,
    LaserError,
    MoveError,
    Permit,
    Receiver,
    Stage,
)
from markerseek.drivers import StageRules, StageStatus, StandardLaser, StandardReceiver, StandardStage
from markerseek.drivers.standard_receiver import mean_counts
from markerseek.sim import VirtualClock
from markerseek.testing import LaserContract, ReceiverContract, StageContract

TRAVEL = Interval(low_deg=-36.5, high_deg=36.5)
SPEED_DEG_S = 20.0


class Turning:
    """A stage that turns evenly to its last target, and what can be wrong with it."""

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.at_s = clock, 0.0
        self.angle_deg = self.target_deg = self.largest_lead_deg = 0.0
        self.speed_deg_s, self.stops, self.ignores_stop, self.beyond_deg = SPEED_DEG_S, 0, False, 0.0

    def read(self) -> StageStatus:
        now_s = self.clock.now_s()
        step_deg = self.speed_deg_s * (now_s - self.at_s)
        self.angle_deg = min(max(self.target_deg, self.angle_deg - step_deg), self.angle_deg + step_deg)
        self.at_s = now_s
        return StageStatus(angle_deg=self.angle_deg, moving=self.angle_deg != self.target_deg)

    def go(self, angle_deg: float) -> None:
        self.read()
        self.largest_lead_deg = max(self.largest_lead_deg, abs(angle_deg - self.angle_deg))
        self.target_deg = angle_deg + math.copysign(self.beyond_deg, angle_deg - self.angle_deg)

    def stop(self) -> None:
        self.read()
        self.stops += 1
        if not self.ignores_stop:
            self.target_deg = self.angle_deg


def standard(**rules: float) -> tuple[StandardStage[Turning], Turning]:
    clock = VirtualClock()
    logic = Turning(clock)
    known = {"speed_deg_s": SPEED_DEG_S, "resolution_deg": 0.001, "unsteady_deg": 0.1}
    return StandardStage(logic, clock=clock, travel=TRAVEL, rules=StageRules(**known | rules)), logic


class TestStandardStage(StageContract):
    def make(self) -> Stage:
        return standard()[0]


def test_no_target_is_far_ahead_and_each_is_approached_from_below() -> None:
    stage, logic = standard(approach_deg=1.0)
    for target_deg in (30.0, -30.0, 0.0):
        stage.move_to(target_deg)
        assert stage.angle_deg == target_deg
    assert logic.largest_lead_deg <= 5.0
    assert logic.stops == 0


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"speed_deg_s": 0.0}, "did not begin to move at 0.000 deg, 20.000 deg from its target; look for an obstacle"),
        ({"speed_deg_s": 0.05}, r"came to rest|has not arrived in .* s; it is too slow"),
        ({"speed_deg_s": 200.0}, "faster than it was set to"),
        ({"beyond_deg": 2.0}, "is not on its way from"),
    ],
    ids=str,
)
def test_a_stage_that_fails_is_stopped_and_named(fault: dict[str, float], said: str) -> None:
    stage, logic = standard()
    for name, value in fault.items():
        setattr(logic, name, value)
    with pytest.raises(MoveError, match=said):
        stage.move_to(20.0)
    assert logic.stops > 0
    assert logic.read().moving is False


def test_a_stage_that_goes_on_after_a_stop_or_turns_at_rest_is_named() -> None:
    stage, logic = standard()
    stage.move_to(5.0)
    logic.target_deg, logic.ignores_stop = 30.0, True
    stage._clock.wait(0.2)
    with pytest.raises(MoveError, match="did somebody turn its wheel"):
        _ = stage.angle_deg
    logic.speed_deg_s = 1.0
    with pytest.raises(MoveError, match="keeps moving; cut its power"):
        stage.stop()


@dataclass
class Lamp:
    """A laser that fires at once, and what can be wrong with it."""

    said: list[str] = field(default_factory=list)
    fires: int | None = None
    breaks: bool = False
    pulses: int = 0

    def fire(self, pulses: int) -> None:
        self.said.append(f"fire {pulses}")
        if self.breaks:
            raise LaserError("its lamp broke")
        self.pulses = pulses if self.fires is None else self.fires

    def fired(self) -> int | None:
        return None if self.pulses < 0 else self.pulses

    def off(self) -> None:
        self.said.append("off")


def laser(**wrong: object) -> tuple[StandardLaser[Lamp], Lamp]:
    lamp = Lamp(**wrong)  # type: ignore[arg-type]
    return StandardLaser(lamp, clock=VirtualClock(), rate_hz=100.0, name="lamp"), lamp


def permit(token: str = "a", *, pulses: int = 4, expires_s: float = math.inf) -> Permit:
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=expires_s)


class TestStandardLaser(LaserContract):
    def make(self) -> Laser:
        return laser()[0]


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ({"fires": 5}, LaserError, "lamp: 4 pulses were permitted and 5 fired"),
        ({"fires": -1}, DeviceTimeoutError, "lamp: the end of the pulses was not confirmed within 1 s"),
        ({"breaks": True}, LaserError, "its lamp broke"),
    ],
    ids=str,
)
def test_whatever_a_laser_does_it_is_off_and_its_permit_is_used(
    wrong: dict[str, object], error: type[DeviceError], said: str
) -> None:
    made, lamp = laser(**wrong)
    with pytest.raises(error, match=said):
        made.fire(permit())
    assert lamp.said == ["fire 4", "off"]
    with pytest.raises(LaserError, match="used before; nothing was fired"):
        made.fire(permit())
    assert lamp.said == ["fire 4", "off"]


def test_a_permit_that_ends_before_its_pulses_fires_nothing() -> None:
    made, lamp = laser()
    with pytest.raises(LaserError, match=r"good for 0\.03 s more and its pulses take 0\.04 s; nothing was fired"):
        made.fire(permit(expires_s=0.03))
    assert lamp.said == []


class Frames:
    """Messages of a device that is triggered by the laser beside it."""

    driver, used, called, cure, check = "lab", "frames", "frames", "wait for the trigger", "the trigger"

    def __init__(self) -> None:
        self.waiting: list[np.ndarray] = []

    def arm(self) -> None:
        """Nothing to note."""

    def take(self) -> tuple[list[np.ndarray], bool]:
        came, self.waiting = self.waiting, []
        return came, bool(came)

    def samples(self, messages: list[np.ndarray]) -> np.ndarray:
        return mean_counts(messages)

    def close(self) -> None:
        """Nothing to release."""

    def fire(self, permit: Permit) -> int:
        """As a laser that triggers it."""
        self.waiting += [np.full((2, 3), number, np.int16) for number in range(permit.pulses or 2)]
        return permit.pulses

    def disarm(self) -> None:
        """As a laser."""


def receiver() -> tuple[StandardReceiver[Frames], Frames]:
    frames = Frames()
    return StandardReceiver(frames, clock=VirtualClock(), dark_triggers=2, sampling_hz=40e6), frames


class TestStandardReceiver(ReceiverContract):
    def make(self) -> tuple[Receiver, Laser]:
        return receiver()


@pytest.mark.parametrize(
    ("pulses", "error", "said"),
    [
        (3, DeviceTimeoutError, "lab: 3 of 4 frames came within 20 s; check the trigger"),
        (5, AcquisitionError, "lab: 5 frames came for 4 pulses; which are of this acquisition is not known"),
    ],
)
def test_a_frame_is_of_as_many_messages_as_pulses(pulses: int, error: type[DeviceError], said: str) -> None:
    made, frames = receiver()
    made.arm(permit())
    frames.fire(permit(pulses=pulses))
    with pytest.raises(error, match=said):
        made.acquire(permit())
    frames.fire(permit())
    with pytest.raises(AcquisitionError, match="4 frames came although nothing was triggered"):
        made.settle()
