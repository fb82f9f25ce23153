"""Two programs timed in turn, A B A B, so that a slow moment of the machine falls on both.

Comparisons are made in processor time: what is compared computes and never waits, and is held to the same cores, so
that on a quiet machine held to one core this is the time on the clock, and on a busy one it leaves out the moments
when the core was taken away.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

Work = Callable[[], object]

PROVES_NOTHING = 2.0
"""Ratios below this (and above its inverse) lie within what the machine alone can do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How long to measure.

    Attributes
    ----------
    rounds
        Most repetitions of each piece of work.
    least
        Fewest, however long they take.
    budget_s
        Time after which a comparison ends once it has the fewest.
    """

    rounds: int = 41
    least: int = 7
    budget_s: float = 8.0


FULL = Effort()
QUICK = Effort(rounds=9, least=3, budget_s=1.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Single:
    """Time of one piece of work of ours, on the clock and in processor time.

    Attributes
    ----------
    work
        What was done.
    ms, least_ms, most_ms
        Median, least and largest time on the clock in milliseconds.
    processor_ms
        Median processor time in milliseconds, processes that were started included.
    rounds
        Number of repetitions.
    """

    work: str
    ms: float
    least_ms: float
    most_ms: float
    processor_ms: float
    rounds: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Processor times of a peer's work and of ours, taken in turn.

    Attributes
    ----------
    work, peer
        What was done, and by whom else.
    ours_ms, peer_ms
        Medians in milliseconds.
    ratio, least_ratio, most_ratio
        Median, least and largest of the peer's time over ours, round by round.
    rounds
        Number of rounds.
    agreement
        How far the two outputs differ, in words.
    """

    work: str
    peer: str
    ours_ms: float
    peer_ms: float
    ratio: float
    least_ratio: float
    most_ratio: float
    rounds: int
    agreement: str

    @property
    def proves_nothing(self) -> bool:
        """Whether the two are too near to each other to be told apart."""
        return 1 / PROVES_NOTHING < self.ratio < PROVES_NOTHING


def alone(work: str, ours: Work, *, effort: Effort) -> Single:
    """Time of our work by itself, after a warm-up."""
    _once_ms(ours)
    times: list[tuple[float, float]] = []
    start = time.perf_counter()
    while len(times) < effort.least or (len(times) < effort.rounds and time.perf_counter() - start < effort.budget_s):
        times.append(_once_ms(ours))
    clock, processor = zip(*times, strict=True)
    return Single(
        work=work,
        ms=statistics.median(clock),
        least_ms=min(clock),
        most_ms=max(clock),
        processor_ms=statistics.median(processor),
        rounds=len(times),
    )


def in_turn(work: str, ours: Work, peer: str, theirs: Work, *, agreement: str, effort: Effort) -> Pair:
    """Processor time of a peer's work and of ours.

    Each turn is one call that is not timed, which brings the program's own data back into the caches, and one that is.
    """
    our_ms: list[float] = []
    their_ms: list[float] = []
    start = time.perf_counter()
    while len(our_ms) < effort.least or (len(our_ms) < effort.rounds and time.perf_counter() - start < effort.budget_s):
        our_ms.append(_warm_ms(ours))
        their_ms.append(_warm_ms(theirs))
    ratios = [b / a for a, b in zip(our_ms, their_ms, strict=True)]
    return Pair(
        work=work,
        peer=peer,
        ours_ms=statistics.median(our_ms),
        peer_ms=statistics.median(their_ms),
        ratio=statistics.median(ratios),
        least_ratio=min(ratios),
        most_ratio=max(ratios),
        rounds=len(ratios),
        agreement=agreement,
    )


def _warm_ms(work: Work) -> float:
    work()
    return _once_ms(work)[1]


def _once_ms(work: Work) -> tuple[float, float]:
    """Time on the clock, and processor time."""
    clock = time.perf_counter()
    processor = _processor_s()
    work()
    return 1e3 * (time.perf_counter() - clock), 1e3 * (_processor_s() - processor)


def _processor_s() -> float:
    """Processor time of this process, and of those that it started and that have ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime
