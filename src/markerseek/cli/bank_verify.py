"""``markerseek bank verify``: checks every frame of a bank."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.terminal import one_line, progress_bar

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
    sound = f"{frames - len(faults)} of {frames} frames"
    if not frames:
        found = f"{len(held.angles_deg)} angles with intensities can be read; there are no frames"
    elif checksums:
        found = f"{sound} are as they were written"
    else:
        found = f"{sound} can be read; the bank has no checksums, so a change would not show"
    report = Report(
        values=with_version(ok=not faults, frames=frames, checksums=checksums, faults=faults),
        shown=[*(f"[red]wrong:[/] {one_line(fault)}" for fault in faults), found],
        exit_code=DAMAGED if faults else 0,
    )
    Output(as_json=as_json).show(report)
