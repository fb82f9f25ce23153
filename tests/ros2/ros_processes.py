"""What the ROS 2 tests share: how a command is started, and what it answers."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markerseek.ros import RosNode

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
    from markerseek.ros import messages

    client = node._node.create_client(messages.kind("std_srvs/srv/Trigger"), service)
    try:
        assert client.wait_for_service(timeout_s), service
        future = client.call_async(client.srv_type.Request())
        node.network.executor.spin_until_future_complete(future, timeout_sec=timeout_s)
        assert future.done(), service
        return future.result().success, future.result().message
    finally:
        node._node.destroy_client(client)
