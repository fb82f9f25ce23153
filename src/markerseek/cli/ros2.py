"""``markerseek ros2``: a search, a run that follows, a stage, an acquisition, or a simulated rig as ROS 2 nodes."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from markerseek import bridges, drivers, rigs, ros
from markerseek.bridges import ros2
from markerseek.cli.emulate import true_marker, world_text, write_text_file
from markerseek.cli.follow import follow_target
from markerseek.cli.follow_run import Followed, FollowPlace, FollowRun
from markerseek.cli.open_rig import NOT_ARMED, confirmed, person, print_permissions
from markerseek.cli.options import AsJson, Out, RigFile, with_values
from markerseek.cli.report import Output
from markerseek.cli.signals import Stopped, noted_signals
from markerseek.cli.terminal import print_json, stderr, stdout
from markerseek.core import ConfigError, SceneOptions, SearchPlan, SimulationOptions
from markerseek.files import quoted
from markerseek.following import FollowPlan
from markerseek.ros import topics

if TYPE_CHECKING:
    from markerseek.sim import SimulatedSettings


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
    asked = bridges.SearchRequest(plan=plan, simulation=simulation)
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
        if as_json and outcome.printed is not None:
            print_json(outcome.printed)
        stderr.print(outcome.message, markup=False)
        raise typer.Exit(outcome.exit_code)
    raise Stopped(128 + stopped[0] if stopped else 0)


@with_values
def follow(
    ctx: typer.Context,
    *,
    followed: Followed,
    place: FollowPlace,
    plan: FollowPlan,
    simulation: SceneOptions,
    plot: Annotated[bool, typer.Option("--plot", help="Write follow.png into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Follow as `markerseek follow` does, and publish the transform of the camera on /tf meanwhile.

    `trus_home` to the camera is on /tf more than ten times a second while the registration holds, carried along with
    the endoscope; /pa_search/registration_state says whether it holds, with its error, and /pa_follow/state how the
    probe stands. A message on /pa_follow/stop holds the probe. No message arms anything.

    Examples
    --------
    markerseek ros2 follow --simulate --pace 1
    markerseek ros2 follow --registration SESSION --rig rig.toml --tip topic:/PSM1/measured_cp --still-valid
    """
    output = Output.asked(as_json=as_json, plot=plot, out=out)
    # Before anybody is asked to arm the rig: a second node is refused.
    with ros_node("pa_follow", publishes=topics.REGISTRATION, arguments=ctx.obj) as node:

        def opens(run: FollowRun) -> ros2.FollowNode:
            stderr.print(f"served: the transform is on {topics.FRAMES} while it holds", markup=False)
            return ros2.FollowNode(
                node,
                simulated=run.simulated,
                publishes_angle=not _is_over_ros(place.rig),
                on_stop=run.follower.stop,
            )

        follow_target(followed, place, plan, simulation, output, opens=opens)


def _is_over_ros(rig: Path | None) -> bool:
    """Return whether a rig file names a stage node, which publishes its angle itself."""
    settings = None if rig is None else rigs.read_rig_file(rig)
    return isinstance(settings, drivers.BenchSettings) and isinstance(settings.stage, drivers.Ros2StageSettings)


class RosGroup(TyperGroup):
    """Keeps what follows ``--ros-args`` (until ``--``, or the end) for the node, as every program of ROS 2 does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return the arguments without those of the node, which are the object of the context."""
        own = args
        ctx.obj = []
        if "--ros-args" in args:
            begin = args.index("--ros-args")
            end = args.index("--", begin) if "--" in args[begin:] else len(args)
            own = args[:begin] + args[end + 1 :]
            ctx.obj = args[begin + 1 : end]
        return super().parse_args(ctx, own)


_STAGE = ("trus_stage", topics.STATE)
_ACQUISITION = ("trus_acquisition", topics.ACQUIRED)
"""Names of the two nodes, and a topic that only nodes of their kind publish."""


@contextmanager
def ros_node(
    name: str,
    *,
    publishes: str,
    arguments: Sequence[str],
    network: ros.Network | None = None,
) -> Iterator[ros.RosNode]:
    """Yield a node as of `markerseek.ros.RosNode`, if there is no second one that does the same work.

    ``publishes``: topic that only nodes of this kind publish. ``arguments``: those of the user after ``--ros-args``.
    """
    if network is None:
        network = ros.Network(arguments=arguments)
        stderr.print(ros.set_up_discovery(), markup=False)
    with ros.RosNode(name, network=network) as node:
        node.require_alone(publishes)
        yield node


def _serve_until_stopped(pump: ros2.MessagePump, *served: ros2.Served, ready: str) -> None:
    """Serve the devices until a signal comes, then make them safe."""
    pump.served = list(served)
    stdout.print(ready)
    sys.stdout.flush()
    with noted_signals() as stopped:
        try:
            ros2.serve_nodes(served, until=lambda: bool(stopped))
        except ros2.StepEnded:
            # Between two steps there is nothing to interrupt.
            pass
        finally:
            pump.served = []
            for each in served:
                each.close()


_Bench = Annotated[Path, typer.Option(help="Rig file (TOML, kind bench) of the devices.")]
_Arm = Annotated[bool, typer.Option("--arm", help="Arm the node without being asked on the terminal.")]


def stage(ctx: typer.Context, rig: _Bench, arm: _Arm = False) -> None:
    """Serve the stage of a rig to any client, under limits and a guard of its own.

    Examples
    --------
    markerseek ros2 stage --rig examples/rigs/bench.toml
    """
    _serve_part("stage", rig, arm=arm, arguments=ctx.obj)


def acquire(ctx: typer.Context, rig: _Bench, arm: _Arm = False) -> None:
    """Serve laser and receiver of a rig: fire and record when asked, under budgets and a guard of its own.

    Examples
    --------
    markerseek ros2 acquire --rig examples/rigs/bench.toml
    """
    _serve_part("acquisition", rig, arm=arm, arguments=ctx.obj)


def _serve_part(
    part: Literal["stage", "acquisition"],
    rig: Path,
    *,
    arm: bool,
    arguments: list[str],
) -> None:
    """Connect to one part of a bench, have it armed by a person here, and serve it until stopped."""
    settings = rigs.read_rig_file(rig)
    if not isinstance(settings, drivers.BenchSettings):
        raise ConfigError(f"{rig}: its kind is simulated; serve it with: markerseek ros2 sim --rig {quoted(rig)}")
    pump = ros2.MessagePump()
    with ExitStack() as opened:
        held = rigs.bench_part(settings, part, beat=pump)
        opened.callback(held.devices.close)
        stderr.print(held.description, markup=False)
        print_permissions(settings)
        # No message arms anything.
        if not arm and not confirmed(f"Arm the {part} and let programs on this network use it?", name=rig.name):
            raise typer.Exit(NOT_ARMED)
        name, publishes = _STAGE if part == "stage" else _ACQUISITION
        node = opened.enter_context(ros_node(name, publishes=publishes, arguments=arguments))
        held.arm(by=person())
        serving = ros2.Serving(node=node, guard=held.guard, by=person(), watchdog=held.devices.supervisor)
        served: ros2.Served
        if isinstance(held.part, tuple):
            laser, receiver = held.part
            served = ros2.AcquisitionNode(serving, laser=laser, receiver=receiver, clock=held.clock)
        else:
            served = ros2.StageNode(serving, stage=held.part)
        _serve_until_stopped(pump, served, ready=f"the {part} is armed and served; Ctrl-C ends it")


def sim(
    ctx: typer.Context,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML, kind simulated); without one, its defaults.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1,
    pace: Annotated[float, typer.Option(help="Real seconds per virtual second: 0 does not wait.")] = 0,
    write_rig: Annotated[
        Path | None, typer.Option(help="Write a rig file for `markerseek search --rig` that uses these nodes.")
    ] = None,
) -> None:
    """Serve a simulated stage and acquisition in one simulated world, until Ctrl-C; nothing turns, and no light.

    Examples
    --------
    markerseek ros2 sim --seed 3 --write-rig ros2-rig.toml
    """
    from markerseek.guard import Admission, FiringLimits, Guard

    cure = "serve it with: markerseek ros2 stage, markerseek ros2 acquire"
    settings = rigs.read_simulated(rig, cure=cure)
    pump = ros2.MessagePump()
    world = rigs.simulated(seed=seed, settings=settings, pace=pace, beat=pump)
    if write_rig is not None:
        write_text_file(write_rig, _rig_text(settings))
    served: list[ros2.Serving] = []
    with ExitStack() as opened:
        for name, topic in (_STAGE, _ACQUISITION):
            network = served[0].node.network if served else None
            made = ros_node(name, publishes=topic, arguments=ctx.obj, network=network)
            # Nothing here emits light or turns, so that no person is needed.
            guard = Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission())
            guard.arm(by="a simulated rig")
            node = opened.enter_context(made)
            served.append(ros2.Serving(node=node, guard=guard, by="a simulated rig", simulated=True))
        stage_serving, acquisition_serving = served
        _serve_until_stopped(
            pump,
            ros2.StageNode(stage_serving, stage=world.stage),
            ros2.AcquisitionNode(
                acquisition_serving, laser=world.laser, receiver=world.receiver, clock=world.scanner.clock
            ),
            ready="simulated stage and acquisition are ready; nothing turns, and no light; Ctrl-C ends it",
        )
    stderr.print(true_marker(world.facts.truth_deg))


def _rig_text(settings: SimulatedSettings) -> str:
    """Return the text of a rig file for a search on the simulated nodes."""
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
