"""Errors of the policies of a study compared with the bound of each marker: ``python -m benchmarks.bounds.study``.

The bound is Van Trees' Bayesian one (`benchmarks.bounds`) with the marker's own noise-free curve, all nuisances unknown
and the ranges of the physics table as the prior: for the best angles of this marker, and for the angles of the policy.
Both need a study in which everything is drawn, and acquisitions at rest. ``--plot`` draws the errors of the study, and
of others that were run (``--beside``), with the bound.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from benchmarks.bounds import (
    TABLE_PRIOR,
    IntensityNoise,
    SampledCurve,
    angle_bound_deg,
    best_angles,
    sample_information,
)
from markerseek.core import ConfigError
from markerseek.rigs import image_peak
from markerseek.show import save_figure
from markerseek.studies import Cell, Study, cells, error_figure, read_study, run_study
from markerseek.studies.policies import build_policy
from markerseek.studies.trial import searched, trial_prior_curve
from markerseek.studies.unknowns import Unknowns
from markerseek.studies.worlds import draw_trial, study_rig

_OFF_DEG = np.concatenate(
    [np.arange(0, 6, 0.25), np.arange(6, 14, 0.5), np.arange(14, 30, 1.0), np.arange(30, 70.1, 5.0)]
)
"""Angles off the marker at which its curve is computed, in degrees: dense where the curve is steep."""

MEAN_OF_ROOT = math.sqrt(2 / math.pi)
"""Mean magnitude of a normal error over its standard deviation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundComparison:
    """Errors of a policy and the bounds, over the first markers of a study.

    ``rmse_deg`` is of ``mean_deg`` whatever the answer; ``best_deg`` and ``taken_deg`` are root mean squares of the
    bounds for the best angles and for the policy's.
    """

    cell: int
    policy: int
    label: str
    markers: int
    acquisitions: int
    rmse_deg: float
    median_error_deg: float
    best_deg: float
    taken_deg: float
    ratio_to_best: float
    ratio_to_taken: float
    median_ratio_to_best: float


def require_bound(study: Study) -> None:
    """Refuse a study whose searches the bound is not that of."""
    if study.drawn != "everything":
        raise ConfigError('the bound needs a study that draws everything: set drawn = "everything"')
    if study.sweeps:
        raise ConfigError("the bound is that of acquisitions with the probe at rest; leave the policies that sweep out")


@lru_cache(maxsize=1024)
def marker_curve(unknowns: Unknowns) -> SampledCurve:
    """Noise-free curve of a drawn marker."""
    model = unknowns.model
    marker = unknowns.marker

    def height(off_deg: float) -> float:
        angle_deg = marker.angle_deg + off_deg
        # Behind the plane of the face there is no signal.
        seen = model.channel_data([marker], angle_deg=angle_deg).any()
        return image_peak([marker], model, angle_deg=angle_deg) if seen else 0.0

    heights = np.array([height(off_deg) for off_deg in _OFF_DEG.tolist()])
    # The bound takes the logarithm of the curve.
    return SampledCurve(_OFF_DEG, np.maximum(heights / heights[0], 1e-6))


def compare_with_bound(study: Study, cell: Cell, *, policy: int, markers: int) -> BoundComparison:
    """Repeat the searches for the first markers of a study, and compare the errors with the bound of each."""
    require_bound(study)
    settings = study.policies[policy]
    limits = cell.world.rig.limits.search
    errors = []
    best = []
    taken = []
    for trial in range(markers):
        unknowns, noise, curve = _marker(study, cell, trial)
        rig = study_rig(study, cell, draw_trial(study, cell, trial))
        prior = trial_prior_curve(study, cell, trial, settings)
        searcher = build_policy(settings, limits=limits, start_deg=rig.stage.angle_deg, prior=prior)
        dark_frames = 0 if settings.plan.as_published else rig.dark_frames
        # Without the confirmation at the end, which no bound on the angle takes into account.
        plan = replace(settings.plan, stay=True, dark_frames=dark_frames)
        samples = searched(searcher, rig, plan).samples
        marker_deg = unknowns.marker.angle_deg
        errors.append(searcher.estimate().mean_deg - marker_deg)
        # The best angles of this marker need its true angle: no policy can know them.
        ideal = best_angles(
            curve, marker_deg=marker_deg, noise=noise, acquisitions=settings.most, limits=limits, prior=TABLE_PRIOR
        )
        best.append(ideal.bound_deg)
        angles_deg = np.array([sample.angle_deg for sample in samples])
        information = sample_information(curve, angles_deg, marker_deg=marker_deg, noise=noise).sum(axis=0)
        taken.append(float(angle_bound_deg(information, prior=TABLE_PRIOR)))
    rmse_deg, best_deg, taken_deg = (float(np.sqrt(np.mean(np.square(values)))) for values in (errors, best, taken))
    magnitude = np.abs(errors)
    return BoundComparison(
        cell=cell.index,
        policy=policy,
        label=str(settings),
        markers=markers,
        acquisitions=settings.most,
        rmse_deg=rmse_deg,
        median_error_deg=float(np.median(magnitude)),
        best_deg=best_deg,
        taken_deg=taken_deg,
        ratio_to_best=rmse_deg / best_deg,
        ratio_to_taken=rmse_deg / taken_deg,
        median_ratio_to_best=float(np.median(magnitude / np.array(best))),
    )


def mean_bounds(study: Study, cell: Cell, *, markers: int, acquisitions: Sequence[int]) -> tuple[float, ...]:
    """Mean error of a normal estimator at the bound of the best angles, for each number of them, in degrees."""
    require_bound(study)
    limits = cell.world.rig.limits.search
    sums = np.zeros(len(acquisitions))
    for trial in range(markers):
        unknowns, noise, curve = _marker(study, cell, trial)
        for place, count in enumerate(acquisitions):
            sums[place] += best_angles(
                curve,
                marker_deg=unknowns.marker.angle_deg,
                noise=noise,
                acquisitions=count,
                limits=limits,
                prior=TABLE_PRIOR,
            ).bound_deg
    return tuple((MEAN_OF_ROOT * sums / markers).tolist())


def _marker(study: Study, cell: Cell, trial: int) -> tuple[Unknowns, IntensityNoise, SampledCurve]:
    unknowns = draw_trial(study, cell, trial).unknowns
    assert unknowns is not None
    rig = cell.world.rig
    noise = IntensityNoise(
        # The energy of an acquisition is the mean of its pulses.
        snr=10 ** (rig.noise.peak_snr_db / 20),
        jitter=rig.laser.energy_jitter / math.sqrt(unknowns.pulses),
    )
    return unknowns, noise, marker_curve(unknowns)


def main() -> None:
    """Run the study, or read its rows, and print one line for each policy in each cell."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bounds.study", description=__doc__)
    parser.add_argument("study", type=Path, help="study file (TOML)")
    parser.add_argument("--markers", type=int, default=60, help="markers to search for again (default 60)")
    parser.add_argument("--beside", type=Path, nargs="*", default=[], help="other studies, for the picture")
    parser.add_argument("--plot", type=Path, help="picture to write")
    arguments = parser.parse_args()
    study = read_study(arguments.study)
    require_bound(study)
    markers = min(arguments.markers, study.trials)
    names = [each.name for each in fields(BoundComparison)]
    print(f"| {' | '.join(names)} |\n|{' --- |' * len(names)}")
    for cell in cells(study):
        for number in range(len(study.policies)):
            found = compare_with_bound(study, cell, policy=number, markers=markers)
            values = [getattr(found, name) for name in names]
            print(f"| {' | '.join(f'{each:.3g}' if isinstance(each, float) else str(each) for each in values)} |")
    if arguments.plot is not None:
        runs = [
            (each, run_study(each, Path("out") / path.stem).summary)
            for path in (arguments.study, *arguments.beside)
            for each in (read_study(path),)
        ]
        bounds = {
            cell.index: (study.marks, mean_bounds(study, cell, markers=markers, acquisitions=study.marks))
            for cell in cells(study)
            if study.marks
        }
        save_figure(error_figure(runs, bounds=bounds), arguments.plot)


if __name__ == "__main__":
    main()
