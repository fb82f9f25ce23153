"""Rotation travel and time of a search (section 4 of the paper), from the stage's motion profile."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.sim import StageMotion
from markerseek.studies.paper.methods import BRACKETS, PAPER_METHODS, TABLE_ACQUISITIONS, PaperMethod, noise_free_track
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import paper_number
from markerseek.studies.paper.section import Cell, Comparison, Errors, Section, errors_of, make_section, make_table

FASTEST = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)
"""The stage at the limits of its data sheet."""


def shortest_order(track_deg: Sequence[float], *, start_deg: float) -> list[float]:
    """The same pairs of angles, each in the order that makes the whole way shortest.

    A search cannot travel so, because it would have to know the later pairs; it is the lower limit of the travel of
    every search that measures these pairs.

    ``track_deg``: angles of a bracket search, two for each iteration. ``start_deg``: where the probe is at first.
    """
    ways: list[tuple[float, list[float]]] = [(0.0, [start_deg])]
    for left_deg, right_deg in zip(track_deg[::2], track_deg[1::2], strict=True):
        # Dynamic programming: of all ways that end at the same angle only the shortest can be part of the answer.
        ways = [
            min(
                ((length + abs(first - way[-1]) + abs(last - first), [*way, first, last]) for length, way in ways),
                key=lambda way: way[0],
            )
            for first, last in ((left_deg, right_deg), (right_deg, left_deg))
        ]
    return min(ways, key=lambda way: way[0])[1][1:]


def travel_deg(track_deg: Sequence[float]) -> float:
    """Rotation from the first angle of a track to its last, in degrees."""
    return float(np.abs(np.diff(track_deg)).sum())


def rotation_s(track_deg: Sequence[float], *, motion: StageMotion) -> float:
    """Time that the stage takes from the first angle of a track to its last, resting at each, in seconds.

    A move downwards goes beyond its target and comes back from below, as `markerseek.sim.SimulatedStage` does.

    ``track_deg``: angles, beginning with that of the probe.
    """
    total_s = 0.0
    for here_deg, there_deg in itertools.pairwise(track_deg):
        below_deg = motion.approach_deg if there_deg < here_deg else 0.0
        # Down beyond the target, and back up: play is always taken up from below.
        moved_s = motion.duration_s(abs(there_deg - here_deg) + below_deg) + motion.duration_s(below_deg)
        total_s += moved_s + motion.settle_s
    return total_s


def travel(options: RunOptions) -> Section:
    """Rotation travel and time of 16 acquisitions, for markers spread evenly over ±35°."""
    rng = np.random.Generator(np.random.PCG64([options.seed, 4]))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, options.markers)
    rows: list[tuple[Cell, ...]] = []
    comparisons: list[Comparison] = []
    shortest: dict[PaperMethod, float] = {}
    for number, name in enumerate(PAPER_METHODS):
        options.progress("travel", number, len(PAPER_METHODS))
        tracks = [noise_free_track(name, at, acquisitions=TABLE_ACQUISITIONS)[0] for at in markers_deg]
        turned = errors_of(map(travel_deg, tracks))
        slow, fast = (
            errors_of(rotation_s(track, motion=motion) for track in tracks) for motion in (StageMotion(), FASTEST)
        )
        rows.append((name, turned.mean_deg, turned.sd_deg, turned.half_deg, slow.mean_deg, fast.mean_deg))
        if name in BRACKETS:
            # The shorter of the paper's two times is that of its shorter travel.
            seconds = "travel/high" if name == "TS" else "travel/low"
            comparisons += [
                _compared(f"travel/{name}", turned, name),
                _compared(seconds, slow, f"{name}, 10°/s"),
                _compared(seconds, fast, f"{name}, 25°/s"),
            ]
            ways = (shortest_order(track, start_deg=PAPER_RANGE.low_deg) for track in tracks)
            shortest[name] = float(np.mean([travel_deg(way) for way in ways]))
    options.progress("travel", len(PAPER_METHODS), len(PAPER_METHODS))
    paper = {name: paper_number(f"travel/{name}").value for name in BRACKETS}
    return make_section(
        "travel",
        comparisons=tuple(comparisons),
        tables=(
            make_table(
                "travel",
                "Rotation travel and time of rotation",
                "method travel_deg spread_deg half_interval95_deg rotation_at_10_deg_s_s rotation_at_25_deg_s_s",
                rows,
            ),
        ),
        acquisitions=TABLE_ACQUISITIONS,
        markers=options.markers,
        shortest=shortest,
        paper=paper,
        speed=FASTEST.speed_deg_s,
        seconds={name: turned_deg / FASTEST.speed_deg_s for name, turned_deg in paper.items()},
    )


def _compared(key: str, ours: Errors, condition: str) -> Comparison:
    return Comparison(
        paper=paper_number(key), ours=ours.mean_deg, sd=ours.sd_deg, half=ours.half_deg, condition=condition
    )
