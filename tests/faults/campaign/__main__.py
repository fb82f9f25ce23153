"""Fault campaign: ``python -m tests.faults.campaign --runs 100000 --out docs/data/fault-tables.md``.

Counts are kept beside the output (``--state``) after each chunk, so that a campaign that was killed continues where it
was; they hold for one commit and one seed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import msgspec
from rich.progress import Progress

from .chunks import CHUNK, readings
from .commit import commit_made_from
from .points import enumerate_points
from .report import faults, in_words, observable_keys, promises
from .tally import Broken, Tally
from .vocabulary import fingerprint


class _Kept(msgspec.Struct, kw_only=True):
    """What is kept between two calls: the chunks that are done, by what they were made of."""

    commit: str
    seed: int
    vocabulary: str = ""
    chunks: dict[str, Tally] = {}


def chunked(*, runs: int, kept: _Kept, save: Callable[[], None], workers: int) -> Tally:
    """Counts of all chunks, those that are done already taken from what is kept."""
    parts = {f"{first} {min(CHUNK, runs - first)}": first for first in range(0, runs, CHUNK)}
    todo = {name: first for name, first in parts.items() if name not in kept.chunks}
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("searches", total=runs, completed=runs - CHUNK * len(todo))
        for name, tally in _each(kept.seed, todo, workers):
            kept.chunks[name] = tally
            progress.advance(bar, tally.runs)
            save()
    whole = Tally()
    for name in parts:
        whole.add(kept.chunks[name])
    return whole


def _each(seed: int, todo: dict[str, int], workers: int) -> Iterator[tuple[str, Tally]]:
    sizes = {name: int(name.rsplit(" ", 1)[1]) for name in todo}
    if workers == 1:
        for name, first in todo.items():
            yield name, readings(seed, first, sizes[name])
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        names = list(todo)
        yield from zip(names, pool.map(partial(readings, seed), todo.values(), sizes.values()), strict=True)


def main() -> int:
    """Run the campaign, and write or print its tables; 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description="fault campaign in virtual time")
    parser.add_argument("--runs", type=int, default=2000, help="how many searches")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--state", type=Path, help="where counts are kept between two calls")
    parser.add_argument("--out", type=Path, help="where the tables go")
    words = parser.parse_args()
    kept = _kept(words.state, seed=words.seed)

    def save() -> None:
        if words.state is not None:
            draft = words.state.with_suffix(".part")
            draft.write_bytes(msgspec.json.encode(kept))
            draft.replace(words.state)

    whole = chunked(runs=words.runs, kept=kept, save=save, workers=words.workers)
    points = enumerate_points()
    page = _page(kept, whole, points)
    if words.out is not None:
        words.out.write_text(page)
    sys.stdout.write(page)
    broken = [each for each in whole.broken if each.promise != "P10"]
    return 1 if broken or any(points.values()) else 0


def _kept(path: Path | None, *, seed: int) -> _Kept:
    commit = commit_made_from()
    if path is not None and path.is_file():
        kept = msgspec.json.decode(path.read_bytes(), type=_Kept)
        if (kept.commit, kept.seed, kept.vocabulary) == (commit, seed, fingerprint()):
            return kept
    return _Kept(commit=commit, seed=seed, vocabulary=fingerprint())


def _page(kept: _Kept, whole: Tally, points: dict[str, list[str]]) -> str:
    lines = [
        "# Faults: the tables",
        "",
        (
            "What the campaign counted; how it was done and what it means is on [the page on faults](faults.md). "
            f"Written by `python -m tests.faults.campaign --runs {whole.runs} --seed {kept.seed}` at "
            f"commit {kept.commit}."
        ),
        "",
        "## Promises",
        "",
        *promises(whole, preventable=observable_keys()),
        "",
        (
            f"Outcomes: {', '.join(f'{count:,} {name}' for name, count in sorted(whole.outcomes.items()))}; "
            f"{whole.accepted:,} frames were accepted. {whole.noticed_later} runs accepted a faulty one, noticed "
            f"it later and ended without an answer. The slowest run took {whole.slowest_s:.2f} s of real time, the "
            f"longest {whole.longest_s:,.0f} s of virtual time."
        ),
        "",
        *faults(whole, seen=observable_keys(), words=in_words()),
        "",
        *_broken_section(whole.broken, set(observable_keys())),
        "## Fault points: the n-th call of each verb fails, for all n",
        "",
        *(f"- {verb}: {'always a clean stop' if not broken else '; '.join(broken)}" for verb, broken in points.items()),
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


if __name__ == "__main__":
    sys.exit(main())
