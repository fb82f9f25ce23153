"""The acquisition of a simulated rig behind a node of ours; as a program, beside the plain node of `number_stage`."""

from __future__ import annotations

import sys

from markerseek import rigs
from markerseek.bridges.ros2 import AcquisitionNode, Serving
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.ros import RosNode


def armed_guard(world: rigs.Rig) -> Guard:
    guard = Guard(limits=world.limits, firing=FiringLimits(), admission=Admission())
    guard.arm(by="a test")
    return guard


def acquisition_of(world: rigs.Rig, *, node: RosNode, guard: Guard) -> AcquisitionNode:
    return AcquisitionNode(
        Serving(node=node, guard=guard, by="a test", simulated=True),
        laser=world.laser,
        receiver=world.receiver,
        clock=world.scanner.clock,
    )


def main() -> None:
    world = rigs.simulated(seed=int(sys.argv[1]))
    with RosNode("acquisition") as node:
        acquisition = acquisition_of(world, node=node, guard=armed_guard(world))
        import rclpy

        from tests.ros2.number_stage import NumberStage

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
