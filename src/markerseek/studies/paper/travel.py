"""Rotation travel and time of a search (section 4 of the paper), from the stage's motion profile."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.pictures import panel_grid, shared_legend
from markerseek.sim import LaserSettings, ReceiverSettings, StageMotion
from markerseek.studies.paper.methods import BRACKETS, PAPER_METHODS, TABLE_ACQUISITIONS, PaperMethod, noise_free_track
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import paper_number
from markerseek.studies.paper.section import Cell, Comparison, Section, Table
from markerseek.studies.paper.style import COLOURS
from markerseek.studies.statistics import Moments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Way:
    """One way to count: a method, an order within each pair, and a start."""

    name: PaperMethod
    order: str
    start: str
    travel: Moments
    rotation: Moments
    fastest: Moments


def travel(options: RunOptions) -> Section:
    """Rotation travel and time of 16 acquisitions, for markers spread evenly over ±35°."""
    rng = np.random.Generator(np.random.PCG64([options.seed, 4]))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, options.markers)
    options.progress("travel", 0, len(PAPER_METHODS))
    ways: list[_Way] = []
    for number, name in enumerate(PAPER_METHODS, start=1):
        tracks = [noise_free_track(name, float(at), acquisitions=TABLE_ACQUISITIONS)[0] for at in markers_deg]
        ways += _ways(name, tracks)
        options.progress("travel", number, len(PAPER_METHODS))
    return Section(
        name="travel",
        title=f"Rotation travel and time of {TABLE_ACQUISITIONS} acquisitions",
        method=(
            (
                f"{options.markers} markers spread evenly over ±35°, without noise: the angles of the acquisitions "
                "then follow from the marker's angle alone, on every symmetric unimodal curve. Time of rotation is "
                "that of a stage with a trapezoidal speed that comes to rest at each angle and approaches it from "
                "below: at 10°/s and 10°/s², the defaults, and at 25°/s and 25°/s², the largest of its data sheet."
            ),
        ),
        comparisons=_comparisons(ways),
        tables=(_travel_table(ways), _time_table(ways)),
        draw=partial(_draw, ways),
        alt="Rotation travel of each method beside the paper's numbers",
        remarks=_remarks(ways),
    )


def _ways(name: PaperMethod, tracks: Sequence[list[float]]) -> list[_Way]:
    low_deg = PAPER_RANGE.low_deg
    orders: dict[str, Callable[[list[float]], list[float]]] = {"as printed": lambda track: track}
    if name in BRACKETS:
        # WA has no pairs: its sweep is the shortest way already.
        orders["shortest order"] = partial(shortest_order, start_deg=low_deg)
    ways = []
    for order, ordered in orders.items():
        for start, before in {"from the first angle": [], "from -35 deg": [low_deg]}.items():
            whole = [[*before, *ordered(track)] for track in tracks]
            ways.append(
                _Way(
                    name=name,
                    order=order,
                    start=start,
                    travel=Moments.of([travel_deg(track) for track in whole]),
                    rotation=Moments.of([rotation_s(track, motion=StageMotion()) for track in whole]),
                    fastest=Moments.of([rotation_s(track, motion=FASTEST) for track in whole]),
                )
            )
    return ways


def _half(moments: Moments) -> float:
    """Half the 95 % interval of the mean, which is normal for this many values."""
    return 1.96 * (moments.sd or 0.0) / math.sqrt(moments.count)


def _compared(key: str, moments: Moments, condition: str) -> Comparison:
    return Comparison(
        paper=paper_number(key), ours=moments.mean, sd=moments.sd, half=_half(moments), condition=condition
    )


def _comparisons(ways: Sequence[_Way]) -> tuple[Comparison, ...]:
    bracket = [way for way in ways if way.name in BRACKETS]
    comparisons = [
        _compared(f"travel/{way.name}", way.travel, f"{way.name}, {way.order}, {way.start}") for way in bracket
    ]
    for way in bracket:
        if (way.order, way.start) == ("as printed", "from the first angle"):
            # The shorter of the paper's two times is that of its shorter travel.
            key = "travel/high" if way.name == "TS" else "travel/low"
            comparisons.append(_compared(key, way.rotation, f"{way.name}, 10°/s"))
            comparisons.append(_compared(key, way.fastest, f"{way.name}, 25°/s"))
    return tuple(comparisons)


def _travel_table(ways: Sequence[_Way]) -> Table:
    return Table(
        name="travel",
        caption="Rotation travel and time of rotation",
        rows=tuple(
            {
                "method": way.name,
                "order": way.order,
                "counted": way.start,
                "travel_deg": way.travel.mean,
                "spread_deg": way.travel.sd,
                "half_interval95_deg": _half(way.travel),
                "rotation_at_10_deg_s_s": way.rotation.mean,
                "rotation_at_25_deg_s_s": way.fastest.mean,
            }
            for way in ways
        ),
    )


def _time_table(ways: Sequence[_Way]) -> Table:
    """Whole searches from −35°, with acquisitions read as files and in real time, beside manual search."""
    laser = LaserSettings()
    # The pulses take the same time with both kinds of reading.
    pulses_s = laser.pulses / laser.rate_hz
    readings = {"SonixDAQ files": ReceiverSettings().readout_s, "real time": 0.0}
    rows: list[dict[str, Cell]] = []
    for way in ways:
        if (way.order, way.start) == ("as printed", "from -35 deg"):
            for kind, readout_s in readings.items():
                acquiring_s = TABLE_ACQUISITIONS * (readout_s + pulses_s)
                rows.append(
                    {
                        "method": way.name,
                        "acquisition": kind,
                        "rotation_s": way.rotation.mean,
                        "acquiring_s": acquiring_s,
                        "total_s": way.rotation.mean + acquiring_s,
                    }
                )
    for key in ("manual/low", "manual/high", "manual/registration"):
        number = paper_number(key)
        rows.append({**dict.fromkeys(rows[0]), "method": f"paper: {number.quantity}", "total_s": number.value})
    return Table(
        name="travel_time",
        caption=f"Time of a whole search of {TABLE_ACQUISITIONS} acquisitions from -35 deg at 10 deg/s, 16 pulses at "
        "100 Hz each, beside the paper's manual search",
        rows=tuple(rows),
    )


def _remarks(ways: Sequence[_Way]) -> tuple[str, ...]:
    shortest = {name: min(way.travel.mean for way in ways if way.name == name) for name in BRACKETS}
    ts, gss = paper_number("travel/TS").value, paper_number("travel/GSS").value
    speed = FASTEST.speed_deg_s
    return (
        (
            f"The paper's travel, {ts:g}° and {gss:g}°, cannot be reproduced. Even if the order within each pair were "
            f"chosen for the shortest way, TS would turn by {shortest['TS']:.0f}° and GSS by {shortest['GSS']:.0f}° on "
            "average."
        ),
        (
            f"Its 1 to 2 s are the times for {ts:g}° and {gss:g}° at {speed:g}°/s without a single stop: "
            f"{ts / speed:.1f} s and {gss / speed:.1f} s. A stage that stops for each of 16 acquisitions takes longer."
        ),
        (
            "The advantage over manual search does not depend on it: with acquisitions in real time a whole search "
            "takes far less than 2 to 3 min. With files of 10 s each, reading takes nearly all of the time, as the "
            "paper says."
        ),
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
            yerr=[_half(way.travel) for way in here],
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
