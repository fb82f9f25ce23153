"""``markerseek ros2 stage`` and ``markerseek ros2 acquire``: the devices of a rig as ROS 2 nodes."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import typer

from markerseek import drivers, rigs
from markerseek.bridges import ros2
from markerseek.cli.open_rig import NOT_ARMED, confirmed, person, print_permissions
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
from markerseek.core import ConfigError
from markerseek.ros import topics

_Bench = Annotated[Path, typer.Option(help="Rig file (TOML, kind bench) of the devices.")]
_Arm = Annotated[bool, typer.Option("--arm", help="Arm the node without being asked on the terminal.")]


def stage(
    ctx: typer.Context,
    rig: _Bench,
    arm: _Arm = False,
    plain_command: PlainCommand = None,
    plain_reached: PlainReached = None,
    plain_unit: PlainUnit = "rad",
    require_security: RequireSecurity = False,
) -> None:
    """Serve the stage of a rig to any client, under limits and a guard of its own."""
    plain = plain_topics(plain_command, plain_reached, plain_unit)
    _serve_part("stage", rig, arm=arm, plain=plain, arguments=ctx.obj, keys=require_security)


def acquire(ctx: typer.Context, rig: _Bench, arm: _Arm = False, require_security: RequireSecurity = False) -> None:
    """Serve laser and receiver of a rig: fire and record when asked, under budgets and a guard of its own."""
    _serve_part("acquisition", rig, arm=arm, plain=None, arguments=ctx.obj, keys=require_security)


def _serve_part(
    part: Literal["stage", "acquisition"],
    rig: Path,
    *,
    arm: bool,
    plain: ros2.PlainTopics | None,
    arguments: list[str],
    keys: bool,
) -> None:
    """Connect to one part of a bench, have it armed by a person here, and serve it until stopped."""
    settings = rigs.read_rig_file(rig)
    if not isinstance(settings, drivers.BenchSettings):
        raise ConfigError(f"{rig}: its kind is simulated; serve it with: markerseek ros2 sim --rig {rig}")
    pump = ros2.MessagePump()
    with ExitStack() as opened:
        held = rigs.bench_part(settings, part, beat=pump)
        opened.callback(held.devices.close)
        stderr.print(held.description, markup=False)
        print_permissions(settings)
        # No message arms anything.
        if not arm and not confirmed(f"Arm the {part} and let programs on this network use it?", name=rig.name):
            raise typer.Exit(NOT_ARMED)
        made = ros_node(
            f"trus_{part}",
            _limits(settings),
            publishes=topics.STATE if part == "stage" else topics.ACQUIRED,
            arguments=arguments,
            require_security=keys,
            on_active=follow_lifecycle(pump, 0),
        )
        node = opened.enter_context(made)
        held.arm(by=person())
        served: ros2.Served
        if isinstance(held.part, tuple):
            laser, receiver = held.part
            served = ros2.AcquisitionNode(
                node=node,
                laser=laser,
                receiver=receiver,
                guard=held.guard,
                clock=held.clock,
                by=person(),
                watchdog=held.devices.supervisor,
            )
        else:
            served = ros2.StageNode(
                node=node,
                stage=held.part,
                guard=held.guard,
                by=person(),
                plain=plain,
                watchdog=held.devices.supervisor,
            )
        pump.served = [served]
        stdout.print(f"the {part} is armed and served; Ctrl-C ends it")
        sys.stdout.flush()
        serve_until_stopped(pump)


def _limits(settings: drivers.BenchSettings) -> dict[str, float | str | int | bool]:
    """Limits of a rig as read-only parameters."""
    limits, firing = settings.limits, settings.firing
    return {
        "simulated": False,
        "search_low_rad": math.radians(limits.search.low_deg),
        "search_high_rad": math.radians(limits.search.high_deg),
        "travel_low_rad": math.radians(limits.travel.low_deg),
        "travel_high_rad": math.radians(limits.travel.high_deg),
        "pulses_per_permit": firing.pulses_per_permit,
        "pulses_per_second": firing.pulses_per_second,
        "pulses_per_session": firing.pulses_per_session,
    }
