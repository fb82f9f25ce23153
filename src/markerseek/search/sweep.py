"""Sweeps in equal steps over the whole range: weighted average and fine scan (sections 2.2 and 2.4 of the paper).

    θd = (θmax − θmin)/(N − 1)                                                           (5)

`WeightedAverage` is the paper's method with its threshold and its early end; `Exhaustive` is the fine scan that a
reference is made from. The formulas themselves are in `average` and `parabola`.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import PAPER_RANGE, ConfigError, Float64, Found, Interval
from markerseek.search.average import THRESHOLD, average_sigma_deg, weighted_average
from markerseek.search.curve import curve_of
from markerseek.search.parabola import fit_top
from markerseek.search.policy import SearchPolicy, check_acquisitions, check_start


def equal_steps(limits: Interval, *, acquisitions: int) -> Float64[np.ndarray, " acquisitions"]:
    """Return the angles of a sweep in degrees, ascending, with both ends of the range and the step of eq. (5)."""
    return np.linspace(limits.low_deg, limits.high_deg, acquisitions)


MAX_STEPS = 5000
"""Most angles of one sweep: the scan of a bank has more angles than a search has acquisitions."""


def peak_passed(intensity: Float64[np.ndarray, " samples"], *, threshold: float = THRESHOLD) -> bool:
    """Whether a sweep has recorded its peak and passed it (section 3.3 of the paper).

    True where the largest sample so far is not the last, and the last two are below ``threshold`` of it. If
    several are equally large, each counts. If all are zero, none is below the threshold, and the sweep continues.

    ``intensity``: intensities in the order in which the sweep took them. ``threshold``: share of the largest sample.
    """
    if intensity.size < 3:
        return False
    level = threshold * float(intensity.max())
    return bool(intensity[-1] < level and intensity[-2] < level)


class Sweep(SearchPolicy):
    """Visits the angles of eq. (5) one after another.

    Parameters
    ----------
    limits
        Range to sweep, both ends included.
    acquisitions
        Number N of angles, at least 2.
    start_deg
        Present angle of the probe, in degrees: the sweep begins at the nearer end, at the low one if both are
        equally near. None: at the low end, as in the paper.
    """

    name = "sweep"
    least = 2

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int, start_deg: float | None = None) -> None:
        super().__init__()
        check_acquisitions(acquisitions, least=self.least, most=MAX_STEPS, method=self.name)
        check_start(start_deg, method=self.name)
        angles = equal_steps(limits, acquisitions=acquisitions)
        descending = start_deg is not None and start_deg > limits.centre_deg
        self._angles = angles[::-1] if descending else angles
        self._limits = limits

    @property
    def step_deg(self) -> float:
        """Step θd of eq. (5) in degrees."""
        return self._limits.width_deg / (self._angles.size - 1)

    def _next_deg(self) -> float | None:
        """Next angle of the sweep in degrees; None at the end."""
        return float(self._angles[len(self._lit)]) if len(self._lit) < self._angles.size else None

    def _found(self, mean_deg: float, sigma_deg: float) -> Found:
        """Answer with a normal interval, its middle moved into the range if the stage overshot the range."""
        inside_deg = self._limits.nearest(mean_deg)
        # An interval has a width: one unit in the last place of a range means "exact".
        half_deg = max(1.96 * sigma_deg, 1e-12 * self._limits.width_deg)
        return Found(
            mean_deg=inside_deg,
            sigma_deg=sigma_deg,
            interval95_deg=Interval(low_deg=inside_deg - half_deg, high_deg=inside_deg + half_deg),
            interval_kind="propagated",
        )

    def _unmeasured(self) -> Found:
        """Answer before the first sample: uniform over the range."""
        return self._found(self._limits.centre_deg, self._limits.width_deg / math.sqrt(12))


class WeightedAverage(Sweep):
    """Sweeps in equal steps and answers with the weighted average of the angles, eq. (1).

    Samples below ``threshold`` of the largest are left out; the weights of the others are not shifted. Where all
    samples are equal, or all are zero, none stands out, and the answer is the plain mean of the angles.

    Parameters
    ----------
    limits, acquisitions, start_deg
        See `Sweep`; a full scan has N = ``acquisitions`` samples.
    threshold
        Share of the largest sample below which a sample is left out, above 0 and at most 1; the paper's is 0.2.
    early_end
        End as soon as the peak is recorded and passed (`peak_passed`), as in the paper's online analysis. Its offline
        analysis has full scans.

    Raises
    ------
    ConfigError
        If an argument is out of the range given above.
    """

    name = "weighted-average"

    def __init__(
        self,
        *,
        limits: Interval = PAPER_RANGE,
        acquisitions: int,
        start_deg: float | None = None,
        threshold: float = THRESHOLD,
        early_end: bool = True,
    ) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions, start_deg=start_deg)
        if not 0 < threshold <= 1:
            raise ConfigError(f"weighted-average: threshold is {threshold:g}, it must lie above 0 and be at most 1")
        self._threshold = threshold
        self._early_end = early_end

    def _next_deg(self) -> float | None:
        """Next angle of the sweep in degrees; None at its end, or once the peak is passed."""
        intensity = np.array([sample.reading.intensity for sample in self._lit], dtype=np.float64)
        if self._early_end and peak_passed(intensity, threshold=self._threshold):
            return None
        return super()._next_deg()

    def estimate(self) -> Found:
        """Weighted average of the angles measured so far; the range's middle before the first."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Weighted average with the uncertainty of `average_sigma_deg`.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity; None: that of the samples left out, once there are four.
        """
        if not self._lit:
            return self._unmeasured()
        curve = curve_of(self._lit)
        if noise_sigma is None:
            largest = float(curve.intensity.max())
            below = curve.intensity[curve.intensity < self._threshold * largest]
            # Computed from shares of the largest, because the squares of large intensities overflow.
            noise_sigma = largest * float(np.std(below / largest, ddof=1)) if below.size >= 4 else 0.0
        mean_deg = float(weighted_average(curve.angle_deg, curve.intensity, threshold=self._threshold))
        sigma_deg = average_sigma_deg(curve, step_deg=self.step_deg, noise_sigma=noise_sigma, threshold=self._threshold)
        return self._found(mean_deg, sigma_deg)


class Exhaustive(Sweep):
    """Sweeps in fine steps and answers with the vertex of a parabola through the top of the curve.

    The parabola is fitted by least squares to the samples around the largest that are not below 0.7 of it, at least
    three (`fit_top`); its vertex lies between the first and the last of them. Where there is no vertex (a flat or zero
    curve, the largest sample at an end), the answer is the angle of the largest sample, and the lowest of these
    angles if several are equally large.
    """

    name = "exhaustive"
    least = 3

    def estimate(self) -> Found:
        """Vertex of the parabola through the top; the range's middle before the first sample."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Vertex with the uncertainty of the fit.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity; the scatter about the parabola counts where it is larger.
        """
        if not self._lit:
            return self._unmeasured()
        # Where the noise is unknown, the scatter alone counts.
        known_sigma = 0.0 if noise_sigma is None else noise_sigma
        top = fit_top(curve_of(self._lit), step_deg=self.step_deg, noise_sigma=known_sigma)
        return self._found(top.vertex_deg, top.sigma_deg)
