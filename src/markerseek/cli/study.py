"""``markerseek study``: runs many simulated searches and summarises them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from markerseek import studies
from markerseek.cli import STOPPED_BY_USER
from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, facts, file_line, make_picture_folder, table
from markerseek.cli.signals import Stopped
from markerseek.cli.terminal import print_json, stages_bar, stderr
from markerseek.core import ConfigError, counted


def command(
    study: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for its files; by default out/ and the name of the study file.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes of this machine; by default as many as it has cores.")
    ] = None,
    row: Annotated[
        int | None, typer.Option(help="Run this one row of the table again, and print it; nothing is written.")
    ] = None,
    plot: Annotated[
        bool,
        typer.Option("--plot", help="Write error.png and error.svg into --out: mean error over the acquisitions."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run a study, or continue one that was interrupted, and print its summary.

    Examples
    --------
    markerseek study examples/studies/quick.toml
    markerseek study examples/studies/quick.toml --row 17 --json
    markerseek study STUDY.toml --workers 4 --out results
    """
    settings = studies.read_study(study)
    if row is not None:
        for name, value in {"out": out, "workers": workers, "plot": plot}.items():
            if value:
                given = "" if value is True else f" {value}"
                raise ConfigError(f"--{name}{given}: --row runs one row and writes nothing; leave one of them out")
        named = dict(zip(studies.columns(settings), studies.values_of(studies.run_row(settings, row)), strict=True))
        shown = facts((name, "–" if value is None else str(value)) for name, value in named.items())
        Output(as_json=as_json).show(Report(values=named, shown=[shown]))
    folder = out or Path("out") / study.stem
    # Before hours of searching, not after them.
    if plot:
        make_picture_folder(folder)
    processes = counted(studies.default_workers() if workers is None else workers, "process", "processes")
    stderr.print(
        f"{escape(settings.name)}: {_searches(settings.rows)}, level {settings.level} "
        f"({counted(len(settings.policies), 'policy', 'policies')}, {counted(len(studies.cells(settings)), 'cell')}, "
        f"{counted(settings.trials, 'trial')}) in {processes}"
    )
    try:
        with stages_bar() as advance:
            finish = studies.run_study(
                settings,
                folder,
                workers=workers,
                progress=lambda done: advance("searches", done, settings.rows),
            )
    except KeyboardInterrupt:
        message = f"stopped by the user; finished rows are in {folder}, and the same command continues the study"
        stderr.print(message)
        if as_json:
            print_json({"error": message, "kind": "Stopped"})
        raise Stopped(STOPPED_BY_USER) from None
    faults = _faults(settings, finish)
    report = Report(
        values={**msgspec.to_builtins(finish.summary), "faults": faults} if faults else finish.summary,
        shown=_shown(finish),
        pictures=_pictures(settings, finish.summary) if plot else {},
        notes=tuple(escape(f"error: {label}: {fault}") for label, fault in faults.items()),
        least_width=80,
        exit_code=1 if any(each.answers["failed"].hits == each.trials for each in finish.summary.policies) else 0,
    )
    Output(as_json=as_json, folder=folder if plot else None).show(report)


def _faults(study: studies.Study, finish: studies.FinishedStudy) -> dict[str, str]:
    """Return how many searches of a policy failed, and why the first one did, by its label."""
    count = study.rows // len(study.policies)
    faults = {}
    for number, policy in enumerate(study.policies):
        failed = sum(each.answers["failed"].hits for each in finish.summary.policies if each.policy == number)
        if failed:
            rows = studies.read_rows(finish.rows, study)
            first = next(row for row in rows if row.policy == number and row.answer == "failed")
            many = "all" if failed == count else f"{failed} of {count}"
            faults[str(policy)] = f"{many} searches failed, the first one (row {first.row}) by: {first.fault}"
    return faults


def _pictures(study: studies.Study, summary: studies.Summary) -> dict[str, Callable[[Path], object]]:
    """Return the picture in both forms."""
    from markerseek.show import save_figure

    figure = studies.error_figure([(study, summary)])
    return {name: partial(save_figure, figure) for name in ("error.png", "error.svg")}


def _shown(finish: studies.FinishedStudy) -> Iterator[str | Table]:
    """Yield the policies by number, a table of each cell, and one of the differences."""
    summary = finish.summary
    yield f"[bold]{escape(summary.name)}[/]: {_searches(summary.rows)}, level: {summary.level}"
    cells = [list(policies) for _, policies in groupby(summary.policies, key=attrgetter("cell"))]
    for policy in cells[0]:
        yield f"  [bold]{policy.policy}[/]  {escape(policy.label)}"
    for policies in cells:
        settings = ", ".join(f"{key} = {value}" for key, value in policies[0].settings.items())
        yield f"\ncell {policies[0].cell}{escape(': ' + settings if settings else '')}"
        yield _table(_of_markers(each) if each.missed.count else _of_nothing(each) for each in policies)
        if any(policy.two_sources is not None for policy in policies):
            yield _table(_of_two_sources(each) for each in policies)
    if summary.differences:
        yield _heading(summary)
        yield _table(
            {
                "cell": str(pair.cell),
                "policies": f"{pair.policy} - {pair.other}",
                "both found": str(pair.error_deg.count),
                "mean difference": _mean(pair.error_deg),
            }
            for pair in summary.differences
        )
    yield ""
    for line in LEGEND:
        yield f"[dim]{escape(line)}[/]"
    yield file_line("rows", finish.rows)
    yield file_line("summary", finish.rows.with_name("summary.json"))


LEGEND = (
    "found, missed: share of the searches that answer found, or not found",
    "covered: share of the 95 % intervals that hold the true angle",
    "> 2 tol.: found, and off by more than twice the tolerance at the marker",
    "error: mean of the searches that answer found; summary.json has that of all, too",
    "N, rotation, time: of one search on average; time is on the simulated clock",
    "±, [low, high]: 95 % interval; ≤: the upper end of one",
)
"""What the columns are."""


def _heading(summary: studies.Summary) -> str:
    """Return the title of the table of differences: in how many trials both policies found, of how many."""
    counts = sorted({pair.error_deg.count for pair in summary.differences})
    least = counts[0]
    most = counts[-1]
    trials = summary.policies[0].trials
    both = f"{most}" if least == most else f"{least} to {most}"
    return (
        f"\nerror of one policy minus that of another, in the trials of a cell in which both found: {both} of "
        f"{trials}; the others are left out"
    )


def _searches(count: int) -> str:
    return counted(count, "simulated search", "simulated searches")


def _table(rows: Iterable[Mapping[str, str | Text]]) -> Table:
    return table(rows, no_wrap=True, gap=1)


def _of_markers(each: studies.PolicySummary) -> dict[str, str | Text]:
    """Return one policy, searching for markers."""
    return {
        "": Text(str(each.policy), style="bold"),
        "found": _share(each.answers["found"]),
        "missed": _rare(each.missed),
        "covered": _share(each.covered),
        "> 2 tol.": _rare(each.wrong_claims),
        "error": _mean(each.error_deg),
        **_costs(each),
    }


def _of_nothing(each: studies.PolicySummary) -> dict[str, str | Text]:
    """Return one policy, where there is no marker."""
    return {
        "": Text(str(each.policy), style="bold"),
        "found where nothing is": _rare(each.false_found),
        **_costs(each),
    }


def _costs(each: studies.PolicySummary) -> dict[str, str]:
    return {
        "N": _plain(each.acquisitions, ".1f"),
        "rotation": _plain(each.travel_deg, ".0f", "°"),
        "time": _plain(each.elapsed_s, ".1f", " s"),
    }


def _of_two_sources(each: studies.PolicySummary) -> dict[str, str | Text]:
    """Return one policy, where there is a second source; searches that a device ended have none."""
    two = each.two_sources
    if two is None:
        return {"": Text(str(each.policy), style="bold")}
    return {
        "": Text(str(each.policy), style="bold"),
        "stronger or ambiguous": _share(two.stronger, interval=True),
        "weaker found": _rare(two.weaker),
        "found between": _rare(two.between),
        "other source named": _share(two.named, interval=True),
    }


def _mean(mean: studies.Mean) -> str:
    """Return a mean with half of its interval."""
    if mean.mean is None:
        return "–"
    return f"{mean.mean:.3g}°" + ("" if mean.half is None else f" ± {mean.half:.2g}")


def _plain(mean: studies.Mean, form: str, unit: str = "") -> str:
    return "–" if mean.mean is None else f"{mean.mean:{form}}{unit}"


def _share(share: studies.Share, *, interval: bool = False) -> str:
    if share.share is None or share.interval95 is None:
        return "–"
    low, high = share.interval95
    return f"{100 * share.share:.1f} %" + (f" [{100 * low:.1f}, {100 * high:.1f}]" if interval else "")


def _rare(share: studies.Share) -> str:
    """Return a share that should be small, with the upper end of its interval only."""
    if share.share is None or share.interval95 is None:
        return "–"
    return f"{_percent(share.share)} % ≤{_percent(share.interval95[1])}"


def _percent(share: float) -> str:
    """Return two significant digits, without an exponent."""
    percent = 100 * share
    return f"{percent:.2g}" if percent < 9.95 else f"{percent:.0f}"
