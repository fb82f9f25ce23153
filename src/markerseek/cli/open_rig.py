"""Opens the rig of a command, and arms it in the name of the user."""

from __future__ import annotations

import getpass
import os
import shlex
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import drivers, rigs
from markerseek.cli.hung import watch_stop
from markerseek.cli.stage_track import tracked
from markerseek.cli.terminal import one_line, print_json, print_warning, printable, stderr
from markerseek.core import USUAL_SEED, AnyPolicy, ConfigError, MarkerseekError, SceneOptions, SimulationOptions

if TYPE_CHECKING:
    from markerseek.sim import SimulatedSettings

NOT_ARMED = 4
"""Exit code if the rig was not armed: nothing moved, nothing was fired."""

_LINE_BYTES = 4096
"""Longest line of a terminal."""


NO_OPTIONS = SimulationOptions()
"""A simulated rig as its file describes it."""


@contextmanager
def open_rig(
    path: Path | None, options: SimulationOptions = NO_OPTIONS, *, sweeps: bool = False, trace: Path | None = None
) -> Iterator[tuple[rigs.Rig, float]]:
    """Yield the rig of a rig file and the angle of its probe in degrees; its devices are closed at the end.

    ``path``: None for the simulated rig with its defaults. ``sweeps``: whether it is to sweep: the one without a file
    then streams its frames, and the gain of a simulated one leaves room for the noise of single pulses. ``trace``: file
    of the trace; None for that of the rig file. Raises `DeviceError` if a device does not answer, or is not ready.
    """
    from markerseek.sim import STREAMING, SimulatedSettings

    settings = None if path is None else rigs.read_rig_file(path)
    if sweeps and path is None:
        stderr.print(
            f"[dim]simulated: a PRM1Z8 at its limits ({STREAMING.stage.speed_deg_s:g} deg/s), and a receiver that "
            f"streams {1 / STREAMING.receiver.frame_period_s:g} frames a second[/]"
        )
    if settings is not None and not isinstance(settings, SimulatedSettings):
        if options.given():
            raise ConfigError(
                f"{' and '.join(options.given())}: only for a simulated rig, and {path} is one of devices (kind "
                "bench); leave it out, or name the rig file of a simulated rig"
            )
        settings = with_trace(settings, trace)
        # Before a run handles signals: a driver may hang while it is made, or while a person is asked.
        watch_stop()
        with naming_trace(settings), rigs.bench(settings) as opened, tracked(opened, settings) as rig:
            yield rig, rig.scanner.angle_deg
        return
    require_no_trace(trace)
    settings = simulated_settings(settings, options, sweeps=sweeps)
    seed = USUAL_SEED if options.seed is None else options.seed
    yield rigs.simulated(seed=seed, settings=settings, pace=options.pace), settings.start_deg


def with_trace(settings: drivers.BenchSettings, trace: Path | None) -> drivers.BenchSettings:
    """Return the settings with the file of the trace that was named; None: that of the rig file."""
    return settings if trace is None else structs.replace(settings, trace=str(trace))


def require_no_trace(trace: Path | None) -> None:
    """Refuse a trace of a simulated rig."""
    if trace is not None:
        raise ConfigError("--trace is for a rig of devices, a simulated one has no lines; leave it out")


@contextmanager
def naming_trace(settings: drivers.BenchSettings | None) -> Iterator[None]:
    """Name the file of the trace after an error, where there is one."""
    try:
        yield
    except MarkerseekError:
        file = None if settings is None or settings.trace is None else Path(settings.trace)
        # Nothing is written through a link, or into what is no file.
        if file is not None and file.is_file() and not file.is_symlink():
            stderr.print(f"[dim]trace:[/] {escape(str(file))}")
        raise


def simulated_settings(settings: SimulatedSettings | None, options: SceneOptions, *, sweeps: bool) -> SimulatedSettings:
    """Return the settings of a simulated rig with a user's options.

    ``settings``: of its file, None for the defaults.
    """
    from markerseek.sim import STREAMING, SimulatedSettings, with_options

    usual = STREAMING if sweeps else SimulatedSettings()
    chosen = with_options(usual if settings is None else settings, options)
    single = sweeps or chosen.receiver.single_pulses
    return structs.replace(chosen, receiver=structs.replace(chosen.receiver, single_pulses=single))


def announce_sweeps(rig: rigs.Rig, policy: AnyPolicy, *, start_deg: float, stay: bool) -> None:
    """Print how a rig will sweep, and for how long, run-up included; ``stay``: whether the probe then stays there."""
    from markerseek.search.posterior import SweepPosterior

    assert isinstance(policy, SweepPosterior)  # noqa: S101  that of a plan with sweeps
    devices = rig.scanner.sweeping
    sweeps = policy.sweeps
    begin_deg = sweeps[0].from_deg
    first_deg = start_deg if begin_deg is None else begin_deg
    places_deg = [first_deg, *(sweep.to_deg for sweep in sweeps)]
    durations_s = [devices.duration_s(sweep, from_deg=at) for sweep, at in zip(sweeps, places_deg, strict=False)]
    turns = "" if begin_deg is None else f"turns to {begin_deg:g} deg without light, then "
    way = " and ".join(f"{sweep.to_deg:g} deg{'' if sweep.back_deg is None else ' and back'}" for sweep in sweeps)
    readout_s = devices.receiver.sweep_readout_s
    read = f", and at most {readout_s:.3g} s after each to read its frames" if readout_s > 0 else ""
    wait_deg = devices.wait_deg(sweeps[0])
    if wait_deg is not None:
        read += f" while it waits at {wait_deg:g} deg"
    stderr.print(
        f"[dim]{turns}sweeps from {first_deg:g} deg to {way} at {sweeps[0].speed_deg_s:.1f} deg/s, at most "
        f"{1 / devices.least_period_s:.3g} frames a second: {sum(durations_s):.1f} s at most with run-up "
        f"and braking{read}{'' if stay else ', then back to the marker'}[/]"
    )


def arm_rig(
    rig: rigs.Rig, *, file: Path | None, arm: bool, what: str, as_json: bool, asked_by: str | None = None
) -> None:
    """Arm a rig of devices in the user's name, or end the command; does nothing for a rig without hardware.

    ``file``: None only for a rig without hardware. ``arm``: whether the user gave --arm; otherwise a question is asked
    on the terminal. ``what``: what will be done, for the question: "search". ``as_json``: whether to print JSON if it
    is not armed. ``asked_by``: None if the user of this terminal did.
    """
    if rig.devices is None or file is None:
        return
    stderr.print(escape(rig.facts.description))
    stderr.print(f"[dim]stands at {rig.scanner.angle_deg:.3f} deg[/]")
    if rig.bench is not None:
        print_permissions(rig.bench)
    if not arm and not confirmed(f"Arm the laser and {what}?", name=file.name, asked_by=asked_by):
        if as_json:
            print_json({"armed": False, "rig": rig.facts.description})
        raise typer.Exit(NOT_ARMED)
    rig.arm(by=person())


def confirmed(question: str, *, name: str, asked_by: str | None = None) -> bool:
    """Return whether a person types the rig's name on the terminal, after the question.

    If nobody does, it prints what to do.

    ``question``: whether something that moves or emits light is to be armed. ``asked_by``: None if the user of this
    terminal did.
    """
    shown = printable(name).strip()
    by = f"asked by: {one_line(asked_by or f'{person()}, on this terminal')}"
    # Only a person at a terminal is asked: "yes | markerseek" must not arm a laser. Without a standard input (<&-), its
    # descriptor may be that of a serial line, which is a terminal too.
    if sys.stdin is not None and sys.stdin.isatty():
        stderr.print(f"{by}\n{question} Only the name of the rig arms it: {one_line(shown)}")
        if _typed_line() == shown:
            return True
    stderr.print("not armed: nothing moved and nothing was fired; add --arm, or type the rig's name on a terminal")
    return False


def _typed_line() -> str:
    """Return the next line of the terminal, without what was typed before; empty if it ends."""
    terminal = sys.stdin.fileno()
    line = b""
    try:
        # By the descriptor, because Python's own buffer may hold earlier lines too.
        termios.tcflush(terminal, termios.TCIFLUSH)
        stderr.print("name of the rig: ", end="")
        sys.stderr.flush()
        while not line.endswith(b"\n"):
            piece = os.read(terminal, _LINE_BYTES)
            if not piece:
                return ""
            line += piece
    except (OSError, termios.error):
        # The terminal has gone.
        return ""
    return line.decode("utf-8", "replace").strip()


def print_permissions(settings: drivers.BenchSettings) -> None:
    """Print what a user's rig file allows once it is armed: limits, pulses, budgets, exposure, its start command."""
    limits = settings.limits
    firing = settings.firing
    command = getattr(settings.receiver, "start_command", None)
    for line in settings.foreign_lines:
        print_warning(line)
    lines = (
        f"limits: search {limits.search}, travel {limits.travel}",
        f"laser: {settings.laser.pulses} pulses per acquisition at {settings.laser.rate_hz:g} Hz",
        (
            f"budgets: {firing.pulses_per_permit} pulses per permit, {firing.pulses_per_second} per second, "
            f"{firing.pulses_per_session} per session"
        ),
        f"start_command: {'none' if command is None else shlex.join(command)}",
        drivers.exposure_line(settings.laser),
    )
    for line in lines:
        stderr.print(f"[dim]{escape(line)}[/]")


def person() -> str:
    """Return the name of the user, for journal and guard."""
    try:
        return getpass.getuser()
    # A container can run under a user number without a name.
    except (KeyError, OSError):
        return "a user without a name"
