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

Samples of one group, at about one angle, differ by noise and by the laser's energy only, and count as one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float64, Int64
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

MIN_FOR_OUTLIERS = 5
OUTLIER_SIGMAS = 6.0
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
    """Return one observation for a group: its median angle and intensity, with the noise of its mean."""
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
    """Return a group without the samples far from its median: (9) allows one outlier, and many have several."""
    if len(group) < MIN_FOR_OUTLIERS:
        return group
    values = np.array([each.log_intensity for each in group])
    away = np.abs(values - np.median(values))
    usual = np.hypot(1.4826 * np.median(away), [each.noise for each in group])
    return [each for each, far in zip(group, away > OUTLIER_SIGMAS * usual, strict=True) if not far]


def _sweep(observation: Observation) -> int:
    """Return the number of the sweep and the direction that the observation belongs to; 0 for none."""
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
    """Return the weak observations, those of sweeps with how many of the same sweep lie within a group's width."""
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


TEMPLATE_LOG_LEVELS = np.log([1.0, 0.6, 0.3, 0.05])
TEMPLATE_SIGMAS = np.array([0.035, 0.12, 0.27, 0.35])
"""Standard deviation s of g where ln S has these levels, downwards; linear in between."""

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
    (0.01, 0.1),
    (0.03, 0.15),
    (0.06, 0.25),
    (0.1, 0.3),
    (0.15, 0.2),
)
"""The same in a search with sweeps, in which a sample is of one pulse: diodes are steady to 1 to 2 %, Q-switched lasers
to 3 to 10 %; where each pulse's energy is measured, less is left. Few pulses do not tell which it is, and one sweep of
a fast stage has few: with more weight on steady lasers 10 of 103 intervals missed."""


USUAL_SAMPLE_ERROR = sum(error * share for error, share in SAMPLE_ERRORS)
"""Mean of the former, before any sample says more."""

USUAL_PULSE_ERROR = math.sqrt(sum(error**2 * share for error, share in PULSE_ERRORS))
"""Root mean square of the latter."""


LOG_WIDTH_STEP = 3 * float(np.log(WIDTHS_DEG[1] / WIDTHS_DEG[0]))
"""Step of ln F between the shapes that are considered, every third of the family: each stands for those in between."""


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


def symmetric_log_likelihood(
    shapes: Shapes,
    hypotheses: Hypotheses,
    observations: Grouped,
    angles_deg: Float64[np.ndarray, " angles"],
    *,
    blur_deg: float = 0.0,
    displaced: Displaced | None = None,
) -> tuple[Float64[np.ndarray, "angles hypotheses"], Float64[np.ndarray, "angles hypotheses"]]:
    """Return ln p of all observations for each angle and hypothesis, and the ln amplitude that goes with it.

    ``hypotheses``: shapes and errors that are considered. ``angles_deg``: angles of the marker that are considered.
    ``blur_deg``: width about each angle over which the likelihood is averaged, to first order: with coarse steps of the
    angle a narrow maximum is then not stepped over. ``displaced``: by how much a moving marker is displaced at each
    sample (`motion`); None: it rests.
    """
    strong = [each for group in observations.strong for each in group]
    weak = observations.others
    errors = tuple(ERRORS.tolist())
    tables = np.empty((len(weak), ERRORS.size, TABLE_SIZE))
    for row, each in zip(tables, weak, strict=True):
        row[:] = log_tables(noise=each.noise, cells=each.cells, errors=errors, ratio=each.lateral_ratio) / each.beside
    log_p = np.empty((angles_deg.size, hypotheses.member.size))
    log_amplitude = np.empty_like(log_p)
    moved_deg = np.zeros(len(strong) + len(weak))
    own_deg = np.zeros(len(strong))
    ways_deg = np.zeros((len(strong), 0))
    if displaced is not None:
        moved_deg = displaced.by_deg[[each.number for each in (*strong, *weak)]]
        own_deg, ways_deg = _unknown_displacements_deg(strong, displaced)
    _fill_in(
        angles_deg,
        hypotheses.member,
        shapes.log_curve,
        shapes.fwhm_deg,
        STEP_DEG,
        blur_deg,
        LOG_WIDTH_STEP,
        np.array([each.angle_deg for each in (*strong, *weak)]) - moved_deg,
        np.array([each.log_intensity for each in (*strong, *weak)]),
        PEAK_NOISE * np.array([each.noise for each in strong]),
        np.repeat(np.arange(len(observations.strong)), [len(group) for group in observations.strong]),
        np.array([each.energy_share for each in strong]),
        np.hypot([math.hypot(each.angle_sigma_deg, each.displaced_sigma_deg) for each in strong], own_deg),
        np.concatenate([shift_sigmas_deg(strong), ways_deg], axis=1),
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Displaced:
    """By how much a moving marker is displaced along the turn at each sample of a search, as an angle.

    The last entry is that of an observation without a number.
    """

    by_deg: Float64[np.ndarray, " samples"]
    """As far as it is known."""
    sigma_deg: Float64[np.ndarray, " samples"]
    """Standard deviation of what is not known, the same displacement for all samples of one way of a sweep."""


def _unknown_displacements_deg(
    observations: Sequence[Observation], displaced: Displaced
) -> tuple[Float64[np.ndarray, " observations"], Float64[np.ndarray, "observations ways"]]:
    """Return the unknown displacements of samples at rest, and those that the samples of each way share."""
    sigma_deg = displaced.sigma_deg[[each.number for each in observations]]
    way = np.array([_sweep(each) for each in observations])
    swept = np.array([each.sweep is not None for each in observations])
    ways = np.unique(way[swept])
    return np.where(swept, 0.0, sigma_deg), sigma_deg[:, None] * (swept[:, None] & (way[:, None] == ways))


def shift_sigmas_deg(observations: Sequence[Observation]) -> Float64[np.ndarray, "observations shifts"]:
    """Return by how much each unknown that samples of sweeps share shifts their angles, a standard deviation of it.

    The first is the delay between pulse and angle, common to all sweeps; each further one is the backlash in one sweep.
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


@compiled
def log_level(log_curve: Float64[np.ndarray, " distances"], steps: float) -> float:
    """Return ln S at this number of steps from the marker, linear between the tabulated ones."""
    near = min(int(steps), log_curve.size - 2)
    part = min(steps - near, 1.0)
    return float((1 - part) * log_curve[near] + part * log_curve[near + 1])


@compiled
def template_sigma(
    level: float, log_levels: Float64[np.ndarray, " levels"], sigmas: Float64[np.ndarray, " levels"]
) -> float:
    """Return the standard deviation s of g where ln S is ``level``: one of ``sigmas`` at each of ``log_levels``."""
    if level >= log_levels[0]:
        return float(sigmas[0])
    for row in range(1, log_levels.size):
        if level >= log_levels[row]:
            part = (log_levels[row - 1] - level) / (log_levels[row - 1] - log_levels[row])
            return float(sigmas[row - 1] + part * (sigmas[row] - sigmas[row - 1]))
    return float(sigmas[-1])


@compiled
def _covariance(
    level: Float64[np.ndarray, " groups"],
    distance: Float64[np.ndarray, " groups"],
    slope: Float64[np.ndarray, " groups"],
    width: Float64[np.ndarray, " groups"],
    shift: Float64[np.ndarray, "groups shifts"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    out: Float64[np.ndarray, "groups groups"],
) -> None:
    """Fill in the lower half of (8), ``distance`` in units of ℓF.

    ``slope`` and ``width`` are of `_unresolved`, ``shift`` of `_shifted`.
    """
    count = level.size
    sigma = np.empty(count)
    for i in range(count):
        own = template_sigma(level[i], log_levels, sigmas)
        # The template's error is as smooth at the marker as anywhere: without the second part it had a cusp there.
        sigma[i] = own / math.sqrt(1 + 1 / (1 + 2 * distance[i] * distance[i]))
        for k in range(i):
            apart = distance[i] - distance[k]
            across = distance[i] + distance[k]
            out[i, k] = sigma[i] * sigma[k] * (1 / (1 + 0.5 * apart * apart) + 1 / (1 + 0.5 * across * across))
            out[i, k] += slope[i] * slope[k] + width[i] * width[k]
            for s in range(shift.shape[1]):
                out[i, k] += shift[i, s] * shift[k, s]
        out[i, i] = own * own + slope[i] ** 2 + width[i] ** 2
        for s in range(shift.shape[1]):
            out[i, i] += shift[i, s] ** 2


@compiled
def factor_and_invert(matrix: Float64[np.ndarray, "n n"], inverse: Float64[np.ndarray, "n n"]) -> float:
    """Put Cholesky's factor in place of the lower half, and its inverse; return ln of the determinant."""
    # 3 to 8 times as fast as LAPACK through Numba for 3 to 16 samples (`benchmarks.kernels`): its calls allocate, and
    # the matrices are small. A decision makes some 300 of them.
    count = matrix.shape[0]
    determinant = 1.0
    for i in range(count):
        for k in range(i + 1):
            rest = matrix[i, k]
            for c in range(k):
                rest -= matrix[i, c] * matrix[k, c]
            if i == k:
                matrix[i, i] = math.sqrt(rest)
                determinant *= rest
            else:
                matrix[i, k] = rest / matrix[k, k]
        inverse[i, i] = 1 / matrix[i, i]
        for k in range(i):
            total = 0.0
            for c in range(k, i):
                total += matrix[i, c] * inverse[c, k]
            inverse[i, k] = -total * inverse[i, i]
    return math.log(determinant)


@compiled
def _log_density(
    inverse: Float64[np.ndarray, "groups groups"],
    log_determinant: float,
    value: Float64[np.ndarray, " strong"],
    weight: Float64[np.ndarray, " strong"],
    apart: Float64[np.ndarray, " strong"],
    group: Int64[np.ndarray, " strong"],
    mean: Float64[np.ndarray, " groups"],
    precision: Float64[np.ndarray, " groups"],
    outlier: float,
    unit: Float64[np.ndarray, " groups"],
    whitened: Float64[np.ndarray, " groups"],
    own: Float64[np.ndarray, " groups"],
) -> tuple[float, float]:
    """Return ln p of values with an unknown common offset ln A, one of them perhaps an outlier (9); and that offset.

    The values of a group share g and differ by errors of their own, 1/``weight``, and about their mean by the slope of
    g as well, together 1/``apart``. ``mean`` and ``precision`` are a group's weighted mean and the sum of its weights,
    and ``inverse`` is that of Cholesky's factor L of the means' covariance; ``unit``, ``whitened``, ``own`` are
    workspace.
    """
    groups = mean.size
    # unit = C⁻¹·1 and whitened = C⁻¹·mean, of C = L·Lᵀ. The offset under a flat prior is that of least squares,
    # 1ᵀC⁻¹mean / 1ᵀC⁻¹1 (Rasmussen and Williams 2.7).
    unit[:] = 0.0
    whitened[:] = 0.0
    own[:] = 0.0
    total = 0.0
    offset = 0.0
    for c in range(groups):
        one = 0.0
        known = 0.0
        for k in range(c + 1):
            one += inverse[c, k]
            known += inverse[c, k] * mean[k]
        total += one * one
        offset += one * known
        for k in range(c + 1):
            unit[k] += one * inverse[c, k]
            whitened[k] += known * inverse[c, k]
            own[k] += inverse[c, k] ** 2
    offset /= total
    square = 0.0
    bad = 0.0
    for c in range(groups):
        square += (whitened[c] - offset * unit[c]) * mean[c]
        log_determinant += math.log(precision[c])
    for i in range(value.size):
        # Precision and residual of one value given the others, the offset integrated out (there 5.12): p without it
        # is p over its density given the others, so that leaving each one out takes no second factorisation. Those of
        # a value follow from its group's mean by Woodbury's identity (there A.9).
        c = group[i]
        share = weight[i] / precision[c]
        away = value[i] - mean[c]
        known = apart[i] * (1 - share) + share * share * (own[c] - unit[c] ** 2 / total)
        weighted = apart[i] * away + share * (whitened[c] - offset * unit[c])
        square += apart[i] * away * away
        log_determinant -= math.log(apart[i])
        known = max(known, 1e-9)
        # Beyond exp(500) the sum would overflow; such a value is an outlier in any case.
        bad += math.sqrt(2 * math.pi / known) * math.exp(min(0.5 * weighted**2 / known, 500.0))
    log_density = -0.5 * (square + log_determinant + math.log(total) + (value.size - 1) * math.log(2 * math.pi))
    return log_density + math.log1p(outlier * bad), offset


@compiled
def _place_groups(
    away_deg: Float64[np.ndarray, " strong"],
    level: Float64[np.ndarray, " strong"],
    share: Float64[np.ndarray, " strong"],
    group: Int64[np.ndarray, " strong"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    length_deg: float,
    place_deg: Float64[np.ndarray, " groups"],
    height: Float64[np.ndarray, " groups"],
    beside: Float64[np.ndarray, " strong"],
) -> None:
    """Fill in distance and level of each group, means with ``share``, and the variance of g beside its middle."""
    place_deg[:] = 0.0
    height[:] = 0.0
    for i in range(away_deg.size):
        place_deg[group[i]] += share[i] * away_deg[i]
        height[group[i]] += share[i] * level[i]
    for i in range(away_deg.size):
        # By (8), to first order.
        off = (away_deg[i] - place_deg[group[i]]) / length_deg
        beside[i] = (template_sigma(height[group[i]], log_levels, sigmas) * off) ** 2


@compiled
def _unresolved(
    log_curve: Float64[np.ndarray, " distances"],
    place_deg: Float64[np.ndarray, " groups"],
    side: Float64[np.ndarray, " groups"],
    step_deg: float,
    blur_deg: float,
    log_width: float,
    slope: Float64[np.ndarray, " groups"],
    width: Float64[np.ndarray, " groups"],
) -> None:
    """Fill in what a standard deviation of the angle, and one of ln F, changes each level by.

    Both are uniform within their steps, and the curve is linear in them.
    """
    half_steps = blur_deg / 2 / step_deg
    widening = math.exp(log_width / 2)
    for c in range(place_deg.size):
        away = place_deg[c] / step_deg
        change = log_level(log_curve, away / widening) - log_level(log_curve, away * widening)
        width[c] = change / math.sqrt(12)
        change = log_level(log_curve, away + half_steps) - log_level(log_curve, abs(away - half_steps))
        slope[c] = side[c] * change / math.sqrt(12)


@compiled
def _shifted(
    log_curve: Float64[np.ndarray, " distances"],
    place_deg: Float64[np.ndarray, " groups"],
    side: Float64[np.ndarray, " groups"],
    step_deg: float,
    shift_deg: Float64[np.ndarray, "strong shifts"],
    share: Float64[np.ndarray, " strong"],
    group: Int64[np.ndarray, " strong"],
    steepness: Float64[np.ndarray, " groups"],
    shift: Float64[np.ndarray, "groups shifts"],
) -> None:
    """Fill in the change of ln S with the probe's angle, per degree, and with a standard deviation of each shift."""
    shift[:] = 0.0
    for c in range(place_deg.size):
        away = place_deg[c] / step_deg
        change = log_level(log_curve, away + 1) - log_level(log_curve, abs(away - 1))
        steepness[c] = side[c] * change / (2 * step_deg)
    # To first order: a shift is some hundredths of a degree, and the narrowest curve two degrees wide.
    for i in range(group.size):
        for s in range(shift_deg.shape[1]):
            shift[group[i], s] += share[i] * steepness[group[i]] * shift_deg[i, s]


@compiled
def _log_tables_at(
    tables: Float64[np.ndarray, "weak errors entries"],
    table_levels: Float64[np.ndarray, " errors"],
    level: Float64[np.ndarray, " weak"],
    log_ratio: Float64[np.ndarray, " weak"],
    table_step: float,
) -> float:
    """Return the sum of ln p of the weak samples by their tables; ``log_ratio``: ln(μ/y) from the tables' low end."""
    total = 0.0
    for i in range(level.size):
        row = 0
        while level[i] < table_levels[row]:
            row += 1
        entry = int(log_ratio[i] / table_step + 0.5)
        total += tables[i, row, min(max(entry, 0), tables.shape[2] - 1)]
    return total


@compiled
def _fill_in(
    angles_deg: Float64[np.ndarray, " angles"],
    members: Int64[np.ndarray, " members"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    fwhm_deg: Float64[np.ndarray, " shapes"],
    step_deg: float,
    blur_deg: float,
    log_width: float,
    measured_deg: Float64[np.ndarray, " samples"],
    log_intensity: Float64[np.ndarray, " samples"],
    noise: Float64[np.ndarray, " strong"],
    group: Int64[np.ndarray, " strong"],
    energy_share: Float64[np.ndarray, " strong"],
    angle_sigma_deg: Float64[np.ndarray, " strong"],
    shift_deg: Float64[np.ndarray, "strong shifts"],
    sample_error: Float64[np.ndarray, " members"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    length: float,
    outlier: float,
    tables: Float64[np.ndarray, "weak errors entries"],
    table_levels: Float64[np.ndarray, " errors"],
    table_low: float,
    table_step: float,
    out: Float64[np.ndarray, "angles members"],
    log_amplitude: Float64[np.ndarray, "angles members"],
) -> None:
    """Fill in ln p of all samples for each angle and shape, and the ln amplitude that goes with it.

    ``sample_error`` goes with each shape; a shape may come with several, after one another. The strong samples come
    first, those of a ``group`` after one another, and count by `_log_density`, the others by their table at the
    amplitude of those. Each angle stands for all within ``blur_deg`` about it, each shape for any ln F within
    ``log_width``; 0: for itself. A strong sample's angle has an error of its own, and is shifted by unknowns that
    others share, each normal, by ``shift_deg`` for a standard deviation.
    """
    strong = noise.size
    groups = group[strong - 1] + 1
    level = np.empty(measured_deg.size)
    away_deg = np.empty(strong)
    value = np.empty(strong)
    weight = np.empty(strong)
    beside = np.empty(strong)
    share = np.empty(strong)
    apart = np.empty(strong)
    known = np.zeros(groups)
    place_deg = np.empty(groups)
    height = np.empty(groups)
    side = np.empty(groups)
    slope = np.empty(groups)
    width = np.empty(groups)
    mean = np.empty(groups)
    precision = np.empty(groups)
    steepness = np.empty(groups)
    shift = np.empty((groups, shift_deg.shape[1]))
    shared = np.empty((groups, groups))
    matrix = np.empty((groups, groups))
    inverse = np.empty((groups, groups))
    unit = np.empty(groups)
    whitened = np.empty(groups)
    own = np.empty(groups)
    for i in range(strong):
        known[group[i]] += noise[i] ** -2
    for i in range(strong):
        share[i] = noise[i] ** -2 / known[group[i]]
    for k in range(angles_deg.size):
        for i in range(strong):
            away_deg[i] = abs(measured_deg[i] - angles_deg[k])
            side[group[i]] = 1.0 if measured_deg[i] > angles_deg[k] else -1.0
        for j in range(members.size):
            member = members[j]
            # What only the shape decides is computed once for all sample errors with it.
            if j == 0 or member != members[j - 1]:
                curve = log_curve[member]
                length_deg = length * fwhm_deg[member]
                for i in range(measured_deg.size):
                    level[i] = log_level(curve, abs(measured_deg[i] - angles_deg[k]) / step_deg)
                value[:] = log_intensity[:strong] - level[:strong]
                _place_groups(
                    away_deg, level[:strong], share, group, log_levels, sigmas, length_deg, place_deg, height, beside
                )
                _unresolved(curve, place_deg, side, step_deg, blur_deg, log_width, slope, width)
                _shifted(curve, place_deg, side, step_deg, shift_deg, share, group, steepness, shift)
                _covariance(height, place_deg / length_deg, slope, width, shift, log_levels, sigmas, shared)
            precision[:] = 0.0
            mean[:] = 0.0
            for i in range(strong):
                # ln y of a strong sample is normal with the standard deviation σ/y.
                by_angle = steepness[group[i]] * angle_sigma_deg[i]
                variance = noise[i] ** 2 + (energy_share[i] * sample_error[j]) ** 2 + by_angle**2
                weight[i] = 1 / variance
                apart[i] = 1 / (variance + beside[i])
                precision[group[i]] += weight[i]
                mean[group[i]] += weight[i] * value[i]
            matrix[:] = shared
            for c in range(groups):
                mean[c] /= precision[c]
                matrix[c, c] += 1 / precision[c]
            log_determinant = factor_and_invert(matrix, inverse)
            log_p, amplitude = _log_density(
                inverse, log_determinant, value, weight, apart, group, mean, precision, outlier, unit, whitened, own
            )
            away = amplitude + level[strong:] - log_intensity[strong:] - table_low
            out[k, j] = log_p + _log_tables_at(tables, table_levels, level[strong:], away, table_step)
            log_amplitude[k, j] = amplitude
