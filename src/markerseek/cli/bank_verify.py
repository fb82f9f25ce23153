"""``markerseek bank verify``: checks every frame of a bank."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from markerseek.cli.options import AsJson
from markerseek.cli.terminal import one_line, print_report, progress_bar, stdout

EXAMPLES = "Examples:\n\n  markerseek bank verify scan.hdf5\n\n  markerseek bank verify scan.hdf5 --json"

DAMAGED = 1
"""Exit code if anything is wrong."""


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
    checksums = has_checksums(held)
    if as_json:
        print_report(ok=not faults, frames=frames, checksums=checksums, faults=faults)
    else:
        for fault in faults:
            stdout.print(f"[red]wrong:[/] {one_line(fault)}")
        sound = f"{frames - len(faults)} of {frames} frames"
        if not frames:
            stdout.print(f"{len(held.angles_deg)} angles with intensities can be read; there are no frames")
        elif checksums:
            stdout.print(f"{sound} are as they were written")
        else:
            stdout.print(f"{sound} can be read; the bank has no checksums, so a change would not show")
    raise typer.Exit(DAMAGED if faults else 0)
