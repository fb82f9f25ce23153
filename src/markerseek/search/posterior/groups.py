"""Samples of a search in groups of about one angle, for the likelihood of a symmetric curve (`symmetry`).

Samples of one group differ by noise and by the laser's energy only, and count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek.search.posterior.likelihood import PEAK_NOISE, Observation

MIN_FOR_OUTLIERS, OUTLIER_SIGMAS = 5, 6.0
"""Least size of a group from which outliers are left out, and the standard deviations from its median that make one."""

MIN_STRONG = 3
"""Strong samples from which (7) replaces the grid. From the first one on it is as good for frames, but in a file of
intensities 5 of 50 pairs of peaks were `Found`, one of them wrong, instead of 2."""

MAX_GROUPS = 24
"""Most groups of strong samples that count by (7), the strongest: the matrix of (8) is as large."""

GROUP_WIDTHS = 0.01, 0.02, 0.04
"""Width of a group over the full width at half maximum: the first with which there are no more groups than that, or the
last. In wider ones the curve's own bend looked like an unsteady laser."""

SWEPT_GROUP_WIDTHS = *GROUP_WIDTHS, 0.08, 0.16
"""The same in a search with sweeps, where samples cover all of the curve, and a pulse's energy exceeds the bend."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grouped:
    """Observations of a search, the strong ones in groups of about one angle.

    The template's error is the same for all of a group: a hundred samples beside one another do not average it.
    """

    strong: Sequence[Sequence[Observation]]
    """Groups of strong observations, the strongest first, `MAX_GROUPS` at most."""
    others: Sequence[Observation]
    """All other observations: weak ones, those from another lateral position, and of each further group its median."""


def median_of(group: Sequence[Observation]) -> Observation:
    """One observation for a group: its median angle and intensity, with the noise of its mean."""
    if len(group) == 1:
        return group[0]
    # A median, for one outlier among several must not move them.
    return replace(
        group[0],
        angle_deg=float(np.median([each.angle_deg for each in group])),
        log_intensity=float(np.median([each.log_intensity for each in group])),
        noise=sum(each.noise**-2 for each in group) ** -0.5,
    )


def _without_outliers(group: list[Observation]) -> list[Observation]:
    """A group without the samples far from its median: (9) holds one outlier of all samples, and many hold several."""
    if len(group) < MIN_FOR_OUTLIERS:
        return group
    values = np.array([each.log_intensity for each in group])
    away = np.abs(values - np.median(values))
    usual = np.hypot(1.4826 * np.median(away), [each.noise for each in group])
    return [each for each, far in zip(group, away > OUTLIER_SIGMAS * usual, strict=True) if not far]


def _sweep(observation: Observation) -> int:
    """Number of the sweep and the direction that the observation belongs to; 0 for none."""
    sweep = observation.sweep
    return 0 if sweep is None else 2 * sweep.number + (sweep.speed_deg_s < 0)


def grouped(observations: Sequence[Observation], *, fwhm_deg: float) -> Grouped:
    """Return the observations, the strong ones in groups.

    ``fwhm_deg``: full width of the curve at half maximum.
    """
    strong: list[Observation] = []
    others: list[Observation] = []
    for each in sorted(observations, key=lambda observation: (_sweep(observation), observation.angle_deg)):
        (strong if each.strong else others).append(each)
    groups: list[list[Observation]] = []
    for width in SWEPT_GROUP_WIDTHS if strong and _sweep(strong[-1]) else GROUP_WIDTHS:
        groups = []
        for each in strong:
            # What shifts the angles of one way does not shift those of another.
            near = groups and each.angle_deg - groups[-1][0].angle_deg <= width * fwhm_deg
            if near and _sweep(each) == _sweep(groups[-1][0]):
                groups[-1].append(each)
            else:
                groups.append([each])
        if len(groups) <= MAX_GROUPS:
            break
    groups = [_without_outliers(group) for group in groups]
    groups.sort(key=lambda group: -float(np.median([each.log_intensity for each in group])))
    others = _counted(others, width_deg=SWEPT_GROUP_WIDTHS[-1] * fwhm_deg)
    return Grouped(strong=groups[:MAX_GROUPS], others=[*others, *map(median_of, groups[MAX_GROUPS:])])


def _counted(weak: Sequence[Observation], *, width_deg: float) -> list[Observation]:
    """Weak observations, those of sweeps with how many of the same sweep lie within a group's width."""
    place_deg, sweep = np.array([(each.angle_deg, _sweep(each)) for each in weak]).reshape(-1, 2).T
    near = (np.abs(place_deg[:, None] - place_deg) <= width_deg / 2) & (sweep[:, None] == sweep)
    return [
        each if each.sweep is None else replace(each, beside=int(count))
        for each, count in zip(weak, near.sum(axis=1), strict=True)
    ]


def with_energies(samples: Grouped) -> tuple[Grouped, float | None]:
    """Return the observations with the spot's energy in the strong ones, and ln of the factor that it has got.

    The peak of a stained spot is speckle, and that of a point has a cell's noise: their energy is steadier. The factor
    makes it as high as the peak at the top of the curve. A strong observation without a known energy counts as a weak
    one. If too few energies are known, all keep their peaks, and the factor is None.
    """
    known = [(each, *each.spot) for group in samples.strong for each in group if each.spot is not None]
    if len(known) < MIN_STRONG:
        return samples, None
    weight = np.exp(4 * np.array([each.log_intensity for each, _, _ in known]))
    away = np.array([each.log_intensity - log_amplitude for each, log_amplitude, _ in known])
    log_gain = float(weight @ away / weight.sum())
    strong: list[list[Observation]] = []
    others = list(samples.others)
    for group in samples.strong:
        # What (7) takes as noise is `PEAK_NOISE` of an observation's, for a peak.
        energies = [
            replace(each, log_intensity=each.spot[0] + log_gain, noise=each.spot[1] / PEAK_NOISE)
            for each in group
            if each.spot is not None
        ]
        if energies:
            strong.append(energies)
        others += [each for each in group if each.spot is None]
    return Grouped(strong=strong, others=others), log_gain
