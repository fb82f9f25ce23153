"""``markerseek benchmark``: our methods and entries from elsewhere in the same frozen worlds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from markerseek import studies
from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, file_line, table
from markerseek.cli.terminal import announce_compilation, one_line, stages_bar, stderr
from markerseek.core import counted

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek benchmark\n\n"
    "  markerseek benchmark --scale 0.1 --entry examples/benchmark_entry.py:Steps\n\n"
    '  markerseek benchmark --entry "octave-cli --quiet my_entry.m" --json'
)


def command(
    entry: Annotated[
        list[str] | None,
        typer.Option(
            help="Your search method: FILE.py:Class, or the command of a program that reads and writes lines of JSON; "
            "may be repeated."
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed of the worlds, to repeat a benchmark; without it entries meet a new one, drawn for them.",
        ),
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Searches over the usual number, which takes a quarter of an hour on two cores.")
    ] = 1.0,
    out: Annotated[Path, typer.Option(help="Folder for its files; what is there already is not computed again.")] = (
        Path("out") / "benchmark"
    ),
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes of this machine; by default as many as it has cores.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run the benchmark of searches in simulated worlds, or the rest of it, and print its table."""
    entries = list(dict.fromkeys(studies.Entry.named(text) for text in entry or []))
    size = studies.benchmark_size(scale=scale, entries=len(entries))
    count = studies.default_workers() if workers is None else workers
    stderr.print(f"{size} simulated searches in {counted(count, 'process', 'processes')}")
    announce_compilation()
    with stages_bar() as progress:
        results = studies.run_benchmark(
            out,
            entries=entries,
            seed=seed,
            scale=scale,
            workers=workers,
            progress=progress,
        )
    failed = [each for each in results.entries if each.failure]
    report = Report(
        values=results,
        shown=_shown(results, out),
        notes=tuple(escape(one_line(f"failed entry: {each.method}: in {each.failure}")) for each in failed),
        least_width=110,
        exit_code=1 if failed else 0,
    )
    Output(as_json=as_json).show(report)


def _shown(results: studies.BenchmarkResults, out: Path) -> Iterator[str | Table]:
    for tier, searches in results.searches.items():
        yield f"[bold]{tier}[/]: {searches} simulated searches of each method in each world"
        scores = [score for score in (*results.scores, *results.totals) if score.tier == tier]
        yield table(_lines(scores), left=("world", "method"), gap=1)
        yield ""
    if results.entries:
        yield f"[dim]seed: {results.seed}[/]"
    yield "[dim]all: over all worlds of the tier[/]"
    yield "[dim]right: found within the tolerance; without a marker: not found[/]"
    yield "[dim]N, time: acquisitions and simulated seconds of searches for a marker, over those that found it so[/]"
    yield "[dim]error: of the angles found; covered: share of the 95 % intervals that hold the true angle[/]"
    yield "[dim]false: found where nothing is, or off by more than two tolerances; missed: answered not found[/]"
    yield file_line("results", out / "results.json")


def _lines(scores: list[studies.Score]) -> Iterator[dict[str, str]]:
    for score in scores:
        yield {
            "world": score.world,
            "method": score.method + (f" ({score.failed} failed)" if score.failed else ""),
            "right": _percent(score.right),
            "N": _number(score.acquisitions, ".1f"),
            "time": _number(score.seconds, ".1f", " s"),
            "error": _number(score.error_deg.mean, ".2f", "°"),
            "covered": _percent(score.covered),
            "false": _percent(score.false_found),
            "missed": _percent(score.missed),
            "travel": _number(score.travel_deg.mean, ".0f", "°"),
        }


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "–" if value is None else f"{value:{form}}{unit}"


def _percent(share: studies.Share) -> str:
    return "–" if share.share is None else f"{100 * share.share:.0f} %"
