"""``markerseek bank verify``: checks every frame of a bank."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from markerseek import __version__
from markerseek.cli.output_options import AsJson
from markerseek.cli.terminal import one_line, print_json, progress_bar, stdout

NAME = "verify"
EXAMPLES = "Examples:\n\n  markerseek bank verify scan.hdf5\n\n  markerseek bank verify scan.hdf5 --json"

DAMAGED = 1
"""Exit code if anything is wrong."""


class VerifyReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a check of a bank found."""

    ok: bool
    frames: int
    checksums: bool
    faults: list[str]
    version: str = __version__


def command(
    bank: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.")],
    as_json: AsJson = False,
) -> None:
    """Read every frame of a bank and compare it with its checksum; exit code 1 if anything is wrong."""
    from markerseek.records.banks import FrameBank, frame_faults, has_checksums, read_bank

    held = read_bank(bank)
    frames = len(held.angles_deg) + held.dark_frames if isinstance(held, FrameBank) else 0
    faults: list[str] = []
    with progress_bar(frames, what="reading") as progress:
        for fault in frame_faults(held):
            if fault is not None:
                faults.append(fault)
            progress.advance(progress.task_ids[0])
    report = VerifyReport(ok=not faults, frames=frames, checksums=has_checksums(held), faults=faults)
    if as_json:
        print_json(report)
    else:
        for fault in faults:
            stdout.print(f"[red]wrong:[/] {one_line(fault)}")
        stdout.print(_summary(report, angles=len(held.angles_deg)))
    raise typer.Exit(DAMAGED if faults else 0)


def _summary(report: VerifyReport, *, angles: int) -> str:
    if not report.frames:
        return f"{angles} angles with intensities can be read; there are no frames"
    sound = report.frames - len(report.faults)
    if report.checksums:
        return f"{sound} of {report.frames} frames are as they were written"
    return f"{sound} of {report.frames} frames can be read; the bank has no checksums, so a change would not show"
