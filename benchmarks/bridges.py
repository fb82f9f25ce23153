"""A search over OpenIGTLink or ROS 2 under load: what its loop notices of clients, and the round trip of a stage node.

Run ``python -m benchmarks.bridges`` from the environment of the tests for OpenIGTLink, and from that of ROS 2
(``.venv-ros/bin/python``) for ROS 2. The cases take turns, so that what else the computer does is in all of them.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.loop_times import PACE, described, own_times_s

MARKERSEEK = [sys.executable, "-P", "-m", "markerseek"]
ACQUISITIONS = 60
SEARCH = ("--method", "exhaustive", "--acquisitions", str(ACQUISITIONS))

IGTL_CLIENT = """
import socket, sys
with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as client:
    print("ready", flush=True)
    while client.recv(1 << 18): pass
"""
ROS_CLIENT = """
from markerseek.ros import RosNode, topics
with RosNode("client") as node:
    for topic, kind in ((topics.SAMPLE, "std_msgs/msg/String"), (topics.ENVELOPE, "sensor_msgs/msg/Image"),
                        (topics.PICTURE, "sensor_msgs/msg/Image")):
        node.subscribe(topic, kind, lambda _message: None)
    print("ready", flush=True)
    while True: node.spin(1.0)
"""

Case = tuple[str, int, bool, bool]
CASES: tuple[Case, ...] = (
    ("no client", 0, False, False),
    ("1 client", 1, False, False),
    ("3 clients, one of them stopped", 3, True, False),
    ("1 client and a flood", 1, False, True),
)
"""Name, clients, whether one is stopped, and whether the bridge is flooded."""


@contextmanager
def clients(count: int, program: str, *arguments: str, stopped: bool) -> Iterator[None]:
    """So many clients in processes of their own, the last of them stopped."""
    with ExitStack() as ends:
        for _ in range(count):
            process = subprocess.Popen(
                [sys.executable, "-c", program, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            ends.callback(process.wait)
            ends.callback(process.kill)
            process.stdout.readline()
        if stopped:
            process.send_signal(signal.SIGSTOP)
        yield


@contextmanager
def flooding(once: Callable[[], None], *, wanted: bool) -> Iterator[list[int]]:
    """Calls a function over and over in a thread; the list receives how often."""
    over = threading.Event()
    count = [0]

    def flood() -> None:
        while not over.is_set():
            once()
            count[0] += 1

    thread = threading.Thread(target=flood, daemon=True)
    if wanted:
        thread.start()
    try:
        yield count
    finally:
        over.set()
        if wanted:
            thread.join(20)


def over_igtl(seed: int, case: Case) -> int:
    """A search that an OpenIGTLink client asks for; returns how often the bridge was flooded."""
    from markerseek.wire import igtl

    _, count, stopped, flooded = case
    bridge = subprocess.Popen(
        [*MARKERSEEK, "igtl", "--port", "0", "--pace", str(PACE)], stderr=subprocess.PIPE, text=True
    )
    try:
        port = int(re.search(r"port (\d+)", bridge.stderr.readline())[1])
        xml = f'<Command Name="StartSearch" Seed="{seed}" Method="{SEARCH[1]}" Acquisitions="{ACQUISITIONS}" />'
        asked = igtl.encode(igtl.Message(device="CMD_1", content=igtl.Text(text=xml)))

        def once() -> None:
            # A command that is refused, in a connection of its own, and bytes that are no message.
            with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
                connection.sendall(asked + bytes(1000))
                connection.recv(1 << 16)

        with clients(count, IGTL_CLIENT, str(port), stopped=stopped):
            with socket.create_connection(("127.0.0.1", port)) as starter:
                starter.sendall(asked)
                time.sleep(0.5)
            with flooding(once, wanted=flooded) as times:
                # The bridge says the answer on its terminal.
                next(line for line in bridge.stderr if re.match("found|not found|unsure", line))
            require_local(bridge.pid)
        return times[0]
    finally:
        bridge.send_signal(signal.SIGINT)
        bridge.communicate(timeout=60)


def over_ros(seed: int, case: Case) -> int:
    """A search of the ROS 2 node; returns how often it was asked for another."""
    from markerseek.ros import RosNode, messages, topics

    _, count, stopped, flooded = case
    with clients(count, ROS_CLIENT, stopped=stopped), RosNode("flood") as node:
        trigger = messages.kind("std_srvs/srv/Trigger")
        client = node._node.create_client(trigger, topics.RUN)  # noqa: SLF001  nodes of ours call no services

        def once() -> None:
            if client.wait_for_service(0.1):
                asked = client.call_async(trigger.Request())
                node.network.executor.spin_until_future_complete(asked, timeout_sec=5.0)

        search = [*MARKERSEEK, "ros2", "search", "--once", "--seed", str(seed), "--pace", str(PACE), *SEARCH]
        with flooding(once, wanted=flooded) as times, subprocess.Popen(search, stderr=subprocess.DEVNULL):
            pass
        return times[0]


def require_local(process: int) -> None:
    """Refuse to go on if a process listens to another address than that of this computer (P14)."""
    inodes = {
        target[8:-1]
        for each in Path(f"/proc/{process}/fd").iterdir()
        if (target := str(each.readlink())).startswith("socket:[")
    }
    for name in ("tcp", "tcp6"):
        for fields in map(str.split, Path(f"/proc/{process}/net/{name}").read_text().splitlines()[1:]):
            if fields[9] in inodes and fields[3] == "0A" and not fields[1].startswith("0100007F:"):
                raise SystemExit(f"the bridge listens on {fields[1]}")


def unnoticed(rounds: int, search: Callable[[int, Case], int]) -> None:
    """The loop's own time with and without clients, the cases taking turns."""
    steps: dict[str, list[float]] = {"the command alone": [], **{case[0]: [] for case in CASES}}
    floods = 0
    for seed in range(1, rounds + 1):
        # Another case first in each round: what else the computer does also changes within a round.
        for name in sorted(steps, key=lambda name: (list(steps).index(name) + seed) % len(steps)):
            with tempfile.TemporaryDirectory() as folder:
                os.environ["XDG_DATA_HOME"] = folder
                case = next((each for each in CASES if each[0] == name), None)
                if case is None:
                    alone = [*MARKERSEEK, "search", "--seed", str(seed), "--pace", str(PACE), *SEARCH]
                    subprocess.run(alone, check=False, capture_output=True)
                else:
                    floods += search(seed, case)
                steps[name] += [step for path in Path(folder).rglob("*.journal") for step in own_times_s(path)]
    for name, values in steps.items():
        print(f"{name}: {described(values)}", flush=True)
    print(f"flood: {floods} requests")


def round_trip(moves: int) -> None:
    """From a command to the angle reached, with a simulated stage node in another process."""
    from markerseek.core import Interval
    from markerseek.drivers import Ros2Stage, Ros2StageSettings, SystemClock
    from markerseek.ros import RosNode

    with subprocess.Popen([*MARKERSEEK, "ros2", "sim"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        server.stdout.readline()
        with RosNode("markerseek_rig") as node:
            travel = Interval(low_deg=-35.0, high_deg=35.0)
            stage = Ros2Stage(node=node, clock=SystemClock(), settings=Ros2StageSettings(), travel=travel)
            times = []
            for number in range(moves + 20):
                began_s = time.perf_counter()
                stage.move_to(float(number % 7))
                times.append(time.perf_counter() - began_s)
        server.send_signal(signal.SIGINT)
    # The first load and compile.
    kept = sorted(times[20:])
    print(f"round trip: median {1e3 * statistics.median(kept):.2f} ms, fastest tenth {1e3 * kept[moves // 10]:.2f} ms")


def main() -> None:
    """Measure what this environment has."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--moves", type=int, default=400)
    given = parser.parse_args()
    if importlib.util.find_spec("rclpy") is None:
        unnoticed(given.rounds, over_igtl)
        return
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 230))
    round_trip(given.moves)
    unnoticed(given.rounds, over_ros)


if __name__ == "__main__":
    main()
