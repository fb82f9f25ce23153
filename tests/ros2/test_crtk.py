"""The stage node as CRTK has it, with the messages and the client of CRTK where they are installed.

PyPI has neither; both are built from their sources. Without them the tests that need them are skipped.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start, answer_of

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.core import Interval, MoveError
from markerseek.drivers import Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.ros import RosNode, topics
from tests.ros2.turning import Client

HERE = Path(__file__).parent
needs_messages = pytest.mark.skipif(find_spec("crtk_msgs") is None, reason="needs crtk_msgs: PyPI does not have it")
needs_client = pytest.mark.skipif(
    find_spec("crtk") is None, reason="needs crtk_python_client, which PyPI does not have"
)


@pytest.fixture
def node() -> Iterator[RosNode]:
    with RosNode("client") as made:
        yield made


def without_messages(patched: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Hide the messages of CRTK from processes that are started."""
    folder = tmp_path / "hidden"
    folder.mkdir(exist_ok=True)
    (folder / "crtk_msgs.py").write_text("raise ModuleNotFoundError('hidden', name='crtk_msgs')\n")
    patched.setenv("PYTHONPATH", str(folder))


@pytest.mark.parametrize("state_topic", [topics.STATE, topics.OPERATING_STATE])
@pytest.mark.parametrize(
    ("node_has", "search_has"),
    [
        (False, False),
        pytest.param(True, True, marks=needs_messages),
        pytest.param(True, False, marks=needs_messages),
        pytest.param(False, True, marks=needs_messages),
    ],
)
def test_item_5_a_simulated_stage_says_so_whoever_has_the_messages_of_crtk(
    start: Start,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    state_topic: str,
    node_has: bool,
    search_has: bool,
) -> None:
    rig = tmp_path / "rig.toml"
    with monkeypatch.context() as patched:
        if not node_has:
            without_messages(patched, tmp_path)
        start(*MARKERSEEK, "ros2", "sim", "--write-rig", rig)
    lines = rig.read_text().replace('driver = "ros2"', f'driver = "ros2"\nstate_topic = "{state_topic}"', 1)
    rig.write_text(lines)
    with monkeypatch.context() as patched:
        if not search_has:
            without_messages(patched, tmp_path)
        options = ("--method", "ternary", "--acquisitions", 3, "--arm", "--json", "--no-journal")
        _code, answer = answer_of("search", "--rig", rig, *options)
    assert answer["emulated"] == ["stage", "laser", "receiver"], answer


@pytest.mark.parametrize("state_topic", [topics.STATE, pytest.param(topics.OPERATING_STATE, marks=needs_messages)])
def test_item_5_a_refusal_reaches_the_driver_at_once(start: Start, node: RosNode, state_topic: str) -> None:
    start(*MARKERSEEK, "ros2", "sim")
    stage = Ros2Stage(
        node=node,
        clock=SystemClock(),
        settings=Ros2StageSettings(state_topic=state_topic),
        travel=Interval(low_deg=-60.0, high_deg=60.0),
    )
    began_s = time.monotonic()
    with pytest.raises(MoveError, match=r"its node refuses 50.000 deg"):
        stage.move_to(50.0)
    assert time.monotonic() - began_s < 10.0


def test_item_12_frames_setpoint_and_transforms_of_a_stage_node(start: Start, node: RosNode) -> None:
    start(*MARKERSEEK, "ros2", "sim")
    client = Client(node)
    heard: dict[str, list[Any]] = {topics.MEASURED_JS: [], topics.MEASURED_CP: [], topics.FRAMES: []}
    kinds = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
    with RosNode("late", network=node.network) as late:
        for topic, kind in zip(heard, kinds, strict=True):
            late.subscribe(topic, kind, heard[topic].append)
        client.go(5.0)
        client.until(lambda: all(heard.values()))
        for messages in heard.values():
            messages.clear()
        client.until(lambda: all(heard.values()))
        (joint, *_), (pose, *_), (turned, *_) = heard.values()
        half = math.radians(client.angle_deg) / 2
        assert joint.header.frame_id == pose.header.frame_id == turned.header.frame_id == "trus_home"
        assert turned.child_frame_id == "trus_probe"
        for rotation in (pose.pose.orientation, turned.transform.rotation):
            assert (rotation.y, rotation.w) == pytest.approx((math.sin(half), math.cos(half)), abs=1e-6)
        # Who comes late is told at once where the stage was sent to: the topic is latched.
        setpoints: list[Any] = []
        late.subscribe(topics.SETPOINT_JS, "sensor_msgs/msg/JointState", setpoints.append, latched=True)
        client.until(lambda: bool(setpoints))
        assert math.degrees(setpoints[0].position[0]) == pytest.approx(5.0)


@needs_messages
@needs_client
def test_item_12_the_client_of_crtk_runs_against_the_node(start: Start) -> None:
    start(*MARKERSEEK, "ros2", "sim", "--pace", "1")
    done = subprocess.run(
        [sys.executable, HERE / "crtk_client.py"], check=False, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert (said["enabled"], said["homed"], said["moved"], said["disabled"]) == (True, True, True, True)
    assert abs(said["off_deg"]) < 0.01
    assert abs(said["pose_deg"]) < 0.01
    assert abs(said["drift_deg"]) < 0.01
    assert abs(said["from_setpoint_deg"]) < 0.01
    # No message arms a stage again.
    assert not said["enabled_again"]
