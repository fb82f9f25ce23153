"""With what ``markerseek follow`` follows: its options, and the run on a rig of devices or in a simulated room."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import msgspec
import typer
from rich.markup import escape

from markerseek import drivers, following, registration, rigs
from markerseek.cli.follow_devices import held_registration, named_registration, say_errors
from markerseek.cli.open_rig import arm_rig, open_rig, person, require_no_trace, simulated_settings
from markerseek.cli.options import Arm, Trace
from markerseek.cli.registering import SpotIsSet
from markerseek.cli.signals import Heartbeat, require_pipe
from markerseek.cli.terminal import announce_compilation, stderr
from markerseek.core import USUAL_SEED, ConfigError, RecordError, SceneOptions, StereoPair, counted, require_range
from markerseek.files import FileVersion, read_input, version_of

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
    tip_sigma_mm: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMA",
            help="What the tip is off by along each direction, the same in all messages, as a standard deviation in "
            "mm: joints and links of the arm, its base frame, the tool's offset. Without it these are not counted.",
        ),
    ] = None
    point: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Turn to this point of the left camera's frame, in mm."),
    ] = None
    pixel: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="X Y",
            help="Turn to what the left image shows at this pixel, which is found in the right image by its texture.",
        ),
    ] = None

    def __post_init__(self) -> None:
        if sum((self.spot, self.tip is not None, self.point is not None, self.pixel is not None)) > 1:
            raise ConfigError("--spot, --tip, --point and --pixel each name what is followed; leave all but one out")
        if self.tool_offset_mm is not None and self.tip is None:
            raise ConfigError("--tool-offset-mm is of a robot's tip; add --tip, or leave it out")
        if self.tip_sigma_mm is not None:
            require_range("--tip-sigma-mm", self.tip_sigma_mm, low=0, high=following.LARGEST_SIGMA_MM, unit="mm")
            if self.tip is None:
                raise ConfigError("--tip-sigma-mm is of a robot's tip; add --tip, or leave it out")


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
        bool,
        typer.Option(
            "--simulate",
            help="In a simulated room, whose registration is simulated, too, or that of a simulated session.",
        ),
    ] = False
    moves: Annotated[
        str | None,
        typer.Option(
            help="How the simulated target moves: still, sine, steps, jump, or lost for a while.",
            show_default="steps for a spot, sine for a tip, still for a pixel",
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
            help="Serve the transform of the camera over OpenIGTLink on this port of this computer, twelve times a "
            "second, with its validity and error; 0 takes any that is free.",
        ),
    ] = None
    record: Annotated[
        Path | None,
        typer.Option(help="Write what is said of the target and the probe into this new file, step by step."),
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
        if self.calibration_sigma_px is not None and not self.cameras:
            raise ConfigError("--calibration-sigma-px belongs to a calibration; name it by --cameras, or leave it out")
        if not self.simulate and (self.rig is None or self.registration is None):
            raise ConfigError(
                "nothing to follow with: name a registration by --registration FOLDER and a rig by --rig RIG.toml, or "
                "add --simulate"
            )


@dataclass(slots=True, kw_only=True)
class FollowRun:
    """A follower, and what is known of its run."""

    follower: following.Follower
    title: str
    what: str
    """What is followed, in words."""
    rig: str
    """The rig in words."""
    ends_s: float | None
    """When it ends, on the rig's clock; None: it does not."""
    simulated: bool
    """Whether the registration is."""
    truth: Callable[[float], float | None] = lambda _at_s: None
    """True angle of the target at a time, where there is one."""
    look_on: Callable[[], None] = lambda: None
    """Shows the newest images to those who look on."""
    record: following.FollowRecord | None = None
    """Where the steps are recorded."""
    hints: Mapping[following.Word, str]
    """What a person may do, by the state."""
    steps: list[following.FollowStep] = field(default_factory=list)
    true_deg: list[float | None] = field(default_factory=list)

    def take(self, step: following.FollowStep) -> None:
        """Keep a step, record it, and show the images of that time."""
        self.steps.append(step)
        self.true_deg.append(self.truth(step.at_s))
        if self.record is not None:
            self.record.add(step)
        if not step.turning:
            # What takes time waits until the probe is at rest.
            self.look_on()


def note(sentence: str) -> None:
    """Print a sentence for people beside what a run is about."""
    stderr.print(f"[dim]{escape(sentence)}[/]")


class PointedAt:
    """The pixel at which somebody points meanwhile, as the page or another program writes it into the session's folder.

    Called, it returns that of the file once; None: there is no new one, or it holds no two numbers.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / registration.POINTED_AT
        # What somebody has pointed at before this run is not meant now.
        self._known = self._version()

    def __call__(self) -> tuple[float, float] | None:
        """Return the pixel since the last call."""
        version = self._version()
        if version in (None, self._known):
            return None
        # The file is not removed: another click may have replaced it in the meantime.
        self._known = version
        try:
            text = read_input(self._path, most_bytes=_PIXEL_BYTES)
            x, y = (float(word) for word in text.split())
        except (OSError, RecordError, ConfigError, ValueError):
            return None
        return x, y

    def _version(self) -> FileVersion | None:
        """Return what tells one file of that name from the next; None: there is none."""
        try:
            return version_of(self._path.stat())
        except OSError:
            return None


_PIXEL_BYTES = 256


def _looking_on(
    folder: Path | None, newest: Callable[[], StereoPair | None], now_s: Callable[[], float]
) -> Callable[[], None]:
    """Return what puts the newest images into the folder of a session, at most once in `registration.SHOWN_S`."""
    if folder is None:
        return lambda: None
    shown_s = -math.inf

    def look_on() -> None:
        nonlocal shown_s
        if now_s() - shown_s >= registration.SHOWN_S and (pair := newest()) is not None:
            shown_s = now_s()
            registration.show_pair(folder, pair)

    return look_on


@contextmanager
def simulated_run(
    followed: Followed, place: FollowPlace, plan: following.FollowPlan, simulation: SceneOptions
) -> Iterator[FollowRun]:
    """Follow in a simulated room."""
    for name, given in (
        ("--cameras", place.cameras),
        ("--images", place.images),
        ("--endoscope-held", place.endoscope_held),
        ("--point", followed.point),
    ):
        if given:
            raise ConfigError(f"{name} is for a rig of devices; the simulated room has its own, leave it out")
    if followed.tip not in (None, "simulated"):
        raise ConfigError(f"--tip {followed.tip}: with --simulate there is a simulated tip; name 'simulated'")
    for name, stated in (("--tool-offset-mm", followed.tool_offset_mm), ("--tip-sigma-mm", followed.tip_sigma_mm)):
        if stated is not None:
            raise ConfigError(f"{name} is of a robot's tip; the simulated one has its own, leave it out")
    require_no_trace(place.trace)
    session = _simulated_session(place, simulation)
    if session is not None:
        _require_confirmed(followed, place)
    announce_compilation()
    motion = _motion(place.moves or _usual_motion(followed))
    room = _simulated_room(followed, place, simulation, motion, session)
    clock = room.rig.scanner.clock
    error_mm = ERROR_MM if place.error_mm is None else place.error_mm
    known = room.registration(error_m=error_mm / 1e3) if session is None else session.known
    pairs = following.NewestPairs(room.images)
    source: following.TargetSource | following.LitSource
    pointed: following.PointedPlace | None = None
    newest = pairs.newest
    if followed.spot:
        source = spot = following.SimulatedSpot(room)
        newest = spot.newest
    elif followed.pixel is not None:
        pointing = None if session is None else PointedAt(session.folder)
        source = pointed = following.PointedPlace(pairs, room.stereo, clock, left_px=followed.pixel, pointed=pointing)
    else:
        source = room.tip()
    confirmed = place.still_valid or (session is None and not followed.spot)
    follower = following.Follower(
        room.rig,
        following.HeldRegistration(known, confirmed=confirmed),
        source,
        # The simulated person lights each place at once.
        plan=msgspec.structs.replace(plan, light_while_waiting=True),
        by="the simulated person",
        reach=following.probe_reach(room.rig),
    )

    def truth(at_s: float) -> float | None:
        return room.angle_deg(at_s) if pointed is None else room.angle_at_deg(pointed.left_px)

    what = "a laser spot" if followed.spot else "a tip"
    moving = source.name if pointed is not None else f"{what} ({motion})"
    with_error = f"registration with {error_mm:g} mm" if session is None else f"registration of {session.folder.name}"
    yield FollowRun(
        follower=follower,
        title=f"simulated: the probe follows {moving}, {with_error}",
        what=moving,
        rig=room.rig.facts.description,
        ends_s=clock.now_s() + (SIMULATED_S if place.seconds is None else place.seconds),
        simulated=True,
        truth=truth,
        look_on=_looking_on(None if session is None else session.folder, newest, clock.now_s),
        hints={},
    )


def _require_confirmed(followed: Followed, place: FollowPlace) -> None:
    """Refuse to follow without light with a registration that nothing has confirmed."""
    if not (followed.spot or place.still_valid):
        raise ConfigError(
            f"{place.registration}: without light nothing confirms it; add --still-valid if neither probe nor camera "
            "was switched off since, or follow a spot first"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _SimulatedSession:
    """A session of the simulated rig, whose room is made again."""

    known: registration.KnownRegistration
    folder: Path
    seed: int


def _simulated_session(place: FollowPlace, simulation: SceneOptions) -> _SimulatedSession | None:
    """Return the session that is followed with; None: the registration is simulated."""
    if place.registration is None:
        for name, given in (("--rig", place.rig), ("--still-valid", place.still_valid)):
            if given:
                raise ConfigError(
                    f"{name} needs --registration SESSION of a simulated session; add it, or leave it out"
                )
        return None
    if place.error_mm is not None:
        raise ConfigError(
            f"--error-mm is of a simulated registration, and {place.registration} names one; leave it out"
        )
    named = named_registration(place.registration)
    known = named.known
    folder = named.session
    if folder is None or not known.simulated:
        raise ConfigError(
            f"--simulate: {place.registration} is no folder of a simulated session; name one, or leave it out"
        )
    view = registration.read_view(folder)
    places = len(set(registration.station_names(view.markers).values()))
    if places > 1:
        raise ConfigError(
            f"{folder}: its endoscope stood at {counted(places, 'place')}, and the simulated room begins at the first; "
            "name a session without --endoscope-moves"
        )
    seed = USUAL_SEED if view.begun is None or view.begun.seed is None else view.begun.seed
    if simulation.seed not in (None, seed):
        raise ConfigError(f"--seed is {simulation.seed}, and {folder} was simulated with {seed}; leave it out")
    return _SimulatedSession(known=known, folder=folder, seed=seed)


def _simulated_room(
    followed: Followed,
    place: FollowPlace,
    simulation: SceneOptions,
    motion: following.Motion,
    session: _SimulatedSession | None,
) -> following.FollowedRoom:
    """Return the simulated room, that of a session where there is one."""
    file = None if place.rig is None else rigs.read_rig_file(place.rig)
    if isinstance(file, drivers.BenchSettings):
        raise ConfigError(f"{place.rig} is a rig of devices; leave --simulate out")
    seed = USUAL_SEED if simulation.seed is None else simulation.seed
    speed_mm_s = SPEED_MM_S if place.speed_mm_s is None else place.speed_mm_s
    return following.FollowedRoom(
        registration.SimulatedRoomSettings(
            rig=simulated_settings(file, simulation, sweeps=True),
            pace=simulation.pace,
            # What is pointed at is found by its texture.
            textured=followed.pixel is not None or session is not None,
        ),
        following.TargetPath(
            motion=motion,
            speed_m_s=speed_mm_s / 1e3,
            # A spot stands still until it has confirmed the registration.
            begins_s=_CONFIRMING_S if followed.spot else 0.0,
        ),
        seed=seed if session is None else session.seed,
    )


_CONFIRMING_S = 8.0
"""Time for which a simulated spot stands still, in seconds."""


def _usual_motion(followed: Followed) -> following.Motion:
    """Return how a simulated target moves unless `--moves` says otherwise."""
    if followed.spot:
        return "steps"
    return "sine" if followed.pixel is None else "still"


def _motion(name: str) -> following.Motion:
    """Return the motion of that name."""
    match name:
        case "still" | "sine" | "steps" | "jump" | "lost":
            return name
    raise ConfigError(f"--moves {name} is none of still, sine, steps, jump, lost")


@contextmanager
def run_on_rig(
    followed: Followed, place: FollowPlace, plan: following.FollowPlan, simulation: SceneOptions, *, as_json: bool
) -> Iterator[FollowRun]:
    """Follow with a rig of devices."""
    assert place.rig is not None  # noqa: S101  checked with the options
    assert place.registration is not None  # noqa: S101  checked with the options
    if simulation != SceneOptions() or (place.moves, place.speed_mm_s, place.error_mm) != (None, None, None):
        raise ConfigError(f"options of a simulation, and {place.rig} is a rig; add --simulate, or leave them out")
    if not isinstance(rigs.read_rig_file(place.rig), drivers.BenchSettings):
        raise ConfigError(f"{place.rig} is a simulated rig; --simulate follows in a simulated room")
    named = named_registration(place.registration)
    session = named.session
    _require_confirmed(followed, place)
    for name, needs_it in (("--spot", followed.spot), ("--pixel", followed.pixel is not None)):
        if needs_it and place.images is None:
            raise ConfigError(f"{name} needs the endoscope: --cameras FILE and --images 'LEFT RIGHT'")
    with ExitStack() as opened:
        rig, _ = opened.enter_context(open_rig(place.rig, sweeps=followed.spot, trace=place.trace))
        clock = rig.scanner.clock
        cameras = _CameraSources()
        if place.images is not None:
            cameras = _open_cameras(followed, place, rig, session, opened)
        source = cameras.source
        links = None
        if followed.tip is not None:
            offset_mm = followed.tool_offset_mm or (0.0, 0.0, 0.0)
            poses = drivers.open_poses(followed.tip, clock)
            tip = following.RobotTip(poses, clock, offset_mm=offset_mm, sigma_mm=followed.tip_sigma_mm, on_note=note)
            source = opened.enter_context(closing(tip))
            links = tip.links
            say_errors(named.known, links)
        elif followed.point is not None:
            source = following.FixedPoint(clock, camera_mm=followed.point)
        assert source is not None  # noqa: S101  one of them is followed
        held = opened.enter_context(
            held_registration(named, rig, stereo=cameras.stereo, lit=followed.spot, still_valid=place.still_valid)
        )
        arm_rig(rig, file=place.rig, arm=place.arm, what="follow", as_json=as_json, asked_by=place.asked_by)
        follower = following.Follower(
            rig,
            held,
            source,
            plan=plan,
            by=person(),
            reach=following.probe_reach(rig),
            endoscope=cameras.endoscope,
            is_set=SpotIsSet(session) if followed.spot else None,
            links=links,
        )
        yield FollowRun(
            follower=follower,
            title=f"{rig.facts.description}: follows {source.name}",
            what=source.name,
            rig=rig.facts.description,
            simulated=named.known.simulated,
            look_on=_looking_on(session, cameras.newest, clock.now_s),
            ends_s=None if place.seconds is None else clock.now_s() + place.seconds,
            hints={**_HINTS, **_DARK} if followed.spot and not plan.light_while_waiting else _HINTS,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _CameraSources:
    """What the cameras give to a run: nothing where there are none."""

    source: following.TargetSource | following.LitSource | None = None
    """What is followed; None: the cameras do not show it."""
    stereo: registration.StereoSettings | None = None
    """Calibration of the cameras."""
    endoscope: Callable[[], registration.SeenEndoscope | following.GoingOn | None] | None = None
    """Looks whether the endoscope has moved; None: it is held."""
    newest: Callable[[], StereoPair | None] = lambda: None
    """Newest pair, for those who look on."""


def _open_cameras(
    followed: Followed, place: FollowPlace, rig: rigs.Rig, session: Path | None, opened: ExitStack
) -> _CameraSources:
    """Open the cameras, and return what they give to the run."""
    assert place.images is not None  # noqa: S101  as it is called
    stereo = registration.read_stereo(place.cameras or (), calibration_sigma_px=place.calibration_sigma_px)
    images = opened.enter_context(
        closing(drivers.open_stereo_images(place.images, left=stereo.left, right=stereo.right))
    )
    source: following.SpotSource | following.PointedPlace | None = None
    dark: following.SpotSource | following.NewestPairs
    if followed.spot:
        room = registration.DeviceRoom(rig=rig, images=images, stereo=stereo, by=person())
        source = dark = following.SpotSource(room)
    else:
        dark = following.NewestPairs(images)
    if followed.pixel is not None and isinstance(dark, following.NewestPairs):
        source = following.PointedPlace(
            dark,
            stereo,
            rig.scanner.clock,
            left_px=followed.pixel,
            pointed=None if session is None else PointedAt(session),
        )
    check = None
    if not place.endoscope_held:
        check = opened.enter_context(following.EndoscopeCheck(stereo, dark, session)).glance
    return _CameraSources(source=source, stereo=stereo, endoscope=check, newest=dark.newest)


_HINTS: Mapping[following.Word, str] = MappingProxyType(
    {"endoscope": "where the endoscope is held so that it cannot move, --endoscope-held leaves its images out"}
)
_DARK: Mapping[following.Word, str] = MappingProxyType(
    dict.fromkeys(following.BY_ITSELF, "press Enter once the spot is set; the laser is dark until then")
)
"""What a person may do in a state, and what besides where a spot is looked for only when a person says so."""
