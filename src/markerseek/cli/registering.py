"""The session of ``markerseek register``: its options, what it prints while it goes on, and its end."""

from __future__ import annotations

import os
import select
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import drivers, registration, rigs
from markerseek.cli.open_rig import arm_rig, open_rig, person, require_no_trace, simulated_settings
from markerseek.cli.options import Arm, Trace
from markerseek.cli.report import file_line
from markerseek.cli.signals import Heartbeat, StoppedBySignal, end_stopped, require_pipe, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, print_warning, progress_bar, show_view, stderr
from markerseek.core import (
    USUAL_SEED,
    ConfigError,
    MarkerseekError,
    SceneOptions,
    SearchError,
    counted,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionPlace:
    """Where a session takes place, and where it is recorded."""

    simulate: Annotated[
        bool, typer.Option("--simulate", help="A session on the simulated rig, with a simulated endoscope.")
    ] = False
    textured: Annotated[
        bool,
        typer.Option(
            "--textured",
            help="The simulated endoscope sees tissue with texture, which is followed; so it does where the tissue "
            "breathes.",
        ),
    ] = False
    endoscope_moves: Annotated[
        int | None,
        typer.Option(
            metavar="MARKER",
            help="Somebody moves the simulated endoscope while this marker is searched, by 5 mm and 3 deg.",
        ),
    ] = None
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
    record: Annotated[
        Path | None,
        typer.Option(help="New folder for the record of the session; without it, one in the user's data folder."),
    ] = None
    continue_: Annotated[
        Path | None, typer.Option("--continue", metavar="FOLDER", help="Go on with the session of this folder.")
    ] = None
    arm: Arm = False
    trace: Trace = None
    asked_by: Annotated[str | None, typer.Option(hidden=True, help="Who asked a bridge for this session.")] = None
    heartbeat: Heartbeat = None

    def __post_init__(self) -> None:
        require_pipe(self.heartbeat)

    @property
    def wanted(self) -> bool:
        """Whether a session is asked for."""
        return self.simulate or self.rig is not None or self.continue_ is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionArguments:
    """All that the command line asks of a session."""

    place: SessionPlace
    plan: registration.SessionPlan
    simulation: SceneOptions
    cameras: Sequence[Path]
    calibration_sigma_px: float | None
    """``cameras`` and ``calibration_sigma_px``: calibration of the endoscope, for a rig of devices."""

    @property
    def seed(self) -> int:
        """Seed of the simulation."""
        return USUAL_SEED if self.simulation.seed is None else self.simulation.seed


def require_no_session(place: SessionPlace, plan: registration.SessionPlan, simulation: SceneOptions) -> None:
    """Refuse options of a session where there is none."""
    usual = {**asdict(SessionPlace()), **structs.asdict(registration.SessionPlan()), **structs.asdict(SceneOptions())}
    given = {**asdict(place), **structs.asdict(plan), **structs.asdict(simulation)}
    for name, value in given.items():
        if value != usual[name]:
            option = name.strip("_").replace("_", "-")
            raise ConfigError(f"--{option} is for a session; add --rig RIG.toml or --simulate, or leave it out")


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionOver:
    """A session that is over."""

    view: registration.SessionView
    folder: Path
    title: str
    truth: registration.SimulatedTruth | None = None
    """What only a simulation knows; None for a rig of devices."""

    @property
    def report(self) -> registration.RegistrationReport:
        """Its registration; `SearchError` with the reason where there is none."""
        if self.view.report is None:
            raise SearchError(
                f"{self.view.reason}; {self.folder} holds what was measured, and --continue goes on with it"
            )
        return self.view.report


def run_session(asked: SessionArguments, *, as_json: bool) -> SessionOver:
    """Run a session to its end; Ctrl-C, SIGTERM and SIGHUP stop the rig and end the command."""
    place = asked.place
    with ExitStack() as opened:
        record = None
        plan = asked.plan
        if place.continue_ is not None:
            record = opened.enter_context(closing(_reopened(place, place.continue_)))
            plan = record.view.continue_plan(plan)
            if record.view.moved:
                # Nothing that is measured now makes a registration of it hold: no device is opened, and none armed.
                _announce(record, as_json=as_json)
                return SessionOver(view=record.view, folder=record.folder, title=record.begun.description)
        room = opened.enter_context(_room(asked, as_json=as_json))
        begun = _begun(room, plan, seed=asked.seed)
        if record is None:
            folder = registration.default_folder() if place.record is None else place.record
            record = opened.enter_context(closing(registration.SessionRecord.create(folder, begun)))
        else:
            _require_same(record, begun)
        _announce(record, as_json=as_json)
        if not as_json and isinstance(room, registration.DeviceRoom):
            stderr.print(f"images: {escape(room.images.name)}")
        if isinstance(room, registration.SimulatedRoom):
            room.skip(record.view.markers)
        if isinstance(room, registration.DeviceRoom) and not plan.light_while_waiting:
            room.is_set = SpotIsSet(record.folder)
            room.show = record.show
            if not (as_json or (sys.stdin is not None and sys.stdin.isatty())):
                print_warning(
                    f"there is no terminal on which somebody could say that a spot is set: make the file "
                    f"{record.folder / registration.SPOT_IS_SET}, or add --idle-s or --light-while-waiting"
                )
        session = registration.RegistrationSession(room, plan=plan, record=record)
        _watch(session, record.folder, as_json=as_json, hold=plan.hold)
        if not as_json:
            _say_size(record.folder, frames=not plan.no_frames)
        simulated = isinstance(room, registration.SimulatedRoom)
        return SessionOver(
            view=session.view,
            folder=record.folder,
            title="simulated rig and endoscope" if simulated else room.rig.facts.description,
            truth=room.truth(session.view) if isinstance(room, registration.SimulatedRoom) else None,
        )


def _say_size(folder: Path, *, frames: bool) -> None:
    """Print how large a record is, and how it is made smaller."""
    size_mb = sum(path.stat().st_size for path in folder.iterdir() if path.is_file()) / 1e6
    smaller = "the receiver's frames for the most part: --no-frames keeps the samples only" if frames else "no frames"
    stderr.print(f"[dim]the record has {size_mb:.3g} MB, {smaller}[/]")


class SpotIsSet:
    """Whether a person has said that the spot is set: by Enter on this terminal, or by a file in the session's folder.

    The page, a pedal or any other program makes the file, `markerseek.registration.SPOT_IS_SET`; it is removed here.
    ``folder``: None: by Enter alone.
    """

    def __init__(self, folder: Path | None) -> None:
        self._path = None if folder is None else folder / registration.SPOT_IS_SET
        self._at_terminal = sys.stdin is not None and sys.stdin.isatty()

    def __call__(self) -> bool:
        """Whether it was said since the last call."""
        typed = self._typed()
        if self._path is None or not self._path.exists():
            return typed
        self._path.unlink(missing_ok=True)
        return True

    def _typed(self) -> bool:
        """Return whether a line was typed since the last call.

        All that was typed is read, so that no key counts later.
        """
        typed = False
        while self._at_terminal:
            try:
                terminal = sys.stdin.fileno()
                # A job in the background would be stopped by the system if it read.
                if os.tcgetpgrp(terminal) != os.getpgrp() or not select.select([terminal], [], [], 0)[0]:
                    break
                line = os.read(terminal, 4096)
            except OSError:
                line = b""
            # The terminal has gone, if nothing comes of it.
            self._at_terminal = bool(line)
            typed = typed or b"\n" in line
        return typed


def _announce(record: registration.SessionRecord, *, as_json: bool) -> None:
    """Print where the session is recorded."""
    if not as_json:
        stderr.print(file_line("session", record.folder))


@contextmanager
def _room(asked: SessionArguments, *, as_json: bool) -> Iterator[registration.Room]:
    """Yield where the session takes place."""
    place = asked.place
    settings = None if place.rig is None else rigs.read_rig_file(place.rig)
    if not isinstance(settings, drivers.BenchSettings):
        for name, given in (("--cameras", asked.cameras), ("--images", place.images)):
            if given:
                raise ConfigError(f"{name} is for a rig of devices; the simulated rig has a simulated endoscope")
        require_no_trace(place.trace)
        announce_compilation()
        rig_settings = simulated_settings(settings, asked.simulation, sweeps=asked.plan.sweep)
        # Where tissue or endoscope move, the cameras are to see it.
        textured = place.textured or place.endoscope_moves is not None or rig_settings.motion.moves
        if asked.plan.hold:
            # The simulated person holds the ventilation whenever a marker is taken.
            still = structs.replace(rig_settings.motion, breathing_mm=0.0)
            rig_settings = structs.replace(rig_settings, motion=still)
        room_settings = registration.SimulatedRoomSettings(
            rig=rig_settings,
            pace=asked.simulation.pace,
            textured=textured,
            moves=() if place.endoscope_moves is None else (_move_during(place.endoscope_moves),),
            endoscope_held=not textured,
        )
        yield registration.SimulatedRoom(room_settings, seed=asked.seed)
        return
    for name, wanted in (("--textured", place.textured), ("--endoscope-moves", place.endoscope_moves is not None)):
        if wanted:
            raise ConfigError(f"{name} is for a simulated rig, and {place.rig} is one of devices; leave it out")
    if asked.simulation != SceneOptions():
        given = ", ".join(asked.simulation.given())
        raise ConfigError(f"{given}: these are for a simulated rig, and {place.rig} is one of devices; leave them out")
    if not asked.cameras or place.images is None:
        raise ConfigError(
            "a session needs the endoscope: its calibration by --cameras FILE, and its images by --images 'LEFT RIGHT'"
        )
    stereo = registration.read_stereo(asked.cameras, calibration_sigma_px=asked.calibration_sigma_px)
    with (
        closing(drivers.open_stereo_images(place.images, left=stereo.left, right=stereo.right)) as images,
        open_rig(place.rig, sweeps=asked.plan.sweep, trace=place.trace) as (rig, _),
    ):
        if rig.facts.face_radius_m is None:
            raise ConfigError(
                f"{place.rig}: face_radius_m is not known, so that no marker has a position; scan a point and "
                "calibrate: markerseek bank scan point.hdf5 --rig RIG.toml, then markerseek calibrate point.hdf5"
            )
        arm_rig(rig, file=place.rig, arm=place.arm, what="register", as_json=as_json, asked_by=place.asked_by)
        yield registration.DeviceRoom(
            rig=rig, images=images, stereo=stereo, by=person(), wait_s=asked.plan.wait_s, idle_s=asked.plan.idle_s
        )


def _move_during(marker: int) -> registration.EndoscopeMove:
    """Return a move of the endoscope that begins 2 s after a place is lit, when its marker is searched."""
    if not 1 <= marker <= registration.MOST_MARKERS:
        raise ConfigError(
            f"--endoscope-moves is {marker}, it must be the number of a marker, from 1 to {registration.MOST_MARKERS}"
        )
    return registration.EndoscopeMove(
        marker=marker, after_s=2.0, shift_m=(3e-3, -4e-3, 0.0), turn_deg=(2.0, -1.0, 2.0), lasts_s=1.0
    )


def _begun(room: registration.Room, plan: registration.SessionPlan, *, seed: int) -> registration.Begun:
    """Return the first line of the record of a session."""
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
        seed=seed if isinstance(room, registration.SimulatedRoom) else None,
        stage_since=room.rig.stage_since,
    )


def _reopened(place: SessionPlace, path: Path) -> registration.SessionRecord:
    """Open the record of the session that is continued."""
    if place.record is not None:
        raise ConfigError(f"--continue {path} has its record; leave --record out")
    return registration.SessionRecord.reopen(path)


def _require_same(record: registration.SessionRecord, begun: registration.Begun) -> None:
    """Refuse to continue a session with another rig, calibration or seed."""
    was = record.begun
    other = f"not on {begun.description}" if begun.description != was.description else "with other settings of it"
    for same, how in (
        (begun.seed == was.seed, f"with --seed {was.seed}, and not {begun.seed}"),
        (begun.rig == was.rig, f"on {was.description}, {other}"),
        (begun.cameras == was.cameras, "with another calibration (--cameras)"),
    ):
        if not same:
            raise ConfigError(f"{record.folder}: the session was begun {how}; name the same, or begin a new session")


def _watch(session: registration.RegistrationSession, folder: Path, *, as_json: bool, hold: bool) -> None:
    """Print each step of a session; a signal stops the rig and ends the command.

    ``hold``: whether the ventilation is held while a marker is searched.
    """
    again = _continue_command(folder)
    with stopped_by_signals():
        try:
            with closing(session.steps()) as steps:
                _show(steps, session, hold=hold)
        except StoppedBySignal as stop:
            end_stopped(stop, as_json=as_json, kept=folder, resume=again)
        except MarkerseekError:
            print_warning(f"once the fault is repaired, continue with: {again}")
            raise


def _show(steps: Iterator[registration.Step], session: registration.RegistrationSession, *, hold: bool) -> None:
    """Print the steps; a search has a bar of its own, with its seconds where the ventilation is held."""
    for name, group in groupby(steps, lambda step: step.name if isinstance(step, registration.Searching) else None):
        if name is None:
            for step in group:
                stderr.print(_line(step, session.view))
            continue
        what = f"searching marker {name}{', the ventilation is held' if hold else ''}"
        with progress_bar(None, what=what, seconds=hold) as progress:
            for step in group:
                if isinstance(step, registration.Searching):
                    show_view(progress, step.view)


def _line(step: registration.Step, view: registration.SessionView) -> str:
    """Return a step in a line; ``view``: the session after it."""
    match step:
        case registration.Waiting():
            set_it = "; the laser is dark: press Enter once the spot is set" if step.dark else ""
            return f"[bold]marker {step.name}:[/] {escape(step.said)}{set_it}"
        case registration.SpotRefused():
            return _refused_line(step)
        case registration.SpotSeen():
            return _seen_line(step)
        case registration.TakenMarker():
            where = f" at {step.candidates[0].angle_deg:.2f} deg" if step.candidates else ""
            why = f": {step.reason}" if step.reason is not None else ""
            found = f"  {escape(step.answer)}{where}, {step.acquisitions} frames, {step.rig_s:.1f} s{escape(why)}"
            return f"{found}{_scene_line(step)}"
        case registration.CorrectedMarker():
            return f"  [dim]{escape(step.said)}[/]"
        case registration.Registered():
            colour = "green" if view.goal_reached else "yellow" if step.decided else "dim"
            return f"  [{colour}]{escape(step.said)}[/]"
        case registration.Continued() | registration.MovedMarker() | registration.SpotChecked() | registration.Ended():
            return f"[bold]{escape(step.said)}[/]"
        case registration.Begun():
            return escape(step.description)
        case registration.Searching():
            from markerseek.show import event_line

            return escape(event_line(step.view))


def _scene_line(step: registration.TakenMarker) -> str:
    """Return what moved during a search, in a line of its own; empty if nobody looked."""
    if step.scene is None:
        return ""
    still = step.scene.is_known and not step.scene.moved
    return f"\n  [{'dim' if still else 'yellow'}]{escape(step.scene.said)}[/]"


def _refused_line(step: registration.SpotRefused) -> str:
    """Return a spot that was not accepted, in a line."""
    again = "" if step.pulses is None else f" ({counted(step.pulses, 'pulse')}); press Enter once the spot is set"
    if step.pulses is not None and step.reason.startswith("no light"):
        again += "; if the cameras do not see single pulses, --light-while-waiting fires more"
    return f"  [yellow]not accepted:[/] {escape(step.reason)}{again}"


def _seen_line(step: registration.SpotSeen) -> str:
    """Return a spot that both cameras see, in a line."""
    x, y, z = (1e3 * value for value in step.camera_m)
    guess = ""
    if step.prediction is not None:
        prior = step.prediction.prior
        guess = f"; expected at {prior.mean_deg:.1f} ± {prior.sigma_deg:.1f} deg"
    at = f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm of the left camera, ± {step.spot.sigma_px:.2f} px"
    fired = "" if step.pulses is None else f"; {counted(step.pulses, 'pulse')} for the cameras"
    late = "" if step.spot.late_s is None else f"; light appears {step.spot.late_s:.1f} s after firing began"
    endoscope = ""
    if step.endoscope is not None:
        colour = "dim" if step.endoscope.state == "at rest" else "yellow"
        endoscope = f"\n  [{colour}]{escape(step.endoscope.said)}[/]"
    return f"  [dim]spot at {at}{late}{fired}{guess}[/]{endoscope}"


_OF_COMMAND = ("--record", "--continue", "--heartbeat", "--asked-by")
"""Options that are of the command and not of the session: its folder, who asked, and what watches it."""


def _continue_command(folder: Path) -> str:
    """Return the command that goes on with a session: this one, with the session's folder."""
    words = ["markerseek"]
    given = iter(sys.argv[1:])
    for word in given:
        if word.partition("=")[0] not in _OF_COMMAND:
            words.append(word)
        elif "=" not in word:
            # Its value.
            next(given, None)
    return shlex.join([*words, "--continue", str(folder)])
