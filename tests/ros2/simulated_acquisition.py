"""The acquisition of a simulated rig behind a node, and the guard of its nodes."""

from __future__ import annotations

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
