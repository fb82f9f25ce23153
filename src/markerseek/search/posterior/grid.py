"""Posterior on a grid of angle, shape and amplitude: where the marker is, before strong samples say it better.

The log-likelihood of each observation is added to every cell: O(cells) per sample, and nothing is computed again. The
cells of one angle and one shape are a row. Rows that are too improbable to come back are dropped.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float32, Float64, Int64
from markerseek.search.posterior.likelihood import TABLE_LOW, TABLE_STEP, Observation, log_tables
from markerseek.search.posterior.shapes import MODEL_ERROR, STEP_DEG, Shapes

LEVELS = np.array([math.log(level) if level > 0 else -math.inf for level, _ in MODEL_ERROR])
"""ln of the levels of `MODEL_ERROR`, downwards."""

ERRORS = np.array([error for _, error in MODEL_ERROR])
"""Relative errors of `MODEL_ERROR`."""

DROPPED_BELOW = 30.0
"""Log-likelihood below the largest from which a row is dropped: three outliers could not bring the row back."""

MIN_LOG_WEIGHT = -18.0
"""Ln of a row's largest weight over the largest of all from which the row counts."""

MAX_SHAPES = 32
"""Most shapes that a finer grid keeps."""

_MIN_SHARE = 1e-4
"""Probability of a shape, over that of the likeliest, below which a finer grid drops the shape."""

BLURS = (0.01, 0.04, 0.125)
"""Relative errors that the steps of a grid may add. With few of them the tables of a sample are found in the cache."""

MAX_STRONG = 16
"""Strong observations that count in full; the likelihood of more counts to the power of this over their number.

The error of the curve's form is taken as each observation's own, but observations beside one another share the error: a
hundred would make one cell of the grid certain, beside the marker.
"""

AMPLITUDES = 20
"""Amplitudes of a finer grid."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Particles:
    """Markers of equal weight drawn from a posterior."""

    theta_deg: Float64[np.ndarray, " particles"]
    """Angles in degrees."""
    member: Int64[np.ndarray, " particles"]
    """Shapes, as indices into the family."""
    log_amplitude: Float64[np.ndarray, " particles"]
    """ln of the amplitudes over the unit of the search."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marginals:
    """Marginal probabilities on a grid, each adding up to 1, and markers drawn from the grid."""

    angle: Float64[np.ndarray, " angles"]
    """Probability of each angle."""
    shape: Float64[np.ndarray, " shapes"]
    """Probability of each shape."""
    amplitude: Float64[np.ndarray, " amplitudes"]
    """Probability of each amplitude."""
    particles: Particles


class Grid:
    """Log-likelihood of the observations so far over angle, shape and ln amplitude.

    ``angles_deg``: angles of the marker that are considered. ``members``: which curves of the family. ``lowest``: ln of
    the lowest amplitude, over the unit of the search. ``phases``: step of ln amplitude, in steps of the table,
    `TABLE_STEP`. ``blur``: relative error that the grid's own steps add to the model's. ``log_amplitude_prior``: mean
    and standard deviation of ln amplitude; None: any is as probable. ``energy_error``: relative error that the laser's
    energy adds beyond the model's.
    """

    def __init__(
        self,
        *,
        shapes: Shapes,
        angles_deg: Float64[np.ndarray, " angles"],
        members: Int64[np.ndarray, " members"],
        lowest: float,
        phases: int,
        amplitudes: int,
        blur: float,
        log_amplitude_prior: tuple[float, float] | None = None,
        energy_error: float = 0.0,
    ) -> None:
        self.angles_deg = angles_deg
        self.members = members
        self.log_amplitude = lowest + phases * TABLE_STEP * np.arange(amplitudes)
        self.step_amplitude = phases * TABLE_STEP
        self.log_amplitude_prior = log_amplitude_prior
        self.energy_error = energy_error
        self._shapes = shapes
        self._phases = phases
        # The curve changes between two cells: that too is an error of the model, added as squares.
        self._errors = np.hypot(ERRORS, blur)
        self._strong = 0
        self._angle, self._member = np.divmod(np.arange(angles_deg.size * members.size), members.size)
        # Single precision halves the memory that each sample passes through; ln p stays exact to 1e-5.
        self._cells: Float32[np.ndarray, "rows amplitudes"] = np.zeros((self._angle.size, amplitudes), np.float32)
        if log_amplitude_prior is not None:
            mean, sigma = log_amplitude_prior
            self._cells += (-((self.log_amplitude - mean) ** 2) / (2 * sigma**2)).astype(np.float32)

    def copy(self) -> Grid:
        """Return a grid that is the same, and that observations can be added to by itself."""
        twin = copy.copy(self)
        # Only the cells are written in place.
        twin._cells = self._cells.copy()  # noqa: SLF001 - of this class
        return twin

    def add(self, observation: Observation) -> None:
        """Add the log-likelihood of one observation."""
        self._strong += observation.strong
        errors = np.hypot(self._errors, self.energy_error * observation.energy_share)
        _add_sample(
            self._cells,
            np.abs(self.angles_deg - observation.angle_deg) / STEP_DEG,
            self._angle,
            self.members[self._member],
            self._shapes.log_curve,
            _tables(observation, tuple(errors.tolist()), phases=self._phases, amplitudes=self.log_amplitude.size),
            LEVELS,
            self.log_amplitude[0] - observation.log_intensity - TABLE_LOW,
            TABLE_STEP,
        )

    def marginals(self, log_angle: Float64[np.ndarray, " angles"], *, particles: int) -> Marginals:
        """Return marginal probabilities; ``log_angle`` is ln of the angle's prior and of its other likelihoods."""
        power = MAX_STRONG / max(self._strong, MAX_STRONG)
        log_shape = self._shapes.log_prior[self.members]
        tops = power * _tops(self._cells) + log_shape[self._member]
        # Without the prior of the angle, which the moments of arrival still change.
        alive = tops >= tops.max() - DROPPED_BELOW
        if not alive.all():
            self._angle = self._angle[alive]
            self._member = self._member[alive]
            self._cells = self._cells[alive]
            tops = tops[alive]
        tops = tops + log_angle[self._angle]
        counted = np.flatnonzero(tops > tops.max() + MIN_LOG_WEIGHT)
        angle = self._angle[counted]
        member = self._member[counted]
        base = log_angle[angle] + log_shape[member] - tops.max()
        weight = np.exp(np.float32(power) * self._cells[counted] + base[:, None].astype(np.float32))
        by_row = weight.sum(axis=1, dtype=np.float64)
        # By systematic resampling, at equal steps of the cumulative weight and without random numbers: the same samples
        # always give the same particles, and so the same next angle.
        cumulative = np.cumsum(by_row)
        target = cumulative[-1] * (np.arange(particles) + 0.5) / particles
        row = np.searchsorted(cumulative, target)
        inside = np.cumsum(weight[row], axis=1, dtype=np.float64)
        place = (inside < (target - cumulative[row] + by_row[row])[:, None]).sum(axis=1)
        total = cumulative[-1]
        return Marginals(
            angle=np.bincount(angle, by_row, self.angles_deg.size) / total,
            shape=np.bincount(member, by_row, self.members.size) / total,
            amplitude=weight.sum(axis=0, dtype=np.float64) / total,
            particles=Particles(
                theta_deg=self.angles_deg[angle[row]],
                member=self.members[member[row]],
                log_amplitude=self.log_amplitude[np.minimum(place, self.log_amplitude.size - 1)],
            ),
        )


@compiled
def _tops(rows: Float32[np.ndarray, "rows amplitudes"]) -> Float32[np.ndarray, " rows"]:
    """Return the largest cell of each row; NumPy reduces a short last axis slowly."""
    tops = rows[:, 0].copy()
    for r in range(rows.shape[0]):
        for a in range(1, rows.shape[1]):
            tops[r] = max(tops[r], rows[r, a])
    return tops


@compiled
def _add_sample(
    rows: Float32[np.ndarray, "rows amplitudes"],
    steps: Float64[np.ndarray, " angles"],
    angle: Int64[np.ndarray, " rows"],
    member: Int64[np.ndarray, " rows"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    tables: Float32[np.ndarray, "errors phases entries"],
    levels: Float64[np.ndarray, " errors"],
    first: float,
    table_step: float,
) -> None:
    """Add ln p of one observation to each cell; ``steps`` is its distance from each angle in steps of the curve.

    ``first`` is ln(lowest amplitude / y) − TABLE_LOW. A cell's place in the table is that plus ln S plus its amplitude.
    The tables are extended at either end by as many entries as there are amplitudes, so that every row lies inside.
    """
    amplitudes = rows.shape[1]
    phases = tables.shape[1]
    entries = tables.shape[2]
    for r in range(rows.shape[0]):
        away = steps[angle[r]]
        near = min(int(away), log_curve.shape[1] - 2)
        part = min(away - near, 1.0)
        level = (1 - part) * log_curve[member[r], near] + part * log_curve[member[r], near + 1]
        # The model error ε of (3) grows from the top of the curve to its tails: a table for each level.
        error = 0
        while level < levels[error]:
            error += 1
        start = math.floor((first + level) / table_step + 0.5)
        entry = math.floor((start + 0.5) / phases)
        shift = min(max(entry + amplitudes, 0), entries - amplitudes)
        # Amplitudes step by whole entries of one phase, so that a row is a sum of two slices: no lookup per cell.
        cells = rows[r]
        known = tables[error, start - entry * phases, shift : shift + amplitudes]
        for a in range(amplitudes):
            cells[a] += known[a]


@lru_cache(maxsize=512)
def _tables(
    observation: Observation, errors: tuple[float, ...], *, phases: int, amplitudes: int
) -> Float32[np.ndarray, "errors phases entries"]:
    """Return the tables of an observation for `_add_sample`: every phases-th entry in a row, and its ends repeated."""
    tables = log_tables(
        noise=observation.noise, cells=observation.cells, errors=errors, ratio=observation.lateral_ratio
    )
    entries = tables.shape[1] // phases
    rows = tables[:, : entries * phases].reshape(len(errors), entries, phases).transpose(0, 2, 1)
    wide = np.empty((len(errors), phases, entries + 2 * amplitudes), np.float32)
    # Beyond the table ln p is that of its last entry.
    wide[..., :amplitudes] = rows[..., :1]
    wide[..., amplitudes:-amplitudes] = rows
    wide[..., -amplitudes:] = rows[..., -1:]
    return wide


def finer(
    shapes: Shapes, coarse: Grid, known: Marginals, observations: Sequence[Observation], *, half_deg: float, angles: int
) -> Grid:
    """Return a grid about the mean of a coarser one, with the shapes and amplitudes that are still probable.

    ``half_deg``: half the width of the new grid. ``angles``: number of angles, odd.
    """
    mean_deg = float(known.angle @ coarse.angles_deg)
    likely = np.argsort(-known.shape, kind="stable")[:MAX_SHAPES]
    members = np.sort(coarse.members[likely[known.shape[likely] > _MIN_SHARE * known.shape.max()]])
    centre = float(known.amplitude @ coarse.log_amplitude)
    # A coarse grid does not resolve less than about half of its step, which is added.
    sigma = math.sqrt(float(known.amplitude @ (coarse.log_amplitude - centre) ** 2)) + coarse.step_amplitude / 2
    # The amplitudes span 8 standard deviations, in steps of 1 to 8 entries of the table.
    phases = max(1, min(8, math.ceil(8 * sigma / (AMPLITUDES - 1) / TABLE_STEP)))
    step_deg = 2 * half_deg / (angles - 1)
    grid = Grid(
        shapes=shapes,
        angles_deg=mean_deg + step_deg * (np.arange(angles) - angles // 2),
        members=members,
        lowest=centre - phases * TABLE_STEP * (AMPLITUDES - 1) / 2,
        phases=phases,
        amplitudes=AMPLITUDES,
        blur=_blur(step_deg),
        log_amplitude_prior=coarse.log_amplitude_prior,
        energy_error=coarse.energy_error,
    )
    for observation in observations:
        grid.add(observation)
    return grid


def _blur(step_deg: float) -> float:
    """Return the relative error that a step of the angle adds: a fifth per degree, rounded up to one of `BLURS`."""
    return min((blur for blur in BLURS if blur >= 0.2 * step_deg), default=max(BLURS))


def mean_and_sigma(
    angle_deg: Float64[np.ndarray, " angles"], probability: Float64[np.ndarray, " angles"]
) -> tuple[float, float]:
    """Return the mean and standard deviation on an even grid, the width of its step included."""
    mean_deg = float(probability @ angle_deg)
    step_deg = float(angle_deg[1] - angle_deg[0])
    return mean_deg, math.sqrt(float(probability @ (angle_deg - mean_deg) ** 2) + step_deg**2 / 12)
