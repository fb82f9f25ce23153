"""A simulated rig whose stage is served by the plain node of `number_stage`, and its acquisition by ours."""

from __future__ import annotations

import sys

from number_stage import NumberStage

from markerseek import rigs
from markerseek.bridges.ros2 import AcquisitionNode
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.ros import RosNode


def main() -> None:
    world = rigs.simulated(seed=int(sys.argv[1]))
    guard = Guard(limits=world.limits, firing=FiringLimits(), admission=Admission())
    guard.arm(by="a test")
    with RosNode("acquisition") as node:
        acquisition = AcquisitionNode(
            node=node,
            laser=world.laser,
            receiver=world.receiver,
            guard=guard,
            clock=world.scanner.clock,
            by="a test",
            simulated=True,
        )
        import rclpy

        plain = rclpy.create_node("labview_bridge", context=node.network.context)
        NumberStage(plain, turn=world.stage.move_to)
        node.network.executor.add_node(plain)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            node.spin(0.05)
            acquisition.step()


if __name__ == "__main__":
    main()
