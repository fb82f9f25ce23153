"""Simulated rigs whose probe a simulated hand turns, on a virtual clock.

``python -m tests.by_hand 40`` prints the table of decision 61: the same worlds searched with the motor and by hand.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from markerseek import find_marker, simulated
from markerseek.core import Reader
from markerseek.drivers import GuidedStage, GuidedStageSettings
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.records import SearchResult
from markerseek.rigs import Rig
from markerseek.scan import Scanner
from markerseek.sim import HandMotion, SimulatedHand


def turned_by_hand(
    rig: Rig,
    *,
    reader: Reader,
    seed: int,
    motion: HandMotion | None = None,
) -> Rig:
    """A simulated rig with a hand in the place of its motor."""
    settings = GuidedStageSettings()
    clock, hand = rig.scanner.clock, settings.by_hand
    turner = SimulatedHand(
        world=rig.laser._world,  # type: ignore[attr-defined]
        clock=clock,
        limits=rig.limits.search,
        rng=np.random.default_rng(seed),
        motion=motion,
    )
    stage = GuidedStage(encoder=turner, clock=clock, settings=settings, limits=rig.limits, asks=turner.turn_to)
    # As `markerseek.rigs.bench_rig.guard_of`.
    guard = Guard(
        limits=rig.limits,
        firing=FiringLimits(),
        admission=Admission(settled_deg=hand.drift_deg),
        arrival_deg=hand.reach_deg + hand.drift_deg,
    )
    scanner = Scanner(
        stage=stage,
        laser=rig.laser,
        receiver=rig.receiver,
        reader=reader,
        clock=clock,
        guard=guard,
        pulses=rig.scanner.pulses,
        arms_itself=True,
    )
    return replace(rig, stage=stage, scanner=scanner, by_hand=hand, recipe=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One world searched with the motor and by hand."""

    motor: SearchResult
    by_hand: SearchResult


def compared(make: Callable[[int], Rig], seed: int, *, reader: Callable[[Rig], Reader]) -> Compared:
    """Both searches of the world of a seed."""
    with_motor, to_turn = make(seed), make(seed)
    return Compared(
        motor=find_marker(with_motor),
        by_hand=find_marker(turned_by_hand(to_turn, reader=reader(to_turn), seed=seed)),
    )


def reversals(result: SearchResult) -> int:
    """How often the probe was turned back, the first turn from where it stood left out."""
    turns = [after.angle_deg - before.angle_deg for before, after in pairwise(result.samples)]
    return sum(one * other < 0 for one, other in pairwise(turns))


def table(pairs: list[Compared]) -> list[str]:
    """The rows of the table, Markdown."""
    rows = ["| | found | acquisitions | reversals | rotation | median error | 90 % | time |", "|" + "---|" * 8]
    for name in ("motor", "by_hand"):
        results = [getattr(pair, name) for pair in pairs]
        errors = [result.error_deg for result in results if result.found]
        rows.append(
            f"| {name.replace('_', ' ')} | {sum(result.found for result in results)} of {len(results)} "
            f"| {np.mean([result.acquisitions for result in results]):.2f} "
            f"| {np.mean([reversals(result) for result in results]):.2f} "
            f"| {np.mean([result.travel_deg for result in results]):.0f}° "
            f"| {np.median(errors):.3f}° | {np.quantile(errors, 0.9):.3f}° "
            f"| {np.mean([result.elapsed_s for result in results]):.0f} s |"
        )
    more = [pair.by_hand.acquisitions - pair.motor.acquisitions for pair in pairs]
    over = sum(each > 2 for each in more)
    return [
        *rows,
        "",
        f"acquisitions more by hand: mean {np.mean(more):+.2f}, most {max(more):+d}, {over} times over 2",
    ]


def main() -> None:
    """Search so many worlds, and print the table."""
    pairs = [
        compared(lambda seed: simulated(seed=seed), seed, reader=lambda rig: rig.imaging)  # type: ignore[arg-type, return-value]
        for seed in range(1, int(sys.argv[1]) + 1)
    ]
    sys.stdout.write("\n".join(table(pairs)) + "\n")


if __name__ == "__main__":
    main()
