"""The drivers of ROS 2 nodes keep the contracts of `markerseek.contract`, with nodes of rclpy on the other side.

Server and driver share a process and a thread: whenever the driver waits, the server is served. All messages go through
rclpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

import rclpy

from markerseek import rigs
from markerseek.bridges.ros2 import Serving, StageNode
from markerseek.contract import LaserContract, ReceiverContract, StageContract
from markerseek.core import Laser, Receiver, Stage
from markerseek.drivers import Ros2Acquisition, Ros2ReceiverSettings, Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.ros import RosNode, topics
from tests.ros2.number_stage import NumberStage
from tests.ros2.plain_rig import acquisition_of, armed_guard


class _OverRos:
    """Makes a server and the driver's node, which are closed with the test."""

    @pytest.fixture(autouse=True)
    def _opened(self) -> Iterator[None]:
        with ExitStack() as self.opened:
            yield

    def nodes(self) -> tuple[RosNode, RosNode]:
        server = self.opened.enter_context(RosNode("server"))
        return server, self.opened.enter_context(RosNode("markerseek_rig", network=server.network))

    def clock(self, step: Callable[[], None]) -> SystemClock:
        return SystemClock(beat=step)


class TestStageNode(_OverRos, StageContract):
    def make(self) -> Stage:
        world = rigs.simulated(seed=1)
        server, node = self.nodes()
        serving = Serving(node=server, guard=armed_guard(world), by="a test", simulated=True)
        served = StageNode(serving, stage=world.stage)
        # A stage node serves the angles that may be searched: those of its travel beyond them, it refuses.
        stage = Ros2Stage(
            node=node, clock=self.clock(served.step), settings=Ros2StageSettings(), travel=world.limits.search
        )
        assert stage.emulated
        return stage


class TestStopRightAfterACommand(_OverRos):
    def test_it_reaches_the_node_before_that_says_it_is_busy(self) -> None:
        world = rigs.simulated(seed=1)
        server, node = self.nodes()
        listener = self.opened.enter_context(RosNode("listener", network=server.network))
        serving = Serving(node=server, guard=armed_guard(world), by="a test", simulated=True)
        served = StageNode(serving, stage=world.stage)
        heard: list[object] = []
        listener.subscribe(topics.STOP, "std_msgs/msg/Empty", heard.append)
        pressed = False

        def step() -> None:
            if pressed:
                raise KeyboardInterrupt
            served.step()

        stage = Ros2Stage(node=node, clock=self.clock(step), settings=Ros2StageSettings(), travel=world.limits.search)
        stage.stop()
        pressed = True
        with pytest.raises(KeyboardInterrupt):
            stage.move_to(stage.angle_deg + 5)
        stage.stop()
        for _ in range(30):
            listener.spin(0.05)
        # That of the stage at rest was not sent.
        assert len(heard) == 1


class TestStageOfPlainNumbers(_OverRos, StageContract):
    # Such a node does not say when it rests: an angle so near to the target counts as reached.
    resolution_deg = Ros2StageSettings().arrival_deg

    def make(self) -> Stage:
        server, node = self.nodes()
        plain = rclpy.create_node("labview_bridge", context=server.network.context)
        self.opened.callback(plain.destroy_node)
        NumberStage(plain)
        server.network.executor.add_node(plain)
        settings = Ros2StageSettings(
            command_topic="/goto", reached_topic="/angle", state_topic=None, message="float64", unit="deg"
        )
        limits = rigs.simulated(seed=1).limits
        return Ros2Stage(node=node, clock=self.clock(lambda: None), settings=settings, travel=limits.travel)


class _Acquisition(_OverRos):
    def acquisition(self) -> Ros2Acquisition:
        world = rigs.simulated(seed=1)
        server, node = self.nodes()
        served = acquisition_of(world, node=server, guard=armed_guard(world))
        settings = Ros2ReceiverSettings(sampling_hz=world.imaging.preset.sampling_hz)
        return Ros2Acquisition(node=node, clock=self.clock(served.step), settings=settings)


class TestLaserOfAnAcquisitionNode(_Acquisition, LaserContract):
    def make(self) -> Laser:
        return self.acquisition()


class TestReceiverOfAnAcquisitionNode(_Acquisition, ReceiverContract):
    # Laser and receiver are one node: a request fires and records, so that both contracts are of one driver.
    def make(self) -> tuple[Receiver, Laser]:
        both = self.acquisition()
        return both, both
