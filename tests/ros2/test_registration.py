"""A registration session handed on over ROS 2 while it runs: given, again, withdrawn; a finished file is static."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from markerseek.registration import SessionRecord
from tests.registration_sessions import begin, kill, matrix_m, registered
from tests.ros2.heard import LISTENER, Heard, state
from tests.ros2.ros_processes import MARKERSEEK, Start

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")


def tf(markers: int) -> Callable[[dict[str, Any]], bool]:
    """Whether ``/tf`` has the transform of a number of markers."""
    place_m = matrix_m(markers)[:3, 3]
    return lambda message: message["topic"] == "tf" and np.allclose(message["place_m"], place_m)


@pytest.fixture
def heard(start: Start) -> Heard:
    return Heard(start(*LISTENER))


def test_a_session_is_on_tf_as_long_as_it_holds(start: Start, heard: Heard, tmp_path: Path) -> None:
    record = begin(tmp_path / "session", markers=2)
    start(*MARKERSEEK, "ros2", "search", "--registration", tmp_path / "session")
    heard.until(state(decided=False, session="running", markers=0))
    record.add(registered(3))
    given = heard.until(tf(3), state(decided=True, markers=3))
    camera = next(each for each in given if each["topic"] == "tf")
    assert camera["frames"] == ["trus_home", "simulated_davinci_camera_optical"]
    assert camera["age_s"] < 5
    # Again and again, so that a lookup at the time of a new image finds it.
    for _ in range(3):
        heard.until(tf(3))
    kill(record)
    heard.until(state(decided=True, session="stopped"))
    heard.until(tf(3))
    record = SessionRecord.reopen(tmp_path / "session")
    record.add(registered(4))
    more = heard.until(tf(4), state(decided=True, session="running", markers=4))
    errors = [each for each in more if each["topic"] == "state"][-1]
    assert errors["tre95_m"] == pytest.approx(registered(4).report.tre95_m)
    record.add(registered(5, decided=False))
    withdrawn = heard.until(state(decided=False))
    rest = []
    while (message := heard.next(2.0)) is not None:
        rest.append(message)
    # A message or two of /tf may have been on their way.
    assert sum(each["topic"] == "tf" for each in rest) <= 2
    latched = [each for each in more + withdrawn + rest if each["topic"] == "registration"]
    assert np.isnan([*latched[-1]["place_m"], *latched[-1]["quaternion"]]).all()
    assert all(each["topic"] != "static" for each in given + more + rest)
    record.close()


def test_a_node_that_comes_late_gets_no_withdrawn_transform(start: Start, tmp_path: Path) -> None:
    record = begin(tmp_path / "session", markers=3)
    start(*MARKERSEEK, "ros2", "search", "--registration", tmp_path / "session")
    Heard(start(*LISTENER)).until(tf(3))
    record.add(registered(4, decided=False))
    late = Heard(start(*LISTENER))
    messages = late.until(state(decided=False))
    while (message := late.next(1.5)) is not None:
        messages.append(message)
    last = [each for each in messages if each["topic"] == "registration"][-1]
    assert np.isnan(last["place_m"]).all()
    record.close()


def test_a_finished_file_is_static(start: Start, heard: Heard, tmp_path: Path) -> None:
    path = tmp_path / "registration.json"
    path.write_bytes(msgspec.json.encode(registered(4).report))
    start(*MARKERSEEK, "ros2", "search", "--registration", path)
    messages = heard.until(lambda message: message["topic"] == "static", state(decided=True))
    last = {each["topic"]: each for each in messages}
    assert last["static"]["place_m"] == pytest.approx(matrix_m(4)[:3, 3].tolist())
    assert last["state"]["tre_m"] == pytest.approx(registered(4).report.tre_m)
