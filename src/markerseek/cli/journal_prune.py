"""``markerseek journal prune``: removes old journals."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek.cli.output_options import AsJson

if TYPE_CHECKING:
    from markerseek.records.journal import JournalSummary

NAME = "prune"
EXAMPLES = (
    "Examples:\n\n  markerseek journal prune --keep 50\n\n"
    "  markerseek journal prune --older-than-days 90 --delete\n\n"
    "  markerseek journal prune /data/runs --keep 10 --older-than-days 30 --json"
)

_S_PER_DAY = 86_400.0


def command(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of journals.", show_default="that of runs that named no journal")
    ] = None,
    keep: Annotated[int | None, typer.Option(min=0, help="Number of the newest journals that stay.")] = None,
    older_than_days: Annotated[
        float | None, typer.Option(min=0, help="Remove only journals that were last changed before so many days.")
    ] = None,
    unfinished: Annotated[
        bool, typer.Option("--unfinished", help="Also journals of runs that could be resumed.")
    ] = False,
    delete: Annotated[bool, typer.Option("--delete", help="Delete them; without it they are only listed.")] = False,
    as_json: AsJson = False,
) -> None:
    """List old journals, and delete them with --delete. A journal of a run that is going on is never deleted."""
    from markerseek.cli.terminal import one_line, print_error, print_json, stdout
    from markerseek.core import MarkerseekError, RecordError
    from markerseek.records.journal import Prunable, journals_folder, prunable, remove_journal

    place = folder or journals_folder()
    # Before the first search there is no such folder.
    empty = folder is None and not place.exists() and (keep is not None or older_than_days is not None)
    found = Prunable(old=(), kept=())
    if not empty:
        found = prunable(
            place,
            now_s=datetime.now(UTC).timestamp(),
            keep=keep,
            older_than_s=None if older_than_days is None else older_than_days * _S_PER_DAY,
            unfinished=unfinished,
        )
    gone: list[JournalSummary] = []
    problems: list[MarkerseekError] = []
    for each in found.old:
        try:
            if delete:
                remove_journal(Path(each.path))
            gone.append(each)
        except RecordError as problem:
            problems.append(problem)
    freed_bytes = sum(each.size_bytes for each in gone)
    if as_json:
        print_json(
            {
                "deleted": delete,
                "journals": [each.path for each in gone],
                "bytes": freed_bytes,
                "kept": [each.path for each in found.kept],
                "problems": list(map(str, problems)),
            }
        )
    else:
        for each in gone:
            stdout.print(f"{one_line(Path(each.path).name)}  {each.size_bytes / 1e6:.1f} MB")
        done = "deleted" if delete else "to be deleted (--delete)"
        stdout.print(f"{len(gone)} journals, {freed_bytes / 1e6:.1f} MB, {done}")
        if found.kept:
            stdout.print(f"{len(found.kept)} old ones stay: their runs are not over, or they cannot be read")
    for error in problems:
        print_error(error, as_json=False)
    raise typer.Exit(problems[0].exit_code if problems else 0)
