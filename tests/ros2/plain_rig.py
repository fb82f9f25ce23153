"""A simulated rig whose stage is served by the plain node of `number_stage`, and its acquisition by ours."""

from __future__ import annotations

import sys

from markerseek import rigs
from markerseek.ros import RosNode
from tests.ros2.number_stage import NumberStage
from tests.ros2.simulated_acquisition import acquisition_of, armed_guard


def main() -> None:
    world = rigs.simulated(seed=int(sys.argv[1]))
    with RosNode("acquisition") as node:
        acquisition = acquisition_of(world, node=node, guard=armed_guard(world))
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
