"""``markerseek ros2``: a search, a stage, an acquisition, or a simulated rig as ROS 2 nodes."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from markerseek import bridges, drivers, rigs
from markerseek.bridges import ros2
from markerseek.cli.options import RigFile, with_values
from markerseek.cli.ros2_devices import ros_node
from markerseek.cli.signals import Stopped, noted_signals
from markerseek.cli.terminal import print_json, stderr
from markerseek.core import SearchPlan, SimulationOptions
from markerseek.ros import topics


@with_values
def search(
    ctx: typer.Context,
    plan: SearchPlan,
    simulation: SimulationOptions,
    rig: RigFile = None,
    registration: Annotated[
        Path | None,
        typer.Option(
            help="Also publish the transform of the da Vinci camera: of the file that `markerseek register` wrote, or "
            "of a session's folder, after each marker."
        ),
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Search at once, then end with the exit code of the search.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, with --once.")] = False,
) -> None:
    """Search when /pa_search/run is called, and publish each acquisition and the answer.

    The search is the ordinary command in a process of its own. A rig of devices asks on this terminal whether it may be
    armed, each time; no message arms it.

    Examples
    --------
    markerseek ros2 search
    markerseek ros2 search --registration SESSION
    markerseek ros2 search --once --rig ros2-rig.toml --json
    """
    asked = bridges.AskedSearch(plan=plan, simulation=simulation)
    if rig is not None:
        # A file that cannot be used is refused now, not when a node calls.
        rigs.read_rig_file(rig)
    options = bridges.SearchOptions(rig=rig)
    with ExitStack() as open_:
        source = None if registration is None else open_.enter_context(bridges.open_registration(registration))
        node = open_.enter_context(ros_node("pa_search", publishes=topics.RESULT, arguments=ctx.obj))
        stopped = open_.enter_context(noted_signals())
        served = ros2.SearchNode(node=node, options=options, asked=asked, publishes_angle=not _is_over_ros(rig))
        registered = None if source is None else ros2.RegistrationTopics(node=node, source=source)
        try:
            if once:
                served.start()
            else:
                stderr.print("the search node is ready; call /pa_search/run (std_srvs/Trigger); Ctrl-C ends it")
            while not stopped and not (once and not served.running):
                node.spin(0.1)
                served.step()
                if registered is not None and (said := registered.step()) is not None:
                    stderr.print(said, markup=False)
        finally:
            served.close()
        outcome = served.outcome
    if once and outcome is not None:
        if as_json and outcome.answer is not None:
            print_json(outcome.answer)
        stderr.print(outcome.message, markup=False)
        raise typer.Exit(outcome.exit_code)
    raise Stopped(128 + stopped[0] if stopped else 0)


def _is_over_ros(rig: Path | None) -> bool:
    """Whether a rig file names a stage node, which publishes its angle itself."""
    settings = None if rig is None else rigs.read_rig_file(rig)
    return isinstance(settings, drivers.BenchSettings) and isinstance(settings.stage, drivers.Ros2StageSettings)


class RosGroup(TyperGroup):
    """Keeps what follows ``--ros-args`` (until ``--``, or the end) for the node, as every program of ROS 2 does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own, ctx.obj = args, []
        if "--ros-args" in args:
            begin = args.index("--ros-args")
            end = args.index("--", begin) if "--" in args[begin:] else len(args)
            own, ctx.obj = args[:begin] + args[end + 1 :], args[begin + 1 : end]
        return super().parse_args(ctx, own)
