"""The targets that exist so far, each with the figure measured and whether it is met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks import beamforming, chain, commands, forward, journal
from benchmarks.timing import Pair, Single


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One line of the last table.

    Attributes
    ----------
    work
        What is to be fast.
    limit, figure
        Target and measurement, both in words.
    met
        Whether the second keeps to the first; None where it could not be measured.
    """

    work: str
    limit: str
    figure: str
    met: bool | None


def judge(pairs: Sequence[Pair], singles: Sequence[Single]) -> list[Target]:
    """Every target, in the order of the benchmarks."""
    times = {single.work: single for single in singles}
    simulate = max((each for each in singles if each.work.startswith(forward.FORWARD)), key=lambda each: each.ms)
    return [
        _fastest_peer(pairs, beamforming.FULL_APERTURE),
        _c_limit(pairs, beamforming.FULL_APERTURE),
        _c_limit(pairs, beamforming.F_NUMBER_1),
        _at_most(chain.CHAIN, times[chain.CHAIN], 5),
        _at_most(f"{forward.FORWARD}, slowest angle", simulate, 1),
        _at_most(forward.NOISE, times[forward.NOISE], 5),
        _at_most(forward.FURTHER, times[forward.FURTHER], 1),
        _at_most(commands.SEARCH, times[commands.SEARCH], 3000),
        _at_most(commands.IMPORT, times[commands.IMPORT], 500),
        _at_most(commands.LOOP, times[commands.LOOP], 10),
        _at_most(journal.FRAME, times[journal.FRAME], 5),
    ]


def _at_most(work: str, single: Single, limit_ms: float) -> Target:
    """The clock decides; the processor time tells how far a busy machine is to blame."""
    figure = f"{single.ms:.3g} ms (processor time {single.processor_ms:.3g} ms)"
    return Target(work=work, limit=f"≤ {limit_ms:g} ms", figure=figure, met=single.ms <= limit_ms)


def _fastest_peer(pairs: Sequence[Pair], work: str) -> Target:
    others = [pair for pair in pairs if pair.work == work and pair.peer != beamforming.C_LIMIT]
    limit = "≥ 5 × the fastest peer"
    if not others:
        return Target(work=work, limit=limit, figure="no peer could be run", met=None)
    nearest = min(others, key=lambda pair: pair.ratio)
    return Target(work=work, limit=limit, figure=f"{nearest.ratio:.3g} × {nearest.peer}", met=nearest.ratio >= 5)


def _c_limit(pairs: Sequence[Pair], work: str) -> Target:
    limit = "≤ 1.5 × the C limit"
    for pair in pairs:
        if pair.work == work and pair.peer == beamforming.C_LIMIT:
            times = 1 / pair.ratio
            return Target(work=work, limit=limit, figure=f"{times:.3g} × the C kernel", met=times <= 1.5)
    return Target(work=work, limit=limit, figure="no gcc here", met=None)
