"""A bank or a finished journal is played to the topics of a search, with its own timing."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start, answer_of

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.ros import RosNode, topics

EXAMPLES = Path(__file__).parents[2] / "examples"
SCAN = EXAMPLES / "simulated_scan.csv"


def heard(start: Start, *options: object) -> tuple[list[dict[str, Any]], list[Any], dict[str, Any]]:
    """Samples, envelopes, and what is known of the recording."""
    samples: list[Any] = []
    envelopes: list[Any] = []
    results: list[Any] = []
    known: list[Any] = []
    with RosNode("listener") as node:
        node.subscribe(topics.SAMPLE, "std_msgs/msg/String", samples.append)
        node.subscribe(topics.ENVELOPE, "sensor_msgs/msg/Image", envelopes.append)
        node.subscribe(topics.RESULT, "std_msgs/msg/String", results.append, latched=True)
        node.subscribe(topics.BANK, "std_msgs/msg/String", known.append, latched=True)
        start(*MARKERSEEK, "ros2", "search", "--play", *options)
        for _ in range(1200):
            node.spin(0.05)
            if results:
                break
        for _ in range(20):
            node.spin(0.05)
    result = json.loads(results[-1].data)
    assert result["state"] == "played"
    # What is sent before the listener has been discovered does not reach it.
    assert 0.9 * result["acquisitions"] <= len(samples) <= result["acquisitions"]
    return [json.loads(each.data) for each in samples], envelopes, json.loads(known[-1].data)


def test_a_table_is_played_row_by_row_in_its_own_time(start: Start) -> None:
    with SCAN.open() as file:
        rows = [(float(row["angle_deg"]), float(row["intensity"])) for row in csv.DictReader(file)]
    samples, _envelopes, known = heard(start, SCAN, "--pace", "0.05")
    assert [(each["angle_deg"], each["intensity"]) for each in samples] == rows[-len(samples) :]
    assert all(each["played"] for each in samples)
    assert known["played"]
    # One row a recorded second: the times between them are the pace, on the average.
    times = [each["time_s"] for each in samples]
    assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(0.05, rel=0.2)


def test_a_finished_journal_is_played_with_its_images(start: Start, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    code, answer = answer_of("search", "--seed", 1, "--acquisitions", 7, "--journal", journal, "--json")
    assert code in (0, 3)
    samples, envelopes, known = heard(start, journal, "--pace", "0.01")
    searched = {each["angle_deg"]: each["intensity"] for each in answer["samples"]}
    played = {each["angle_deg"]: each["intensity"] for each in samples}
    assert searched.items() <= {**played, **searched}.items()
    assert set(searched) <= set(played)
    assert len(envelopes) == len(samples)
    assert known["rig"] == "simulated"


def test_b_mode_images_and_a_registration_are_shown(start: Start, tmp_path: Path) -> None:
    journal, rig, registration = tmp_path / "tip.journal", tmp_path / "rig.toml", tmp_path / "registration.json"
    rig.write_text('kind = "simulated"\n[receiver]\ndata = "b-mode"\n')
    answer_of("search", "--rig", rig, "--acquisitions", 4, "--method", "ternary", "--journal", journal, "--json")
    code, registered = answer_of("register", EXAMPLES / "points.csv", "--json")
    assert code == 0
    registration.write_text(json.dumps(registered | {"simulation": {}}))
    images: list[Any] = []
    cameras: list[Any] = []
    with RosNode("listener") as node:
        node.subscribe(topics.BMODE, "sensor_msgs/msg/Image", images.append)
        for topic in (topics.REGISTRATION, topics.STATIC_FRAMES):
            node.subscribe(topic, "geometry_msgs/msg/TransformStamped", cameras.append, latched=True)
        start(*MARKERSEEK, "ros2", "search", "--play", journal, "--registration", registration, "--pace", "0.05")
        for _ in range(600):
            node.spin(0.05)
            if images and len(cameras) == 2:
                break
    assert (images[-1].encoding, images[-1].header.frame_id) == ("mono8", "trus_bmode")
    assert len(images[-1].data) == images[-1].height * images[-1].width
    # A transform on its own must not pass for one of a real camera.
    assert {each.child_frame_id for each in cameras} == {"simulated_davinci_camera_optical"}
    place = cameras[-1].transform.translation
    assert [place.x, place.y, place.z] == [row[3] for row in registered["davinci_to_trus"][:3]]


def test_a_run_that_is_not_over_is_not_played(tmp_path: Path) -> None:
    code, answer = answer_of("ros2", "search", "--play", tmp_path / "nothing.hdf5", "--json")
    assert code == 2
    assert "nothing.hdf5" in answer["error"]
