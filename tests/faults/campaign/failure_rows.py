"""The table of failures for our methods, row by row, with enough searches for a share of 1e-3.

``python -m tests.faults.campaign.failure_rows --workers 2 --out docs/data/failures.md`` (half an hour): every
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
from markerseek.studies.paper.methods import ALL_METHODS, AnyMethod

from .commit import commit_made_from
from .failure_cases import CASES, MOVED_AFTER, FaultRun, draw_runs, outcomes_of, share_off
from .tally import upper95

OFF_DEG = 1.0
"""Error beyond which a claim counts as off here, in degrees; twice the usual tolerance is more at most markers."""


def _head(count: int, seed: int) -> str:
    """Head of the page: what was searched for, what the columns are, and where it came from."""
    return (
        "# Searches under faults\n\n"
        f"{count:,} simulated markers for each fault, searched for by each method behind the guard, with three dark "
        "frames and its default number of acquisitions; from frames of channel data by the posterior alone. The "
        "posterior also looks for other sources, as it does by default.\n\n"
        "- *In the data*: whether the fault leaves a trace in what the devices send.\n"
        f"- *Found and off*: answers `found` that are more than {OFF_DEG:g}° from the marker, with the one-sided "
        "upper 95 % limit of their share (Clopper-Pearson).\n"
        "- *No angle*: refused, not found, at bound, unsure or ambiguous. Without a marker that is the right answer.\n"
        f"- A marker that moves does so after {MOVED_AFTER} acquisitions, and its last place counts as true: a search "
        "that ended before the move is off by it.\n\n"
        f"Made from commit {commit_made_from()} by `python -m tests.faults.campaign.failure_rows --count {count} "
        f"--seed {seed}`.\n\n"
        "| fault | in the data | method | searches | found and off | upper 95 % limit | no angle |\n"
        "|---|---|---|---|---|---|---|\n"
    )


def row(words: str, observable: bool | None, method: AnyMethod, errors_deg: Sequence[float | None]) -> str:
    """Line of the table for one method under one fault."""
    off, none = share_off(errors_deg, limit_deg=OFF_DEG), sum(each is None for each in errors_deg)
    reported, most = {None: "", True: "yes", False: "no"}[observable], upper95(off.hits, off.count)
    return f"| {words} | {reported} | {method} | {off.count:,} | {off.hits} | {most:.2g} | {none / off.count:.1%} |\n"


def runs_of_ours(name: str, methods: tuple[AnyMethod, ...], *, count: int, seed: int) -> list[FaultRun]:
    """Runs of some methods with our rules; each case has a seed of its own, so that any of them can be made alone."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 10, list(CASES).index(name)])))
    return draw_runs(name, count, rng, methods=methods)


def main() -> None:
    """Add to the page the rows that are missing."""
    parser = argparse.ArgumentParser(description="table of failures, for ours alone")
    parser.add_argument("--count", type=int, default=3700, help="markers of each fault")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--faults", nargs="+", choices=tuple(CASES), default=tuple(CASES))
    parser.add_argument("--out", type=Path, required=True, help="page of the table")
    words = parser.parse_args()
    head = _head(words.count, words.seed)
    done = words.out.read_text() if words.out.is_file() else ""
    page = done if done.startswith(head) else head
    with Progress() as progress:
        for name in words.faults:
            case = CASES[name]
            if f"| {case.words} |" in page:
                continue
            methods: tuple[AnyMethod, ...] = ("posterior",) if case.frames else ALL_METHODS
            bar = progress.add_task(case.words)
            options = RunOptions(
                seed=words.seed,
                workers=words.workers,
                progress=lambda _what, part, parts, bar=bar: progress.update(bar, completed=part, total=parts),
            )
            outcomes = outcomes_of(runs_of_ours(name, methods, count=words.count, seed=words.seed), options)
            for method in methods:
                page += row(case.words, case.observable, method, outcomes[name, method])
            words.out.write_text(page)


if __name__ == "__main__":
    main()
