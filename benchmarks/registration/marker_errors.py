"""Errors of marker positions from simulated searches, for the registrations of the study to draw from."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np

from markerseek.core import SearchPlan
from markerseek.files import replace_file
from markerseek.registration import REGISTRATION_TOLERANCE_MM
from markerseek.rigs import draw_scene, simulated
from markerseek.runs import new_run, plan_on
from markerseek.sim import SimulatedSettings, tissue_named

KEPT = "marker_errors.csv"
"""Table of the searches that were made; ``python -m benchmarks.registration --searches`` makes it."""

SEARCHES = {
    "plastisol-phantom": range(1, 301),
    "liver": range(1, 81),
    "chicken-breast": range(1, 51),
    "muscle": range(1, 81),
    "muscle-icg": range(1, 51),
}
"""Materials and seeds of these searches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerError:
    """One search: what its marker's position was off by, and what the search said."""

    tissue: str
    seed: int
    """``tissue`` and ``seed``: material and seed of the search, at the rig's default settings (40 dB)."""
    acquisitions: int
    angle_m: float
    lateral_m: float
    depth_m: float
    """``angle_m``, ``lateral_m`` and ``depth_m``: errors along the turn, along the axis, and away from the axis. The
    truth is the centroid of the absorbed energy."""
    angle_sigma_m: float
    lateral_sigma_m: float
    depth_sigma_m: float
    """``angle_sigma_m``, ``lateral_sigma_m`` and ``depth_sigma_m``: standard deviations that the result gives."""


def search_errors(tissue: str, seeds: Sequence[int]) -> Iterator[MarkerError]:
    """Search once for each seed on the simulated rig; a search that does not know its source is left out.

    ``tissue``: simulated material.
    """
    settings = SimulatedSettings(tissue=tissue)
    for seed in seeds:
        rig = simulated(seed=seed, settings=settings)
        plan = SearchPlan(method="posterior", start_deg=rig.stage.angle_deg, tolerance_mm=REGISTRATION_TOLERANCE_MM)
        run = new_run(rig, plan_on(rig, plan))
        with closing(run.events()) as events:
            for _ in events:
                pass
        result = run.result()
        marker = result.marker
        if marker is None:
            continue
        true_angle, true_y, true_radius = _middle_of_spot(settings, seed)
        x, y, z = marker.position_m
        yield MarkerError(
            tissue=tissue,
            seed=seed,
            acquisitions=result.acquisitions,
            angle_m=(math.atan2(x, z) - true_angle) * true_radius,
            lateral_m=y - true_y,
            depth_m=math.hypot(x, z) - true_radius,
            angle_sigma_m=marker.sigma_m[0],
            lateral_sigma_m=marker.sigma_m[1],
            depth_sigma_m=marker.sigma_m[2],
        )


def _middle_of_spot(settings: SimulatedSettings, seed: int) -> tuple[float, float, float]:
    """Angle (rad), lateral position and distance from the axis (m) of the centroid of the absorbed energy."""
    # `simulated` draws the scene first, so that the same seed draws the same one here.
    scene = draw_scene(settings, np.random.default_rng(seed))
    spot = scene.absorbers[: tissue_named(settings.tissue).spot.count]
    strength = np.array([absorber.strength for absorber in spot])
    turned = np.radians([absorber.angle_deg for absorber in spot])
    radius_m = np.array([absorber.radius_m for absorber in spot])
    x, z, y = (
        float(np.average(place, weights=strength))
        for place in (radius_m * np.sin(turned), radius_m * np.cos(turned), [each.lateral_m for each in spot])
    )
    return math.atan2(x, z), y, math.hypot(x, z)


def write_errors(errors: Sequence[MarkerError], path: Path) -> None:
    """Write searches as a CSV, lengths to the nanometre."""
    names = [field.name for field in fields(MarkerError)]
    with replace_file(path) as part, part.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(names)
        for error in errors:
            values = asdict(error)
            writer.writerow([f"{values[name]:.9f}" if name.endswith("_m") else values[name] for name in names])


def kept_errors(tissue: str) -> list[MarkerError]:
    """The searches of `KEPT` on one material."""
    text = resources.files(__package__).joinpath(KEPT).read_text(encoding="utf-8")
    kept = msgspec.convert(list(csv.DictReader(io.StringIO(text))), list[MarkerError], strict=False)
    return [error for error in kept if error.tissue == tissue]
