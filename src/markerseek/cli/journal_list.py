"""``markerseek journal list``: lists the journals of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek.cli.output_options import AsJson

if TYPE_CHECKING:
    from markerseek.records.journal import JournalSummary

NAME = "list"
EXAMPLES = "Examples:\n\n  markerseek journal list\n\n  markerseek journal list /data/runs --last 100 --json"


def command(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of journals.", show_default="that of runs that named no journal")
    ] = None,
    last: Annotated[int, typer.Option(min=1, help="Number of the newest journals to list.")] = 20,
    as_json: AsJson = False,
) -> None:
    """List the journals of a folder, the newest last, with time, method, result and size.

    Journals are never deleted automatically: markerseek journal prune deletes old ones.
    """
    from markerseek.cli.terminal import print_json
    from markerseek.records.journal import journals_folder, journals_in, size_bytes_of, summary

    place = folder or journals_folder()
    # Before the first search there is no such folder.
    paths = journals_in(place) if folder is not None or place.exists() else []
    total_bytes = sum(map(size_bytes_of, paths))
    summaries = [summary(path) for path in paths[-last:]]
    if as_json:
        print_json(
            {"folder": str(place), "count": len(paths), "total_bytes": total_bytes, "journals": summaries},
        )
    else:
        _print(summaries, place, count=len(paths), total_bytes=total_bytes)


def _print(summaries: list[JournalSummary], place: Path, *, count: int, total_bytes: int) -> None:
    from rich.markup import escape

    from markerseek.cli.terminal import one_line, stdout

    for each in summaries:
        stdout.print(f"[bold]{one_line(Path(each.path).name)}[/]\n  {one_line(_in_words(each))}")
    shown = "" if len(summaries) == count else f", the newest {len(summaries)} are listed (--last)"
    stdout.print(f"{count} journals in {escape(str(place))}, {total_bytes / 1e6:.1f} MB{shown}")


def _in_words(each: JournalSummary) -> str:
    if each.method is None:
        return f"{each.state}: {each.problem}"
    begun = "not begun" if each.begun is None else f"{each.begun[:16].replace('T', ' ')} UTC"
    end = each.answer or each.state
    # Where nothing was detected, the angle is that of the noise; the paper's form has one then too.
    if each.angle_deg is not None and each.answer != "not found":
        end = f"{each.angle_deg:.3f}°" if each.as_published else f"{end} at {each.angle_deg:.3f}°"
    form = " as published" if each.as_published else ""
    emulated = f" with emulated {' and '.join(each.emulated)}" if each.emulated else ""
    text = f"{begun}, {each.method}{form} on a {each.rig} rig{emulated}: {end}, {each.acquisitions} acquisitions"
    return f"{text}, {each.size_bytes / 1e6:.1f} MB" + ("" if each.problem is None else f"; {each.problem}")
