"""``markerseek ros2``: a search, a stage, an acquisition, or a simulated rig as ROS 2 nodes."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.bridges.ros2 import Beat, PlainTopics, Served
    from markerseek.drivers import BenchSettings
    from markerseek.ros import Network, RosNode

NAME = "ros2"

app = typer.Typer(
    name=NAME,
    help="Run a search, a stage, an acquisition or a simulated rig as ROS 2 nodes.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

_Bench = Annotated[Path, typer.Option(help="Rig file (TOML, kind bench) of the devices.")]
_Arm = Annotated[bool, typer.Option("--arm", help="Arm the node without being asked on the terminal.")]
_Security = Annotated[
    bool, typer.Option("--require-security", help="End with exit code 2 unless ROS 2 is run with keys (SROS 2).")
]
_Command = Annotated[
    str | None,
    typer.Option("--plain-command", help="Also take angles from this topic, std_msgs/Float64 without a stamp."),
]
_Reached = Annotated[
    str | None, typer.Option("--plain-reached", help="Publish the angle reached on this topic, std_msgs/Float64.")
]
_Unit = Annotated[str, typer.Option("--plain-unit", help="Unit of the two plain topics: rad or deg.")]


@app.command(
    epilog="Examples:\n\n  markerseek ros2 search\n\n  markerseek ros2 search --once --rig ros2-rig.toml --json"
)
def search(
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    method: Annotated[str, typer.Option(help="How to search; an unknown name lists them all.")] = "posterior",
    acquisitions: Annotated[int | None, typer.Option(min=2, help="Most acquisitions.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of a simulated rig.")] = None,
    pace: Annotated[
        float | None,
        typer.Option(help="Real seconds per virtual second of a simulated rig (0), or per recorded second (1)."),
    ] = None,
    play: Annotated[
        Path | None, typer.Option(help="Search nothing: play a bank or the journal of a finished run, once.")
    ] = None,
    stay: Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")] = False,
    once: Annotated[
        bool, typer.Option("--once", help="Search at once, then end with the exit code of the search.")
    ] = False,
    require_security: _Security = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, with --once.")] = False,
) -> None:
    """Search when /pa_search/run is called, and publish each acquisition and the answer.

    The search is the ordinary command in a process of its own. A rig of devices asks on this terminal whether it may be
    armed, each time; no message arms it.
    """
    from markerseek.bridges import Searches, SearchOptions, SearchRequest
    from markerseek.bridges.ros2 import SearchNode
    from markerseek.cli.terminal import print_json, stderr

    if play is not None:
        _play(play, pace=1.0 if pace is None else pace, require_security=require_security)
        return
    request = SearchRequest(method=method, acquisitions=acquisitions, stay=stay, seed=seed)
    searches = Searches(SearchOptions(rig=rig, pace=pace or 0.0, frames=True))
    parameters: dict[str, str | int] = {
        "method": method,
        "acquisitions": acquisitions or 0,
        "rig": "simulated" if rig is None else str(rig),
    }
    with _node("pa_search", parameters, require_security=require_security) as node, _stopping() as stopped:
        served = SearchNode(node=node, searches=searches, request=request, publishes_angle=not _is_over_ros(rig))
        try:
            if once:
                served.start()
            else:
                stderr.print("the search node is ready; call /pa_search/run (std_srvs/Trigger); Ctrl-C ends it")
            while not stopped and not (once and not served.running):
                node.spin(0.1)
                served.step()
        finally:
            served.close()
        outcome = served.outcome
    if once and outcome is not None:
        if as_json and outcome.answer is not None:
            print_json(outcome.answer)
        stderr.print(outcome.message, markup=False)
        raise typer.Exit(outcome.exit_code)
    raise typer.Exit(128 + stopped[0] if stopped else 0)


@app.command(epilog="Example:\n\n  markerseek ros2 stage --rig examples/rigs/bench.toml")
def stage(
    rig: _Bench,
    arm: _Arm = False,
    plain_command: _Command = None,
    plain_reached: _Reached = None,
    plain_unit: _Unit = "rad",
    require_security: _Security = False,
) -> None:
    """Serve the stage of a rig to any client, under limits and a guard of its own."""
    _serve_part("stage", rig, arm=arm, plain=_plain(plain_command, plain_reached, plain_unit), keys=require_security)


@app.command(epilog="Example:\n\n  markerseek ros2 acquire --rig examples/rigs/bench.toml")
def acquire(rig: _Bench, arm: _Arm = False, require_security: _Security = False) -> None:
    """Serve laser and receiver of a rig: fire and record when asked, under budgets and a guard of its own."""
    _serve_part("acquisition", rig, arm=arm, plain=None, keys=require_security)


@app.command(epilog="Example:\n\n  markerseek ros2 sim --seed 3 --write-rig ros2-rig.toml")
def sim(
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML, kind simulated); without one, its defaults.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1,
    pace: Annotated[float, typer.Option(help="Real seconds per virtual second: 0 does not wait.")] = 0,
    write_rig: Annotated[
        Path | None, typer.Option(help="Write a rig file for `markerseek search --rig` that uses these nodes.")
    ] = None,
    plain_command: _Command = None,
    plain_reached: _Reached = None,
    plain_unit: _Unit = "rad",
    require_security: _Security = False,
) -> None:
    """Serve a simulated stage and acquisition in one simulated world, until Ctrl-C; nothing turns, and no light."""
    from markerseek import rigs
    from markerseek.bridges.ros2 import AcquisitionNode, Beat, StageNode
    from markerseek.cli.terminal import stderr, stdout
    from markerseek.guard import Admission, FiringLimits, Guard
    from markerseek.sim import SimulatedSettings

    settings = SimulatedSettings() if rig is None else rigs.read_rig_file(rig)
    if not isinstance(settings, SimulatedSettings):
        raise ConfigError(f"{rig}: its kind is bench; serve it with: markerseek ros2 stage, markerseek ros2 acquire")
    plain = _plain(plain_command, plain_reached, plain_unit)
    beat = Beat()
    world = rigs.simulated(seed=seed, settings=settings, pace=pace, beat=beat)
    limits, clock = settings.limits, world.scanner.clock
    if write_rig is not None:
        _write_rig(write_rig, settings)
    parameters = {
        "simulated": True,
        "search_low_rad": _radians(limits.search.low_deg),
        "search_high_rad": _radians(limits.search.high_deg),
    }
    with ExitStack() as opened:
        guards = [Guard(limits=limits, firing=FiringLimits(), admission=Admission()) for _ in range(2)]
        for guard in guards:
            # Nothing here emits light or turns, so that no person is needed.
            guard.arm(by="a simulated rig")
        nodes: list[RosNode] = []
        for index, name in enumerate(("trus_stage", "trus_acquisition")):
            network = nodes[0].network if nodes else None
            made = _served_node(name, parameters, beat, index, require_security=require_security, network=network)
            nodes.append(opened.enter_context(made))
        by = "a simulated rig"
        beat.served = [
            StageNode(
                node=nodes[0], stage=world.stage, guard=guards[0], clock=clock, by=by, plain=plain, simulated=True
            ),
            AcquisitionNode(
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
        _serve_until_stopped(beat)
    truth = (
        "there is no marker" if world.facts.truth_deg is None else f"the marker is at {world.facts.truth_deg:.3f} deg"
    )
    stderr.print(f"truth: {truth}")


def _play(path: Path, *, pace: float, require_security: bool) -> None:
    """Play a recording to the topics of a search."""
    from markerseek.bridges.ros2 import RecordedSeries, play
    from markerseek.cli.terminal import announce_compilation, stdout

    announce_compilation()
    recording = RecordedSeries(path)
    with _node("pa_search", {"plays": str(path)}, require_security=require_security) as node, _stopping() as stopped:
        stdout.print(f"playing {len(recording.series.angles_deg)} acquisitions; ready", markup=False)
        sys.stdout.flush()
        played = play(recording, node, pace=pace, until=lambda: bool(stopped))
        stdout.print(f"{played} acquisitions were played")
    raise typer.Exit(128 + stopped[0] if stopped else 0)


def _serve_part(
    part: Literal["stage", "acquisition"], rig: Path, *, arm: bool, plain: PlainTopics | None, keys: bool
) -> None:
    """Connect to one part of a bench, have it armed by a person here, and serve it until stopped."""
    from markerseek.bridges.ros2 import AcquisitionNode, Beat, StageNode
    from markerseek.cli.open_rig import NOT_ARMED, person, print_permissions
    from markerseek.cli.terminal import stderr, stdout
    from markerseek.drivers import BenchSettings
    from markerseek.rigs import bench_part, read_rig_file

    settings = read_rig_file(rig)
    if not isinstance(settings, BenchSettings):
        raise ConfigError(f"{rig}: its kind is simulated; serve it with: markerseek ros2 sim --rig {rig}")
    beat = Beat()
    with ExitStack() as opened:
        held = bench_part(settings, part, beat=beat)
        opened.callback(held.devices.close)
        stderr.print(held.description, markup=False)
        print_permissions(settings)
        question = f"Arm the {part} and let programs on this network use it?"
        # Only a person at a terminal is asked, and no message arms anything.
        if not arm and not (sys.stdin.isatty() and typer.confirm(question, default=False, err=True)):
            stderr.print("not armed: nothing moved and nothing was fired; add --arm, or say yes on a terminal")
            raise typer.Exit(NOT_ARMED)
        node = opened.enter_context(_served_node(f"trus_{part}", _limits(settings), beat, 0, require_security=keys))
        held.arm(by=person())
        dead_man = held.devices.supervisor
        served: Served
        if held.stage is not None:
            served = StageNode(
                node=node,
                stage=held.stage,
                guard=held.guard,
                clock=held.clock,
                by=person(),
                plain=plain,
                dead_man=dead_man,
            )
        else:
            assert held.laser is not None  # noqa: S101  a part is one or the other
            assert held.receiver is not None  # noqa: S101
            served = AcquisitionNode(
                node=node,
                laser=held.laser,
                receiver=held.receiver,
                guard=held.guard,
                clock=held.clock,
                by=person(),
                dead_man=dead_man,
            )
        beat.served = [served]
        stdout.print(f"the {part} is armed and served; Ctrl-C ends it")
        sys.stdout.flush()
        _serve_until_stopped(beat)


def _serve_until_stopped(beat: Beat) -> None:
    from markerseek.bridges.ros2 import Interrupted, serve

    with _stopping() as stopped:
        served = list(beat.served)

        def ended() -> bool:
            return bool(stopped)

        try:
            serve(served, until=ended)
        except Interrupted:
            # Between two steps there is nothing to interrupt.
            pass
        finally:
            beat.served = []
            for each in served:
                each.close()


@contextmanager
def _stopping() -> Iterator[list[int]]:
    """A list that receives the number of the first signal: a node ends between two messages, not inside of one."""
    stopped: list[int] = []
    before = {
        number: signal.signal(number, lambda received, _frame: stopped.append(received))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _node(
    name: str, parameters: Mapping[str, float | str | int | bool], *, require_security: bool
) -> Iterator[RosNode]:
    """A node, with its keys checked where that is wanted."""
    from markerseek.ros import RosNode, Security

    enclave = f"/markerseek/{name}"
    if require_security:
        Security.of_environment().require(enclave)
    with RosNode(name, parameters=parameters, enclave=enclave) as node:
        yield node


@contextmanager
def _served_node(
    name: str,
    parameters: Mapping[str, float | str | int | bool],
    beat: Beat,
    index: int,
    *,
    require_security: bool,
    network: Network | None = None,
) -> Iterator[RosNode]:
    """The node of a device, which follows its lifecycle."""
    from markerseek.ros import RosNode, Security

    enclave = f"/markerseek/{name}"
    if require_security:
        Security.of_environment().require(enclave)

    def set_active(active: bool) -> None:
        # Made active before it serves a device.
        if beat.served:
            beat.served[index].set_active(active)

    with RosNode(name, parameters=parameters, enclave=enclave, on_active=set_active, network=network) as node:
        yield node


def _plain(command: str | None, reached: str | None, unit: str) -> PlainTopics | None:
    from markerseek.bridges.ros2 import PlainTopics

    if command is None and reached is None:
        return None
    if command is None or reached is None:
        raise ConfigError("--plain-command and --plain-reached belong together; name both topics, or neither")
    if unit == "rad":
        return PlainTopics(command=command, reached=reached, unit="rad")
    if unit == "deg":
        return PlainTopics(command=command, reached=reached, unit="deg")
    raise ConfigError(f"--plain-unit is {unit}, it must be rad or deg")


def _is_over_ros(rig: Path | None) -> bool:
    """Whether a rig file names a stage node, which publishes its angle itself."""
    from markerseek.drivers import BenchSettings, RosStage
    from markerseek.rigs import read_rig_file

    settings = None if rig is None else read_rig_file(rig)
    return isinstance(settings, BenchSettings) and isinstance(settings.stage, RosStage)


def _limits(settings: BenchSettings) -> dict[str, float | str | int | bool]:
    """Limits of a rig as read-only parameters."""
    limits, firing = settings.limits, settings.firing
    return {
        "simulated": False,
        "search_low_rad": _radians(limits.search.low_deg),
        "search_high_rad": _radians(limits.search.high_deg),
        "travel_low_rad": _radians(limits.travel.low_deg),
        "travel_high_rad": _radians(limits.travel.high_deg),
        "pulses_per_permit": firing.pulses_per_permit,
        "pulses_per_second": firing.pulses_per_second,
        "pulses_per_session": firing.pulses_per_session,
    }


def _radians(angle_deg: float) -> float:
    import math

    return math.radians(angle_deg)


def _write_rig(path: Path, settings: object) -> None:
    """Write a rig file for a search on the simulated nodes."""
    from markerseek.files import replace_file
    from markerseek.sim import SimulatedSettings

    assert isinstance(settings, SimulatedSettings)  # noqa: S101
    limits = settings.limits
    text = f"""# Simulated ROS 2 nodes (markerseek ros2 sim): no light, nothing turns.
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

[probe]
trigger_offset_s = {settings.receiver.trigger_offset_s}
face_radius_m = {settings.probe.face_radius_m}

[limits.search]
low_deg = {limits.search.low_deg}
high_deg = {limits.search.high_deg}

[limits.travel]
low_deg = {limits.travel.low_deg}
high_deg = {limits.travel.high_deg}
"""
    with replace_file(path) as part:
        part.write_text(text, encoding="utf-8")
