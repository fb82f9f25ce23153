"""Fault campaign: ``python -m tests.faults.campaign --runs 100000 --out docs/data/fault-tables.md``."""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from rich.progress import track

from tests.faults.followed_runs import CHUNK as FOLLOWED_CHUNK
from tests.faults.followed_runs import Counts, counts

from .report import faults, observable_keys, promises
from .tally import CHUNK, Broken, Tally, readings


def main() -> int:
    """Run the campaign, and write or print its tables; 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description="fault campaign in virtual time")
    parser.add_argument("--runs", type=int, default=2000, help="how many searches")
    parser.add_argument("--follows", type=int, default=0, help="how many runs that follow a target, besides")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, help="where the tables go")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end early; the page says how many were run")
    words = parser.parse_args()
    commit = _commit_made_from()
    whole = Tally()
    firsts = range(0, words.runs, CHUNK)
    ends_s = time.monotonic() + 60 * words.minutes
    with ProcessPoolExecutor(words.workers, mp_context=get_context("spawn")) as pool:
        counted = pool.map(partial(readings, words.seed), firsts, (min(CHUNK, words.runs - each) for each in firsts))
        for part in track(counted, total=len(firsts), disable=not sys.stderr.isatty()):
            whole.add(part)
            if time.monotonic() > ends_s:
                break
        followed = Counts()
        firsts = range(0, words.follows, FOLLOWED_CHUNK)
        runs = pool.map(counts, firsts, (min(FOLLOWED_CHUNK, words.follows - each) for each in firsts))
        for counted_runs in track(runs, total=len(firsts), disable=not sys.stderr.isatty()):
            followed.add(counted_runs)
            if time.monotonic() > ends_s:
                break
        pool.shutdown(cancel_futures=True)
    page = _page(whole, followed, seed=words.seed, commit=commit)
    if words.out is not None:
        words.out.write_text(page)
    sys.stdout.write(page)
    return int(bool(followed.broken) or any(each.promise != "P10" for each in whole.broken))


def _page(whole: Tally, followed: Counts, *, seed: int, commit: str) -> str:
    follows = f" --follows {followed.runs}" if followed.runs else ""
    lines = [
        "# Faults: the tables",
        "",
        (
            "What the campaign counted; how it was done and what it means is on "
            "[the page on faults](../validation/faults.md). "
            f"Written by `python -m tests.faults.campaign --runs {whole.runs}{follows} --seed {seed}` at "
            f"commit {commit}."
        ),
        "",
        "## Promises",
        "",
        *promises(whole),
        "",
        (
            f"Outcomes: {', '.join(f'{count:,} {name}' for name, count in sorted(whole.outcomes.items()))}; "
            f"{whole.accepted:,} frames were accepted. {whole.noticed_later} runs accepted a faulty one, noticed "
            f"it later and ended without an answer. The slowest run took {whole.slowest_s:.2f} s of real time, the "
            f"longest {whole.longest_s:,.0f} s of virtual time."
        ),
        "",
        *faults(whole),
        "",
        *(["## Following (P19)", "", *followed.lines(), ""] if followed.runs else []),
        *_broken_section(whole.broken, set(observable_keys())),
    ]
    return "\n".join(lines) + "\n"


def _broken_section(broken: Sequence[Broken], preventable: set[str]) -> list[str]:
    """The runs that broke a promise, with their numbers; not the wrong angles under a fault that no program can see."""
    listed = [each for each in broken if each.promise != "P10" or preventable.issuperset(each.faults)]
    if not listed:
        return []
    lines = (
        f"- {each.promise}, run {each.run} ({', '.join(each.faults) or 'no fault'}): {each.said}" for each in listed
    )
    return ["## Runs that broke a promise", "", *lines, ""]


def _commit_made_from() -> str:
    """Commit of the working tree, and whether the package or the campaign was changed since."""
    here = Path(__file__).parent
    described = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=False)
    root = here.parents[2]
    changed = subprocess.run(
        ["git", "status", "--porcelain", "src", "tests/faults/campaign"],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return described.stdout.strip()[:12] + (" with changes" if changed.stdout.strip() else "")


if __name__ == "__main__":
    sys.exit(main())
