"""What a reproduction may use: seed, number of markers, processes; its progress, and how long its stages take."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
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
    """What a reproduction may use.

    Attributes
    ----------
    seed
        Seed of everything that is drawn.
    markers
        Markers of the Monte Carlo studies. Fewer than the paper's 1000 also reduce repeats and frames in proportion.
    workers
        Processes.
    progress
        Receives the progress.
    """

    seed: int = 1
    markers: int = PAPER_MARKERS
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

        Parameters
        ----------
        function
            A function of a module, which other processes can import.
        jobs
            Its arguments, one after another.
        stage
            What is done, in words.
        part
            Jobs that a process is given at once.
        """
        parts = [jobs[first : first + part] for first in range(0, len(jobs), part)]
        # Results come as they are ready, and are sorted: tables must not depend on the number of processes.
        results: dict[int, list[Done]] = {}
        self.progress(stage, 0, len(jobs))
        for number, done in on_processes(partial(_all, function), parts, workers=min(self.workers, max(1, len(parts)))):
            results[number] = done
            self.progress(stage, sum(map(len, results.values())), len(jobs))
        return [result for number in range(len(parts)) for result in results[number]]


def _all(function: Callable[[Job], Done], jobs: Sequence[Job]) -> list[Done]:
    return [function(job) for job in jobs]


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration:
    """How long something took.

    Attributes
    ----------
    seconds
        From its beginning to its end.
    stages_s
        Seconds of its stages, by their names.
    """

    seconds: float
    stages_s: Mapping[str, float]

    def __str__(self) -> str:
        stages = [f"{name}: {spent_s:.1f} s" for name, spent_s in self.stages_s.items()]
        rest_s = self.seconds - sum(self.stages_s.values())
        return f"{self.seconds:.1f} s" + (f" ({'; '.join(stages)}; the rest: {rest_s:.1f} s)" if stages else "")


class Stopwatch:
    """Times the stages of a work by its progress, which it passes on.

    Parameters
    ----------
    progress
        Receives the progress after the watch.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._since_s = time.perf_counter()
        self._began_s: dict[str, float] = {}
        self._stages_s: dict[str, float] = {}

    def progress(self, stage: str, done: int, total: int) -> None:
        """Note the progress of a stage and pass it on; see `Progress`."""
        now_s = time.perf_counter()
        self._stages_s[stage] = now_s - self._began_s.setdefault(stage, now_s)
        self._progress(stage, done, total)

    def lap(self) -> Duration:
        """Time since the watch was made, or since the last lap, and that of the stages since."""
        now_s = time.perf_counter()
        duration = Duration(seconds=now_s - self._since_s, stages_s=self._stages_s)
        self._since_s, self._began_s, self._stages_s = now_s, {}, {}
        return duration
