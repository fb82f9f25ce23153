"""A stage node with a slow stage, and its client, in one process."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from markerseek.bridges.ros2 import MessagePump, Serving, StageNode
from markerseek.core import Interval, MoveError
from markerseek.drivers import SystemClock
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.ros import RosNode, messages, topics

JOINT = "sensor_msgs/msg/JointState"
SPEED_DEG_S = 20.0


class SlowStage:
    """A stage that turns at 20 degrees per second of real time, and notes what it is asked."""

    def __init__(self, clock: SystemClock) -> None:
        self.angle_deg = 0.0
        self.limits = Interval(low_deg=-36.5, high_deg=36.5)
        self.asked: list[float] = []
        self.stops = 0
        self.stuck = False
        self._clock = clock

    def move_to(self, angle_deg: float) -> float:
        self.asked.append(angle_deg)
        if self.stuck:
            raise MoveError("stage: it does not turn")
        while (left_deg := angle_deg - self.angle_deg) != 0:
            self._clock.wait(0.02)
            step_deg = SPEED_DEG_S * 0.02
            self.angle_deg = (
                angle_deg if abs(left_deg) <= step_deg else self.angle_deg + math.copysign(step_deg, left_deg)
            )
        return self.angle_deg

    def stop(self) -> None:
        self.stops += 1


class Bench:
    """A stage node and its client in one process and thread: the node is served whenever the client waits."""

    def __init__(self) -> None:
        self.beat = MessagePump()
        self.clock = SystemClock(beat=self.beat)
        self.stage = SlowStage(self.clock)
        self.guard = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission())
        self.guard.arm(by="a test")
        self.node = RosNode("trus_stage")
        self.client = RosNode("client", network=self.node.network)
        self.heard: dict[str, list[Any]] = {}
        for topic, kind in (
            (topics.MEASURED_JS, JOINT),
            (topics.SETPOINT_JS, JOINT),
            (topics.STATE, "std_msgs/msg/String"),
        ):
            self.heard[topic] = []
            self.client.subscribe(topic, kind, self.heard[topic].append)
        self.client.advertise(topics.MOVE_JP, JOINT)
        self.client.advertise(topics.STOP, "std_msgs/msg/Empty")
        self.served = StageNode(Serving(node=self.node, guard=self.guard, by="a test"), stage=self.stage)
        self.beat.served = [self.served]
        self.during: Callable[[], None] | None = None
        self.until(lambda: self.client.matched(topics.MOVE_JP))
        self.until(lambda: self.client.matched(topics.STOP) and bool(self.heard[topics.MEASURED_JS] and self.states))

    def until(self, ended: Callable[[], bool], *, most_s: float = 20.0) -> None:
        ends_s = self.clock.now_s() + most_s
        while not ended():
            assert self.clock.now_s() < ends_s, (self.states[-1:], self.stage.asked, self.stage.angle_deg)
            self.node.spin(0.01)
            self.served.step()

    def serve(self, duration_s: float) -> None:
        ends_s = self.clock.now_s() + duration_s
        self.until(lambda: self.clock.now_s() >= ends_s)

    def send(self, topic: str, angle_deg: float, *, stamp_s: float | None = None) -> None:
        time_s = self.client.now_s() if stamp_s is None else stamp_s
        self.client.publish(topic, messages.joint_state(time_s=time_s, angle_deg=angle_deg))

    @property
    def states(self) -> list[dict[str, Any]]:
        return [json.loads(each.data) for each in self.heard[topics.STATE]]

    def close(self) -> None:
        self.beat.served = []
        self.served.close()
        self.client.close()
        self.node.close()
