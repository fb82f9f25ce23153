"""``markerseek ros2``: a search, a stage, an acquisition, or a simulated rig as ROS 2 nodes."""

from __future__ import annotations

import typer

from markerseek.cli import ros2_devices, ros2_search, ros2_sim

app = typer.Typer(
    name="ros2",
    help="Run a search, a stage, an acquisition or a simulated rig as ROS 2 nodes.",
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
