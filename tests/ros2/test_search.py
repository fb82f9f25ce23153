"""A search over ROS 2 makes the acquisitions of the same search in one process, and gives its answer."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start, answer_of, sockets_of
from tests.waiting import wait_until

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

HERE = Path(__file__).parent
SEED = 3

PLAIN_RIG = """
kind = "bench"
[stage]
driver = "ros2"
command_topic = "/goto"
reached_topic = "/angle"
state_topic = "none"
message = "float64"
unit = "deg"
[laser]
driver = "ros2"
[receiver]
driver = "ros2"
[probe]
face_radius_m = 0.01
"""


@pytest.fixture(scope="module")
def alone() -> dict[str, Any]:
    """The search in one process, without ROS."""
    _code, answer = answer_of("search", "--seed", SEED, "--no-journal", "--json")
    return answer


def require_same(over_ros: dict[str, Any], alone: dict[str, Any]) -> None:
    assert over_ros["answer"] == alone["answer"] == "found"
    assert abs(over_ros["angle_deg"] - alone["angle_deg"]) < 1e-6
    ours, theirs = (answer["samples"] for answer in (over_ros, alone))
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        assert abs(one["angle_deg"] - other["angle_deg"]) < 1e-6
        assert one["intensity"] == pytest.approx(other["intensity"], rel=1e-9)


def test_a_search_on_simulated_nodes_in_another_process(start: Start, tmp_path: Path, alone: dict[str, Any]) -> None:
    rig = tmp_path / "rig.toml"
    nodes = start(*MARKERSEEK, "ros2", "sim", "--seed", SEED, "--write-rig", rig)
    code, answer = answer_of("search", "--rig", rig, "--arm", "--json", "--no-journal")
    assert code == 0, answer
    require_same(answer, alone)
    assert answer["emulated"] == ["stage", "laser", "receiver"]
    # Local addresses, as the system lists them: 127.0.0.1 and no other.
    assert {each.split()[2].partition(":")[0] for each in sockets_of(nodes.pid)} == {"0100007F"}
    _code, unarmed = answer_of("search", "--rig", rig, "--json", "--no-journal")
    assert unarmed["rig"].startswith("SIMULATED stage node on /TRUS/move_jp")


def test_a_search_on_a_stage_of_plain_numbers(start: Start, tmp_path: Path, alone: dict[str, Any]) -> None:
    assert len((HERE / "number_stage.py").read_text().splitlines()) < 45
    (tmp_path / "rig.toml").write_text(PLAIN_RIG)
    start(sys.executable, "-m", "tests.ros2.plain_rig", SEED)
    code, answer = answer_of("search", "--rig", tmp_path / "rig.toml", "--arm", "--json", "--no-journal")
    assert code == 0, answer
    require_same(answer, alone)


def test_a_rig_whose_nodes_are_killed_ends_the_search_and_serves_the_next_when_started_again(
    start: Start, tmp_path: Path, alone: dict[str, Any]
) -> None:
    rig = tmp_path / "rig.toml"
    nodes = start(*MARKERSEEK, "ros2", "sim", "--seed", SEED, "--pace", "0.05", "--write-rig", rig)
    quicker = rig.read_text().replace('driver = "ros2"', 'driver = "ros2"\ntimeout_s = 3.0', 1)
    rig.write_text(quicker.replace("[receiver]", "[receiver]\ntimeout_s = 3.0"))
    events = tmp_path / "events"
    search = subprocess.Popen(
        [*MARKERSEEK, "search", "--rig", rig, "--arm", "--json", "--no-journal", "--events", str(events)],
        stdout=subprocess.PIPE,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    wait_until(
        lambda: (events.exists() and b'"kind":"measured"' in events.read_bytes()) or search.poll() is not None,
    )
    assert search.poll() is None, search.communicate()[0]
    nodes.send_signal(signal.SIGKILL)
    answer = json.loads(search.communicate(timeout=200)[0])
    assert search.returncode == 1
    assert "node" in answer["error"]
    start(*MARKERSEEK, "ros2", "sim", "--seed", SEED)
    code, answer = answer_of("search", "--rig", rig, "--arm", "--json", "--no-journal")
    assert code == 0, answer
    require_same(answer, alone)


def test_without_nodes_the_search_says_what_to_start(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(PLAIN_RIG.replace('unit = "deg"', 'unit = "deg"\nconnect_s = 1.0'))
    code, answer = answer_of("search", "--rig", tmp_path / "rig.toml", "--arm", "--json", "--no-journal")
    assert code == 1
    assert "no node takes angles on /goto within 1 s; start it, and compare topics" in answer["error"]
