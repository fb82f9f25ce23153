"""``markerseek journal list`` and ``markerseek journal prune``: journals of a folder, listed or removed."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report
from markerseek.cli.terminal import one_line, print_error
from markerseek.core import MarkerseekError, RecordError, counted, rig_in_words

if TYPE_CHECKING:
    from markerseek.records.journal import JournalSummary

LIST_EXAMPLES = "Examples:\n\n  markerseek journal list\n\n  markerseek journal list /data/runs --last 100 --json"
PRUNE_EXAMPLES = (
    "Examples:\n\n  markerseek journal prune --keep 50\n\n"
    "  markerseek journal prune --older-than-days 90 --delete\n\n"
    "  markerseek journal prune /data/runs --keep 10 --older-than-days 30 --json"
)

_Folder = Annotated[
    Path | None, typer.Argument(help="Folder of journals.", show_default="that of runs that named no journal")
]

_S_PER_DAY = 86_400.0


def list_journals(
    folder: _Folder = None,
    last: Annotated[int, typer.Option(min=1, help="Number of the newest journals to list.")] = 20,
    as_json: AsJson = False,
) -> None:
    """List the journals of a folder, the newest first, with local time, method, result, size, tissue and seed.

    Journals are never deleted automatically: markerseek journal prune deletes old ones.
    """
    from markerseek.records.journal import journals_folder, journals_in, size_bytes_of, summary

    place = folder or journals_folder()
    # Before the first search there is no such folder.
    paths = journals_in(place) if folder is not None or place.exists() else []
    total_bytes = sum(map(size_bytes_of, paths))
    summaries = [summary(path) for path in paths[: -last - 1 : -1]]
    lines = []
    for each in summaries:
        lines.append(f"[bold]{one_line(Path(each.path).name)}[/]\n  {one_line(_in_words(each))}")
        if each.description is not None:
            lines.append(f"  [dim]{one_line(each.description)}[/]")
    listed = "" if len(summaries) == len(paths) else f", the newest {len(summaries)} are listed (--last)"
    lines.append(f"{counted(len(paths), 'journal')} in {escape(str(place))}, {total_bytes / 1e6:.1f} MB{listed}")
    values = {"folder": str(place), "count": len(paths), "total_bytes": total_bytes, "journals": summaries}
    Output(as_json=as_json).show(Report(values=values, shown=lines))


def _in_words(each: JournalSummary) -> str:
    if each.method is None or each.acquisitions is None:
        return f"{each.state}: {each.problem}"
    begun = "not begun" if each.begun is None else _local(each.begun)
    end = each.answer or each.state
    # Where nothing was detected, the angle is that of the noise; the paper's form has one then too.
    if each.angle_deg is not None and each.answer != "not found":
        end = f"{each.angle_deg:.3f}°" if each.as_published else f"{end} at {each.angle_deg:.3f}°"
    form = " as published" if each.as_published else ""
    rig = rig_in_words(str(each.rig), each.emulated)
    text = f"{begun}, {each.method}{form} on a {rig}: {end}, {counted(each.acquisitions, 'acquisition')}"
    return f"{text}, {each.size_bytes / 1e6:.1f} MB" + ("" if each.problem is None else f"; {each.problem}")


def _local(begun: str) -> str:
    """A time in the zone of this computer."""
    try:
        return f"{datetime.fromisoformat(begun).astimezone():%Y-%m-%d %H:%M %Z}"
    # The file may be another's, and hold any text.
    except (ValueError, OverflowError, OSError):
        return begun


def prune(
    folder: _Folder = None,
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
    done = "deleted" if delete else "to be deleted (--delete)"
    stay = counted(len(found.kept), "old one stays", "old ones stay")
    report = Report(
        values={
            "deleted": delete,
            "journals": [each.path for each in gone],
            "bytes": freed_bytes,
            "kept": [each.path for each in found.kept],
            "problems": list(map(str, problems)),
        },
        shown=[
            *(f"{one_line(Path(each.path).name)}  {each.size_bytes / 1e6:.1f} MB" for each in gone),
            f"{counted(len(gone), 'journal')}, {freed_bytes / 1e6:.1f} MB, {done}",
            *([f"{stay}: a run that is not over, or a file that cannot be read"] if found.kept else []),
        ],
        exit_code=problems[0].exit_code if problems else 0,
    )
    for error in problems:
        print_error(error, as_json=False)
    Output(as_json=as_json).show(report)
