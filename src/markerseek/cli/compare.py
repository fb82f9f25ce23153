"""``markerseek search --compare METHOD,METHOD``: searches one simulated rig with several methods."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer
from rich.markup import escape

from markerseek import runs
from markerseek.cli.open_rig import SimulationOptions, open_rig
from markerseek.cli.session import run_session
from markerseek.cli.show_result import FOUND, OTHER_ANSWER, Output
from markerseek.cli.terminal import announce_compilation, new_table, print_json, save_picture, stdout
from markerseek.core import ConfigError, SearchPlan, Tolerance
from markerseek.search import method_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.records import SearchResult


def compare(
    methods: str,
    rig: Path | None,
    options: SimulationOptions,
    output: Output,
    *,
    acquisitions: int | None,
    as_published: bool,
    stay: bool,
    tolerance: Tolerance,
) -> NoReturn:
    """Search the same simulated world with each method, and print one table; ends with exit code 0 if all found it.

    ``methods``: names of the methods, with commas between them.
    """
    names = [name.strip() for name in methods.split(",")]
    for name in names:
        method_named(name)
    if len(names) < 2 or len(set(names)) < len(names):
        raise ConfigError(f"--compare is {methods!r}, two or more different methods are needed: ternary,posterior")
    announce_compilation()
    sessions = []
    for name in names:
        # A new rig of the same seed, so that every method begins in the same world.
        with open_rig(rig, options) as (assembled, start_deg):
            if not assembled.simulated:
                raise ConfigError(f"--compare is for a simulated rig, and {rig} is one of devices; leave it out")
            plan = runs.plan_on(
                assembled,
                SearchPlan(
                    method=name,
                    acquisitions=acquisitions,
                    as_published=as_published,
                    start_deg=start_deg,
                    stay=stay,
                    tolerance=tolerance,
                ),
            )
            session = runs.new_session(assembled, plan)
            run_session(session, as_json=output.as_json)
        sessions.append(session)
    results = [session.result() for session in sessions]
    title = f"{', '.join(names)} on a simulated rig: {sessions[0].configuration.facts.description}"
    if output.as_json:
        print_json(results)
    else:
        _print_table(results, title)
    if output.plot:
        save_picture(_figure(sessions, title), output.folder / f"{output.name}.png", as_json=output.as_json)
    raise typer.Exit(FOUND if all(result.found for result in results) else OTHER_ANSWER)


def _print_table(results: list[SearchResult], title: str) -> None:
    stdout.print(escape(title))
    headings = ("method", "answer", "angle", "±", "error", "acquisitions", "rotation")
    table = new_table(*headings, left=("method", "answer"), no_wrap=True)
    for result in results:
        table.add_row(
            escape(result.method),
            result.answer,
            f"{result.angle_deg:.3f}°",
            "–" if result.sigma_deg is None else f"{result.sigma_deg:.3f}°",
            "–" if result.error_deg is None else f"{result.error_deg:.3f}°",
            str(result.acquisitions),
            f"{result.travel_deg:.1f}°",
        )
    stdout.print(table)
    if not all(result.found for result in results):
        stdout.print("[dim]only an answer of 'found' claims a marker at its angle[/]")


def _figure(sessions: list[runs.Session], title: str) -> Figure:
    from markerseek.pictures import ComparedSearch, comparison_figure

    facts = sessions[0].configuration.facts
    searches = [
        ComparedSearch(
            name=session.configuration.plan.method,
            samples=session.recorder.samples,
            estimate=session.recorder.finished.estimate,
            start_deg=session.recorder.start_deg,
        )
        for session in sessions
        if session.recorder.finished is not None
    ]
    return comparison_figure(searches, title=title, limits=facts.search, truth_deg=facts.truth_deg)
