"""Posterior on a grid of angle, shape and amplitude; the nuisance parameters are summed out for the marginals.

The log-likelihood of each observation is added to every cell: O(cells) per sample, and nothing is computed again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek.core import Float32, Float64, Int64
from markerseek.search.posterior import _grid
from markerseek.search.posterior.likelihood import TABLE_LOW, TABLE_STEP, Observation, log_tables
from markerseek.search.posterior.shapes import MODEL_ERROR, STEP_DEG, Shapes

LEVELS = np.array([math.log(level) if level > 0 else -math.inf for level, _ in MODEL_ERROR])
"""ln of the levels of `MODEL_ERROR`, downwards."""

ERRORS = np.array([error for _, error in MODEL_ERROR])
"""Relative errors of `MODEL_ERROR`."""

MAX_SHAPES = 32
"""Most shapes that a finer grid keeps."""

MIN_SHARE = 1e-4
"""Probability of a shape, over that of the likeliest, below which a finer grid drops it."""

BLURS = (0.01, 0.04, 0.125)
"""Relative errors that the steps of a grid may add; few, so that the tables of a sample are found in the cache."""

MAX_STRONG = 16
"""Strong observations that count in full; the likelihood of more counts to the power of this over their number.

The error of the curve's form is taken as each observation's own, but those that are beside one another share it: a
hundred would make one cell of the grid certain, beside the marker.
"""

AMPLITUDES = 20
"""Amplitudes of a finer grid."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Particles:
    """Markers of equal weight drawn from a posterior."""

    theta_deg: Float64[np.ndarray, " particles"]
    member: Int64[np.ndarray, " particles"]
    """Shapes, as indices into the family."""
    log_amplitude: Float64[np.ndarray, " particles"]
    """ln of the amplitudes over the unit of the search."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marginals:
    """Marginal probabilities on a grid, each adding up to 1, and markers drawn from it."""

    angle: Float64[np.ndarray, " angles"]
    shape: Float64[np.ndarray, " shapes"]
    amplitude: Float64[np.ndarray, " amplitudes"]
    """``angle``, ``shape`` and ``amplitude``: marginal probabilities."""
    particles: Particles


class Grid:
    """Log-likelihood of the observations so far over angle, shape and ln amplitude.

    ``angles_deg``: angles of the marker that are considered. ``members``: which curves of the family. ``lowest``: ln of
    the lowest amplitude, over the unit of the search. ``phases``: step of ln amplitude, in steps of the table,
    `TABLE_STEP`. ``blur``: relative error that the grid's own steps add to the model's. ``energy_error``: that which
    the laser's energy adds beyond what the model's holds.
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
        self._shapes = shapes
        self._phases = phases
        # The curve changes between two cells: that too is an error of the model, added as squares.
        self._errors = np.hypot(ERRORS, blur)
        self._energy_error = energy_error
        # Single precision halves the memory that each sample passes through; ln p stays exact to 1e-5.
        self._cube: Float32[np.ndarray, "angles shapes amplitudes"] = np.zeros(
            (angles_deg.size, members.size, amplitudes), np.float32
        )
        if log_amplitude_prior is not None:
            mean, sigma = log_amplitude_prior
            self._cube += (-((self.log_amplitude - mean) ** 2) / (2 * sigma**2)).astype(np.float32)
        self._log_amplitude_prior = log_amplitude_prior
        self._weight = np.empty_like(self._cube)
        self._strong = 0
        self._alive = np.ones((angles_deg.size, members.size), np.bool_)

    @property
    def log_amplitude_prior(self) -> tuple[float, float] | None:
        """Prior of ln amplitude, as given."""
        return self._log_amplitude_prior

    @property
    def energy_error(self) -> float:
        """Relative error by the laser's energy, as given."""
        return self._energy_error

    @property
    def step_amplitude(self) -> float:
        """Step of ln amplitude."""
        return self._phases * TABLE_STEP

    def add(self, observation: Observation) -> None:
        """Add the log-likelihood of one observation."""
        self._strong += observation.strong
        errors = np.hypot(self._errors, self._energy_error * observation.energy_share)
        tables = _tables(observation, tuple(errors.tolist()), phases=self._phases, amplitudes=self.log_amplitude.size)
        _grid.add_sample(
            self._cube,
            self._alive,
            self.angles_deg,
            self.members,
            self._shapes.log_curve,
            STEP_DEG,
            observation.angle_deg,
            tables,
            LEVELS,
            self.log_amplitude[0] - observation.log_intensity - TABLE_LOW,
            TABLE_STEP,
        )

    def marginals(self, log_angle: Float64[np.ndarray, " angles"], *, particles: int) -> Marginals:
        """Marginal probabilities; ``log_angle`` is ln of the angle's prior and of its other likelihoods."""
        weight = self._weight
        angle, shape, amplitude = (np.empty(size) for size in self._cube.shape)
        log_shape = self._shapes.log_prior[self.members]
        power = MAX_STRONG / max(self._strong, MAX_STRONG)
        _grid.weigh(self._cube, self._alive, log_angle, log_shape, power, weight, angle, shape, amplitude)
        drawn = np.zeros((particles, 3), np.int64)
        cell = drawn[: _grid.draw(weight, angle, drawn)]
        markers = Particles(
            theta_deg=self.angles_deg[cell[:, 0]],
            member=self.members[cell[:, 1]],
            log_amplitude=self.log_amplitude[cell[:, 2]],
        )
        total = angle.sum()
        return Marginals(angle=angle / total, shape=shape / total, amplitude=amplitude / total, particles=markers)


@lru_cache(maxsize=512)
def _tables(
    observation: Observation, errors: tuple[float, ...], *, phases: int, amplitudes: int
) -> Float32[np.ndarray, "errors phases entries"]:
    """Tables of an observation for `_grid.add_sample`: every phases-th entry in a row, and its ends repeated."""
    tables = log_tables(
        noise=observation.noise, cells=observation.cells, errors=errors, ratio=observation.lateral_ratio
    )
    entries = tables.shape[1] // phases
    rows = tables[:, : entries * phases].reshape(len(errors), entries, phases).transpose(0, 2, 1)
    wide = np.empty((len(errors), phases, entries + 2 * amplitudes), np.float32)
    # Repeated ends: beyond the table ln p is that of its last entry.
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
    members = np.sort(coarse.members[likely[known.shape[likely] > MIN_SHARE * known.shape.max()]])
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
    """Relative error that a step of the angle adds: a fifth per degree, rounded up to one of `BLURS`."""
    return min((blur for blur in BLURS if blur >= 0.2 * step_deg), default=max(BLURS))
