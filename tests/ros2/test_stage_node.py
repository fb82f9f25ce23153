"""The stage node: what it refuses, how it is stopped, and what it tells."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.bridges.ros2 import StepEnded
from markerseek.guard import State
from markerseek.ros import messages, topics
from tests.ros2.stage_bench import Bench


def test_a_command_is_carried_out_and_the_state_is_busy_and_then_idle(bench: Bench) -> None:
    bench.heard[topics.STATE].clear()
    bench.send(topics.MOVE_JP, 4.0)
    bench.until(lambda: bench.stage.angle_deg == 4.0 and not bench.states[-1]["is_busy"])
    busy = [state["is_busy"] for state in bench.states]
    assert busy.index(True) < len(busy) - 1
    assert bench.states[-1]["angle_deg"] == 4.0
    bench.until(lambda: math.degrees(bench.heard[topics.MEASURED_JS][-1].position[0]) == pytest.approx(4.0))
    assert list(bench.heard[topics.MEASURED_JS][-1].name) == ["trus_roll"]
    assert math.degrees(bench.heard[topics.SETPOINT_JS][-1].position[0]) == pytest.approx(4.0)


def test_a_command_that_is_sent_twice_is_carried_out_once(bench: Bench) -> None:
    stamp_s = bench.client.now_s()
    bench.send(topics.MOVE_JP, 1.0, stamp_s=stamp_s)
    bench.until(lambda: bench.stage.asked == [1.0])
    bench.send(topics.MOVE_JP, 2.0, stamp_s=stamp_s)
    bench.until(lambda: "it is a repetition" in bench.states[-1].get("refused", ""))
    assert bench.stage.asked == [1.0]


@pytest.mark.parametrize("angle_deg", [35.01, math.nan])
def test_an_angle_outside_of_the_limits_is_refused_and_never_clamped(bench: Bench, angle_deg: float) -> None:
    bench.send(topics.MOVE_JP, angle_deg)
    bench.until(lambda: bool(bench.states[-1].get("refused")))
    bench.serve(0.3)
    assert bench.stage.asked == []
    assert bench.guard.state is State.ARMED


def test_a_stop_ends_the_move_and_the_next_command_is_carried_out(bench: Bench) -> None:
    bench.send(topics.MOVE_JP, 30.0)
    stop = messages.empty()
    sent: list[float] = []

    def stop_soon() -> None:
        if bench.stage.angle_deg > 2.0 and not sent:
            sent.append(bench.stage.angle_deg)
            bench.client.publish(topics.STOP, stop)
        bench.beat()

    bench.clock._beat = stop_soon
    bench.until(lambda: bool(bench.stage.asked) and bench.stage.stops > 0)
    # 0.2 s at 20 degrees a second are 4 degrees: a beat, a message, a beat. A busy computer takes longer.
    assert sent[0] <= bench.stage.angle_deg < sent[0] + 12.0
    assert bench.guard.state is State.ARMED
    bench.clock._beat = bench.beat
    here_deg = bench.stage.angle_deg
    bench.serve(0.2)
    assert bench.stage.angle_deg == here_deg
    bench.send(topics.MOVE_JP, 0.0)
    bench.until(lambda: bench.stage.angle_deg == 0.0)


def test_a_second_move_is_refused_while_the_stage_turns(bench: Bench) -> None:
    bench.send(topics.MOVE_JP, 6.0)
    sent: list[bool] = []

    def ask_again() -> None:
        if bench.stage.angle_deg > 1.0 and not sent:
            sent.append(True)
            bench.send(topics.MOVE_JP, -20.0)
        bench.beat()

    bench.clock._beat = ask_again
    bench.until(lambda: bench.stage.angle_deg == 6.0)
    bench.until(lambda: "the stage is turning" in bench.states[-1].get("refused", ""))
    assert bench.stage.asked == [6.0]


def test_a_stage_that_fails_is_in_fault_and_no_message_leaves_it(bench: Bench) -> None:
    bench.stage.stuck = True
    bench.send(topics.MOVE_JP, 4.0)
    bench.until(lambda: bench.states[-1]["state"] == "FAULT")
    bench.stage.stuck = False
    bench.send(topics.MOVE_JP, 5.0)
    bench.client.publish(topics.STOP, messages.empty())
    bench.until(lambda: "it does not turn" in bench.states[-1].get("refused", ""))
    assert bench.stage.asked == [4.0]
    assert bench.guard.state is State.FAULT
    assert "it does not turn" in bench.states[-1]["fault"]


def test_nothing_interrupts_a_stage_that_rests(bench: Bench) -> None:
    bench.client.publish(topics.STOP, messages.empty())
    try:
        bench.serve(0.3)
    except StepEnded:
        pytest.fail("a stop of a stage at rest interrupts nothing")
    assert bench.stage.stops == 0
