"""What the ROS 2 tests share: how a command is started, what it answers, and a client of a stage node."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markerseek.ros import RosNode, messages, topics

MARKERSEEK = (sys.executable, "-P", "-m", "markerseek")

Start = Callable[..., subprocess.Popen[str]]


def answer_of(*words: object) -> tuple[int, dict[str, Any]]:
    """Exit code and JSON object of a command that nobody can be asked."""
    command = [*MARKERSEEK, *map(str, words)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    return done.returncode, json.loads(done.stdout)


def sockets_of(pid: int) -> list[str]:
    """Network sockets of a process, as the system lists them: TCP and UDP, of both versions."""
    targets = [str(each.readlink()) for each in Path(f"/proc/{pid}/fd").iterdir()]
    inodes = {target[8:-1] for target in targets if target.startswith("socket:[")}
    return [
        f"{name}: {line}"
        for name in ("tcp", "tcp6", "udp", "udp6")
        for line in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]
        if line.split()[9] in inodes
    ]


def call(node: RosNode, service: str, *, timeout_s: float) -> tuple[bool, str]:
    """Call a std_srvs/Trigger of another node."""
    client = node._node.create_client(messages.kind("std_srvs/srv/Trigger"), service)
    try:
        assert client.wait_for_service(timeout_s), service
        future = client.call_async(client.srv_type.Request())
        node.network.executor.spin_until_future_complete(future, timeout_sec=timeout_s)
        assert future.done(), service
        return future.result().success, future.result().message
    finally:
        node._node.destroy_client(client)


class Client:
    """Sends commands to a stage node, with the clock of that node, and notes what it publishes."""

    def __init__(self, node: RosNode) -> None:
        self.node = node
        self.clock_ahead_s = 0.0
        joint = "sensor_msgs/msg/JointState"
        self.angles: list[tuple[float, float]] = []
        self.states: list[dict[str, Any]] = []
        node.advertise(topics.MOVE_JP, joint)
        node.subscribe(topics.MEASURED_JS, joint, self._on_angle)
        node.subscribe(
            topics.STATE, "std_msgs/msg/String", lambda message: self.states.append(json.loads(message.data))
        )
        self.until(lambda: node.matched(topics.MOVE_JP) and bool(self.angles and self.states))

    def _on_angle(self, message: Any) -> None:
        self.angles.append((time.monotonic(), math.degrees(message.position[0])))

    @property
    def angle_deg(self) -> float:
        return self.angles[-1][1]

    def until(self, ended: Callable[[], bool], *, most_s: float = 20.0) -> None:
        ends_s = time.monotonic() + most_s
        while not ended():
            assert time.monotonic() < ends_s, (self.angles[-1:], self.states[-1:])
            self.node.spin(0.01)

    def wait(self, duration_s: float) -> None:
        ends_s = time.monotonic() + duration_s
        self.until(lambda: time.monotonic() >= ends_s, most_s=duration_s + 1)

    def send(self, topic: str, angle_deg: float) -> None:
        time_s = self.node.now_s() + self.clock_ahead_s
        self.node.publish(topic, messages.joint_state(time_s=time_s, angle_deg=angle_deg))

    def go(self, angle_deg: float) -> None:
        """Have it go to an angle; on a busy computer a command can be too old when it comes, and is sent again."""
        ends_s = time.monotonic() + 20.0
        while abs(self.angle_deg - angle_deg) > 0.01:
            assert time.monotonic() < ends_s, (self.angles[-1:], self.states[-1:])
            if not self.states[-1]["is_busy"]:
                self.send(topics.MOVE_JP, angle_deg)
            self.wait(0.2)

    def rest(self) -> None:
        """Wait until the stage says that it rests, twice: the first may be from before a command."""
        self.states.clear()
        self.until(lambda: [each["is_busy"] for each in self.states[-3:]] == [False] * 3)
