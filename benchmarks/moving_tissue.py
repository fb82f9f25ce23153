"""Searches in tissue that moves while cameras follow it: found, error and coverage without and with what they see.

``python -m benchmarks.moving_tissue --searches 32 --out docs/data/moving-tissue.csv`` runs the searches that the file
does not have yet, and prints the table. Nothing here was used to build the method: the tissue moves as a saw, or as a
trace with breaths of uneven length and depth, heartbeat and drift, and not as `markerseek.sim` has it; the cameras are
late, miss images, are off by their noise, by the rotation to the probe and by the rate of their clock. All else is
drawn as in a study that draws everything.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from msgspec import structs

from markerseek.core import Clock, DeviceError, Displacement, Finished, Float64, FollowedTissue, Found, SearchPlan
from markerseek.rigs import Rig, rig_in_world, scene_of
from markerseek.runs import new_run, plan_on
from markerseek.sim import STREAMING, SimulatedSettings, StainedSpot, VirtualClock, tissue_named
from markerseek.studies.unknowns import draw_unknowns
from markerseek.vision.tissue_motion import DisplacementSeries, TissueMoves, tissue_motion

FIRST_SEED = 71_001
"""Seed of the first search of each row; nothing was chosen on these."""

LATERAL_M = 10e-3
"""Markers lie within this of the middle of the array."""


class Saw:
    """The whole way in 1.2 s, back in as long, then a pause; the next breath comes after 3.4 to 4.6 s."""

    moves = True

    def __init__(self, rng: np.random.Generator, amplitude_mm: float) -> None:
        self._direction = _direction(rng)
        self._way_m = 2e-3 * amplitude_mm
        self._period_s = float(rng.uniform(3.4, 4.6))
        self._begin_s = float(rng.uniform(0.0, self._period_s))

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """Displacement in the direction of motion."""
        since_s = (at_s - self._begin_s) % self._period_s
        return np.asarray(self._way_m * np.clip(1 - np.abs(since_s - 1.2) / 1.2, 0.0, None))

    def displacement_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, "times 3"]:
        """Displacement in the TRUS frame."""
        return np.asarray(self.way_m(at_s)[:, None] * self._direction)


class Trace:
    """Breaths of uneven length and depth on a narrow loop, with heartbeat and drift, as recordings of patients have."""

    moves = True

    def __init__(self, rng: np.random.Generator, amplitude_mm: float) -> None:
        self._direction = _direction(rng)
        self._across = np.cross(self._direction, _direction(rng))
        count = 400
        self._begin_s = np.cumsum(rng.normal(4.0, 0.2, count)) - float(rng.uniform(40.0, 44.0))
        self._rise_s = rng.normal(0.35, 0.03, count)
        self._depth_m = 2e-3 * amplitude_mm * rng.normal(1.0, 0.06, count)
        self._heart_m = 0.05e-3
        self._drift_m_s = 1e-3 * float(rng.normal(0.0, 0.1)) / 60
        self._heart_s = float(rng.uniform(0.75, 1.05))

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """Displacement in the direction of motion: an exponential rise and fall for each breath."""
        breath = np.zeros(len(at_s))
        for begin_s, rise_s, depth_m in zip(self._begin_s, self._rise_s, self._depth_m, strict=True):
            since = np.clip((at_s - begin_s) / rise_s, 0.0, None)
            breath += depth_m * (since / 2) ** 2 * np.exp(2 - since)
        heart = self._heart_m * np.sin(2 * np.pi * at_s / self._heart_s)
        return np.asarray(breath + heart + self._drift_m_s * at_s)

    def displacement_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, "times 3"]:
        """Displacement in the TRUS frame; it comes back beside the way on which it went."""
        now = self.way_m(at_s)
        return np.asarray(now[:, None] * self._direction + 0.15 * self.way_m(at_s - 0.3)[:, None] * self._across)


class Still:
    """Tissue at rest."""

    moves = False

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """None."""
        return np.zeros(len(at_s))

    def displacement_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, "times 3"]:
        """None."""
        return np.zeros((len(at_s), 3))


def _direction(rng: np.random.Generator) -> Float64[np.ndarray, " 3"]:
    """A unit vector, evenly over the sphere."""
    drawn = rng.standard_normal(3)
    return np.asarray(drawn / np.linalg.norm(drawn))


Motion = Saw | Trace | Still

RATE_HZ = 20.0
LATE_S = 0.06
MISSING = 0.05
ACROSS_MM = 0.05
ALONG_MM = 0.3
CLOCK_SIGMA_S = 10e-3
CLOCK_DRIFT = 50e-6
ROTATION_SIGMA_DEG = 1.5
"""Rate and lateness of the images, the share that is missing, the error of a displacement across and along the view,
what is not known of the cameras' clock and by how much it is fast, and the error of their rotation to the probe."""

GAP_S = 0.3
"""Images further apart do not say what was in between."""


@dataclass
class Cameras:
    """Two cameras that follow the tissue: a `FollowedTissue`."""

    motion: Motion
    clock: Clock
    rng: np.random.Generator
    turned: bool = True
    """Whether the rotation between cameras and probe is known."""
    gates: bool = True
    """Whether the pause is told."""
    began_s: float = -30.0
    """When they began to look."""
    _seen_mm: list[Float64[np.ndarray, " 3"] | None] = field(default_factory=list)
    _told: tuple[int, TissueMoves | None] = (-1, None)

    def __post_init__(self) -> None:
        self._off_s = CLOCK_SIGMA_S * float(self.rng.standard_normal())
        self._view = _direction(self.rng)
        if self._view[2] > 0:
            self._view = -self._view
        self._covariance_mm2 = ACROSS_MM**2 * np.eye(3)
        self._covariance_mm2 += (ALONG_MM**2 - ACROSS_MM**2) * np.outer(self._view, self._view)
        turn = math.radians(ROTATION_SIGMA_DEG) * self.rng.standard_normal(3)
        self._rotation = np.eye(3) + np.cross(np.eye(3), turn)

    @property
    def known_after_s(self) -> float:
        """An image later on, and its lateness."""
        return LATE_S + 1 / RATE_HZ

    @property
    def breath_s(self) -> float | None:
        """As the images so far tell."""
        return None if self._moves is None else self._moves.period_s

    @property
    def pause_s(self) -> float:
        """As the images so far tell."""
        return 0.0 if self._moves is None else self._moves.pause_s

    def rests(self, for_s: float) -> bool | None:
        """As the images so far tell."""
        if self._moves is None:
            return True
        now_s = self.clock.now_s()
        return self._moves.in_pause(now_s) and self._moves.in_pause(now_s + for_s)

    def displacement(self, at_s: float) -> Displacement | None:
        """Interpolated between two images."""
        place = (at_s - self.began_s) * RATE_HZ
        before, after = self._around(place)
        if before is None or after is None or (after - before) / RATE_HZ > GAP_S:
            return None
        share = (place - before) / (after - before)
        seen_mm = (1 - share) * self._image_mm(before) + share * self._image_mm(after) - self._rest_mm
        covariance_mm2 = ((1 - share) ** 2 + share**2) * self._covariance_mm2
        if not self.turned:
            size_mm2 = float(seen_mm @ seen_mm)
            return Displacement(mm=(0.0, 0.0, 0.0), covariance_mm2=_rows(covariance_mm2 + size_mm2 / 3 * np.eye(3)))
        turned_mm = math.radians(ROTATION_SIGMA_DEG) * float(np.linalg.norm(seen_mm))
        x, y, z = seen_mm.tolist()
        return Displacement(mm=(x, y, z), covariance_mm2=_rows(covariance_mm2 + turned_mm**2 * np.eye(3)))

    def _around(self, place: float) -> tuple[int | None, int | None]:
        """Numbers of the images before and after a moment that are not missing."""
        self._look()
        before = next((each for each in range(math.floor(place), -1, -1) if self._is_seen(each)), None)
        later = range(math.floor(place) + 1, len(self._seen_mm))
        return before, next((each for each in later if self._is_seen(each)), None)

    def _is_seen(self, number: int) -> bool:
        return number < len(self._seen_mm) and self._seen_mm[number] is not None

    def _image_mm(self, number: int) -> Float64[np.ndarray, " 3"]:
        seen_mm = self._seen_mm[number]
        assert seen_mm is not None
        return seen_mm

    def _look(self) -> None:
        """Take the images that have come."""
        last = math.floor((self.clock.now_s() - LATE_S - self.began_s) * RATE_HZ)
        first = len(self._seen_mm)
        if last < first:
            return
        numbers = np.arange(first, last + 1)
        true_s = self.began_s + numbers / RATE_HZ * (1 + CLOCK_DRIFT) + self._off_s
        noise = self.rng.multivariate_normal(np.zeros(3), self._covariance_mm2, size=len(numbers))
        seen_mm = 1e3 * self.motion.displacement_m(true_s) @ self._rotation.T + noise
        missing = self.rng.random(len(numbers)) < MISSING
        self._seen_mm += [None if lost else each for each, lost in zip(seen_mm, missing, strict=True)]

    @property
    def _moves(self) -> TissueMoves | None:
        """How the tissue moves, by the images of the last 30 s; computed again every 2 s."""
        self._look()
        turn = math.floor(self.clock.now_s() / 2)
        if turn != self._told[0]:
            self._told = (turn, tissue_motion(self._series) if self.gates else None)
        return self._told[1]

    @property
    def _series(self) -> DisplacementSeries:
        numbers = [each for each in range(max(0, len(self._seen_mm) - 600), len(self._seen_mm)) if self._is_seen(each)]
        return DisplacementSeries(
            at_s=np.array([self.began_s + each / RATE_HZ for each in numbers]),
            displacements_m=1e-3 * np.array([self._image_mm(each) for each in numbers]),
            covariances_m2=1e-6 * np.tile(self._covariance_mm2, (len(numbers), 1, 1)),
        )

    @cached_property
    def _rest_mm(self) -> Float64[np.ndarray, " 3"]:
        """Where the images of the first 30 s show it at rest."""
        moves = tissue_motion(self._series)
        if moves is None:
            return np.asarray(np.mean([each for each in self._seen_mm if each is not None], axis=0))
        return np.array(moves.rest_mm)


def _rows(
    matrix: Float64[np.ndarray, "3 3"],
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    first, second, third = (tuple(row) for row in matrix.tolist())
    return first, second, third


def _cameras(how: str, motion: Motion, rig: Rig, rng: np.random.Generator) -> FollowedTissue | None:
    """What a search gets of the cameras, by its name in `HOW`."""
    if how == "none":
        return None
    return Cameras(motion, rig.scanner.clock, rng, turned=how != "gate", gates=how != "shift")


HOW = ("none", "shift", "gate", "both")
"""What a search gets of the cameras: nothing, displacements, the pause and the size of displacements, or all of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One search."""

    amplitude_mm: float
    snr_db: float
    mode: str
    how: str
    seed: int
    answer: str
    error_deg: float
    covered: bool
    sigma_deg: float
    length_mm: float
    """Error as a length at the marker."""
    tolerance_deg: float
    acquisitions: int
    elapsed_s: float


def searched(amplitude_mm: float, snr_db: float, mode: str, how: str, seed: int) -> Row:
    """Run one search."""
    rng = np.random.default_rng((seed, round(100 * amplitude_mm), round(snr_db)))
    kind = Saw if seed % 2 else Trace
    motion: Motion = kind(rng, amplitude_mm) if amplitude_mm else Still()
    rig, truth_deg, radius_m = _rig(rng, snr_db=snr_db, sweep=mode == "sweep", motion=motion)
    tissue = _cameras(how, motion, rig, np.random.default_rng((seed, 1)))
    plan = plan_on(rig, SearchPlan(sweep=mode == "sweep"))
    running = new_run(rig, plan, tissue=tissue)
    finished: Finished | None = None
    for event in running.events():
        if isinstance(event, Finished):
            finished = event
    assert finished is not None
    estimate = finished.estimate
    error_deg = abs(estimate.mean_deg - truth_deg)
    interval = estimate.interval95_deg
    return Row(
        amplitude_mm=amplitude_mm,
        snr_db=snr_db,
        mode=mode,
        how=how,
        seed=seed,
        answer="found" if isinstance(estimate, Found) else getattr(estimate, "doubt", type(estimate).__name__.lower()),
        error_deg=round(error_deg, 4),
        covered=interval is not None and interval.low_deg <= truth_deg <= interval.high_deg,
        sigma_deg=round(estimate.sigma_deg or math.nan, 4),
        length_mm=round(1e3 * radius_m * math.radians(error_deg), 4),
        tolerance_deg=round(plan.tolerance.half_width_deg(radius_m), 4),
        acquisitions=finished.acquisitions,
        elapsed_s=round(finished.elapsed_s, 2),
    )


def _rig(rng: np.random.Generator, *, snr_db: float, sweep: bool, motion: Motion) -> tuple[Rig, float, float]:
    """A rig with everything drawn, whose tissue moves; its marker's angle at rest, and distance from the axis."""
    settings = STREAMING if sweep else SimulatedSettings()
    settings = structs.replace(settings, noise=structs.replace(settings.noise, peak_snr_db=snr_db))
    limits = settings.limits.search
    marker_deg = float(rng.uniform(limits.low_deg, limits.high_deg))
    unknowns = draw_unknowns(
        rng, marker_deg=marker_deg, lateral_m=float(rng.uniform(-LATERAL_M, LATERAL_M)), receiver=settings.receiver
    )
    settings = structs.replace(settings, probe=unknowns.model.probe)
    material = structs.replace(tissue_named(settings.tissue), spot=StainedSpot(grain=unknowns.marker.source))
    scene = scene_of(material, unknowns.marker, settings, unknowns.model, rng)
    world = scene.world(settings, rng)
    world.motion = motion  # type: ignore[assignment]
    rig = rig_in_world(world, settings, "moving tissue", truth_deg=marker_deg, rng=rng, clock=VirtualClock())
    return rig, marker_deg, unknowns.marker.radius_m


def table(rows: Sequence[Row]) -> Iterator[str]:
    """The rows of the table, a cell of searches each."""
    cells = sorted({(row.mode, row.snr_db, row.amplitude_mm, row.how) for row in rows})
    yield "mode   dB  mm    cameras  searches  found  median error mm  covered  > 2 tolerances  acquisitions  s"
    for mode, snr_db, amplitude_mm, how in cells:
        own = [
            row
            for row in rows
            if (row.mode, row.snr_db, row.amplitude_mm, row.how) == (mode, snr_db, amplitude_mm, how)
        ]
        found = [row for row in own if row.answer == "found"]
        error_mm = float(np.median([row.length_mm for row in found])) if found else math.nan
        wrong = sum(row.error_deg > 2 * row.tolerance_deg for row in found)
        yield (
            f"{mode:5} {snr_db:3.0f} {amplitude_mm:4.1f}  {how:6} {len(own):8} {len(found):7} {error_mm:12.2f} "
            f"{sum(row.covered for row in found):12} {wrong:12} {np.mean([row.acquisitions for row in own]):13.1f} "
            f"{np.mean([row.elapsed_s for row in own]):8.0f}"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=32)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--amplitudes-mm", type=float, nargs="+", default=[0.0, 0.3, 1.0, 2.0])
    parser.add_argument("--snr-db", type=float, nargs="+", default=[40.0, 30.0])
    parser.add_argument("--modes", nargs="+", default=["rest", "sweep"])
    parser.add_argument("--how", nargs="+", default=list(HOW))
    asked = parser.parse_args(arguments)
    rows = list(_read(asked.out))
    known = {(row.amplitude_mm, row.snr_db, row.mode, row.how, row.seed) for row in rows}
    seeds = range(FIRST_SEED, FIRST_SEED + asked.searches)
    with asked.out.open("a", newline="") as file:
        writer = csv.writer(file)
        if not rows:
            writer.writerow([each.name for each in fields(Row)])
        for seed, *cell in product(seeds, asked.amplitudes_mm, asked.snr_db, asked.modes, asked.how):
            if (*cell, seed) in known:
                continue
            try:
                row = searched(*cell, seed)
            except DeviceError as problem:
                sys.stderr.write(f"{cell} {seed}: {problem}\n")
                continue
            rows.append(row)
            writer.writerow([getattr(row, each.name) for each in fields(Row)])
            file.flush()
    sys.stdout.write("\n".join(table(rows)) + "\n")


def _read(path: Path) -> Iterator[Row]:
    """The rows of a file; none where there is none."""
    if not path.exists() or not path.stat().st_size:
        return
    kinds = {"float": float, "int": int, "str": str, "bool": lambda text: text == "True"}
    with path.open(newline="") as file:
        for each in csv.DictReader(file):
            yield Row(**{name.name: kinds[str(name.type)](each[name.name]) for name in fields(Row)})


if __name__ == "__main__":
    main()
