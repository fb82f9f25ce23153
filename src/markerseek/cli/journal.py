"""``markerseek journal``: lists, prints, follows and checks the journals of runs, and computes their answers again."""

from __future__ import annotations

import sys
import time
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape

from markerseek import runs
from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, facts
from markerseek.cli.terminal import (
    announce_compilation,
    local_time,
    new_table,
    one_line,
    print_error,
    print_json,
    stdout,
)
from markerseek.core import Finished, Turning, counted, rig_in_words

if TYPE_CHECKING:
    from markerseek.records.journal import JournalEntry, RecordedRun


_POLL_S = 0.02
"""Time between two looks for a new entry, in seconds."""

_File = Annotated[Path, typer.Argument(help="Journal of a run.")]


def list_journals(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of journals.", show_default="that of runs that named no journal")
    ] = None,
    last: Annotated[int, typer.Option(min=1, help="Number of the newest journals to list.")] = 20,
    as_json: AsJson = False,
) -> None:
    """List the journals of a folder, the newest first, with local time, method, result, size, tissue and seed.

    Journals are never deleted: each is a file, and rm deletes it.

    Examples
    --------
    markerseek journal list /data/runs --last 100 --json
    """
    from markerseek.records.journal import journals_folder, journals_in, size_bytes_of

    place = folder or journals_folder()
    # Before the first search there is no such folder.
    paths = journals_in(place) if folder is not None or place.exists() else []
    total_bytes = sum(map(size_bytes_of, paths))
    summaries = [runs.journal_summary(path) for path in paths[: -last - 1 : -1]]
    lines = []
    for each in summaries:
        lines.append(f"[bold]{one_line(Path(each.path).name)}[/]\n  {one_line(_in_words(each))}")
        if each.description is not None:
            lines.append(f"  [dim]{one_line(each.description)}[/]")
    listed = "" if len(summaries) == len(paths) else f", the newest {len(summaries)} are listed (--last)"
    lines.append(f"{counted(len(paths), 'journal')} in {escape(str(place))}, {total_bytes / 1e6:.1f} MB{listed}")
    values = {"folder": str(place), "count": len(paths), "total_bytes": total_bytes, "journals": summaries}
    Output(as_json=as_json).show(Report(values=values, shown=lines))


def show(journal: _File, as_json: AsJson = False) -> None:
    """Print all entries; of a damaged journal those before the damage, then the error.

    Examples
    --------
    markerseek journal show run.journal
    """
    from markerseek.records.journal import RunView, salvage

    objects: list[dict[str, object]] = []
    # Converted one by one, so that the frames (half a megabyte each) are not all in memory.
    on_entry = (lambda entry: objects.append(_as_object(entry))) if as_json else None
    recorded, damage = salvage(journal, frames=False, on_entry=on_entry)
    if as_json:
        print_json(
            {
                "configuration": recorded.configuration,
                "state": RunView.of(recorded).state,
                "entries": objects,
                "damage": None if damage is None else str(damage),
            }
        )
    else:
        _print_table(recorded)
    if damage is not None:
        # The JSON object above has the damage already.
        print_error(damage, as_json=False)
        raise typer.Exit(damage.exit_code)


def follow(journal: _File) -> None:
    """Print each entry as a JSON line as soon as it is written, to the end of the run; the first has its configuration.

    A search never waits for this command, and no entry is lost, however slowly the lines are read.

    Examples
    --------
    markerseek journal follow run.journal | jq 'select(.kind == "measured").body.sample'
    """
    from markerseek.records.journal import Configuration, follow_journal

    wait = partial(time.sleep, _POLL_S)  # noqa: TID251  a file is followed in real time
    for item in follow_journal(journal, wait=wait):
        known = {"configuration": item} if isinstance(item, Configuration) else _as_object(item)
        sys.stdout.buffer.write(msgspec.json.encode(known).replace(b"\n", b" ") + b"\n")
        sys.stdout.buffer.flush()


def verify(journal: _File, as_json: AsJson = False) -> None:
    """Check that all entries can be read and agree with their checksums; exit code 1 if anything is wrong.

    Examples
    --------
    markerseek journal verify run.journal
    """
    from markerseek.records.journal import salvage

    recorded, damage = salvage(journal, frames=False)
    faults = [] if damage is None else [str(damage)]
    entries = len(recorded.entries)
    unfinished_bytes = recorded.unfinished_bytes
    values = {"ok": not faults, "entries": entries, "faults": faults, "unfinished_bytes": unfinished_bytes}
    # Nothing acted on an unfinished entry, so it is no fault.
    unfinished = f"; an unfinished entry of {counted(unfinished_bytes, 'byte')} behind them is ignored"
    whole = (
        f"{counted(entries, 'entry is', 'entries are')} whole"
        + ("" if faults else ", and nothing is wrong")
        + (unfinished if unfinished_bytes else "")
    )
    shown = [*(f"[red]wrong:[/] {one_line(fault)}" for fault in faults), whole]
    Output(as_json=as_json).show(Report(values=values, shown=shown, exit_code=1 if faults else 0))


def replay(journal: _File, as_json: AsJson = False) -> None:
    """Compute the answer again, from the samples and from the frames, and print both beside the recorded one.

    Examples
    --------
    markerseek journal replay run.journal
    """
    from markerseek.records.journal import RunView, read_journal
    from markerseek.show import estimate_line, flat_answer

    recorded = read_journal(journal)
    announce_compilation()
    last = [entry.event.estimate for entry in recorded.entries if isinstance(entry.event, Finished)]
    estimates = {
        "recorded": last[-1] if last else None,
        "from the samples": runs.answer_again(recorded, read_frames=False),
        "from the frames": runs.answer_again(recorded, read_frames=True) if recorded.configuration.frames else None,
    }
    values = {name.replace(" ", "_"): None if each is None else flat_answer(each) for name, each in estimates.items()}
    missing = dict.fromkeys(estimates, "none: the run is not over")
    if not recorded.configuration.frames:
        missing["from the frames"] = "none: they were not kept"
    rows = ((name, missing[name] if each is None else estimate_line(each)) for name, each in estimates.items())
    state = RunView.of(recorded).state
    Output(as_json=as_json).show(Report(values={"state": state} | values, shown=[facts(rows)]))


def _as_object(entry: JournalEntry) -> dict[str, object]:
    from markerseek.records.journal import encode_entry

    line, _ = encode_entry(entry)
    return {name: getattr(line, name) for name in ("number", "kind", "written", "clock_s", "body")}


def _print_table(recorded: RecordedRun) -> None:
    from markerseek.records.journal import RunView
    from markerseek.show import event_line

    plan = recorded.configuration.plan
    facts = recorded.configuration.facts
    form = " as published" if plan.as_published else ""
    stdout.print(f"[bold]{one_line(plan.method)}{form}[/] on a {facts.rig_name}: {one_line(facts.description)}")
    versions = ", ".join(f"{name} {version}" for name, version in recorded.configuration.versions.items())
    seed = "" if facts.seed is None else f"seed {facts.seed}, "
    stdout.print(f"[dim]{seed}rig {one_line(facts.fingerprint)}, {one_line(versions)}[/]")
    if not recorded.configuration.frames:
        stdout.print("[dim]samples only: its frames were not kept[/]")
    table = new_table("", "clock [s]", "event", left=("event",))
    view = RunView.of(recorded.configuration)
    for entry, after in zip_longest(recorded.entries, recorded.entries[1:]):
        view = view.add_entry(entry)
        # A hand's angle is reported five times a second: the last before something else happens is enough to look at.
        if after is not None and isinstance(entry.event, Turning) and isinstance(after.event, Turning):
            continue
        table.add_row(str(entry.number), f"{entry.clock_s:.2f}", one_line(event_line(view)))
    stdout.print(table)
    stdout.print(f"state: {view.state}" + ("" if view.fault is None else f": {one_line(view.fault)}"))


def _in_words(each: runs.JournalSummary) -> str:
    if each.method is None or each.acquisitions is None:
        return f"{each.state}: {each.problem}"
    begun = "not begun" if each.begun is None else local_time(each.begun)
    form = " as published" if each.as_published else ""
    rig = rig_in_words(str(each.rig), each.emulated)
    text = f"{begun}, {each.method}{form} on a {rig}: {each.end}, {counted(each.acquisitions, 'acquisition')}"
    return f"{text}, {each.size_bytes / 1e6:.1f} MB" + ("" if each.problem is None else f"; {each.problem}")
