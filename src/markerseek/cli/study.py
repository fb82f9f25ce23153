"""``markerseek study``: many searches, one table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from markerseek.studies import Study, Summary
    from markerseek.studies.statistics import Mean, Share

NAME = "study"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek study examples/studies/quick.toml\n\n"
    "  markerseek study examples/studies/quick.toml --row 17 --json\n\n"
    "  markerseek study STUDY.toml --out results --scheduler tcp://10.0.0.5:8786"
)


def command(
    study: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of its files; by default out/ and the name of the study file.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes of this machine; by default as many as it has cores.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run on its workers instead.")
    ] = None,
    row: Annotated[
        int | None, typer.Option(help="Run this one row of the table again, and print it; nothing is written.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Run a study, or continue it where it was killed; then say what its table says."""
    from markerseek.cli.terminal import aside, people, print_json, progress_bar
    from markerseek.studies import read_study, run_study

    settings = read_study(study)
    if row is not None:
        _show_row(settings, row, as_json=as_json)
        return
    folder = out or Path("out") / study.stem
    try:
        with progress_bar(settings.rows, what="searching") as progress:
            task = progress.task_ids[0]
            finish = run_study(
                settings,
                folder,
                workers=workers,
                scheduler=scheduler,
                progress=lambda done: progress.update(task, completed=done),
            )
    except KeyboardInterrupt:
        aside.print(f"interrupted; what is finished lies in {folder}, and the same command continues it")
        raise typer.Exit(1) from None
    if as_json:
        print_json(finish.summary)
        return
    _show(finish.summary)
    people.print(f"[dim]rows:[/] {finish.rows}   [dim]summary:[/] {finish.rows.with_name('summary.json')}")


def _show_row(study: Study, row: int, *, as_json: bool) -> None:
    from rich.table import Table

    from markerseek.cli.terminal import people, print_json
    from markerseek.studies import run_row
    from markerseek.studies.table import columns, values_of

    again = run_row(study, row)
    named = dict(zip(columns(study), values_of(again), strict=True))
    if as_json:
        print_json(named)
        return
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in named.items():
        table.add_row(f"[dim]{name}[/]", "–" if value is None else str(value))
    people.print(table)


def _show(summary: Summary) -> None:
    """The policies by number, a table for each cell, and one of the differences."""
    from rich.markup import escape

    from markerseek.cli.terminal import people

    people.print(f"[bold]{escape(summary.name)}[/]: {summary.rows} simulated searches, level: {summary.level}")
    first = [policy for policy in summary.policies if policy.cell == summary.policies[0].cell]
    for policy in first:
        people.print(f"  [bold]{policy.policy}[/]  {escape(policy.label)}")
    for cell in sorted({policy.cell for policy in summary.policies}):
        here = [policy for policy in summary.policies if policy.cell == cell]
        settings = ", ".join(f"{key} = {value}" for key, value in here[0].settings.items())
        people.print(f"\ncell {cell}{escape(': ' + settings if settings else '')}")
        table = _table("", "found", "mean error of these", f"> {summary.failure_deg:g}°", "N", "rotation", "time")
        for policy in here:
            table.add_row(
                f"[bold]{policy.policy}[/]",
                _share(policy.answers["found"], interval=False),
                _mean(policy.error_deg),
                _share(policy.failures, interval=True),
                _plain(policy.acquisitions, ""),
                _plain(policy.travel_deg, "°"),
                _plain(policy.elapsed_s, " s"),
            )
        people.print(table)
    if summary.differences:
        people.print("\nerror of one less that of another, where both found, same trials")
        table = _table("cell", "policies", "trials", "mean difference")
        for pair in summary.differences:
            table.add_row(
                str(pair.cell), f"{pair.policy} - {pair.other}", str(pair.error_deg.count), _mean(pair.error_deg)
            )
        people.print(table)


def _table(*names: str) -> Table:
    from rich.table import Table

    table = Table(box=None, padding=(0, 1, 0, 0))
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _mean(mean: Mean) -> str:
    if mean.mean is None:
        return "–"
    if mean.interval95 is None:
        return f"{mean.mean:.3g}°"
    return f"{mean.mean:.3g}° [{mean.interval95[0]:.3g}, {mean.interval95[1]:.3g}]"


def _plain(mean: Mean, unit: str) -> str:
    return "–" if mean.mean is None else f"{mean.mean:.1f}{unit}"


def _share(share: Share, *, interval: bool) -> str:
    if share.share is None or share.interval95 is None:
        return "–"
    low, high = share.interval95
    return f"{100 * share.share:.1f} %" + (f" [{100 * low:.1f}, {100 * high:.1f}]" if interval else "")
