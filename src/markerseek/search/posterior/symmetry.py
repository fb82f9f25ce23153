"""Likelihood for a symmetric elevation curve: a Gaussian process over |t| models the template's error.

No real curve is of the family (`shapes`): on a flank it is 10 to 30 % off. Taken as an error of each sample by itself,
that hides the angle. But the curve of a point is symmetric, whatever its form: the error at the distance |t| from the
marker is the same on either side, and nearly the same at a distance a little larger. So

    ln y_i = ln A + ln S(t_i) + g(|t_i|) + e_i,                                                                (7)
    cov(g, g') ∝ s·s'·(k(|t| − |t'|) + k(|t| + |t'|)),      k(d) = 1/(1 + d²/(2 (ℓF)²)),                     (8)

with g a Gaussian process over |t| whose standard deviation s grows towards the tails (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, 2.7: the amplitude under a flat prior; 4.19: the rational quadratic kernel), and e
a sample's own error: noise, and the laser's energy. Any one sample may be an outlier: by its density given all the
others (5.10 to 5.12 there), which costs nothing more. Samples too weak for a normal ln y, and those from another
lateral position, count by their table (3) as before.

It is computed about the angle that a finer grid has found, and replaces the grid's answer (`inference`). Of strong
samples y is the root of the spot's energy (`Reading.spot`) where that is known, else the peak.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import Float64, Int64
from markerseek.search.posterior import _symmetry
from markerseek.search.posterior.grid import ERRORS, LEVELS
from markerseek.search.posterior.likelihood import (
    OUTLIER_RANGE,
    OUTLIER_SHARE,
    PEAK_NOISE,
    TABLE_LOW,
    TABLE_SIZE,
    TABLE_STEP,
    Observation,
    log_tables,
)
from markerseek.search.posterior.shapes import STEP_DEG, WIDTHS_DEG, Shapes

TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS = np.log([1.0, 0.6, 0.3, 0.05]), np.array([0.035, 0.12, 0.27, 0.35])
"""Standard deviation s of g where ln S has these levels, downwards; linear in between."""

MIN_FOR_OUTLIERS, OUTLIER_SIGMAS = 5, 6.0
"""Samples of a group from which those are left out that differ from its median by more than so many standard
deviations."""

CORRELATION_LENGTH = 0.2
"""Distance ℓ over which g is correlated, over the full width at half maximum."""

SAMPLE_ERRORS: tuple[tuple[float, float], ...] = (
    (0.003, 0.22),
    (0.01, 0.23),
    (0.025, 0.25),
    (0.05, 0.18),
    (0.09, 0.12),
)
"""Relative errors e of one sample by itself, the laser's energy, and the prior probability of each."""

PULSE_ERRORS: tuple[tuple[float, float], ...] = (
    (0.01, 0.2),
    (0.03, 0.2),
    (0.06, 0.25),
    (0.1, 0.25),
    (0.15, 0.1),
)
"""The same in a search with sweeps, in which a sample is of one pulse: diodes are steady to 1 to 2 %, Q-switched lasers
to 3 to 10 %; where each pulse's energy is measured, less is left."""


USUAL_SAMPLE_ERROR = sum(error * share for error, share in SAMPLE_ERRORS)
"""Mean of the former, before any sample says more."""

USUAL_PULSE_ERROR = math.sqrt(sum(error**2 * share for error, share in PULSE_ERRORS))
"""Root mean square of the latter."""


LOG_WIDTH_STEP = 3 * float(np.log(WIDTHS_DEG[1] / WIDTHS_DEG[0]))
"""Step of ln F between the shapes that are considered, every third of the family: each stands for those in between."""

MIN_STRONG = 3
"""Strong samples that are needed."""

MAX_GROUPS = 24
"""Most groups of strong samples that count by (7), the strongest: the matrix of (8) is as large."""

GROUP_WIDTHS = 0.01, 0.02, 0.04
"""Width of a group over the full width at half maximum: the first with which there are no more groups than that, or the
last. In wider ones the curve's own bend looked like an unsteady laser."""

SWEPT_GROUP_WIDTHS = *GROUP_WIDTHS, 0.08, 0.16
"""The same in a search with sweeps, where samples cover all of the curve, and a pulse's energy exceeds the bend."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """Hypotheses about the curve: a shape, and the relative error of one sample by itself."""

    member: Int64[np.ndarray, " hypotheses"]
    """Shapes, as indices into the family; each may stand with several errors."""
    sample_error: Float64[np.ndarray, " hypotheses"]
    """Relative error of one sample by itself."""
    log_prior: Float64[np.ndarray, " hypotheses"]
    """ln of the prior probability."""

    def kept(self, which: Int64[np.ndarray, " kept"]) -> Hypotheses:
        """Only those of these indices."""
        return Hypotheses(
            member=self.member[which], sample_error=self.sample_error[which], log_prior=self.log_prior[which]
        )


def hypotheses_of(
    shapes: Shapes, members: Int64[np.ndarray, " members"], errors: Sequence[tuple[float, float]] = SAMPLE_ERRORS
) -> Hypotheses:
    """Return these shapes, each with all of the errors."""
    sample_error, share = np.tile(np.array(errors), (members.size, 1)).T
    member = np.repeat(members, len(errors))
    return Hypotheses(member=member, sample_error=sample_error, log_prior=shapes.log_prior[member] + np.log(share))


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
    """Number of its sweep; 0 for none."""
    return 0 if observation.sweep is None else observation.sweep.number


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
            # What shifts the angles of one sweep does not shift those of another.
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
    makes it as high as the peak at the top of the curve. A strong observation of which it is not known counts as a weak
    one. Where too few are known, all keep their peaks, and the factor is None.
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


def symmetric_log_likelihood(
    shapes: Shapes,
    hypotheses: Hypotheses,
    observations: Grouped,
    angles_deg: Float64[np.ndarray, " angles"],
    *,
    blur_deg: float = 0.0,
) -> tuple[Float64[np.ndarray, "angles hypotheses"], Float64[np.ndarray, "angles hypotheses"]]:
    """Return ln p of all observations for each angle and hypothesis, and the ln amplitude that goes with it.

    ``hypotheses``: shapes and errors that are considered. ``angles_deg``: angles of the marker that are considered.
    ``blur_deg``: width about each angle over which the likelihood is averaged, to first order: with coarse steps of the
    angle a narrow maximum is then not stepped over.
    """
    strong = [each for group in observations.strong for each in group]
    weak = observations.others
    errors = tuple(ERRORS.tolist())
    tables = np.empty((len(weak), ERRORS.size, TABLE_SIZE))
    for row, each in zip(tables, weak, strict=True):
        row[:] = log_tables(noise=each.noise, cells=each.cells, errors=errors, ratio=each.lateral_ratio) / each.beside
    log_p = np.empty((angles_deg.size, hypotheses.member.size))
    log_amplitude = np.empty_like(log_p)
    _symmetry.symmetric_likelihood(
        angles_deg,
        hypotheses.member,
        shapes.log_curve,
        shapes.fwhm_deg,
        STEP_DEG,
        blur_deg,
        LOG_WIDTH_STEP,
        np.array([each.angle_deg for each in (*strong, *weak)]),
        np.array([each.log_intensity for each in (*strong, *weak)]),
        PEAK_NOISE * np.array([each.noise for each in strong]),
        np.repeat(np.arange(len(observations.strong)), [len(group) for group in observations.strong]),
        np.array([each.energy_share for each in strong]),
        np.array([each.angle_sigma_deg for each in strong]),
        shift_sigmas_deg(strong),
        hypotheses.sample_error,
        TEMPLATE_LOG_LEVELS,
        TEMPLATE_SIGMAS,
        CORRELATION_LENGTH,
        OUTLIER_SHARE / OUTLIER_RANGE,
        tables,
        LEVELS,
        TABLE_LOW,
        TABLE_STEP,
        log_p,
        log_amplitude,
    )
    return log_p, log_amplitude


def shift_sigmas_deg(observations: Sequence[Observation]) -> Float64[np.ndarray, "observations shifts"]:
    """Return by how much each unknown that samples of sweeps share shifts their angles, a standard deviation of it.

    The first is the delay between pulse and angle, common to all sweeps; each further one is the play of one sweep.
    Samples at rest have no part in them. There are none where no sample is shifted.
    """
    sweeps = [each.sweep for each in observations]
    played = sorted({sweep.number for sweep in sweeps if sweep is not None and sweep.play_sigma_deg > 0})
    shifts = np.zeros((len(sweeps), 1 + len(played)))
    for row, sweep in zip(shifts, sweeps, strict=True):
        if sweep is not None:
            row[0] = sweep.speed_deg_s * sweep.delay_sigma_s
            if sweep.play_sigma_deg > 0:
                row[1 + played.index(sweep.number)] = sweep.play_sigma_deg
    return shifts if shifts.any() else shifts[:, :0]
