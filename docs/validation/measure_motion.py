"""Search for a marker that moves: the figures of "A marker that moves" in ``answers.md``.

``python docs/validation/measure_motion.py 80``: so many searches a row; each is a line of ``out/motion.csv``, and the
table is ``docs/data/answers-motion.csv``. ``… 80 "at rest" breaths 0.3`` measures the rows with these words alone.

The motions are not those with which the search was built (`sim.motion`): a sine just along the turn, whose truth is its
middle, and breaths of which no two are equal, in any direction, with a heartbeat and a drift, whose truth is the end of
exhalation. No search is told of them.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from markerseek import find_marker
from markerseek.core import DeviceError, Float64, SearchPlan
from markerseek.rigs import Rig
from markerseek.sim import LaserSettings, NoiseSettings, ReceiverSettings, SimulatedSettings, StageMotion, TissueMotion
from markerseek.studies import Share, Study, cells, study_policy
from markerseek.studies.unknowns import DrawnScene
from markerseek.studies.worlds import draw_trial, study_rig

SEED = 20261130
ROOT = Path(__file__).parents[2]
SEARCHES = ROOT / "out" / "motion.csv"
TABLE = ROOT / "docs" / "data" / "answers-motion.csv"

Acquisitions = Literal["at rest", "sweep"]
Shape = Literal["sine along the turn", "breaths in any direction"]
AMPLITUDES_MM = (0.0, 0.3, 1.0, 2.0)
LASTS_S = 900.0
"""Time for which breaths are drawn."""


class Sine(TissueMotion, frozen=True, kw_only=True):
    """To and fro about the truth at 0.25 Hz."""

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """Displacement at times of the rig's clock."""
        return np.asarray(1e-3 * self.breathing_mm * np.sin(2 * np.pi * (0.25 * at_s + (self.phase or 0.0))))


class Breaths(TissueMotion, frozen=True, kw_only=True):
    """Breaths as they are recorded: quickly in, slowly out, of unequal length and depth, with heartbeat and drift."""

    begins_s: tuple[float, ...] = ()
    """When each breath begins."""
    depth: tuple[float, ...] = ()
    """Depth of each over the mean."""

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """Displacement at times of the rig's clock."""
        begins_s = np.array(self.begins_s)
        number = np.clip(np.searchsorted(begins_s, at_s, side="right") - 1, 0, begins_s.size - 2)
        since = (at_s - begins_s[number]) / np.diff(begins_s)[number]
        inhaled = 0.5 - 0.5 * np.cos(np.pi * np.clip(since / 0.35, 0.0, 1.0))
        exhaled = np.exp(-np.maximum(since - 0.35, 0.0) / 0.13)
        breath_mm = 2 * self.breathing_mm * np.array(self.depth)[number] * inhaled * exhaled
        heart_mm = 0.05 * np.sin(2 * np.pi * 1.15 * at_s)
        drift_mm = 0.1 * np.sin(2 * np.pi * at_s / 130.0)
        return np.asarray(1e-3 * (breath_mm + heart_mm + drift_mm))


def motion_of(shape: Shape, amplitude_mm: float, *, marker_deg: float, rng: np.random.Generator) -> TissueMotion:
    """Draw the motion of one search."""
    at = math.radians(marker_deg)
    x, y, z = rng.standard_normal(3).tolist()
    phase = float(rng.random())
    if shape == "sine along the turn":
        along_turn = (math.cos(at), 0.0, -math.sin(at))
        return Sine(breathing_mm=amplitude_mm, phase=phase, direction=along_turn)
    lasts_s = rng.uniform(3.0, 5.0) * np.exp(0.12 * rng.standard_normal(400))
    begins_s = np.cumsum(lasts_s) - lasts_s[0] * (1 + phase)
    return Breaths(
        breathing_mm=amplitude_mm,
        phase=phase,
        direction=(x, y, z),
        begins_s=tuple(begins_s[begins_s < LASTS_S].tolist()),
        depth=tuple(np.exp(0.15 * rng.standard_normal(400)).tolist()),
    )


def drawn_rig(number: int, *, acquisitions: Acquisitions, shape: Shape, amplitude_mm: float) -> Rig:
    """The simulated rig, with all that is not known drawn: the same for each motion."""
    sweep = acquisitions == "sweep"
    settings = SimulatedSettings(start_deg=-35.0, noise=NoiseSettings(peak_snr_db=40.0))
    if sweep:
        settings = SimulatedSettings(
            start_deg=-35.0,
            noise=NoiseSettings(peak_snr_db=40.0),
            laser=LaserSettings(rate_hz=20.0, energy_jitter=0.1),
            stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
            receiver=ReceiverSettings(readout_s=0.05),
        )
    study = Study(
        name="motion",
        seed=SEED,
        trials=number + 1,
        level="frames",
        drawn="everything-and-timing" if sweep else "everything",
        policies=(study_policy(method="posterior", sweep=sweep),),
        rig=settings,
    )
    (cell,) = cells(study)
    draw = draw_trial(study, cell, number)
    if amplitude_mm > 0:
        rng = np.random.Generator(np.random.PCG64([SEED, number]))
        motion = motion_of(shape, amplitude_mm, marker_deg=draw.marker_deg, rng=rng)
        draw = replace(draw, scene=DrawnScene(motion=motion))
    return study_rig(study, cell, draw)


class Search(NamedTuple):
    """One search, a line of the file."""

    acquisitions: Acquisitions
    shape: Shape
    amplitude_mm: float
    number: int
    answer: str
    error_deg: float = math.nan
    """Angle less the true one."""
    sigma_deg: float = math.nan
    covered: bool | None = None
    """Whether the 95 % interval holds the truth; None if there is none."""
    half_deg: float = math.nan
    lateral_mm: float | None = None
    depth_mm: float | None = None
    turn_sigma_mm: float = math.nan
    elapsed_s: float = math.nan
    steps: int = 0
    said: str = ""
    """What is said of the motion, and the reason of an answer that is none."""

    half_width_m: float | None = None
    """Half of the interval as a length at the marker."""

    @property
    def beyond(self) -> bool:
        """Whether it is found, and off by more than twice the tolerance of 1 mm."""
        if self.answer != "found" or self.half_width_m is None:
            return False
        return abs(self.error_deg) / self.half_deg * self.half_width_m > 2e-3


def searched(number: int, *, acquisitions: Acquisitions, shape: Shape, amplitude_mm: float) -> Search:
    """Search once."""
    asked = Search(acquisitions, shape, amplitude_mm, number, "refused")
    rig = drawn_rig(number, acquisitions=acquisitions, shape=shape, amplitude_mm=amplitude_mm)
    try:
        result = find_marker(rig, SearchPlan(sweep=acquisitions == "sweep", stay=True))
    except DeviceError as problem:
        return asked._replace(said=str(problem))
    estimate = result.estimate
    truth_deg = result.run.facts.truth_deg or 0.0
    interval = estimate.interval95_deg
    motion = estimate.motion
    asked = asked._replace(
        answer=result.answer,
        error_deg=estimate.mean_deg - truth_deg,
        elapsed_s=result.elapsed_s,
        steps=result.acquisitions,
        said=getattr(estimate, "reason", ""),
    )
    if interval is not None and estimate.sigma_deg is not None:
        asked = asked._replace(
            sigma_deg=estimate.sigma_deg,
            covered=truth_deg in interval,
            half_deg=interval.width_deg / 2,
            half_width_m=estimate.half_width_m,
        )
    if motion is not None:
        asked = asked._replace(
            lateral_mm=motion.lateral_mm, depth_mm=motion.depth_mm, turn_sigma_mm=motion.turn_sigma_mm
        )
    return asked


class Line(NamedTuple):
    """A row of the table; shares in per cent."""

    world: str
    searches: int
    found: float
    found_low: float
    found_high: float
    error_deg: float
    """Median error of the found."""
    covered: float
    covered_low: float
    covered_high: float
    """Of the found."""
    beyond_twice_the_tolerance: int
    """Of the found."""
    others: int
    """Those that are not found."""
    others_named: int
    """Of these: motion is named as a reason."""


def line_of(rows: Sequence[Search]) -> Line:
    """Count the searches of one row."""
    found = [row for row in rows if row.answer == "found"]
    others = [row for row in rows if row.answer != "found"]
    first = rows[0]
    motion = f"{first.shape}, ± {first.amplitude_mm:g} mm" if first.amplitude_mm > 0 else "no motion"
    return Line(
        f"{first.acquisitions}, {motion}",
        len(rows),
        *percents(len(found), len(rows)),
        round(float(np.median([abs(row.error_deg) for row in found])), 3) if found else math.nan,
        *percents(sum(bool(row.covered) for row in found), len(found)),
        sum(row.beyond for row in found),
        len(others),
        sum("the marker moves" in row.said for row in others),
    )


def percents(count: int, of: int) -> tuple[float, float, float]:
    """A share in per cent, and its 95 % limits."""
    share = Share.of(count, of)
    low, high = share.interval95 or (0.0, 1.0)
    return round(100 * (share.share or 0.0), 1), round(100 * low, 1), round(100 * high, 1)


def main() -> None:
    """Search, and write the table row by row."""
    count = int(sys.argv[1])
    kinds: list[tuple[Acquisitions, Shape, float]] = [
        (acquisitions, shape, amplitude_mm)
        for acquisitions, amplitude_mm, shape in product(
            ("at rest", "sweep"), AMPLITUDES_MM, ("sine along the turn", "breaths in any direction")
        )
        if amplitude_mm > 0 or shape == "sine along the turn"
    ]
    chosen = [kind for kind in kinds if all(word in f"{kind}" for word in sys.argv[2:])]
    SEARCHES.parent.mkdir(exist_ok=True)
    with (
        ProcessPoolExecutor(2) as pool,
        SEARCHES.open("w", encoding="utf-8", newline="") as searches,
        TABLE.open("w", encoding="utf-8", newline="") as table,
    ):
        every = csv.writer(searches)
        every.writerow(Search._fields)
        lines = csv.writer(table, lineterminator="\n")
        lines.writerow(Line._fields)
        for acquisitions, shape, amplitude_mm in chosen:
            search = partial(searched, acquisitions=acquisitions, shape=shape, amplitude_mm=amplitude_mm)
            rows = list(pool.map(search, range(count)))
            every.writerows(rows)
            lines.writerow(line_of(rows))
            searches.flush()
            table.flush()


if __name__ == "__main__":
    main()
