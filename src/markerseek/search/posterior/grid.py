"""The posterior of the angle on a grid: sums over shape and amplitude, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek.core.shapes import Float32, Float64, Int64
from markerseek.search.posterior import _kernel
from markerseek.search.posterior.heard import LOW, STEP, log_tables
from markerseek.search.posterior.shapes import MODEL_ERROR, STEP_DEG, Shapes

LEVELS = np.array([math.log(level) if level > 0 else -math.inf for level, _ in MODEL_ERROR])
"""ln of the levels of `MODEL_ERROR`, downwards."""

ERRORS = np.array([error for _, error in MODEL_ERROR])
"""Relative errors of `MODEL_ERROR`."""

MOST_SHAPES = 32
"""Shapes that a finer grid keeps at most."""

LEAST_SHARE = 1e-4
"""Probability over the likeliest shape's below which a finer grid drops a shape."""

BLURS = (0.01, 0.04, 0.125)
"""Relative errors that the steps of a grid may add."""

AMPLITUDES = 20
"""Amplitudes of a finer grid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """One lit sample in the terms of the likelihood.

    Attributes
    ----------
    angle_deg
        Angle reached, in degrees.
    log_intensity
        ln of the intensity over the unit of the search.
    noise
        Standard deviation σ of one quadrature over the intensity.
    cells
        Number M of independent envelope cells.
    ratio
        What the peak's place says for the marker over noise, `place_ratio`.
    """

    angle_deg: float
    log_intensity: float
    noise: float
    cells: int
    ratio: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Markers:
    """Markers of equal weight drawn from a posterior.

    Attributes
    ----------
    theta_deg
        Angles in degrees.
    member
        Shapes, as places in the family.
    log_amplitude
        ln of the amplitudes over the unit of the search.
    """

    theta_deg: Float64[np.ndarray, " particles"]
    member: Int64[np.ndarray, " particles"]
    log_amplitude: Float64[np.ndarray, " particles"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marginals:
    """Probabilities on a grid, each adding up to 1, and markers drawn from it.

    Attributes
    ----------
    angle, shape, amplitude
        Marginal probabilities.
    markers
        Markers of equal weight.
    """

    angle: Float64[np.ndarray, " angles"]
    shape: Float64[np.ndarray, " shapes"]
    amplitude: Float64[np.ndarray, " amplitudes"]
    markers: Markers


class Grid:
    """Log-likelihood of the samples so far over angle, shape and ln amplitude.

    Parameters
    ----------
    shapes
        Family of curves.
    angles_deg
        Angles of the marker that are considered, in degrees.
    members
        Which curves of the family.
    lowest
        ln of the lowest amplitude, over the unit of the search.
    phases
        Step of ln amplitude, in steps of the table, `heard.STEP`.
    amplitudes
        Number of amplitudes.
    blur
        Relative error that the grid's own steps add to the model's.
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
    ) -> None:
        self.angles_deg = angles_deg
        self.members = members
        self.log_amplitude = lowest + phases * STEP * np.arange(amplitudes)
        self._shapes = shapes
        self._phases = phases
        self._errors = tuple(np.hypot(ERRORS, blur).tolist())
        self._cube: Float32[np.ndarray, "angles shapes amplitudes"] = np.zeros(
            (angles_deg.size, members.size, amplitudes), np.float32
        )
        self._weight = np.empty_like(self._cube)
        self._alive = np.ones((angles_deg.size, members.size), np.bool_)

    @property
    def step_amplitude(self) -> float:
        """Step of ln amplitude."""
        return self._phases * STEP

    def add(self, heard: Heard) -> None:
        """Take in one sample."""
        tables = _tables(heard, self._errors, phases=self._phases, amplitudes=self.log_amplitude.size)
        _kernel.add_sample(
            self._cube,
            self._alive,
            self.angles_deg,
            self.members,
            self._shapes.log_curve,
            STEP_DEG,
            heard.angle_deg,
            tables,
            LEVELS,
            self.log_amplitude[0] - heard.log_intensity - LOW,
            STEP,
        )

    def marginals(self, log_angle: Float64[np.ndarray, " angles"], *, particles: int) -> Marginals:
        """Probabilities under the priors; ``log_angle`` holds the angle's, with whatever else is known of it."""
        weight = self._weight
        angle, shape, amplitude = (np.empty(size) for size in self._cube.shape)
        log_shape = self._shapes.log_prior[self.members]
        _kernel.weigh(self._cube, self._alive, log_angle, log_shape, weight, angle, shape, amplitude)
        drawn = np.zeros((particles, 3), np.int64)
        place = drawn[: _kernel.draw(weight, angle, drawn)]
        markers = Markers(
            theta_deg=self.angles_deg[place[:, 0]],
            member=self.members[place[:, 1]],
            log_amplitude=self.log_amplitude[place[:, 2]],
        )
        total = angle.sum()
        return Marginals(angle=angle / total, shape=shape / total, amplitude=amplitude / total, markers=markers)


@lru_cache(maxsize=512)
def _tables(
    heard: Heard, errors: tuple[float, ...], *, phases: int, amplitudes: int
) -> Float32[np.ndarray, "errors phases heights"]:
    """Tables of a sample as `_kernel.add_sample` wants them: a phase a row, and its ends repeated."""
    tables = log_tables(noise=heard.noise, cells=heard.cells, errors=errors, ratio=heard.ratio)
    heights = tables.shape[1] // phases
    rows = tables[:, : heights * phases].reshape(len(errors), heights, phases).transpose(0, 2, 1)
    wide = np.empty((len(errors), phases, heights + 2 * amplitudes), np.float32)
    wide[..., :amplitudes] = rows[..., :1]
    wide[..., amplitudes:-amplitudes] = rows
    wide[..., -amplitudes:] = rows[..., -1:]
    return wide


def finer(
    shapes: Shapes, coarse: Grid, known: Marginals, samples: Sequence[Heard], *, half_deg: float, angles: int
) -> Grid:
    """Return a grid about the middle of a coarser one, with the shapes and amplitudes that are left.

    Parameters
    ----------
    shapes
        Family of curves.
    coarse, known
        The coarser grid and its probabilities.
    samples
        All samples so far.
    half_deg
        Half the width of the new grid, in degrees.
    angles
        Number of angles, odd.
    """
    middle_deg = float(known.angle @ coarse.angles_deg)
    likely = np.argsort(-known.shape, kind="stable")[:MOST_SHAPES]
    members = np.sort(coarse.members[likely[known.shape[likely] > LEAST_SHARE * known.shape.max()]])
    centre = float(known.amplitude @ coarse.log_amplitude)
    spread = math.sqrt(float(known.amplitude @ (coarse.log_amplitude - centre) ** 2)) + coarse.step_amplitude / 2
    phases = max(1, min(8, math.ceil(8 * spread / (AMPLITUDES - 1) / STEP)))
    step_deg = 2 * half_deg / (angles - 1)
    grid = Grid(
        shapes=shapes,
        angles_deg=middle_deg + step_deg * (np.arange(angles) - angles // 2),
        members=members,
        lowest=centre - phases * STEP * (AMPLITUDES - 1) / 2,
        phases=phases,
        amplitudes=AMPLITUDES,
        blur=_blur(step_deg),
    )
    for heard in samples:
        grid.add(heard)
    return grid


def _blur(step_deg: float) -> float:
    """Error that a step of the angle adds: a fifth per degree, rounded up to one of few, so that tables are kept."""
    return min((blur for blur in BLURS if blur >= 0.2 * step_deg), default=max(BLURS))
