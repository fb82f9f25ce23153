"""The session of ``markerseek register``: its options, what it prints while it goes on, and its end."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from markerseek import drivers, registration, rigs
from markerseek.cli.open_rig import arm_rig, open_rig, person
from markerseek.cli.options import Arm
from markerseek.cli.report import file_line
from markerseek.cli.signals import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, print_warning, progress_bar, show_view, stderr
from markerseek.cli.watched import Heartbeat, WatchOptions
from markerseek.core import ConfigError, MarkerseekError, SearchError, SearchPlan, SimulationOptions, require_range

if TYPE_CHECKING:
    from markerseek.sim import SimulatedSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionOptions:
    """Options of a session."""

    simulate: Annotated[
        bool, typer.Option("--simulate", help="A session on the simulated rig, with a simulated endoscope.")
    ] = False
    rig: Annotated[
        Path | None,
        typer.Option(help="A session on the rig of this file; a simulated one has a simulated endoscope."),
    ] = None
    images: Annotated[
        str | None,
        typer.Option(
            metavar="'LEFT RIGHT'",
            help="Where the images of both cameras come from: two folders into which another program writes, two "
            "video devices or files, topic:/LEFT topic:/RIGHT of ROS 2, or one video with both side by side.",
        ),
    ] = None
    sweep: Annotated[bool, typer.Option("--sweep", help="Search each marker by sweeps.")] = False
    tre_mm: Annotated[float, typer.Option(help="Expected error at the target at which the session ends, in mm.")] = 0.5
    markers: Annotated[
        int | None,
        typer.Option(help="End after this number of markers, 3 to 12.", show_default="when the error is reached"),
    ] = None
    again: Annotated[
        bool, typer.Option("--again", help="Measure the first marker again at the end, to see whether it has moved.")
    ] = False
    record: Annotated[
        Path | None,
        typer.Option(help="New folder for the record of the session; without it, one in the user's data folder."),
    ] = None
    continue_: Annotated[
        Path | None, typer.Option("--continue", metavar="FOLDER", help="Go on with the session of this folder.")
    ] = None
    wait_s: Annotated[float, typer.Option(help="Longest wait for a spot, in seconds.")] = 300.0
    readout_s: Annotated[
        float | None, typer.Option(help="Seconds to read one acquisition of the simulated rig.", show_default="10")
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1
    pace: Annotated[
        float, typer.Option(help="Real seconds per second of the simulated rig; 1 is real time, 0 does not wait.")
    ] = 0.0
    arm: Arm = False
    heartbeat: Heartbeat = None

    @property
    def wanted(self) -> bool:
        """Whether a session is asked for."""
        return self.simulate or self.rig is not None or self.continue_ is not None

    @property
    def given(self) -> dict[str, object]:
        """Values that differ from the defaults, by their option as it is typed."""
        usual = SessionOptions()
        return {
            f"--{each.name.strip('_').replace('_', '-')}": value
            for each in fields(self)
            if (value := getattr(self, each.name)) != getattr(usual, each.name)
        }

    def require_none(self) -> None:
        """Refuse options of a session where there is none."""
        for option in self.given:
            raise ConfigError(f"{option} is for a session; add --rig RIG.toml or --simulate, or leave it out")

    def __post_init__(self) -> None:
        require_range("--wait-s", self.wait_s, low=1, high=3600, unit="s")

    def plan(self, target_trus_m: tuple[float, float, float] | None) -> registration.SessionPlan:
        """What the session is to reach."""
        return registration.SessionPlan(
            goal_m=self.tre_mm / 1e3,
            markers=self.markers,
            target_trus_m=target_trus_m,
            search=SearchPlan(tolerance_mm=registration.REGISTRATION_TOLERANCE_MM, sweep=self.sweep),
            again=self.again,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """A session that is over."""

    title: str
    last: registration.Registered | None
    registered: bool
    """Whether its registration holds."""
    taken: Sequence[registration.TakenMarker]
    rig_s: float
    truth: registration.SimulatedTruth | None
    """What only a simulation knows; None for a rig of devices."""
    folder: Path


def run_session(
    options: SessionOptions,
    cameras: Sequence[Path] | None,
    *,
    calibration_sigma_px: float | None,
    target_trus_m: tuple[float, float, float] | None,
    as_json: bool,
) -> Session:
    """Run a session to its end; Ctrl-C, SIGTERM and SIGHUP stop the rig and end the command.

    ``cameras``, ``calibration_sigma_px``: calibration of the endoscope, for a rig of devices.
    """
    plan = options.plan(target_trus_m)
    with (
        _room(options, cameras, calibration_sigma_px, as_json=as_json) as (room, begun),
        closing(_record(options, begun(plan))) as record,
    ):
        if not as_json:
            stderr.print(file_line("session", record.folder))
        if isinstance(room, registration.SimulatedRoom):
            room.skip(record.taken)
        session = registration.RegistrationSession(room, plan=plan, record=record)
        again = _continue_command(options, cameras, calibration_sigma_px, target_trus_m, record.folder)
        _watch(session, options.heartbeat, record.folder, again=again, as_json=as_json)
        truth = None
        if isinstance(room, registration.SimulatedRoom):
            truth = room.truth(session.last, session.taken, rig_s=session.rig_s)
        return Session(
            title="simulated rig and endoscope" if truth is not None else room.rig.facts.description,
            last=session.last,
            registered=session.registered,
            taken=session.taken,
            rig_s=session.rig_s,
            truth=truth,
            folder=record.folder,
        )


@contextmanager
def _room(
    options: SessionOptions,
    cameras: Sequence[Path] | None,
    calibration_sigma_px: float | None,
    *,
    as_json: bool,
) -> Iterator[tuple[registration.Room, _Begun]]:
    """The room, and what its record begins with."""
    settings = None if options.rig is None else rigs.read_rig_file(options.rig)
    if not isinstance(settings, drivers.BenchSettings):
        for name, given in (("--cameras", cameras), ("--images", options.images)):
            if given:
                raise ConfigError(f"{name} is for a rig of devices; the simulated rig has a simulated endoscope")
        announce_compilation()
        simulated = registration.SimulatedRoom(
            registration.SimulatedRoomSettings(rig=_simulated(options, settings), pace=options.pace), seed=options.seed
        )
        yield simulated, _Begun(simulated, images="simulated endoscope", seed=options.seed)
        return
    if not cameras or options.images is None:
        raise ConfigError(
            "a session needs the endoscope: its calibration by --cameras FILE, and its images by --images 'LEFT RIGHT'"
        )
    stereo = registration.read_stereo(cameras, calibration_sigma_px=calibration_sigma_px)
    with (
        closing(drivers.open_stereo_images(options.images, left=stereo.left, right=stereo.right)) as images,
        open_rig(options.rig, SimulationOptions(), sweeps=options.sweep) as (rig, _),
    ):
        if rig.facts.face_radius_m is None:
            raise ConfigError(
                f"{options.rig}: face_radius_m is not known, so that no marker has a position; scan a point and "
                "calibrate: markerseek bank scan point.hdf5 --rig RIG.toml, then markerseek calibrate point.hdf5"
            )
        arm_rig(rig, file=options.rig, arm=options.arm, what="register", as_json=as_json)
        room = registration.DeviceRoom(rig=rig, images=images, stereo=stereo, by=person(), wait_s=options.wait_s)
        yield room, _Begun(room, images=images.name)


def _simulated(options: SessionOptions, settings: SimulatedSettings | None) -> SimulatedSettings:
    """Settings of the simulated rig."""
    from markerseek.sim import STREAMING, SimulatedSettings, with_options

    usual = STREAMING if options.sweep else SimulatedSettings()
    chosen = with_options(usual if settings is None else settings, SimulationOptions(readout_s=options.readout_s))
    single = options.sweep or chosen.receiver.single_pulses
    return replace(chosen, receiver=replace(chosen.receiver, single_pulses=single))


@dataclass(frozen=True, slots=True)
class _Begun:
    """First line of the record of a room."""

    room: registration.Room
    images: str
    seed: int | None = None

    def __call__(self, plan: registration.SessionPlan) -> registration.Begun:
        facts = self.room.rig.facts
        return registration.Begun(
            rig=facts.fingerprint,
            description=facts.description,
            simulated=self.room.rig.simulated,
            images=self.images,
            cameras=registration.camera_text(self.room.stereo),
            size_px=self.room.stereo.left.size_px,
            goal_m=plan.goal_m,
            target_trus_m=plan.target_trus_m,
            begun=datetime.now(UTC).isoformat(timespec="seconds"),
            seed=self.seed,
        )


def _record(options: SessionOptions, begun: registration.Begun) -> registration.SessionRecord:
    """The record of a new session, or of the one that is continued."""
    if options.continue_ is None:
        folder = registration.default_folder() if options.record is None else options.record
        return registration.SessionRecord.create(folder, begun)
    if options.record is not None:
        raise ConfigError(f"--continue {options.continue_} has its record; leave --record out")
    record = registration.SessionRecord.reopen(options.continue_)
    for what, mine, theirs in (
        ("rig", begun.rig, record.begun.rig),
        ("calibration of the cameras", begun.cameras, record.begun.cameras),
        ("seed", begun.seed, record.begun.seed),
    ):
        if mine != theirs:
            record.close()
            raise ConfigError(
                f"{options.continue_}: the session has another {what}; name those with which it was begun, or begin a "
                "new session"
            )
    return record


def _watch(
    session: registration.RegistrationSession, heartbeat: Path | None, folder: Path, *, again: str, as_json: bool
) -> None:
    """Print each step of a session; a signal stops the rig and ends the command.

    ``again``: the command that goes on with the session.
    """
    watch = WatchOptions(heartbeat=heartbeat)
    with stopped_by_signals():
        try:
            with watch.stopping(), closing(session.steps()) as steps:
                _show(steps)
        except StoppedBySignal as stop:
            end_stopped(stop, as_json=as_json, kept=folder, resume=again)
        except MarkerseekError:
            print_warning(f"once the fault is repaired, continue with: {again}")
            raise


def _show(steps: Iterator[registration.Step]) -> None:
    """Print the steps; a search has a bar of its own."""
    searching: str | None = None
    step = next(steps, None)
    while step is not None:
        if isinstance(step, registration.Searching):
            searching = step.name
            with progress_bar(None, what=f"searching marker {step.name}") as progress:
                while isinstance(step, registration.Searching) and step.name == searching:
                    show_view(progress, step.view)
                    step = next(steps, None)
            continue
        stderr.print(_line(step))
        step = next(steps, None)


def _line(step: registration.RecordedStep) -> str:
    """A step in a line."""
    match step:
        case registration.Waiting():
            return f"[bold]marker {step.name}:[/] {escape(step.said)}"
        case registration.SpotRefused():
            return f"  [yellow]not accepted:[/] {escape(step.reason)}"
        case registration.SpotSeen():
            x, y, z = (1e3 * value for value in step.camera_m)
            guess = ""
            if step.prediction is not None:
                prior = step.prediction.prior
                guess = f"; expected at {prior.mean_deg:.1f} ± {prior.sigma_deg:.1f} deg"
            at = f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm of the left camera, ± {step.spot.sigma_px:.2f} px"
            return f"  [dim]spot at {at}{guess}[/]"
        case registration.TakenMarker():
            where = f" at {step.candidates[0].angle_deg:.2f} deg" if step.candidates else ""
            why = f": {step.reason}" if step.reason is not None else ""
            return f"  {escape(step.answer)}{where}, {step.acquisitions} frames, {step.rig_s:.1f} s{escape(why)}"
        case registration.Registered():
            colour = "green" if step.decided else "dim"
            return f"  [{colour}]{escape(step.said)}[/]"
        case registration.MovedMarker() | registration.Ended():
            return f"[bold]{escape(step.said)}[/]"
        case registration.Begun():
            return escape(step.description)


def _continue_command(
    options: SessionOptions,
    cameras: Sequence[Path] | None,
    calibration_sigma_px: float | None,
    target_trus_m: tuple[float, float, float] | None,
    folder: Path,
) -> str:
    """The command that goes on with a session, with the options that it was begun with."""
    words = ["markerseek", "register"]
    for option, value in options.given.items():
        if option not in _OF_COMMAND:
            words += [option] if value is True else [option, str(value)]
    for camera in cameras or ():
        words += ["--cameras", str(camera)]
    if calibration_sigma_px is not None:
        words += ["--calibration-sigma-px", f"{calibration_sigma_px:g}"]
    if target_trus_m is not None:
        words += ["--target-mm", *(f"{1e3 * value:g}" for value in target_trus_m)]
    return shlex.join([*words, "--continue", str(folder)])


_OF_COMMAND = ("--record", "--continue", "--heartbeat")
"""Options that are of the command and not of the session: its folder, and what watches it."""


def require_registered(session: Session) -> registration.RegistrationReport:
    """The registration of a session; `SearchError` with the reason where there is none."""
    last = session.last
    if last is None or last.report is None:
        why = "no marker was taken" if last is None else last.said
        raise SearchError(f"{why}; {session.folder} holds what was measured, and --continue goes on with it")
    return last.report
