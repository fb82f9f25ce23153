"""What a reproduction may use: seed, number of markers, processes; and how it shows that it goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from markerseek.core import ConfigError
from markerseek.studies.workers import Done, Job, on_processes

Advance: TypeAlias = Callable[[str, int, int], None]
"""Hears what is being done, how many parts of it are done, and how many there are."""

PAPER_MARKERS = 1000
"""Random markers of the paper's simulation (section 2.4)."""


def _silent(_what: str, _done: int, _total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """What a reproduction may use.

    Attributes
    ----------
    seed
        Seed of everything that is drawn.
    markers
        Markers of the Monte Carlo studies, and the measure of all other efforts: fewer than the paper's 1000 also thin
        out repeats and frames.
    workers
        Processes.
    advance
        Hears of the progress.
    """

    seed: int = 1
    markers: int = PAPER_MARKERS
    workers: int = 1
    advance: Advance = _silent

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

    def each(self, function: Callable[[Job], Done], jobs: Sequence[Job], *, what: str) -> list[Done]:
        """Results of a function on many jobs, in their order, whatever the number of processes.

        Parameters
        ----------
        function
            A function of a module, so that other processes find it.
        jobs
            Its arguments, one after another.
        what
            What is being done, in words.
        """
        done: dict[int, Done] = {}
        self.advance(what, 0, len(jobs))
        for number, result in on_processes(function, jobs, workers=min(self.workers, max(1, len(jobs)))):
            done[number] = result
            self.advance(what, len(done), len(jobs))
        return [done[number] for number in range(len(jobs))]
