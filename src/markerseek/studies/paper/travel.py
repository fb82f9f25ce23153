"""Rotation travel and time of a search (section 4 of the paper), from the stage's motion profile."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.pictures import panel_grid, shared_legend
from markerseek.sim import LaserSettings, ReceiverSettings, StageMotion
from markerseek.studies.paper.methods import BRACKETS, PAPER_METHODS, TABLE_ACQUISITIONS, PaperMethod, noise_free_track
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import paper_number
from markerseek.studies.paper.section import Cell, Comparison, Section, Table, make_section, make_table
from markerseek.studies.paper.style import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FASTEST = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)
"""The stage at the limits of its data sheet."""

AS_PRINTED, FROM_FIRST, FROM_LOW_END = "as printed", "from the first angle", "from -35 deg"


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


class _Spread(NamedTuple):
    """Mean of many values, their standard deviation, and half the 95 % interval of the mean, which is normal."""

    mean: float
    sd: float
    half: float

    @classmethod
    def of(cls, values: Sequence[float]) -> _Spread:
        sd = float(np.std(values, ddof=1))
        return cls(float(np.mean(values)), sd, 1.96 * sd / math.sqrt(len(values)))


class _Way(NamedTuple):
    """One way to count: a method, an order within each pair, and a start."""

    name: PaperMethod
    order: str
    start: str
    travel: _Spread
    rotation: _Spread
    fastest: _Spread

    def compared(self, key: str, ours: _Spread, condition: str) -> Comparison:
        """A number of the paper beside ours."""
        return Comparison(paper=paper_number(key), ours=ours.mean, sd=ours.sd, half=ours.half, condition=condition)


def travel(options: RunOptions) -> Section:
    """Rotation travel and time of 16 acquisitions, for markers spread evenly over ±35°."""
    rng = np.random.Generator(np.random.PCG64([options.seed, 4]))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, options.markers)
    options.progress("travel", 0, len(PAPER_METHODS))
    ways: list[_Way] = []
    for number, name in enumerate(PAPER_METHODS, start=1):
        ways += _ways(name, [noise_free_track(name, at, acquisitions=TABLE_ACQUISITIONS)[0] for at in markers_deg])
        options.progress("travel", number, len(PAPER_METHODS))
    brackets = [way for way in ways if way.name in BRACKETS]
    comparisons = [
        way.compared(f"travel/{way.name}", way.travel, f"{way.name}, {way.order}, {way.start}") for way in brackets
    ]
    for way in brackets:
        if (way.order, way.start) == (AS_PRINTED, FROM_FIRST):
            # The shorter of the paper's two times is that of its shorter travel.
            key = "travel/high" if way.name == "TS" else "travel/low"
            comparisons.append(way.compared(key, way.rotation, f"{way.name}, 10°/s"))
            comparisons.append(way.compared(key, way.fastest, f"{way.name}, 25°/s"))
    shortest = {name: min(way.travel.mean for way in ways if way.name == name) for name in BRACKETS}
    ts, gss, speed = paper_number("travel/TS").value, paper_number("travel/GSS").value, FASTEST.speed_deg_s
    return make_section(
        "travel",
        comparisons=tuple(comparisons),
        tables=(_travel_table(ways), _time_table(ways)),
        draw=partial(_draw, brackets),
        acquisitions=TABLE_ACQUISITIONS,
        markers=options.markers,
        shortest=shortest,
        paper={"TS": ts, "GSS": gss},
        speed=speed,
        seconds={"TS": ts / speed, "GSS": gss / speed},
    )


def _ways(name: PaperMethod, tracks: Sequence[list[float]]) -> list[_Way]:
    low_deg = PAPER_RANGE.low_deg
    orders: dict[str, Callable[[list[float]], list[float]]] = {AS_PRINTED: list}
    if name in BRACKETS:
        # WA has no pairs: its sweep is the shortest way already.
        orders["shortest order"] = partial(shortest_order, start_deg=low_deg)
    ways = []
    for order, ordered in orders.items():
        for start, before in {FROM_FIRST: [], FROM_LOW_END: [low_deg]}.items():
            whole = [[*before, *ordered(track)] for track in tracks]
            spreads = (
                _Spread.of([measure(track) for track in whole])
                for measure in (
                    travel_deg,
                    partial(rotation_s, motion=StageMotion()),
                    partial(rotation_s, motion=FASTEST),
                )
            )
            ways.append(_Way(name, order, start, *spreads))
    return ways


def _travel_table(ways: Sequence[_Way]) -> Table:
    return make_table(
        "travel",
        "Rotation travel and time of rotation",
        "method order counted travel_deg spread_deg half_interval95_deg rotation_at_10_deg_s_s rotation_at_25_deg_s_s",
        ((way.name, way.order, way.start, *way.travel, way.rotation.mean, way.fastest.mean) for way in ways),
    )


def _time_table(ways: Sequence[_Way]) -> Table:
    """Whole searches from −35°, with acquisitions read as files and in real time, beside manual search."""
    laser = LaserSettings()
    rows: list[tuple[Cell, ...]] = []
    for way in ways:
        if (way.order, way.start) == (AS_PRINTED, FROM_LOW_END):
            for kind, readout_s in {"SonixDAQ files": ReceiverSettings().readout_s, "real time": 0.0}.items():
                # The pulses take the same time with both kinds of reading.
                acquiring_s = TABLE_ACQUISITIONS * (readout_s + laser.pulses / laser.rate_hz)
                rows.append((way.name, kind, way.rotation.mean, acquiring_s, way.rotation.mean + acquiring_s))
    manual = map(paper_number, ("manual/low", "manual/high", "manual/registration"))
    rows += [(f"paper: {number.quantity}", None, None, None, number.value) for number in manual]
    return make_table(
        "travel_time",
        f"Time of a whole search of {TABLE_ACQUISITIONS} acquisitions from -35 deg at 10 deg/s, 16 pulses at "
        "100 Hz each, beside the paper's manual search",
        "method acquisition rotation_s acquiring_s total_s",
        rows,
    )


def _draw(ways: Sequence[_Way]) -> Figure:
    figure, panels = panel_grid(
        list(BRACKETS),
        heading=f"Rotation travel of {TABLE_ACQUISITIONS} acquisitions",
        x_label="order within a pair, and start of the travel",
        y_label="travel [deg]",
        columns=2,
        panel_in=(5.2, 3.2),
    )
    for axes, name in zip(panels, BRACKETS, strict=True):
        here = [way for way in ways if way.name == name]
        axes.bar(
            range(1, len(here) + 1),
            [way.travel.mean for way in here],
            yerr=[way.travel.half for way in here],
            label=f"{name}, ours",
            color=COLOURS[name],
            ecolor="#444444",
            capsize=2,
        )
        paper_deg = paper_number(f"travel/{name}").value
        axes.axhline(paper_deg, color="#222222", linestyle="--", linewidth=1.2, label="paper")
        axes.set_xticks(range(1, len(here) + 1), [f"{way.order},\n{way.start}" for way in here], fontsize=8)
    shared_legend(figure)
    return figure
