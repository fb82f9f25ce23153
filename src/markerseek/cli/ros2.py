"""``markerseek ros2``: a search, a stage, an acquisition, or a simulated rig as ROS 2 nodes."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

from markerseek.cli import ros2_devices, ros2_search, ros2_sim


class _RosGroup(TyperGroup):
    """Keeps what follows ``--ros-args`` (until ``--``, or the end) for the node, as every program of ROS 2 does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own, ctx.obj = args, []
        if "--ros-args" in args:
            begin = args.index("--ros-args")
            end = args.index("--", begin) if "--" in args[begin:] else len(args)
            own, ctx.obj = args[:begin] + args[end + 1 :], args[begin + 1 : end]
        return super().parse_args(ctx, own)


app = typer.Typer(
    name="ros2",
    cls=_RosGroup,
    help="Run a search, a stage, an acquisition or a simulated rig as ROS 2 nodes. What follows `--ros-args` is for "
    "the node: `--ros-args -r __ns:=/left`.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
for _name, _command, _examples in (
    ("search", ros2_search.command, ros2_search.EXAMPLES),
    ("stage", ros2_devices.stage, "Example:\n\n  markerseek ros2 stage --rig examples/rigs/bench.toml"),
    ("acquire", ros2_devices.acquire, "Example:\n\n  markerseek ros2 acquire --rig examples/rigs/bench.toml"),
    ("sim", ros2_sim.command, ros2_sim.EXAMPLES),
):
    app.command(name=_name, epilog=_examples)(_command)
