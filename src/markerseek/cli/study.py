"""``markerseek study``: runs many simulated searches and summarises them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import typer

from markerseek import studies
from markerseek.cli import STOPPED_BY_USER
from markerseek.cli.options import AsJson
from markerseek.cli.signals import Stopped
from markerseek.cli.study_table import show_bounds, show_summary
from markerseek.cli.terminal import picture_folder, print_facts, print_json, print_path, progress_bar, stderr
from markerseek.core import ConfigError

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek study examples/studies/quick.toml\n\n"
    "  markerseek study examples/studies/quick.toml --row 17 --json\n\n"
    "  markerseek study STUDY.toml --out results --scheduler tcp://10.0.0.5:8786"
)


def command(
    study: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for its files; by default out/ and the name of the study file.")
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
    plot: Annotated[
        bool,
        typer.Option("--plot", help="Write error.png and error.svg into --out: mean error over the acquisitions."),
    ] = False,
    bound: Annotated[
        int | None,
        typer.Option(min=1, help="Markers to search for again, to compare the errors with the bound of each."),
    ] = None,
    beside: Annotated[
        list[Path] | None, typer.Option(help="File of another finished study, to draw its lines into the same picture.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a study, or continue one that was interrupted, and print its summary."""
    # Before hours of searching, not after them.
    if workers is not None and scheduler is not None:
        raise ConfigError("--workers are of this machine, and --scheduler has its own; leave one of them out")
    settings = studies.read_study(study)
    if row is not None:
        _require_alone(out=out, workers=workers, scheduler=scheduler, plot=plot or None, bound=bound)
        _show_row(settings, row, as_json=as_json)
        return
    folder = out or Path("out") / study.stem
    _require_drawable(folder, beside or [], plot=plot)
    try:
        with progress_bar(settings.rows, what="searching") as progress:
            task = progress.task_ids[0]
            finish = studies.run_study(
                settings,
                folder,
                workers=workers,
                scheduler=scheduler,
                progress=lambda done: progress.update(task, completed=done),
            )
    except KeyboardInterrupt:
        _end_stopped(folder, as_json=as_json)
    bounds = _bounds(settings, markers=bound) if bound is not None else []
    finished = [(settings, finish.summary), *(_finished(path) for path in beside or [])]
    pictures = _draw(folder / "error", finished, markers=bound) if plot else ()
    faults = _faults(settings, finish.summary)
    if as_json:
        more = {name: value for name, value in (("bound", bounds), ("faults", faults)) if value}
        print_json({**msgspec.to_builtins(finish.summary), **more} if more else finish.summary)
    else:
        show_summary(finish.summary)
        if bounds:
            show_bounds(bounds)
        print_path("rows", finish.rows)
        print_path("summary", finish.rows.with_name("summary.json"))
    for path in pictures:
        print_path("picture", path, as_json=as_json)
    for label, fault in faults.items():
        stderr.print(f"error: {label}: all of its searches failed, the first one by: {fault}", markup=False)
    if faults:
        raise typer.Exit(1)


def _faults(study: studies.Study, summary: studies.Summary) -> dict[str, str]:
    """Why a policy whose searches all failed has failed, by its label."""
    worked = {policy.policy for policy in summary.policies if policy.answers["failed"].hits < policy.trials}
    failed = [number for number in range(len(study.policies)) if number not in worked]
    return {str(study.policies[number]): studies.fault_of(study, number) for number in failed}


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
        picture_folder(folder, plot=plot)


def _require_alone(**given: object) -> None:
    """Refuse options that have no meaning for a single row."""
    for name, value in given.items():
        if value is not None:
            option = f"--{name}" if value is True else f"--{name} {value}"
            raise ConfigError(f"{option}: --row runs one row and writes nothing; leave one of them out")


def _show_row(study: studies.Study, row: int, *, as_json: bool) -> None:
    again = studies.run_row(study, row)
    named = dict(zip(studies.columns(study), studies.values_of(again), strict=True))
    if as_json:
        print_json(named)
        return
    print_facts((name, "–" if value is None else str(value)) for name, value in named.items())


def _bounds(study: studies.Study, *, markers: int) -> list[studies.BoundComparison]:
    """Each policy in each cell compared with the bound."""
    return [
        studies.compare_with_bound(study, cell, policy=number, markers=min(markers, study.trials))
        for cell in studies.cells(study)
        for number in range(len(study.policies))
    ]


def _finished(path: Path) -> tuple[studies.Study, studies.Summary]:
    """A study and its summary, read from its usual folder, or run there."""
    study = studies.read_study(path)
    return study, studies.run_study(study, Path("out") / path.stem).summary


def _draw(
    stem: Path, finished: list[tuple[studies.Study, studies.Summary]], *, markers: int | None
) -> tuple[Path, ...]:
    """Write the picture in both forms, and return their paths."""
    from markerseek.pictures import save_png, save_svg

    study = finished[0][0]
    counts = study.marks
    bounds = {}
    if markers is not None and counts:
        for cell in studies.cells(study):
            bounds[cell.index] = (counts, studies.mean_bounds(study, cell, markers=markers, acquisitions=counts))
    png, svg = stem.with_suffix(".png"), stem.with_suffix(".svg")
    figure = studies.error_figure(finished, bounds=bounds)
    save_png(figure, png)
    save_svg(figure, svg)
    return png, svg
