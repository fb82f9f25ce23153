"""``markerseek follow``: the probe follows what the surgeon looks at."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape

from markerseek import bridges, drivers, following, registration, rigs
from markerseek.bridges import igtl
from markerseek.cli.open_rig import arm_rig, open_rig, person, require_no_trace, simulated_settings
from markerseek.cli.options import Arm, AsJson, Out, Trace, with_values
from markerseek.cli.registering import SpotIsSet
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.signals import Heartbeat, StoppedBySignal, end_stopped, require_pipe, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, stderr
from markerseek.core import USUAL_SEED, ConfigError, SceneOptions, require_range

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HELD = 3
"""Exit code where a person must come: the probe stays."""

SPEED_MM_S = 2.0
ERROR_MM = 0.5
"""Speed and error of a simulated room, where nobody names them."""

SIMULATED_S = 30.0
"""Time that is simulated, where nobody names one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """What is followed; one of them."""

    spot: Annotated[bool, typer.Option("--spot", help="Follow the laser spot that both cameras see.")] = False
    tip: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Follow the tip that a robot reports in the frame of the left camera: topic:/PSM1/measured_cp of "
            "ROS 2, or HOST:PORT/DEVICE, a TRANSFORM of OpenIGTLink. With --simulate, 'simulated'.",
        ),
    ] = None
    tool_offset_mm: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="From the frame that the robot reports to the tip, in that frame."),
    ] = None
    point: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Turn to this point of the left camera's frame, in mm."),
    ] = None

    def __post_init__(self) -> None:
        if sum((self.spot, self.tip is not None, self.point is not None)) > 1:
            raise ConfigError("--spot, --tip and --point each name what is followed; leave all but one out")
        if self.tool_offset_mm is not None and self.tip is None:
            raise ConfigError("--tool-offset-mm is of a robot's tip; add --tip, or leave it out")


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowPlace:
    """With what, and how long."""

    registration: Annotated[
        Path | None,
        typer.Option(help="Registration of the camera to the probe: folder of a session, or registration.json."),
    ] = None
    still_valid: Annotated[
        bool,
        typer.Option(
            "--still-valid",
            help="Neither probe nor camera were switched off, nor was the probe moved, since the registration: it "
            "holds before a spot has confirmed it.",
        ),
    ] = False
    rig: Annotated[Path | None, typer.Option(help="Rig file (TOML).")] = None
    simulate: Annotated[
        bool, typer.Option("--simulate", help="In a simulated room, whose registration is simulated, too.")
    ] = False
    moves: Annotated[
        str | None,
        typer.Option(
            help="How the simulated target moves: still, sine, steps, jump, or lost for a while.",
            show_default="steps for a spot, sine for a tip",
        ),
    ] = None
    speed_mm_s: Annotated[
        float | None,
        typer.Option(
            help="Largest speed of a simulated target that moves to and fro, in mm/s.", show_default=str(SPEED_MM_S)
        ),
    ] = None
    error_mm: Annotated[
        float | None,
        typer.Option(help="Error of the simulated registration, drawn, in mm.", show_default=str(ERROR_MM)),
    ] = None
    seconds: Annotated[
        float | None,
        typer.Option(help="Time after which it ends, in seconds.", show_default="30 with --simulate, else never"),
    ] = None
    cameras: Annotated[list[Path] | None, typer.Option(help="Calibration of the stereo endoscope; as of register.")] = (
        None
    )
    calibration_sigma_px: Annotated[
        float | None, typer.Option(help="Reprojection error of that calibration, if its file does not state it.")
    ] = None
    images: Annotated[
        str | None,
        typer.Option(
            metavar="'LEFT RIGHT'",
            help="Where the images of both cameras come from; as of register. They show the spot, and how the "
            "endoscope moves.",
        ),
    ] = None
    endoscope_held: Annotated[
        bool,
        typer.Option(
            "--endoscope-held",
            help="The endoscope is held so that it cannot move: its images are not compared with those before.",
        ),
    ] = False
    igtl_port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Serve the transform of the camera over OpenIGTLink on this port of this computer, ten times a "
            "second, with its validity and error; 0 takes any that is free.",
        ),
    ] = None
    arm: Arm = False
    trace: Trace = None
    asked_by: Annotated[str | None, typer.Option(hidden=True, help="Who asked a bridge for it.")] = None
    heartbeat: Heartbeat = None

    def __post_init__(self) -> None:
        require_pipe(self.heartbeat)
        if self.seconds is not None:
            require_range("--seconds", self.seconds, low=0, high=86_400, unit="s")
        if (self.images is None) != (not self.cameras):
            raise ConfigError("--cameras FILE and --images 'LEFT RIGHT' belong together; name both, or leave both out")
        if not self.simulate and (self.rig is None or self.registration is None):
            raise ConfigError(
                "nothing to follow with: name a registration by --registration FOLDER and a rig by --rig RIG.toml, or "
                "add --simulate"
            )


@with_values
def command(
    *,
    followed: Followed,
    place: FollowPlace,
    plan: following.FollowPlan,
    simulation: SceneOptions,
    plot: Annotated[bool, typer.Option("--plot", help="Write follow.png into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Turn the probe to what the surgeon looks at: a laser spot, the tip of an instrument, or a point.

    The probe turns in the dark, at most 5 degrees from rest to rest, where the target is further from the image plane
    than --within-deg. It stays, and the laser is dark, where the target is out of reach, lost, or jumps, where its link
    is silent, and where the endoscope or the tissue has moved away from the registration. Ctrl-C stops the rig. A
    registration holds once a spot has confirmed it, or with --still-valid. Exit code 3 where a person must come.

    Examples
    --------
    markerseek follow --simulate --plot
    markerseek follow --simulate --spot --seconds 20
    markerseek follow --registration SESSION --rig rig.toml --tip topic:/PSM1/measured_cp --still-valid
    markerseek follow --registration SESSION --rig rig.toml --spot --cameras stereo.toml --images 'left right'
    markerseek follow --registration SESSION --rig rig.toml --point 4 -12 105 --still-valid
    """
    follow_target(followed, place, plan, simulation, Output.asked(as_json=as_json, plot=plot, out=out))


def follow_target(
    followed: Followed,
    place: FollowPlace,
    plan: following.FollowPlan,
    simulation: SceneOptions,
    output: Output,
    *,
    opens: Callable[[FollowRun], AbstractContextManager[bridges.StepListener]] | None = None,
) -> None:
    """Follow, and show what was done.

    ``opens``: opens what takes the steps of the run besides; None: nothing does.
    """
    as_json = output.as_json
    if not followed.spot and followed.tip is None and followed.point is None:
        if not place.simulate:
            raise ConfigError("nothing to follow: name it by --spot, --tip WHERE or --point X Y Z")
        followed = Followed(tip="simulated")
    with ExitStack() as opened:
        run = opened.enter_context(
            _simulated(followed, place, plan, simulation)
            if place.simulate
            else _on_rig(followed, place, plan, simulation, as_json=as_json)
        )
        listeners: list[bridges.StepListener] = []
        if opens is not None:
            listeners.append(opened.enter_context(opens(run)))
        if place.igtl_port is not None:
            service = igtl.FollowService("127.0.0.1", place.igtl_port, simulated=run.simulated, on_note=_note)
            listeners.append(opened.enter_context(service))
            _note(f"OpenIGTLink clients connect to 127.0.0.1, port {service.port}")
        ended = _follow(run, listeners, as_json=as_json)
    output.show(_report(run, ended))


@dataclass(slots=True, kw_only=True)
class FollowRun:
    """A follower, and what is known of its run."""

    follower: following.Follower
    title: str
    simulated: bool
    """Whether the registration is."""
    ends_s: float | None
    """When it ends, on the rig's clock; None: it does not."""
    room: following.FollowedRoom | None = None
    """The simulated room."""
    hints: Mapping[following.Word, str]
    """What a person may do, by the state."""
    steps: list[following.FollowStep]
    true_deg: list[float | None]


def _note(sentence: str) -> None:
    stderr.print(f"[dim]{escape(sentence)}[/]")


def _follow(run: FollowRun, listeners: Sequence[bridges.StepListener], *, as_json: bool) -> str:
    """Follow until the end, a signal, or a state that only a person ends; returns why it has ended."""
    said = ""
    begun_s: float | None = None
    with stopped_by_signals(), closing(run.follower.steps()) as steps:
        try:
            for step in steps:
                run.steps.append(step)
                begun_s = step.at_s if begun_s is None else begun_s
                for listener in listeners:
                    listener.show(step)
                run.true_deg.append(None if run.room is None else run.room.angle_deg(step.at_s))
                follows = step.word in _FOLLOWS
                line = "follows the target" if follows else step.word
                if line != said and not as_json:
                    colour = "green" if follows else "yellow"
                    why = "" if follows else f": {escape(step.said)}"
                    stderr.print(f"{step.at_s - begun_s:7.2f} s  [{colour}]{line}[/]{why}")
                    if hint := run.hints.get(step.word):
                        _note(hint)
                said = line
                if step.word in following.BY_A_PERSON:
                    return step.said
                if run.ends_s is not None and step.at_s >= run.ends_s:
                    return ""
        except StoppedBySignal as stop:
            end_stopped(stop, as_json=as_json, kept=None)
    return ""


_FOLLOWS = frozenset({"there", "turning", "resting"})
"""Words of a target that is followed."""


def _report(run: FollowRun, ended: str) -> Report:
    """What was done, with the error of the simulated truth where there is one."""
    steps = run.steps
    last = steps[-1] if steps else None
    # From the first time that it was there: before, the probe comes from anywhere.
    first_s = next((step.at_s for step in steps if step.word == "there"), None)
    off = [
        abs(step.probe_deg - true_deg)
        for step, true_deg in zip(steps, run.true_deg, strict=True)
        if true_deg is not None and first_s is not None and step.at_s >= first_s and step.word in _FOLLOWS
    ]
    held = last is not None and last.word in following.BY_A_PERSON
    values: dict[str, object] = {
        "ended": ended,
        "last": None if last is None else msgspec.to_builtins(last),
        "turns": sum(a.turning and not b.turning for a, b in pairwise(steps)),
        "confirmed": "" if last is None else last.confirmed,
        "states": sorted({step.word for step in steps}),
    }
    rows = [
        ("ended", ended or "at the time that was asked for"),
        ("states", ", ".join(dict.fromkeys(step.word for step in steps))),
    ]
    if last is not None and last.confirmed:
        rows.append(("probe's image", last.confirmed))
    if off:
        mean_deg = sum(off) / len(off)
        inside = sum(each <= last.within_deg for each in off) / len(off) if last is not None else 0.0
        values["simulation"] = {"mean_off_deg": mean_deg, "inside": inside, "largest_off_deg": max(off)}
        rows.append(
            ("off the target (simulated truth)", f"{mean_deg:.2f} deg in the mean, {inside:.0%} of the time inside")
        )
    return Report(
        values=with_version(**values),
        shown=[f"[bold]{escape(run.title)}[/]", facts(rows)],
        pictures={"follow.png": drawn(_figure, run)},
        exit_code=HELD if held else 0,
    )


def _figure(run: FollowRun) -> Figure:
    from markerseek.show import FollowedMoment, follow_figure

    moments = [
        FollowedMoment(
            at_s=step.at_s - run.steps[0].at_s,
            probe_deg=step.probe_deg,
            target_deg=step.target_deg,
            within_deg=step.within_deg,
            word=step.word,
            stays=step.word in following.BY_ITSELF or step.word in following.BY_A_PERSON,
            true_deg=true_deg,
        )
        for step, true_deg in zip(run.steps, run.true_deg, strict=True)
    ]
    return follow_figure(moments, title=run.title)


@contextmanager
def _simulated(
    followed: Followed, place: FollowPlace, plan: following.FollowPlan, simulation: SceneOptions
) -> Iterator[FollowRun]:
    """Follow in a simulated room."""
    for name, given in (
        ("--registration", place.registration),
        ("--rig", place.rig),
        ("--cameras", place.cameras),
        ("--images", place.images),
        ("--endoscope-held", place.endoscope_held),
        ("--point", followed.point),
    ):
        if given:
            raise ConfigError(f"{name} is for a rig of devices; the simulated room has its own, leave it out")
    if followed.tip not in (None, "simulated"):
        raise ConfigError(f"--tip {followed.tip}: with --simulate there is a simulated tip; name 'simulated'")
    require_no_trace(place.trace)
    announce_compilation()
    motion = _motion(place.moves or ("steps" if followed.spot else "sine"))
    speed_mm_s = SPEED_MM_S if place.speed_mm_s is None else place.speed_mm_s
    error_mm = ERROR_MM if place.error_mm is None else place.error_mm
    settings = simulated_settings(None, simulation, sweeps=True)
    room = following.FollowedRoom(
        registration.SimulatedRoomSettings(rig=settings, pace=simulation.pace),
        following.TargetPath(
            motion=motion,
            speed_m_s=speed_mm_s / 1e3,
            # A spot stands still until it has confirmed the registration.
            begins_s=_CONFIRMING_S if followed.spot else 0.0,
        ),
        seed=USUAL_SEED if simulation.seed is None else simulation.seed,
    )
    held = following.HeldRegistration(
        room.registration(error_m=error_mm / 1e3), confirmed=place.still_valid or not followed.spot
    )
    follower = following.Follower(
        room.rig,
        held,
        following.SimulatedSpot(room) if followed.spot else room.tip(),
        # The simulated person lights each place at once.
        plan=msgspec.structs.replace(plan, light_while_waiting=True),
        by="the simulated person",
        reach=following.probe_reach(room.rig),
    )
    what = "a laser spot" if followed.spot else "a tip"
    yield FollowRun(
        follower=follower,
        title=f"simulated: the probe follows {what} ({motion}), registration with {error_mm:g} mm",
        simulated=True,
        ends_s=SIMULATED_S if place.seconds is None else place.seconds,
        room=room,
        hints={},
        steps=[],
        true_deg=[],
    )


_CONFIRMING_S = 8.0
"""Time for which a simulated spot stands still, in seconds."""


def _motion(name: str) -> following.Motion:
    """The motion of that name."""
    match name:
        case "still" | "sine" | "steps" | "jump" | "lost":
            return name
    raise ConfigError(f"--moves {name} is none of still, sine, steps, jump, lost")


@contextmanager
def _on_rig(
    followed: Followed, place: FollowPlace, plan: following.FollowPlan, simulation: SceneOptions, *, as_json: bool
) -> Iterator[FollowRun]:
    """Follow with a rig of devices."""
    assert place.rig is not None  # noqa: S101  checked with the options
    assert place.registration is not None  # noqa: S101  checked with the options
    if simulation != SceneOptions() or (place.moves, place.speed_mm_s, place.error_mm) != (None, None, None):
        raise ConfigError(f"options of a simulation, and {place.rig} is a rig; add --simulate, or leave them out")
    if not isinstance(rigs.read_rig_file(place.rig), drivers.BenchSettings):
        raise ConfigError(f"{place.rig} is a simulated rig; --simulate follows in a simulated room")
    known, session = _known(place.registration)
    if not (followed.spot or place.still_valid):
        raise ConfigError(
            f"{place.registration}: without light nothing confirms it; add --still-valid if neither probe nor camera "
            "was switched off since, or follow a spot first"
        )
    if followed.spot and place.images is None:
        raise ConfigError("--spot needs the endoscope: --cameras FILE and --images 'LEFT RIGHT'")
    with ExitStack() as opened:
        rig, _ = opened.enter_context(open_rig(place.rig, sweeps=followed.spot, trace=place.trace))
        clock = rig.scanner.clock
        endoscope = is_set = None
        dark: following.DarkPairs | None = None
        source: following.TargetSource | following.LitSource
        if place.images is not None:
            stereo = registration.read_stereo(place.cameras or (), calibration_sigma_px=place.calibration_sigma_px)
            images = opened.enter_context(
                closing(drivers.open_stereo_images(place.images, left=stereo.left, right=stereo.right))
            )
            if followed.spot:
                room = registration.DeviceRoom(rig=rig, images=images, stereo=stereo, by=person())
                source = dark = following.SpotSource(room)
                is_set = SpotIsSet(session)
            else:
                dark = following.NewestPairs(images)
            if not place.endoscope_held:
                endoscope = following.EndoscopeCheck(stereo, dark, session).look
        if followed.tip is not None:
            offset_mm = followed.tool_offset_mm or (0.0, 0.0, 0.0)
            poses = drivers.open_poses(followed.tip, clock)
            source = opened.enter_context(closing(following.RobotTip(poses, clock, offset_mm=offset_mm, on_note=_note)))
        elif followed.point is not None:
            source = following.FixedPoint(clock, camera_mm=followed.point)
        arm_rig(rig, file=place.rig, arm=place.arm, what="follow", as_json=as_json, asked_by=place.asked_by)
        follower = following.Follower(
            rig,
            following.HeldRegistration(known, confirmed=place.still_valid),
            source,
            plan=plan,
            by=person(),
            reach=following.probe_reach(rig),
            endoscope=endoscope,
            is_set=is_set,
        )
        yield FollowRun(
            follower=follower,
            title=f"{rig.facts.description}: follows {source.name}",
            simulated=known.simulated,
            ends_s=None if place.seconds is None else clock.now_s() + place.seconds,
            hints={**_HINTS, **_DARK} if followed.spot and not plan.light_while_waiting else _HINTS,
            steps=[],
            true_deg=[],
        )


_HINTS: Mapping[following.Word, str] = MappingProxyType(
    {"endoscope": "where the endoscope is held so that it cannot move, --endoscope-held leaves its images out"}
)
_DARK: Mapping[following.Word, str] = MappingProxyType(
    dict.fromkeys(following.BY_ITSELF, "press Enter once the spot is set; the laser is dark until then")
)
"""What a person may do in a state, and what besides where a spot is looked for only when a person says so."""


def _known(path: Path) -> tuple[registration.KnownRegistration, Path | None]:
    """The registration at a path, and the folder of its session."""
    folder = registration.session_folder(path)
    if folder is None:
        return registration.read_registration(path), None
    view = registration.read_view(folder)
    if view.registration is None:
        raise ConfigError(f"{folder}: no registration holds: {view.reason}")
    return view.registration, folder
