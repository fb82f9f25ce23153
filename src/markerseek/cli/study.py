"""``markerseek study``: runs many simulated searches and summarises them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from markerseek import studies
from markerseek.cli import STOPPED_BY_USER
from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, facts, file_line, require_room, table
from markerseek.cli.signals import Stopped
from markerseek.cli.terminal import print_json, stages_bar, stderr
from markerseek.core import ConfigError, counted

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek study examples/studies/quick.toml\n\n"
    "  markerseek study examples/studies/quick.toml --row 17 --json\n\n"
    "  markerseek study STUDY.toml --workers 4 --out results"
)


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
    beside: Annotated[
        list[Path] | None, typer.Option(help="File of another finished study, to draw its lines into the same picture.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a study, or continue one that was interrupted, and print its summary."""
    # Before hours of searching, not after them.
    settings = studies.read_study(study)
    if row is not None:
        _require_alone(out=out, workers=workers, plot=plot, beside=beside)
        named = dict(zip(studies.columns(settings), studies.values_of(studies.run_row(settings, row)), strict=True))
        shown = facts((name, "–" if value is None else str(value)) for name, value in named.items())
        Output(as_json=as_json).show(Report(values=named, shown=[shown]))
    folder = out or Path("out") / study.stem
    _require_drawable(folder, beside or [], plot=plot)
    _announce(settings, workers=workers)
    try:
        with stages_bar() as advance:
            finish = studies.run_study(
                settings,
                folder,
                workers=workers,
                progress=lambda done: advance("searches", done, settings.rows),
            )
    except KeyboardInterrupt:
        _end_stopped(folder, as_json=as_json)
    finished = [(settings, finish.summary), *(_finished(path) for path in beside or [])]
    faults = _faults(settings, finish)
    report = Report(
        values={**msgspec.to_builtins(finish.summary), "faults": faults} if faults else finish.summary,
        shown=_shown(finish),
        pictures=_pictures(finished) if plot else {},
        notes=tuple(escape(f"error: {label}: {fault}") for label, fault in faults.items()),
        least_width=80,
        exit_code=1 if any(each.answers["failed"].hits == each.trials for each in finish.summary.policies) else 0,
    )
    Output(as_json=as_json, folder=folder if plot else None).show(report)


def _announce(study: studies.Study, *, workers: int | None) -> None:
    """Say what will be done, before anything is computed."""
    count = studies.default_workers() if workers is None else workers
    stderr.print(
        f"{escape(study.name)}: {counted(study.rows, 'simulated search', 'simulated searches')}, level {study.level} "
        f"({counted(len(study.policies), 'policy', 'policies')}, {counted(len(studies.cells(study)), 'cell')}, "
        f"{counted(study.trials, 'trial')}) in {counted(count, 'process', 'processes')}"
    )


def _faults(study: studies.Study, finish: studies.FinishedStudy) -> dict[str, str]:
    """How many searches of a policy failed, and why the first one did, by its label."""
    count, faults = study.rows // len(study.policies), {}
    for number, policy in enumerate(study.policies):
        failed = sum(each.answers["failed"].hits for each in finish.summary.policies if each.policy == number)
        if failed:
            rows = studies.read_rows(finish.rows, study)
            first = next(row for row in rows if row.policy == number and row.answer == "failed")
            many = "all" if failed == count else f"{failed} of {count}"
            faults[str(policy)] = f"{many} searches failed, the first one (row {first.row}) by: {first.fault}"
    return faults


def _end_stopped(folder: Path, *, as_json: bool) -> NoReturn:
    """Print how to continue, and end the command as after Ctrl-C."""
    message = f"stopped by the user; finished rows are in {folder}, and the same command continues the study"
    stderr.print(message)
    if as_json:
        print_json({"error": message, "kind": "Stopped"})
    raise Stopped(STOPPED_BY_USER) from None


def _require_drawable(folder: Path, beside: list[Path], *, plot: bool) -> None:
    """Refuse studies beside without a picture, files that cannot be read, and a folder that takes no picture."""
    if beside and not plot:
        raise ConfigError("--beside adds lines to a picture; add --plot, or leave it out")
    for path in beside:
        studies.read_study(path)
    if plot:
        require_room(folder)


def _require_alone(**given: object) -> None:
    """Refuse options that have no meaning for a single row."""
    for name, value in given.items():
        if value:
            given_as = "" if isinstance(value, bool | list) else f" {value}"
            raise ConfigError(f"--{name}{given_as}: --row runs one row and writes nothing; leave one of them out")


def _finished(path: Path) -> tuple[studies.Study, studies.Summary]:
    """A study and its summary, read from its usual folder, or run there."""
    study = studies.read_study(path)
    return study, studies.run_study(study, Path("out") / path.stem).summary


def _pictures(finished: list[tuple[studies.Study, studies.Summary]]) -> dict[str, Callable[[Path], object]]:
    """The picture in both forms."""
    from markerseek.pictures import save_figure

    figure = studies.error_figure(finished)
    return {name: partial(save_figure, figure) for name in ("error.png", "error.svg")}


def _shown(finish: studies.FinishedStudy) -> Iterator[str | Table]:
    yield from _summary(finish.summary)
    yield file_line("rows", finish.rows)
    yield file_line("summary", finish.rows.with_name("summary.json"))


def _summary(summary: studies.Summary) -> Iterator[str | Table]:
    """The policies by number, tables for each cell, and one of the differences."""
    searches = counted(summary.rows, "simulated search", "simulated searches")
    yield f"[bold]{escape(summary.name)}[/]: {searches}, level: {summary.level}"
    first = [policy for policy in summary.policies if policy.cell == summary.policies[0].cell]
    for policy in first:
        yield f"  [bold]{policy.policy}[/]  {escape(policy.label)}"
    for cell in sorted({policy.cell for policy in summary.policies}):
        here = [policy for policy in summary.policies if policy.cell == cell]
        settings = ", ".join(f"{key} = {value}" for key, value in here[0].settings.items())
        yield f"\ncell {cell}{escape(': ' + settings if settings else '')}"
        yield _table(
            {
                "": _number(policy),
                "found": _share(policy.answers["found"], interval=False),
                "error of these": _mean(policy.error_deg),
                "covered": _share(policy.covered, interval=False),
                "> 2 tol.": _rare(policy.wrong_claims),
                "N": _plain(policy.acquisitions, ""),
                "rotation": _plain(policy.travel_deg, "°"),
                "time": _plain(policy.elapsed_s, " s"),
            }
            for policy in here
        )
        yield _whatever_the_answer(here, failure_deg=summary.failure_deg)
        if any(policy.two_sources is not None for policy in here):
            yield _two_sources(here)
    if summary.differences:
        yield "\nerror of one policy minus that of another, over the same trials, where both found"
        yield _table(
            {
                "cell": str(pair.cell),
                "policies": f"{pair.policy} - {pair.other}",
                "trials": str(pair.error_deg.count),
                "mean difference": _mean(pair.error_deg, least=-math.inf),
            }
            for pair in summary.differences
        )
    yield ""
    for line in _legend(summary):
        yield f"[dim]{escape(line)}[/]"


def _legend(summary: studies.Summary) -> list[str]:
    """What the columns are."""
    far = f"{summary.failure_deg:g}°"
    lines = [
        "found: share of the searches that answer found, and the mean error of these",
        "covered: share of the 95 % intervals that hold the true angle",
        "> 2 tol.: found, and off by more than twice the tolerance at the marker",
        "N, rotation, time: of one search on average; time is on the simulated clock",
        "[low, high]: 95 % interval; ≤: the upper end of one",
    ]
    if any(policy.missed.count for policy in summary.policies):
        lines += [
            "error of all: of the angle in every search with a marker, whatever the answer",
            "no claim: any answer but found; missed: the answer not found",
            f"> {far}: off by more, so that a tool tip is not in the image: of all, and of those found",
        ]
    return lines


def _whatever_the_answer(policies: Sequence[studies.PolicySummary], *, failure_deg: float) -> Table:
    """Shares of all searches, also of those without an answer; without a marker, the share that found one."""
    if all(policy.missed.count == 0 for policy in policies):
        return _table({"": _number(each), "found where nothing is": _rare(each.false_found)} for each in policies)
    return _table(
        {
            "": _number(each),
            "error of all": _mean(each.any_error_deg),
            f"> {failure_deg:g}°": _rare(each.off),
            "found": _rare(each.failures),
            "no claim": _rare(each.not_found),
            "missed": _rare(each.missed),
        }
        for each in policies
    )


def _two_sources(policies: Sequence[studies.PolicySummary]) -> Table:
    """Answers where there is a second source."""
    return _table(
        {
            "": _number(each),
            "stronger or ambiguous": _share(two.stronger, interval=True),
            "weaker found": _rare(two.weaker),
            "found between": _rare(two.between),
            "other source named": _share(two.named, interval=True),
        }
        for each in policies
        if (two := each.two_sources) is not None
    )


def _table(rows: Iterable[Mapping[str, str | Text]]) -> Table:
    return table(rows, no_wrap=True, gap=1)


def _number(each: studies.PolicySummary) -> Text:
    return Text(str(each.policy), style="bold")


def _mean(mean: studies.Mean, *, least: float = 0.0) -> str:
    """A mean with its interval, clipped at the least possible value."""
    if mean.mean is None:
        return "–"
    if mean.interval95 is None:
        return f"{mean.mean:.3g}°"
    low, high = mean.interval95
    # The interval is symmetric; the magnitude of an error is never negative.
    return f"{mean.mean:.3g}° [{max(low, least):.3g}, {high:.3g}]"


def _plain(mean: studies.Mean, unit: str) -> str:
    return "–" if mean.mean is None else f"{mean.mean:.1f}{unit}"


def _share(share: studies.Share, *, interval: bool) -> str:
    if share.share is None or share.interval95 is None:
        return "–"
    low, high = share.interval95
    return f"{100 * share.share:.1f} %" + (f" [{100 * low:.1f}, {100 * high:.1f}]" if interval else "")


def _rare(share: studies.Share) -> str:
    """A share that should be small, with the upper end of its interval only."""
    if share.share is None or share.interval95 is None:
        return "–"
    return f"{_percent(share.share)} % ≤{_percent(share.interval95[1])}"


def _percent(share: float) -> str:
    """Two significant digits, without an exponent."""
    percent = 100 * share
    return f"{percent:.2g}" if percent < 9.95 else f"{percent:.0f}"
