"""``markerseek ros2 sim``: a simulated stage and acquisition as ROS 2 nodes."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek import rigs
from markerseek.bridges import ros2
from markerseek.cli.emulate import true_marker, world_text, write_rig_file
from markerseek.cli.ros2_nodes import (
    PlainCommand,
    PlainReached,
    PlainUnit,
    RequireSecurity,
    follow_lifecycle,
    plain_topics,
    ros_node,
    serve_until_stopped,
)
from markerseek.cli.terminal import stderr, stdout
from markerseek.ros import topics

if TYPE_CHECKING:
    from markerseek.ros import RosNode
    from markerseek.sim import SimulatedSettings

EXAMPLES = "Example:\n\n  markerseek ros2 sim --seed 3 --write-rig ros2-rig.toml"


def command(
    ctx: typer.Context,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML, kind simulated); without one, its defaults.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1,
    pace: Annotated[float, typer.Option(help="Real seconds per virtual second: 0 does not wait.")] = 0,
    write_rig: Annotated[
        Path | None, typer.Option(help="Write a rig file for `markerseek search --rig` that uses these nodes.")
    ] = None,
    plain_command: PlainCommand = None,
    plain_reached: PlainReached = None,
    plain_unit: PlainUnit = "rad",
    require_security: RequireSecurity = False,
) -> None:
    """Serve a simulated stage and acquisition in one simulated world, until Ctrl-C; nothing turns, and no light."""
    from markerseek.guard import Admission, FiringLimits, Guard

    cure = "serve it with: markerseek ros2 stage, markerseek ros2 acquire"
    settings = rigs.read_simulated(rig, cure=cure)
    plain = plain_topics(plain_command, plain_reached, plain_unit)
    pump = ros2.MessagePump()
    world = rigs.simulated(seed=seed, settings=settings, pace=pace, beat=pump)
    limits, clock = settings.limits, world.scanner.clock
    if write_rig is not None:
        write_rig_file(write_rig, _rig_text(settings))
    parameters = {
        "simulated": True,
        "search_low_rad": math.radians(limits.search.low_deg),
        "search_high_rad": math.radians(limits.search.high_deg),
    }
    with ExitStack() as opened:
        guards = [Guard(limits=limits, firing=FiringLimits(), admission=Admission()) for _ in range(2)]
        for guard in guards:
            # Nothing here emits light or turns, so that no person is needed.
            guard.arm(by="a simulated rig")
        nodes: list[RosNode] = []
        parts = ("trus_stage", topics.STATE), ("trus_acquisition", topics.ACQUIRED)
        for index, (name, topic) in enumerate(parts):
            network = nodes[0].network if nodes else None
            made = ros_node(
                name,
                parameters,
                publishes=topic,
                arguments=ctx.obj,
                require_security=require_security,
                on_active=follow_lifecycle(pump, index),
                network=network,
            )
            nodes.append(opened.enter_context(made))
        by = "a simulated rig"
        pump.served = [
            ros2.StageNode(node=nodes[0], stage=world.stage, guard=guards[0], by=by, plain=plain, simulated=True),
            ros2.AcquisitionNode(
                node=nodes[1],
                laser=world.laser,
                receiver=world.receiver,
                guard=guards[1],
                clock=clock,
                by=by,
                simulated=True,
            ),
        ]
        stdout.print("simulated stage and acquisition are ready; nothing turns, and no light; Ctrl-C ends it")
        sys.stdout.flush()
        serve_until_stopped(pump)
    stderr.print(true_marker(world.facts.truth_deg))


def _rig_text(settings: SimulatedSettings) -> str:
    """Text of a rig file for a search on the simulated nodes."""
    return f"""# Simulated ROS 2 nodes (markerseek ros2 sim): no light, nothing turns.
kind = "bench"

[stage]
driver = "ros2"

[laser]
driver = "ros2"
pulses = {settings.laser.pulses}
rate_hz = {settings.laser.rate_hz}

[receiver]
driver = "ros2"
sampling_hz = {settings.receiver.sampling_hz}

{world_text(settings)}"""
