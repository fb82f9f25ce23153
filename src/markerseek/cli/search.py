"""``markerseek search``: searches for the marker on a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from msgspec.structs import replace
from rich.markup import escape
from rich.table import Table

from markerseek import rigs, runs
from markerseek.cli.open_rig import announce_sweeps, arm_rig, open_rig
from markerseek.cli.options import Arm, AsJson, Out, RigFile, Single, Trace, single_source, with_values
from markerseek.cli.report import Output, Report, drawn, table
from markerseek.cli.signals import WatchOptions
from markerseek.cli.terminal import announce_compilation
from markerseek.core import ConfigError, SearchPlan, SimulationOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.show import SearchResult


@with_values
def command(
    *,
    plan: SearchPlan,
    single: Single = False,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Result (JSON) or journal of a former search on this rig: fewer acquisitions for a like marker."
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="METHOD,METHOD",
            help="Search the same simulated world with each of these methods; one table, and no journals.",
        ),
    ] = None,
    rig: RigFile = None,
    arm: Arm = False,
    trace: Trace = None,
    simulation: SimulationOptions,
    journal: Annotated[
        Path | None,
        typer.Option(help="Journal of the run, a new file; without it, one in the user's data folder."),
    ] = None,
    no_journal: Annotated[
        bool, typer.Option("--no-journal", help="Keep no journal; the search cannot be resumed.")
    ] = False,
    plot: Annotated[
        bool, typer.Option("--plot", help="Write search.png and search.html into --out; of --compare compare.png.")
    ] = False,
    out: Out = None,
    watch: WatchOptions,
    asked_by: Annotated[str | None, typer.Option(hidden=True, help="Who asked a bridge for this search.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the marker on a rig: rotate, fire, measure, decide; then rotate to it and confirm.

    In a result, ± is one standard deviation.

    Examples
    --------
    markerseek search --seed 1 --plot
    markerseek search --sweep --single --readout-s 0.05
    markerseek search --marker-deg 10 --second-marker-deg -12 --snr-db 30
    markerseek search --compare posterior,golden-section,ternary --plot
    markerseek search --method my_method:MyMethod
    markerseek search --rig examples/rigs/bench.toml --arm
    """
    from markerseek.cli.searching import conclude, require_journal_options, run_anew

    # The folder for pictures is tested now: a search on tissue is not repeated for a picture.
    output = Output.asked(as_json=as_json, plot=plot, out=out)
    plan = replace(single_source(plan, single=single), prior=None if prior is None else runs.former_curve(prior))
    runs.require_possible(plan)
    if compare is not None:
        if plan.sweep:
            raise ConfigError("--compare names methods that stop for each acquisition; leave --sweep out")
        if journal is not None or plan.method != "posterior":
            raise ConfigError("--compare names the methods and keeps no journals; leave --method and --journal out")
        if watch != WatchOptions():
            raise ConfigError("--compare writes no --events and listens to no --heartbeat; leave them out")
        _compare(compare, rig, simulation, plan, output)
    require_journal_options(journal, keep=not no_journal, watch=watch)
    with open_rig(rig, simulation, sweeps=plan.sweep, trace=trace) as (assembled, start_deg):
        run = runs.new_run(assembled, runs.plan_on(assembled, plan))
        if plan.sweep:
            announce_sweeps(assembled, run.policy, start_deg=start_deg, stay=run.configuration.plan.stay)
        announce_compilation()
        arm_rig(assembled, file=rig, arm=arm, what="search", as_json=as_json, asked_by=asked_by)
        run = run_anew(run, as_json=as_json, journal=journal, keep=not no_journal, rig_file=rig, watch=watch)
    conclude(
        run.view,
        output,
        name="search",
        imaging=assembled.imaging,
    )


def _compare(
    methods: str,
    rig: Path | None,
    simulation: SimulationOptions,
    plan: SearchPlan,
    output: Output,
) -> NoReturn:
    """Search the same simulated world with each method, and print one table; ends with exit code 0 if all found it.

    ``methods``: names of the methods, with commas between them.
    """
    from markerseek.cli.searching import FOUND, OTHER_ANSWER, run_to_end
    from markerseek.show import flat_result

    names = [name.strip() for name in methods.split(",")]
    for name in names:
        runs.require_possible(SearchPlan(method=name))
    if len(names) < 2 or len(set(names)) < len(names):
        raise ConfigError(f"--compare is {methods!r}, two or more different methods are needed: ternary,posterior")
    # Not once its devices are open.
    rigs.read_simulated(rig, cure="--compare is for a simulated rig; leave it out")
    announce_compilation()
    made = []
    for name in names:
        chosen = replace(plan, method=name)
        if name != "posterior":
            # Only the posterior has these settings.
            chosen = replace(chosen, others=None, prior=None, near=None)
        # A new rig of the same seed, so that every method begins in the same world.
        with open_rig(rig, simulation) as (assembled, _):
            run = runs.new_run(assembled, runs.plan_on(assembled, chosen))
            run_to_end(run, as_json=output.as_json)
        made.append(run)
    results = [run.result() for run in made]
    title = f"{', '.join(names)} on a simulated rig: {made[0].configuration.facts.description}"
    report = Report(
        values=[flat_result(result) for result in results],
        shown=_compared(results, title),
        pictures={"compare.png": drawn(_figure, made, title)},
        exit_code=FOUND if all(result.found for result in results) else OTHER_ANSWER,
    )
    output.show(report)


def _compared(results: list[SearchResult], title: str) -> Iterator[str | Table]:
    yield escape(title)
    rows = (
        {
            "method": result.method,
            "answer": result.answer,
            "angle": f"{result.angle_deg:.3f}°",
            "±": "–" if result.sigma_deg is None else f"{result.sigma_deg:.3f}°",
            "error": "–" if result.error_deg is None else f"{result.error_deg:.3f}°",
            "acquisitions": str(result.acquisitions),
            "rotation": f"{result.travel_deg:.1f}°",
        }
        for result in results
    )
    yield table(rows, left=("method", "answer"), no_wrap=True)
    if not all(result.found for result in results):
        yield "[dim]only an answer of 'found' claims a marker at its angle[/]"


def _figure(made: list[runs.Run], title: str) -> Figure:
    from markerseek.show import comparison_figure, drawn_curve

    curves = [(run.configuration.plan.method, drawn_curve(run.view, reveal=True)) for run in made]
    return comparison_figure(curves, title=title)
