"""What a reproduction may use: seed, number of markers, processes, and its progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from markerseek.core import ConfigError
from markerseek.studies.workers import Done, Job, on_processes

Progress: TypeAlias = Callable[[str, int, int], None]
"""Receives the name of a stage, how many of its parts are done, and how many there are."""

PAPER_MARKERS = 1000
"""Random markers of the paper's simulation (section 2.4)."""


def _ignore(_stage: str, _done: int, _total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What a reproduction may use."""

    seed: int = 1
    markers: int = PAPER_MARKERS
    """Markers of the Monte Carlo studies. Fewer than the paper's 1000 also reduce repeats and frames in proportion."""
    workers: int = 1
    progress: Progress = _ignore

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or more")
        if not 10 <= self.markers <= 1_000_000:
            raise ConfigError(f"markers is {self.markers}, it must lie between 10 and 1000000; the paper has 1000")
        if not 1 <= self.workers <= 256:
            raise ConfigError(f"workers is {self.workers}, it must lie between 1 and 256")

    @property
    def share(self) -> float:
        """Markers over the paper's number of them, at most 1."""
        return min(1.0, self.markers / PAPER_MARKERS)

    def each(self, function: Callable[[Job], Done], jobs: Sequence[Job], *, stage: str, part: int = 1) -> list[Done]:
        """Results of a function on many jobs, in their order, whatever the number of processes.

        ``function``: a function of a module, which other processes can import. ``jobs``: its arguments, one after
        another. ``part``: jobs that a process is given at once.
        """
        parts = [jobs[first : first + part] for first in range(0, len(jobs), part)]
        results: list[Done] = []
        self.progress(stage, 0, len(jobs))
        for done in on_processes(partial(_all, function), parts, workers=min(self.workers, max(1, len(parts)))):
            results += done
            self.progress(stage, len(results), len(jobs))
        return results


def _all(function: Callable[[Job], Done], jobs: Sequence[Job]) -> list[Done]:
    return [function(job) for job in jobs]
