"""Sessions of a benchmark in a CSV file, one a line: those that the file does not have yet are run, and added to it."""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import msgspec


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionOutcome:
    """What came of one session; a benchmark adds fields of numbers, words, truth values and None."""

    row: str
    """Name of its row."""
    seed: int


Outcome = TypeVar("Outcome", bound=SessionOutcome)


def session_parser(module: str, doc: str | None, rows: Collection[str], *, sessions: int) -> argparse.ArgumentParser:
    """Return the options that all benchmarks of sessions have; ``sessions``: of each row, if nobody names another."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=doc)
    parser.add_argument("--sessions", type=int, default=sessions, help=f"sessions of each row ({sessions})")
    parser.add_argument("--rows", nargs="+", choices=[*rows], default=[*rows], help="rows to run (all)")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--out", type=Path, required=True, help="the CSV file of all sessions, which is added to")
    return parser


def run_missing(
    asked: argparse.Namespace,
    run: Callable[..., Outcome],
    kind: type[Outcome],
    *,
    first_seed: int,
    counts: Callable[[Outcome], bool] = lambda _: True,
) -> list[Outcome]:
    """Run the sessions that a file does not have yet, add each as soon as it is done, and return all of the file.

    ``asked``: from `session_parser`. ``run``: takes the name of a row, a seed and ``commit=``. ``counts``: whether a
    session of the file is one of those that are asked for.
    """
    done = {(each.row, each.seed) for each in read_outcomes(asked.out, kind) if counts(each)}
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    tasks = [
        (name, seed)
        for seed in range(first_seed, first_seed + asked.sessions)
        for name in asked.rows
        if (name, seed) not in done
    ]
    with get_context("spawn").Pool(asked.workers) as pool:
        for outcome in pool.imap_unordered(partial(_run_one, run, commit), tasks):
            append_outcome(asked.out, outcome)
            sys.stderr.write(f"{outcome}\n")
    return read_outcomes(asked.out, kind)


def _run_one(run: Callable[..., Outcome], commit: str, task: tuple[str, int]) -> Outcome:
    name, seed = task
    return run(name, seed, commit=commit)


def read_outcomes(path: Path, kind: type[Outcome]) -> list[Outcome]:
    """Return the sessions of a file; none where there is no file. An empty cell is None, or an empty text."""
    if not path.exists():
        return []
    texts = {each.name for each in fields(kind) if each.type == "str"}
    with path.open(encoding="utf-8", newline="") as file:
        rows = [
            {key: value if value or key in texts else None for key, value in row.items()}
            for row in csv.DictReader(file)
        ]
    return [msgspec.convert(row, kind, strict=False) for row in rows]


def append_outcome(path: Path, outcome: SessionOutcome) -> None:
    """Write one more session to a file."""
    names = [each.name for each in fields(outcome)]
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(names)
        writer.writerow(["" if (value := getattr(outcome, name)) is None else value for name in names])
