"""The table of failures for our methods, row by row, with enough searches for a share of 1e-3.

``python -m tests.faults.campaign.failure_rows --workers 2 --out docs/explanation/failures.md`` (half an hour): every
method on intensities, the posterior alone from frames. Rows are added as they are done; those that are there already,
from the same commit, are kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.progress import Progress

from markerseek.studies.paper import RunOptions
from markerseek.studies.paper.failure_runs import CASES, METHODS, AnyMethod, FaultRun, Outcome, draw_runs, outcomes_of
from markerseek.studies.paper.failures import CLOSE_DEG, share_off

from .commit import commit_made_from
from .tally import upper95

HEAD = (
    "| fault | to be seen | method | searches | found and off by more than 1° | upper 95 % limit | no angle |\n"
    "|---|---|---|---|---|---|---|\n"
)


def row(words: str, seen: bool | None, method: AnyMethod, outcomes: Sequence[Outcome]) -> str:
    """Line of the table for one method under one fault."""
    off, none = share_off(outcomes, limit_deg=CLOSE_DEG), sum(each.error_deg is None for each in outcomes)
    reported, most = {None: "", True: "yes", False: "no"}[seen], upper95(off.hits, off.count)
    return f"| {words} | {reported} | {method} | {off.count:,} | {off.hits} | {most:.2g} | {none / off.count:.1%} |\n"


def runs_of_ours(name: str, methods: tuple[AnyMethod, ...], *, count: int, seed: int) -> list[FaultRun]:
    """Runs of some methods with our rules; each case has a seed of its own, so that any of them can be made alone."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 10, list(CASES).index(name)])))
    return draw_runs(name, count, rng, rules=("ours",), methods=methods)


def main() -> None:
    """Add to the page the rows that are missing."""
    parser = argparse.ArgumentParser(description="table of failures, for ours alone")
    parser.add_argument("--count", type=int, default=3700, help="markers of each fault")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--faults", nargs="+", choices=tuple(CASES), default=tuple(CASES))
    parser.add_argument("--out", type=Path, required=True, help="page of the table")
    words = parser.parse_args()
    head = (
        "# The table of failures, for ours alone\n\n"
        f"Made from commit {commit_made_from()} by `python -m tests.faults.campaign.failure_rows --count {words.count} "
        f"--seed {words.seed}`. Limits are one-sided (Clopper-Pearson). All of it is simulated; the "
        f"report of `markerseek reproduce failures` says what each fault does.\n\n{HEAD}"
    )
    done = words.out.read_text() if words.out.is_file() else ""
    page = done if done.startswith(head) else head
    with Progress() as progress:
        for name in words.faults:
            case = CASES[name]
            if f"| {case.words} |" in page:
                continue
            methods: tuple[AnyMethod, ...] = ("posterior",) if case.frames else METHODS["ours"]
            bar = progress.add_task(case.words)
            options = RunOptions(
                seed=words.seed,
                workers=words.workers,
                progress=lambda _what, part, parts, bar=bar: progress.update(bar, completed=part, total=parts),
            )
            outcomes = outcomes_of(runs_of_ours(name, methods, count=words.count, seed=words.seed), options)
            for method in methods:
                page += row(case.words, case.observable, method, [o for o in outcomes if o.method == method])
            words.out.write_text(page)


if __name__ == "__main__":
    main()
