"""The rig that a command was given: simulated, or of devices, which a person arms."""

from __future__ import annotations

import getpass
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.rigs import Rig

NOT_ARMED = 4
"""Exit code of a run that nobody armed: nothing moved, nothing was fired."""


@contextmanager
def open_rig(
    path: Path | None, *, seed: int, tissue: str | None = None, pace: float = 0.0
) -> Iterator[tuple[Rig, float]]:
    """The rig of a rig file, and where its probe stands, in degrees; its devices are let go of at the end.

    Parameters
    ----------
    path
        Rig file; None for the simulated rig with its defaults.
    seed, tissue, pace
        Of a simulation. A rig of devices takes neither tissue nor pace.

    Raises
    ------
    ConfigError
        If the file or an option cannot be used.
    DeviceError
        If a device does not answer, or is not fit for use.
    """
    from markerseek import rigs
    from markerseek.drivers.settings import BenchSettings
    from markerseek.rig_file import read_rig_file
    from markerseek.sim import SimulatedSettings

    settings = SimulatedSettings() if path is None else read_rig_file(path)
    if isinstance(settings, BenchSettings):
        if tissue is not None or pace != 0:
            raise ConfigError(
                f"--tissue and --pace are for simulated rigs, and {path} is of kind bench; leave them out"
            )
        from markerseek.rigs.bench import bench

        with bench(settings) as rig:
            yield rig, rig.scanner.angle_deg
        return
    if tissue is not None:
        settings = replace(settings, tissue=tissue)
    yield rigs.simulated(seed=seed, settings=settings, pace=pace), settings.start_deg


def arm_rig(rig: Rig, *, arm: bool, what: str) -> None:
    """Arm a rig of devices in the user's name, or end the command; rigs without hardware need no leave.

    Parameters
    ----------
    rig
        The rig.
    arm
        Whether the user has said so already; else whoever sits at the terminal is asked.
    what
        What will be done, for the question: "search".
    """
    from rich.markup import escape

    from markerseek.cli.terminal import aside

    if rig.devices is None:
        return
    aside.print(escape(rig.description))
    aside.print(
        f"[dim]search {rig.limits.search}, travel {rig.limits.travel}; stands at {rig.scanner.angle_deg:.3f} deg[/]"
    )
    if not arm and not (sys.stdin.isatty() and typer.confirm(f"Arm the laser and {what}?", default=False, err=True)):
        aside.print("not armed: nothing moved and nothing was fired; add --arm, or say yes on a terminal")
        raise typer.Exit(NOT_ARMED)
    rig.arm(by=person())


def person() -> str:
    """Name of the user, for journal and guard."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "a user without a name"
