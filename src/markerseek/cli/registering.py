"""The session of ``markerseek register``: its options, what it prints while it goes on, and its end."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from markerseek import drivers, registration, rigs
from markerseek.cli.open_rig import arm_rig, open_rig, person, simulated_settings
from markerseek.cli.options import Arm
from markerseek.cli.report import file_line
from markerseek.cli.signals import Heartbeat, StoppedBySignal, end_stopped, require_pipe, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, print_warning, progress_bar, show_view, stderr
from markerseek.core import (
    ConfigError,
    MarkerseekError,
    SearchError,
    SearchPlan,
    SimulationOptions,
    require_pace,
    require_range,
)


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
    asked_by: Annotated[str | None, typer.Option(hidden=True, help="Who asked a bridge for this session.")] = None
    heartbeat: Heartbeat = None

    @property
    def wanted(self) -> bool:
        """Whether a session is asked for."""
        return self.simulate or self.rig is not None or self.continue_ is not None

    def require_none(self) -> None:
        """Refuse options of a session where there is none."""
        usual = SessionOptions()
        for each in fields(self):
            if getattr(self, each.name) != getattr(usual, each.name):
                option = each.name.strip("_").replace("_", "-")
                raise ConfigError(f"--{option} is for a session; add --rig RIG.toml or --simulate, or leave it out")

    def __post_init__(self) -> None:
        require_range("wait_s", self.wait_s, low=1, high=3600, unit="s")
        require_pace(self.pace)
        require_pipe(self.heartbeat)

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
class SessionOver:
    """A session that is over."""

    session: registration.RegistrationSession
    truth: registration.SimulatedTruth | None
    """What only a simulation knows; None for a rig of devices."""
    title: str
    folder: Path

    @property
    def report(self) -> registration.RegistrationReport:
        """Its registration; `SearchError` with the reason where there is none."""
        last = self.session.last
        if last is None or last.report is None:
            why = "no marker was taken" if last is None else last.said
            raise SearchError(f"{why}; {self.folder} holds what was measured, and --continue goes on with it")
        return last.report


def run_session(
    options: SessionOptions,
    cameras: Sequence[Path] | None,
    *,
    calibration_sigma_px: float | None,
    target_trus_m: tuple[float, float, float] | None,
    as_json: bool,
) -> SessionOver:
    """Run a session to its end; Ctrl-C, SIGTERM and SIGHUP stop the rig and end the command.

    ``cameras``, ``calibration_sigma_px``: calibration of the endoscope, for a rig of devices.
    """
    plan = options.plan(target_trus_m)
    with (
        _room(options, cameras, calibration_sigma_px, as_json=as_json) as room,
        closing(_record(options, _begun(room, plan, options))) as record,
    ):
        if not as_json:
            stderr.print(file_line("session", record.folder))
            if isinstance(room, registration.DeviceRoom):
                stderr.print(f"images: {escape(room.images.name)}")
        if isinstance(room, registration.SimulatedRoom):
            room.skip(record.taken)
        session = registration.RegistrationSession(room, plan=plan, record=record)
        _watch(session, record.folder, as_json=as_json)
        truth = None
        if isinstance(room, registration.SimulatedRoom):
            truth = room.truth(session.last, session.taken, rig_s=session.rig_s)
        title = "simulated rig and endoscope" if truth is not None else room.rig.facts.description
        return SessionOver(session=session, truth=truth, title=title, folder=record.folder)


@contextmanager
def _room(
    options: SessionOptions,
    cameras: Sequence[Path] | None,
    calibration_sigma_px: float | None,
    *,
    as_json: bool,
) -> Iterator[registration.Room]:
    """Where the session takes place."""
    settings = None if options.rig is None else rigs.read_rig_file(options.rig)
    if not isinstance(settings, drivers.BenchSettings):
        for name, given in (("--cameras", cameras), ("--images", options.images)):
            if given:
                raise ConfigError(f"{name} is for a rig of devices; the simulated rig has a simulated endoscope")
        announce_compilation()
        simulation = SimulationOptions(readout_s=options.readout_s)
        rig_settings = simulated_settings(settings, simulation, sweeps=options.sweep)
        yield registration.SimulatedRoom(
            registration.SimulatedRoomSettings(rig=rig_settings, pace=options.pace), seed=options.seed
        )
        return
    if not cameras or options.images is None:
        raise ConfigError(
            "a session needs the endoscope: its calibration by --cameras FILE, and its images by --images 'LEFT RIGHT'"
        )
    stereo = registration.read_stereo(cameras, calibration_sigma_px=calibration_sigma_px)
    with (
        closing(drivers.open_stereo_images(options.images, left=stereo.left, right=stereo.right)) as images,
        open_rig(options.rig, sweeps=options.sweep) as (rig, _),
    ):
        if rig.facts.face_radius_m is None:
            raise ConfigError(
                f"{options.rig}: face_radius_m is not known, so that no marker has a position; scan a point and "
                "calibrate: markerseek bank scan point.hdf5 --rig RIG.toml, then markerseek calibrate point.hdf5"
            )
        arm_rig(rig, file=options.rig, arm=options.arm, what="register", as_json=as_json, asked_by=options.asked_by)
        yield registration.DeviceRoom(rig=rig, images=images, stereo=stereo, by=person(), wait_s=options.wait_s)


def _begun(room: registration.Room, plan: registration.SessionPlan, options: SessionOptions) -> registration.Begun:
    """First line of the record of a session."""
    facts = room.rig.facts
    return registration.Begun(
        rig=facts.fingerprint,
        description=facts.description,
        simulated=room.rig.simulated,
        images=room.images.name,
        cameras=registration.camera_text(room.stereo),
        size_px=room.stereo.left.size_px,
        goal_m=plan.goal_m,
        target_trus_m=plan.target_trus_m,
        begun=datetime.now(UTC).isoformat(timespec="seconds"),
        seed=options.seed if isinstance(room, registration.SimulatedRoom) else None,
    )


def _record(options: SessionOptions, begun: registration.Begun) -> registration.SessionRecord:
    """The record of a new session, or of the one that is continued."""
    if options.continue_ is None:
        folder = registration.default_folder() if options.record is None else options.record
        return registration.SessionRecord.create(folder, begun)
    if options.record is not None:
        raise ConfigError(f"--continue {options.continue_} has its record; leave --record out")
    record = registration.SessionRecord.reopen(options.continue_)
    was = record.begun
    other = f"not on {begun.description}" if begun.description != was.description else "with other settings of it"
    for same, how in (
        (begun.seed == was.seed, f"with --seed {was.seed}, and not {begun.seed}"),
        (begun.rig == was.rig, f"on {was.description}, {other}"),
        (begun.cameras == was.cameras, "with another calibration (--cameras)"),
    ):
        if not same:
            record.close()
            raise ConfigError(
                f"{options.continue_}: the session was begun {how}; name the same, or begin a new session"
            )
    return record


def _watch(session: registration.RegistrationSession, folder: Path, *, as_json: bool) -> None:
    """Print each step of a session; a signal stops the rig and ends the command."""
    again = _continue_command(folder)
    with stopped_by_signals():
        try:
            with closing(session.steps()) as steps:
                _show(steps)
        except StoppedBySignal as stop:
            end_stopped(stop, as_json=as_json, kept=folder, resume=again)
        except MarkerseekError:
            print_warning(f"once the fault is repaired, continue with: {again}")
            raise


def _show(steps: Iterator[registration.Step]) -> None:
    """Print the steps; a search has a bar of its own."""
    for name, group in groupby(steps, lambda step: step.name if isinstance(step, registration.Searching) else None):
        if name is None:
            for step in group:
                stderr.print(_line(step))
            continue
        with progress_bar(None, what=f"searching marker {name}") as progress:
            for step in group:
                if isinstance(step, registration.Searching):
                    show_view(progress, step.view)


def _line(step: registration.Step) -> str:
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
            late = "" if step.spot.late_s is None else f"; light appears {step.spot.late_s:.1f} s after firing began"
            return f"  [dim]spot at {at}{late}{guess}[/]"
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
        case registration.Searching():
            return escape(step.view.line)


_OF_COMMAND = ("--record", "--continue", "--heartbeat", "--asked-by")
"""Options that are of the command and not of the session: its folder, who asked, and what watches it."""


def _continue_command(folder: Path) -> str:
    """The command that goes on with a session: this one, with the session's folder."""
    words, given = ["markerseek"], iter(sys.argv[1:])
    for word in given:
        if word.partition("=")[0] not in _OF_COMMAND:
            words.append(word)
        elif "=" not in word:
            # Its value.
            next(given, None)
    return shlex.join([*words, "--continue", str(folder)])
