"""What the field reports of ROS 2: QoS that does not fit, nodes that do not see one another, no middleware.

The peers are plain rclpy in processes of their own, with the settings that ROS 2 has by default.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start, answer_of, sockets_of

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek import rigs
from markerseek.core import ConfigError, DeviceTimeoutError, Interval, NotConnectedError
from markerseek.drivers import Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.ros import RosNode, require_middleware, set_up_discovery, topics
from markerseek.ros.node import DuplicateFilter
from tests.ros2.plain_rig import acquisition_of, armed_guard
from tests.ros2.stage_bench import Bench

HERE = Path(__file__).parent
CONNECTED_RIG = """
kind = "bench"

[stage]
driver = "ros2"
connect_s = 3.0

[laser]
driver = "ros2"

[receiver]
driver = "ros2"
"""


def plain_environment(chosen: Mapping[str, str]) -> dict[str, str]:
    """The environment of a lab's own node: nothing that this program has set."""
    ours = ("FASTDDS_BUILTIN_TRANSPORTS", "FASTDDS_DEFAULT_PROFILES_FILE")
    return {key: value for key, value in os.environ.items() if key not in ours} | dict(chosen)


@pytest.fixture
def peer() -> Iterator[Any]:
    """Starts a program of a lab; each is ended with the test."""
    made: list[subprocess.Popen[str]] = []

    def begin(program: str, *words: object, **chosen: str) -> subprocess.Popen[str]:
        command = [sys.executable, HERE / program, *map(str, words)]
        made.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=plain_environment(chosen)))
        return made[-1]

    yield begin
    for each in made:
        each.kill()
        each.communicate()


def heard_until(process: subprocess.Popen[str], *wanted: str, most_s: float = 20.0) -> str:
    """Output of a process until it has said something."""
    said = ""
    ends_s = time.monotonic() + most_s
    while not all(each in " ".join(said.split()) for each in wanted):
        assert time.monotonic() < ends_s, said
        if select.select([process.stdout], [], [], 0.2)[0]:
            said += os.read(process.stdout.fileno(), 1 << 16).decode()
    return " ".join(said.split())


@pytest.mark.real_time
@pytest.mark.parametrize(("topic", "reliability"), [(topics.STOP, "BEST_EFFORT"), (topics.HOLD, "RELIABLE")])
def test_b1_a_stop_is_heard_from_every_publisher(bench: Bench, peer: Any, reliability: str, topic: str) -> None:
    console = peer("console.py", reliability, "stop", topic)
    bench.until(lambda: console.poll() is not None)
    said = json.loads(console.stdout.read())
    assert bench.stage.asked == [pytest.approx(30.0)]
    assert bench.stage.stops == 1
    # 0.3 s at 20 degrees a second are 6 degrees; a busy computer takes longer. The way takes 1.5 s.
    assert said["rest_deg"] == pytest.approx(bench.stage.angle_deg)
    assert 0.0 < bench.stage.angle_deg < 29.0
    assert bench.states[-1]["refused"] == ""


def test_b1_an_acquisition_is_asked_for_once_by_a_publisher_of_sensors(peer: Any) -> None:
    world = rigs.simulated(seed=1)
    with RosNode("trus_acquisition") as node:
        served = acquisition_of(world, node=node, guard=armed_guard(world))
        console = peer("console.py", "BEST_EFFORT", "acquire", 4, 3)
        ends_s = time.monotonic() + 20.0
        while console.poll() is None and time.monotonic() < ends_s:
            node.spin(0.02)
            served.step()
    answers = json.loads(console.stdout.read())["answers"]
    assert answers == [[number, step, ""] for number in "01" for step in ("fired", "frame")]


@pytest.mark.parametrize("state_topic", ["/arm/state", None])
def test_b1_a_stage_with_the_qos_of_sensors_is_driven(peer: Any, state_topic: str | None) -> None:
    assert peer("sensor_stage.py").stdout.readline() == "ready\n"
    settings = Ros2StageSettings(
        command_topic="/arm/move_jp", reached_topic="/arm/measured_js", state_topic=state_topic
    )
    with RosNode("markerseek_rig") as node:
        clock = SystemClock(beat=lambda: beats.append(None))
        beats: list[None] = []
        stage = Ros2Stage(node=node, clock=clock, settings=settings, travel=Interval(low_deg=-36.5, high_deg=36.5))
        assert stage.move_to(2.0) == pytest.approx(2.0, abs=0.05)
        assert stage.angle_deg == pytest.approx(2.0, abs=0.05)
        if state_topic is None:
            return
        # Its stop is reliable, and ours is heard there: it stands on its way to 30 degrees.
        began_s = clock.now_s()

        def give_up() -> None:
            if clock.now_s() - began_s > 0.5:
                raise KeyboardInterrupt

        clock._beat = give_up
        with pytest.raises(KeyboardInterrupt):
            stage.move_to(30.0)
        clock._beat = lambda: None
        stage.stop()
        ends_s = clock.now_s() + 10.0
        while stage._busy and clock.now_s() < ends_s:
            node.spin(0.02)
        assert not stage._busy
        assert 2.0 < stage.angle_deg < 25.0


ARM = {"command_topic": "/arm/move_jp", "reached_topic": "/arm/measured_js", "state_topic": "/arm/state"}
TRAVEL = Interval(low_deg=-36.5, high_deg=36.5)


@pytest.mark.parametrize("state", ["latched", "on-change"])
def test_a_stage_that_publishes_its_state_when_it_changes_is_driven(peer: Any, state: str) -> None:
    assert peer("sensor_stage.py", "--state", state).stdout.readline() == "ready\n"
    # What a latched topic keeps was said long before.
    time.sleep(1.0)
    with RosNode("markerseek_rig") as node:
        stage = Ros2Stage(node=node, clock=SystemClock(), settings=Ros2StageSettings(**ARM), travel=TRAVEL)
        for angle_deg in (1.5, -0.5):
            assert stage.move_to(angle_deg) == pytest.approx(angle_deg, abs=0.05)


def test_the_joints_that_came_are_named_and_the_right_one_is_a_key(peer: Any) -> None:
    assert peer("sensor_stage.py", "--joint", "rotary_axis").stdout.readline() == "ready\n"
    with RosNode("markerseek_rig") as node:
        with pytest.raises(NotConnectedError, match=r"the joints rotary_axis, .*'trus_roll'.*stage.joint"):
            Ros2Stage(node=node, clock=SystemClock(), settings=Ros2StageSettings(**ARM), travel=TRAVEL)
        settings = Ros2StageSettings(**ARM, joint="rotary_axis")
        stage = Ros2Stage(node=node, clock=SystemClock(), settings=settings, travel=TRAVEL)
        assert stage.move_to(2.5) == pytest.approx(2.5, abs=0.05)


def test_messages_of_another_joint_on_the_same_topic_are_none_of_the_stage(peer: Any) -> None:
    assert peer("sensor_stage.py", "--joint", "roll", "--beside", "gripper").stdout.readline() == "ready\n"
    with RosNode("markerseek_rig") as node:
        settings = Ros2StageSettings(**ARM, joint="roll")
        stage = Ros2Stage(node=node, clock=SystemClock(), settings=settings, travel=TRAVEL)
        for angle_deg in (1.5, -1.0):
            assert stage.move_to(angle_deg) == pytest.approx(angle_deg, abs=0.05)
            assert stage.angle_deg == pytest.approx(angle_deg, abs=0.05)


@pytest.mark.parametrize(("stamp", "said"), [("zero", "stamped 0.000 s"), ("simulated", r"stamped \d\.000 s")])
def test_angles_with_stamps_of_another_clock_are_named(peer: Any, stamp: str, said: str) -> None:
    assert peer("sensor_stage.py", "--stamp", stamp).stdout.readline() == "ready\n"
    with RosNode("markerseek_rig") as node:
        settings = Ros2StageSettings(**ARM, timeout_s=3.0)
        stage = Ros2Stage(node=node, clock=SystemClock(), settings=settings, travel=TRAVEL)
        with pytest.raises(DeviceTimeoutError, match=f"busy and is idle again, .*{said}.*simulation time"):
            stage.move_to(2.0)


@pytest.mark.parametrize("domain", ["233", "300", "-1", "7.5", "lab"])
def test_a_domain_that_does_not_exist_is_refused_with_the_range(monkeypatch: pytest.MonkeyPatch, domain: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(ConfigError, match=f"ROS_DOMAIN_ID is '{domain}', .* from 0 to 232"):
        RosNode("markerseek_rig")


@pytest.mark.parametrize("home", [{}, {"HOME": ""}])
def test_without_a_home_folder_a_node_starts(home: dict[str, str]) -> None:
    program = "from markerseek.ros import RosNode\nwith RosNode('markerseek_rig'): print('started')"
    environment = {key: value for key, value in os.environ.items() if key not in ("HOME", "ROS_LOG_DIR")} | home
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout == "started\n", done.stderr


def test_b1_a_latched_topic_is_heard_from_a_publisher_that_keeps_nothing(peer: Any) -> None:
    assert peer("sensor_stage.py").stdout.readline() == "ready\n"
    heard: list[Any] = []
    with RosNode("client") as node:
        node.subscribe("/arm/state", "std_msgs/msg/String", heard.append, latched=True)
        ends_s = time.monotonic() + 10.0
        while not heard and time.monotonic() < ends_s:
            node.spin(0.05)
        assert heard
        assert node.publishes("/arm/state")


def info(publisher: bytes | None, number: int | None, stamp_ns: int = 0) -> dict[str, Any]:
    gid = None if publisher is None else {"data": publisher}
    return {"publisher_gid": gid, "publication_sequence_number": number, "source_timestamp": stamp_ns}


def test_b1_the_copies_of_a_message_are_one_message() -> None:
    duplicates = DuplicateFilter()
    assert [duplicates.is_new(info(b"a", number)) for number in (1, 1, 2, 3, 2, 3, 4)] == [
        *(True, False, True, True),
        *(False, False, True),
    ]
    # The next publisher counts from the beginning.
    assert duplicates.is_new(info(b"b", 1))
    # A move that was lost and sent again does not come after the stop that followed it.
    assert [duplicates.is_new(info(b"c", number)) for number in (2, 1)] == [True, False]


@pytest.mark.parametrize("number", [None, 1])
def test_b1_copies_are_told_apart_where_rclpy_names_no_publisher(number: int | None) -> None:
    duplicates = DuplicateFilter()
    # Two clocks: what is stamped earlier is not what was sent earlier.
    stamps_ns = (5, 5, 3, 4, 3)
    assert [duplicates.is_new(info(None, number, each)) for each in stamps_ns] == [True, False, True, True, False]


def test_b6_a_node_of_default_settings_and_ours_see_one_another(start: Start, peer: Any) -> None:
    nodes = start(*MARKERSEEK, "ros2", "sim", "--pace", 1)
    console = peer("console.py", "RELIABLE", "stop", topics.STOP)
    said = json.loads(console.communicate(timeout=30)[0])
    assert said["rest_deg"] < 29.0, said
    # Local addresses as the system lists them: 127.0.0.1, and nothing else.
    listening = [each.split()[2] for each in sockets_of(nodes.pid)]
    assert listening
    assert {each.partition(":")[0] for each in listening} == {"0100007F"}


@pytest.mark.parametrize(
    ("first", "chosen"),
    [
        ("theirs", {}),
        ("ours", {}),
        ("theirs", {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}),
    ],
)
def test_b6_a_stage_on_this_computer_is_driven_whoever_is_first(peer: Any, first: str, chosen: dict[str, str]) -> None:
    if first == "theirs":
        assert peer("number_stage.py", **chosen).stdout.readline() == "ready\n"
    settings = Ros2StageSettings(
        command_topic="/goto", reached_topic="/angle", state_topic=None, message="float64", unit="deg", connect_s=20
    )
    with RosNode("markerseek_rig") as node:
        if first == "ours":
            peer("number_stage.py", **chosen)
        travel = Interval(low_deg=-36.5, high_deg=36.5)
        stage = Ros2Stage(node=node, clock=SystemClock(), settings=settings, travel=travel)
        assert stage.move_to(5.0) == pytest.approx(5.0, abs=0.05)


HERE_ONLY = "on this computer only (127.0.0.1 and shared memory); FASTDDS_BUILTIN_TRANSPORTS=DEFAULT opens the network"


def test_b6_both_commands_say_where_nodes_are_looked_for(start: Start, tmp_path: Path) -> None:
    where = f"ROS 2 domain {os.environ['ROS_DOMAIN_ID']} (ROS_DOMAIN_ID), {HERE_ONLY}"
    (tmp_path / "rig.toml").write_text(CONNECTED_RIG)
    nodes = start(*MARKERSEEK, "ros2", "search", wait=False)
    words = [*MARKERSEEK, "search", "--rig", tmp_path / "rig.toml", "--arm", "--json", "--no-journal"]
    search = subprocess.run([*map(str, words)], check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert search.returncode == 1
    missing = "stage: no node takes angles on /TRUS/move_jp"
    warned = f"warning: {missing} so far; it is looked for in {where}; waiting up to 3 s"
    assert warned in " ".join(search.stderr.split())
    assert json.loads(search.stdout)["error"] == (
        f"{missing} within 3 s; start it, and compare topics and message types; it is looked for in {where}"
    )
    heard_until(nodes, where)


def test_b6_a_middleware_that_is_not_installed_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    (tmp_path / "rig.toml").write_text(CONNECTED_RIG)
    said = (
        "RMW_IMPLEMENTATION is rmw_cyclonedds_cpp, which is not installed here (rmw_fastrtps_cpp is); unset "
        "RMW_IMPLEMENTATION, or install that package"
    )
    code, answer = answer_of("search", "--rig", tmp_path / "rig.toml", "--arm", "--json", "--no-journal")
    assert (code, answer["error"]) == (2, said)


@pytest.mark.parametrize("name", ["rmw_fastrtps_cpp", ""])
def test_b6_the_middleware_that_is_installed_may_be_named(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", name)
    require_middleware()
    assert set_up_discovery().endswith(HERE_ONLY)
