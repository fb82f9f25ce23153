"""Rotation travel and time of a search (section 4 of the paper), from the stage's motion profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.pictures import Line, Panel, panels_figure
from markerseek.sim import LaserSettings, ReceiverSettings, StageMotion
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.look import COLOURS
from markerseek.studies.paper.methods import NAMES, TABLE_ACQUISITIONS, Name
from markerseek.studies.paper.reported import reported
from markerseek.studies.paper.rotation import quiet_track, rotation_s, shortest_order, travel_deg
from markerseek.studies.paper.section import Beside, Cell, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FASTEST = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)
"""The stage at the limits of its data sheet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Way:
    """One way to count: which method, in which order, from where."""

    name: Name
    order: str
    start: str
    travel: Mean
    rotation: Mean
    fastest: Mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """Mean, standard deviation, and half the 95 % interval of the mean."""

    value: float
    spread: float
    half: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Mean:
        """Summary of two values or more."""
        spread = float(np.std(values, ddof=1))
        return cls(value=float(np.mean(values)), spread=spread, half=1.96 * spread / float(np.sqrt(len(values))))


def travel(effort: Effort) -> Section:
    """Rotation travel and time of 16 acquisitions, for markers spread evenly over ±35°.

    Parameters
    ----------
    effort
        What may be used: its number of markers.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([effort.seed, 4])))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, effort.markers)
    effort.advance("travel", 0, len(NAMES))
    ways: list[_Way] = []
    for number, name in enumerate(NAMES, start=1):
        tracks = [quiet_track(name, float(marker), acquisitions=TABLE_ACQUISITIONS)[0] for marker in markers_deg]
        ways += _ways(name, tracks)
        effort.advance("travel", number, len(NAMES))
    return Section(
        name="travel",
        title=f"Rotation travel and time of {TABLE_ACQUISITIONS} acquisitions",
        method=(
            (
                f"{effort.markers} markers spread evenly over ±35°, without noise: the angles asked for then follow "
                "from the marker's angle alone, whatever symmetric unimodal curve is searched. Time of rotation is "
                "that of a stage with a trapezoidal speed that comes to rest at each angle and approaches it from "
                "below: at 10°/s and 10°/s², the defaults, and at 25°/s and 25°/s², the largest of its data sheet."
            ),
        ),
        besides=_besides(ways),
        tables=(_travel_table(ways), _time_table(ways)),
        pictures=(
            Picture(
                name="travel",
                alt="Rotation travel of each method beside the paper's numbers",
                draw=partial(_draw, ways),
            ),
        ),
        remarks=_remarks(ways),
    )


def _ways(name: Name, tracks: Sequence[list[float]]) -> list[_Way]:
    low_deg = PAPER_RANGE.low_deg
    orders: dict[str, Callable[[list[float]], list[float]]] = {"as printed": lambda track: track}
    if name != "WA":
        orders["shortest order"] = lambda track: shortest_order(track, start_deg=low_deg)
    ways = []
    for order, ordered in orders.items():
        for start, before in {"from the first angle": [], "from -35 deg": [low_deg]}.items():
            whole = [[*before, *ordered(track)] for track in tracks]
            ways.append(
                _Way(
                    name=name,
                    order=order,
                    start=start,
                    travel=Mean.of([travel_deg(track) for track in whole]),
                    rotation=Mean.of([rotation_s(track, motion=StageMotion()) for track in whole]),
                    fastest=Mean.of([rotation_s(track, motion=FASTEST) for track in whole]),
                )
            )
    return ways


def _besides(ways: Sequence[_Way]) -> tuple[Beside, ...]:
    besides = []
    for way in ways:
        condition = f"{way.name}, {way.order}, {way.start}"
        if way.name != "WA":
            paper = reported(f"travel/{way.name}")
            besides.append(
                Beside(
                    paper=paper,
                    ours=way.travel.value,
                    spread=way.travel.spread,
                    half=way.travel.half,
                    condition=condition,
                )
            )
    for way in ways:
        if way.name != "WA" and way.order == "as printed" and way.start == "from the first angle":
            for motion, spent in (("10°/s", way.rotation), ("25°/s", way.fastest)):
                besides.append(
                    Beside(
                        # the shorter of the paper's two times belongs to its shorter travel
                        paper=reported("travel/high" if way.name == "TS" else "travel/low"),
                        ours=spent.value,
                        spread=spent.spread,
                        half=spent.half,
                        condition=f"{way.name}, {motion}",
                    )
                )
    return tuple(besides)


def _travel_table(ways: Sequence[_Way]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            way.name,
            way.order,
            way.start,
            way.travel.value,
            way.travel.spread,
            way.travel.half,
            way.rotation.value,
            way.fastest.value,
        )
        for way in ways
    ]
    return Table(
        name="travel",
        caption="Rotation travel and time of rotation",
        columns=(
            "method",
            "order",
            "counted",
            "travel_deg",
            "spread_deg",
            "half_interval95_deg",
            "rotation_at_10_deg_s_s",
            "rotation_at_25_deg_s_s",
        ),
        rows=tuple(rows),
    )


def _time_table(ways: Sequence[_Way]) -> Table:
    """Whole searches from −35°, with acquisitions read as files and in real time, beside manual search."""
    laser = LaserSettings()
    lit_s = laser.pulses / laser.rate_hz
    readings = {"SonixDAQ files": ReceiverSettings().readout_s, "real time": 0.0}
    rows: list[tuple[Cell, ...]] = []
    for way in ways:
        if way.order == "as printed" and way.start == "from -35 deg":
            for kind, readout_s in readings.items():
                acquiring_s = TABLE_ACQUISITIONS * (readout_s + lit_s)
                rows.append((way.name, kind, way.rotation.value, acquiring_s, way.rotation.value + acquiring_s))
    for key in ("manual/low", "manual/high", "manual/registration"):
        number = reported(key)
        rows.append((f"paper: {number.what}", None, None, None, number.mean))
    return Table(
        name="travel_time",
        caption=f"Time of a whole search of {TABLE_ACQUISITIONS} acquisitions from -35 deg at 10 deg/s, 16 pulses at "
        "100 Hz each, beside the paper's manual search",
        columns=("method", "acquisition", "rotation_s", "acquiring_s", "total_s"),
        rows=tuple(rows),
    )


def _remarks(ways: Sequence[_Way]) -> tuple[str, ...]:
    shortest = {name: min(way.travel.value for way in ways if way.name == name) for name in ("TS", "GSS")}
    ts, gss = reported("travel/TS").mean, reported("travel/GSS").mean
    speed = FASTEST.speed_deg_s
    return (
        (
            f"The paper's travel, {ts:g}° and {gss:g}°, does not replay. Even if the order within each pair "
            f"were chosen for the shortest way, TS turns by {shortest['TS']:.0f}° and GSS by {shortest['GSS']:.0f}° on "
            "average."
        ),
        (
            f"Its 1 to 2 s are what {ts:g}° and {gss:g}° take at {speed:g}°/s without a single stop: {ts / speed:.1f} "
            f"s and {gss / speed:.1f} s. A stage that stops for each of 16 acquisitions takes longer."
        ),
        (
            "The advantage over manual search does not hang on it: with acquisitions in real time a whole search stays "
            "far below 2 to 3 min. With files of 10 s each, reading takes nearly all of the time, as the paper says."
        ),
    )


def _draw(ways: Sequence[_Way]) -> Figure:
    panels = []
    for name in ("TS", "GSS"):
        here = [way for way in ways if way.name == name]
        bars = Line(
            label=f"{name}, ours",
            x=tuple(float(number) for number in range(1, len(here) + 1)),
            y=tuple(way.travel.value for way in here),
            half=tuple(way.travel.half for way in here),
            colour=COLOURS["TS" if name == "TS" else "GSS"],
            form="bar",
        )
        paper = reported(f"travel/{name}").mean
        level = Line(label="paper", x=(0.0,), y=(paper,), colour="#222222", form="level")
        ticks = tuple(f"{way.order},\n{way.start}" for way in here)
        panels.append(Panel(title=name, lines=(bars, level), ticks=ticks))
    return panels_figure(
        panels,
        title=f"Rotation travel of {TABLE_ACQUISITIONS} acquisitions",
        across="order within a pair, and where the travel is counted from",
        up="travel [deg]",
        columns=2,
        panel_in=(5.2, 3.2),
    )
