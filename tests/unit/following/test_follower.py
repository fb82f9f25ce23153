"""The loop in virtual time: a probe that follows a point ends at it, and a slow look is no target that is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from markerseek.core import Clock, Float64
from markerseek.following import Follower, FollowPlan, FollowStep, HeldRegistration, Look, ProbeReach, Target
from markerseek.guard import State
from markerseek.registration import EndoscopeNotKnown, SeenEndoscope
from tests.faults.followed_runs import CAMERA_TO_TRUS, LIMITS, Room, draw_plan, open_room, registration

ANGLE_DEG = 8.28


class Point:
    """A point that rests, which no light shows."""

    name = "a point"

    def __init__(self, clock: Clock, camera_m: Float64[np.ndarray, " 3"]) -> None:
        self._clock = clock
        self._camera_m = camera_m

    def newest(self) -> Target:
        return Target(at_s=self._clock.now_s(), camera_m=self._camera_m, covariance_m2=np.zeros((3, 3)))

    @property
    def heard_s(self) -> float:
        return self._clock.now_s()


class SlowSpot:
    """A spot that rests, whose looks take as long to evaluate as a first one on a busy computer."""

    name = "a spot"

    def __init__(self, clock: Clock, camera_m: Float64[np.ndarray, " 3"]) -> None:
        self._clock = clock
        self._camera_m = camera_m

    def look(self, pulses: int) -> Look:
        assert pulses > 0
        target = Target(at_s=self._clock.now_s(), camera_m=self._camera_m, covariance_m2=np.eye(3) * 1e-9)
        self._clock.wait(2.0)
        return Look(target=target)


def room() -> Room:
    """A room without a fault."""
    made = open_room(replace(draw_plan(0), start_deg=0.0, fault=None))
    made.rig.scanner.guard.arm(by="a test")
    return made


def steps(
    made: Room,
    source: Point | SlowSpot,
    *,
    until_s: float,
    plan: FollowPlan | None = None,
    endoscope: Callable[[], SeenEndoscope | Literal["going on"] | None] | None = None,
) -> list[FollowStep]:
    """Steps of a run that follows for some seconds."""
    follower = Follower(
        made.rig,
        HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True),
        source,
        plan=plan or FollowPlan(),
        by="a test",
        reach=ProbeReach(angles=LIMITS.search, lateral_m=20e-3, radius_m=(10e-3, 90e-3)),
        endoscope=endoscope,
    )
    came: list[FollowStep] = []
    running = follower.steps()
    for step in running:
        came.append(step)
        if step.at_s >= until_s:
            break
    running.close()
    return came


def camera_m() -> Float64[np.ndarray, " 3"]:
    """The point, in the frame of the camera."""
    angle = np.radians(ANGLE_DEG)
    return CAMERA_TO_TRUS.inverse().apply(0.05 * np.array([np.sin(angle), 0.0, np.cos(angle)]))


@pytest.mark.parametrize("begins_s", [0.0, 7431.59])
def test_the_probe_ends_at_a_point_that_rests(begins_s: float) -> None:
    made = room()
    # The clock of a computer does not begin at 0, so that its times are rounded.
    made.clock.wait(begins_s)
    last = steps(made, Point(made.clock, camera_m()), until_s=begins_s + 6.0)[-1]
    assert last.word == "there"
    assert last.target_deg == pytest.approx(ANGLE_DEG, abs=1e-6)
    # A stage arrives within 0.05 deg.
    assert last.probe_deg == pytest.approx(ANGLE_DEG, abs=0.05)


def test_a_spot_whose_looks_take_long_is_not_lost() -> None:
    made = room()
    came = steps(made, SlowSpot(made.clock, camera_m()), until_s=20.0)
    assert "lost" not in {step.word for step in came}
    target_deg = came[-1].target_deg
    # Its source lies below it, along the sight.
    assert target_deg == pytest.approx(ANGLE_DEG, abs=0.2)
    assert came[-1].probe_deg == pytest.approx(target_deg, abs=0.05)


def test_an_endoscope_that_is_not_known_while_the_probe_turns_ends_the_turn() -> None:
    made = room()
    states = []

    def hidden() -> EndoscopeNotKnown | None:
        states.append(made.rig.scanner.guard.state)
        return EndoscopeNotKnown(after="4", reason="the scene is hidden") if made.clock.now_s() > 0.6 else None

    came = steps(made, Point(made.clock, camera_m()), until_s=6.0, plan=FollowPlan(speed_deg_s=2.0), endoscope=hidden)
    assert State.TURNING in states
    assert came[-1].word == "endoscope"
    assert came[-1].davinci_to_trus is None
    # The first turn alone is of 4.5 deg, and takes 2.3 s: two looks, half a second apart, have broken it off.
    assert 0.5 < came[-1].probe_deg < 3.0


def test_a_look_that_goes_on_is_asked_for_again_soon() -> None:
    made = room()
    asked = []

    def slow() -> Literal["going on"] | None:
        asked.append(made.clock.now_s())
        return None if len(asked) % 4 == 0 else "going on"

    steps(made, Point(made.clock, camera_m()), until_s=3.0, endoscope=slow)
    apart_s = np.diff(asked)
    assert apart_s[:2].max() < 0.2
    assert apart_s[3] >= 0.5
