"""Prints the summary of a study as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from markerseek import studies
from markerseek.cli.terminal import stdout


def show_summary(summary: studies.Summary) -> None:
    """Print the policies by number, tables for each cell, and one of the differences."""
    stdout.print(f"[bold]{escape(summary.name)}[/]: {summary.rows} simulated searches, level: {summary.level}")
    first = [policy for policy in summary.policies if policy.cell == summary.policies[0].cell]
    for policy in first:
        stdout.print(f"  [bold]{policy.policy}[/]  {escape(policy.label)}")
    for cell in sorted({policy.cell for policy in summary.policies}):
        here = [policy for policy in summary.policies if policy.cell == cell]
        settings = ", ".join(f"{key} = {value}" for key, value in here[0].settings.items())
        stdout.print(f"\ncell {cell}{escape(': ' + settings if settings else '')}")
        table = _table("", "found", "error of these", "covered", "> 2 tol.", "N", "rotation", "time")
        for policy in here:
            table.add_row(
                f"[bold]{policy.policy}[/]",
                _share(policy.answers["found"], interval=False),
                _mean(policy.error_deg),
                _share(policy.covered, interval=False),
                _rare(policy.wrong_claims),
                _plain(policy.acquisitions, ""),
                _plain(policy.travel_deg, "°"),
                _plain(policy.elapsed_s, " s"),
            )
        _show(table)
        _show(_whatever_the_answer(here, failure_deg=summary.failure_deg))
        if any(policy.two_sources is not None for policy in here):
            _show(_two_sources(here))
    if summary.differences:
        stdout.print("\nerror of one policy minus that of another, over the same trials, where both found")
        table = _table("cell", "policies", "trials", "mean difference")
        for pair in summary.differences:
            table.add_row(
                str(pair.cell),
                f"{pair.policy} - {pair.other}",
                str(pair.error_deg.count),
                _mean(pair.error_deg, least=-math.inf),
            )
        _show(table)
    _show_legend(summary)


def _show_legend(summary: studies.Summary) -> None:
    """Print what the columns are."""
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
    stdout.print()
    for line in lines:
        stdout.print(f"[dim]{escape(line)}[/]")


def show_bounds(comparisons: Sequence[studies.BoundComparison]) -> None:
    """Print each policy in each cell compared with the bound."""
    stdout.print("\nroot mean square error, bound for the best angles and for those taken, ratios")
    table = _table("cell", "", "markers", "N", "rmse", "best", "taken", "ratio", "to taken")
    for each in comparisons:
        table.add_row(
            str(each.cell),
            f"[bold]{each.policy}[/]",
            str(each.markers),
            str(each.acquisitions),
            f"{each.rmse_deg:.3g}°",
            f"{each.best_deg:.3g}°",
            f"{each.taken_deg:.3g}°",
            f"{each.ratio_to_best:.3g}",
            f"{each.ratio_to_taken:.3g}",
        )
    _show(table)


def _whatever_the_answer(policies: Sequence[studies.PolicySummary], *, failure_deg: float) -> Table:
    """Shares of all searches, also of those without an answer; without a marker, the share that found one."""
    if all(policy.missed.count == 0 for policy in policies):
        table = _table("", "found where nothing is")
        for policy in policies:
            table.add_row(f"[bold]{policy.policy}[/]", _rare(policy.false_found))
        return table
    table = _table("", "error of all", f"> {failure_deg:g}°", "found", "no claim", "missed")
    for policy in policies:
        table.add_row(
            f"[bold]{policy.policy}[/]",
            _mean(policy.any_error_deg),
            _rare(policy.off),
            _rare(policy.failures),
            _rare(policy.not_found),
            _rare(policy.missed),
        )
    return table


def _two_sources(policies: Sequence[studies.PolicySummary]) -> Table:
    """Answers where there is a second source."""
    table = _table("", "stronger or ambiguous", "weaker found", "found between", "other source named")
    for policy in policies:
        if (two := policy.two_sources) is not None:
            table.add_row(
                f"[bold]{policy.policy}[/]",
                _share(two.stronger, interval=True),
                _rare(two.weaker),
                _rare(two.between),
                _share(two.named, interval=True),
            )
    return table


def _table(*names: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0))
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _show(table: Table) -> None:
    """Print a table in full: in a terminal of less than 80 columns its lines are broken, and no cell is cut."""
    usual = stdout.width
    # Rich prints nothing wider than the console.
    stdout.width = max(80, usual)
    stdout.print(table)
    stdout.width = usual


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
