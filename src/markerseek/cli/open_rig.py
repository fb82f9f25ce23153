"""Opens the rig of a command, and arms it in the name of the user."""

from __future__ import annotations

import getpass
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.drivers import BenchSettings
    from markerseek.rigs import Rig

_USUAL_SEED = 1
"""Default seed of a simulation."""

NOT_ARMED = 4
"""Exit code if the rig was not armed: nothing moved, nothing was fired."""


@contextmanager
def open_rig(
    path: Path | None,
    *,
    seed: int | None = None,
    tissue: str | None = None,
    pace: float = 0.0,
    snr_db: float | None = None,
    readout_s: float | None = None,
) -> Iterator[tuple[Rig, float]]:
    """The rig of a rig file and the angle of its probe in degrees; its devices are closed at the end.

    Parameters
    ----------
    path
        Rig file; None for the simulated rig with its defaults.
    seed, tissue, pace, snr_db, readout_s
        Options of a simulated rig (default seed 1), in place of its settings; an error for a rig of devices.

    Raises
    ------
    ConfigError
        If the file or an option cannot be used.
    DeviceError
        If a device does not answer, or is not ready.
    """
    from markerseek import rigs
    from markerseek.drivers import BenchSettings
    from markerseek.rigs import read_rig_file
    from markerseek.sim import SimulatedSettings, changed_settings

    settings = SimulatedSettings() if path is None else read_rig_file(path)
    if isinstance(settings, BenchSettings):
        simulated_only: dict[str, object] = {"--seed": seed, "--tissue": tissue, "--pace": pace or None}
        _require_none(path, simulated_only | {"--snr-db": snr_db, "--readout-s": readout_s})
        from markerseek.rigs import bench

        with bench(settings) as rig:
            yield rig, rig.scanner.angle_deg
        return
    settings = changed_settings(settings, tissue=tissue, snr_db=snr_db, readout_s=readout_s)
    yield rigs.simulated(seed=_USUAL_SEED if seed is None else seed, settings=settings, pace=pace), settings.start_deg


def _require_none(path: Path | None, options: dict[str, object]) -> None:
    """Refuse options that only a simulation has; a rig of devices would ignore them."""
    given = [f"{name} {value}" for name, value in options.items() if value is not None]
    if given:
        raise ConfigError(
            f"{' and '.join(given)}: only for a simulated rig, and {path} is one of devices (kind bench); leave "
            "it out, or name the rig file of a simulated rig"
        )


def arm_rig(rig: Rig, *, arm: bool, what: str, as_json: bool) -> None:
    """Arm a rig of devices in the user's name, or end the command; does nothing for a rig without hardware.

    Parameters
    ----------
    rig
        The rig.
    arm
        Whether the user gave --arm; otherwise a question is asked on the terminal.
    what
        What will be done, for the question: "search".
    as_json
        Whether to print JSON if it is not armed.
    """
    from rich.markup import escape

    from markerseek.cli.terminal import print_json, stderr
    from markerseek.rigs import BenchRecipe

    if rig.devices is None:
        return
    stderr.print(escape(rig.facts.description))
    stderr.print(f"[dim]stands at {rig.scanner.angle_deg:.3f} deg[/]")
    if isinstance(rig.recipe, BenchRecipe):
        print_permissions(rig.recipe.settings)
    # Only a person at a terminal is asked: "yes | markerseek" must not arm a laser.
    if not arm and not (sys.stdin.isatty() and typer.confirm(f"Arm the laser and {what}?", default=False, err=True)):
        stderr.print("not armed: nothing moved and nothing was fired; add --arm, or say yes on a terminal")
        if as_json:
            print_json({"armed": False, "rig": rig.facts.description})
        raise typer.Exit(NOT_ARMED)
    rig.arm(by=person())


def print_permissions(settings: BenchSettings) -> None:
    """Print what a rig of devices may do once it is armed: limits, pulses, budgets, exposure, its start command.

    Parameters
    ----------
    settings
        From the user's rig file.
    """
    from rich.markup import escape

    from markerseek.cli.terminal import stderr
    from markerseek.drivers import exposure_line

    limits, firing, command = settings.limits, settings.firing, settings.receiver.start_command
    lines = (
        f"limits: search {limits.search}, travel {limits.travel}",
        f"laser: {settings.laser.pulses} pulses per acquisition at {settings.laser.rate_hz:g} Hz",
        (
            f"budgets: {firing.pulses_per_permit} pulses per permit, {firing.pulses_per_second} per second, "
            f"{firing.pulses_per_session} per session"
        ),
        f"start_command: {'none' if command is None else shlex.join(command)}",
        exposure_line(settings.laser),
    )
    for line in lines:
        stderr.print(f"[dim]{escape(line)}[/]")


def person() -> str:
    """Name of the user, for journal and guard."""
    try:
        return getpass.getuser()
    # A container can run under a user number without a name.
    except (KeyError, OSError):
        return "a user without a name"
