"""Sweeps in equal steps over the whole range: weighted average and fine scan (sections 2.2 and 2.4 of the paper).

    θp = Σ θi·S(θi) / Σ S(θi)                                                            (1)
    θd = (θmax − θmin)/(N − 1)                                                           (5)

`WeightedAverage` is the paper's method with its threshold and its early end; `Exhaustive` is the fine scan that a
reference is made from, with the vertex of a parabola through the top of the curve.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import PAPER_RANGE, Float64, Found, Interval
from markerseek.search.curve import Curve, curve_of
from markerseek.search.policy import SearchPolicy, check_acquisitions, check_start

THRESHOLD = 0.2
"""Share of the largest sample below which a sample is left out (section 3.1 of the paper)."""


def weighted_average(
    angle_deg: Float64[np.ndarray, "*scans samples"],
    intensity: Float64[np.ndarray, "*scans samples"],
) -> Float64[np.ndarray, "*scans"]:
    """Return θp of eq. (1) for each scan, in degrees.

    Samples below `THRESHOLD` of the scan's largest are left out and the weights of the others stay as they are. Where
    all are zero the weights are equal.

    ``angle_deg``, ``intensity``: angles in degrees and intensities (≥ 0); the last axis is averaged over.
    """
    weight = _weights(intensity)
    mean_deg = np.sum(weight * angle_deg, axis=-1) / np.sum(weight, axis=-1)
    # A mean of numbers lies among them; rounding alone can push it out.
    return np.asarray(np.clip(mean_deg, angle_deg.min(axis=-1), angle_deg.max(axis=-1)))


def _weights(intensity: Float64[np.ndarray, "*scans samples"]) -> Float64[np.ndarray, "*scans samples"]:
    """Return the share of the largest sample where it reaches the threshold, else 0.

    All ones where all samples are zero.
    """
    largest = intensity.max(axis=-1, keepdims=True)
    relative = np.divide(intensity, largest, out=np.ones_like(intensity), where=largest > 0)
    return np.where(relative >= THRESHOLD, relative, 0.0)


def average_sigma_deg(curve: Curve, *, step_deg: float, noise_sigma: float) -> float:
    """Return the standard deviation of eq. (1) in degrees, as four independent parts; W = Σ S/Smax of the kept samples.

    1. Noise σ in the kept samples, propagated: σ²·Σ(θi − θp)² / (ΣSi)².
    2. Noise that puts a sample in or out. A sample within 2/√π·σ of the threshold is in or out with equal chance:
       Σ ((θi − θp)·Si/ΣS)²/4 over those. (That width makes the sum equal to ∫ q(1 − q) of a normal q.)
    3. The step. Each end of the kept part lies anywhere between two samples, and Euler–Maclaurin gives an error of
       τ·w·(u1 + u2)/W there, w half the kept width and u uniform in ±1/2: a standard deviation of τ·w/(W·√6). While
       only n samples reach half maximum the curve may fall between the samples, which adds 0.15·θd/n²: not derived, but
       the least that covers curves of 3–17° (FWHM) with n = 1 in simulation.
    4. The range. Where the kept part touches the first or last sample, the curve may continue beyond it and the average
       leans inwards. The average of the kept samples that have a partner on the other side of the largest does not; the
       difference of the two counts in full, and so do parts 1 and 3 for that average, whose window ends where the
       curve is still high.

    Over curves of 3–17° (FWHM), tails as 1/|t| to 1/|t|^2.5, 30 and 40 dB, 15 to 71 samples and markers anywhere in the
    range, ±1.96 standard deviations hold the marker in 94 to 99 % of searches (Monte Carlo of 1,000 each;
    ``tests/reference/search/test_checked.py`` keeps it above 93 %).

    ``step_deg``: step θd of the sweep. ``noise_sigma``: standard deviation σ of one intensity, in its unit; 0 for none.
    """
    weight = _weights(curve.intensity)
    total = float(weight.sum())
    mean_deg = float(weighted_average(curve.angle_deg, curve.intensity))
    distance_deg = curve.angle_deg - mean_deg
    kept = weight > 0
    largest = float(curve.intensity.max())
    if largest == 0:
        return float(np.ptp(curve.angle_deg)) / math.sqrt(12) or step_deg / math.sqrt(12)
    noise = noise_sigma / largest
    relative = curve.intensity / largest

    propagated = noise**2 * float(np.sum(distance_deg[kept] ** 2)) / total**2
    # Part 2; part 1 is the line before.
    marginal = np.abs(relative - THRESHOLD) <= 2 / math.sqrt(math.pi) * noise
    in_or_out = float(np.sum((distance_deg * relative)[marginal] ** 2)) / total**2 / 4
    half_width_deg = np.count_nonzero(kept) * step_deg / 2
    between = THRESHOLD * half_width_deg / (total * math.sqrt(6))
    # Part 3: the ends of the kept run, and the curve between the samples.
    coarse = 0.15 * step_deg / np.count_nonzero(relative >= 0.5) ** 2
    cut = _cut_variance(curve, weight, mean_deg=mean_deg, step_deg=step_deg, noise=noise) if kept[0] or kept[-1] else 0
    return math.sqrt(propagated + in_or_out + between**2 + coarse**2 + cut)


def _cut_variance(
    curve: Curve, weight: Float64[np.ndarray, " samples"], *, mean_deg: float, step_deg: float, noise: float
) -> float:
    """Return the part of the samples with as many neighbours on either side of the largest, in deg²."""
    top = curve.strongest
    reach = min(top, len(curve) - 1 - top)
    near = slice(top - reach, top + reach + 1)
    total = float(weight[near].sum())
    paired_deg = float(np.average(curve.angle_deg[near], weights=weight[near]))
    propagated = noise**2 * float(np.sum((curve.angle_deg[near] - paired_deg) ** 2)) / total**2
    end = float(weight[near][0] + weight[near][-1]) / 2
    between = end * (reach + 0.5) * step_deg / (total * math.sqrt(6))
    return (mean_deg - paired_deg) ** 2 + propagated + between**2


TOP_SHARE = 0.7
"""Samples not below this share of the largest belong to the top: a Gaussian is a parabola there to 3 %."""


def fit_top(curve: Curve, *, step_deg: float, noise_sigma: float) -> tuple[float, float]:
    """Return the vertex of the least-squares parabola S ≈ a + b·t + c·t² through the top, and its standard deviation.

    With t counted from the middle of the top it is −b/(2c); its variance is gᵀ·C·g with g = (0, −1/(2c), b/(2c²)) and
    C = s²·(XᵀX)⁻¹, where s² is σ² or the scatter about the parabola, whichever is larger. Added is 0.5·θd/(n + 1) for a
    top that is not a parabola, n the number of samples that reach half maximum: not derived, but what covers noise-free
    curves from a cusp, 1/(1 + 2|t|), to a Gaussian with steps of 0.15 to 1.2 of their width.

    The top is the run of samples round the largest that are not below `TOP_SHARE` of it, with one neighbour on each
    side where the run is shorter than three. Without a vertex in it (no bend downwards, fewer than three samples,
    the same angle three times) the largest sample answers, uncertain by the step to its neighbours or the run's width,
    whichever is larger, over √3.

    Over the curves of `average_sigma_deg`, 141 samples, ±1.96 standard deviations hold the marker in 95 to 99.7 % of
    searches (Monte Carlo of 400 each).

    ``step_deg``: step θd of the sweep. ``noise_sigma``: standard deviation σ of one intensity, in its unit; 0 for none.
    """
    first, last = _top_run(curve)
    largest = float(curve.intensity[curve.strongest])
    peak_deg = float(curve.angle_deg[curve.strongest])
    run_deg = float(curve.angle_deg[last - 1] - curve.angle_deg[first])
    unresolved = peak_deg, max(step_deg, run_deg) / math.sqrt(3)
    angle_deg = curve.angle_deg[first:last]
    scale_deg = float(np.ptp(angle_deg)) / 2
    if largest == 0 or np.unique(angle_deg).size < 3:
        return unresolved
    middle_deg = float(angle_deg[0]) + scale_deg
    t = (angle_deg - middle_deg) / scale_deg
    # Centred and scaled to ±1, the normal equations are well conditioned.
    powers = np.stack([np.ones_like(t), t, t**2], axis=-1)
    height = curve.intensity[first:last] / largest
    coefficients, _, rank, _ = np.linalg.lstsq(powers, height, rcond=None)
    _, slope, bend = (float(value) for value in coefficients)
    # A flat top bends by rounding alone.
    if rank < 3 or bend > -1e-9 or abs(slope) > 2 * abs(bend):
        return unresolved
    vertex = -slope / (2 * bend)
    scatter = float(np.sum((height - powers @ coefficients) ** 2)) / max(1, t.size - 3)
    variance = max((noise_sigma / largest) ** 2, scatter)
    resolved = np.count_nonzero(curve.intensity >= largest / 2)
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)])
    vertex_variance = variance * float(gradient @ np.linalg.inv(powers.T @ powers) @ gradient)
    sigma_deg = math.hypot(scale_deg * math.sqrt(vertex_variance), 0.5 * step_deg / (resolved + 1))
    return middle_deg + scale_deg * vertex, sigma_deg


def _top_run(curve: Curve) -> tuple[int, int]:
    """Return the half-open run of samples round the largest that reach `TOP_SHARE`, widened to three if possible."""
    top = curve.strongest
    level = TOP_SHARE * curve.intensity[top]
    first = top
    last = top
    while first > 0 and curve.intensity[first - 1] >= level:
        first -= 1
    while last < len(curve) - 1 and curve.intensity[last + 1] >= level:
        last += 1
    if last - first < 2:
        first = max(0, top - 1)
        last = min(len(curve) - 1, top + 1)
    return first, last + 1


def equal_steps(limits: Interval, *, acquisitions: int) -> Float64[np.ndarray, " acquisitions"]:
    """Return the angles of a sweep in degrees, ascending, with both ends of the range and the step of eq. (5)."""
    return np.linspace(limits.low_deg, limits.high_deg, acquisitions)


MAX_STEPS = 5000
"""Most angles of one sweep: the scan of a bank has more angles than a search has acquisitions."""


def peak_passed(intensity: Float64[np.ndarray, " samples"]) -> bool:
    """Return whether a sweep has recorded its peak and passed it (section 3.3 of the paper).

    True where the largest sample so far is not the last, and the last two are below `THRESHOLD` of it. If
    several are equally large, each counts. If all are zero, none is below the threshold, and the sweep continues.

    ``intensity``: intensities in the order in which the sweep took them.
    """
    if intensity.size < 3:
        return False
    level = THRESHOLD * float(intensity.max())
    return bool(intensity[-1] < level and intensity[-2] < level)


class EqualSteps(SearchPolicy):
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
        """Return the next angle of the sweep in degrees; None at the end."""
        return float(self._angles[len(self._lit)]) if len(self._lit) < self._angles.size else None

    def _found(self, mean_deg: float, sigma_deg: float) -> Found:
        """Return the answer with a normal interval, its middle moved into the range if the stage overshot the range."""
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
        """Return the answer before the first sample: uniform over the range."""
        return self._found(self._limits.centre_deg, self._limits.width_deg / math.sqrt(12))


class WeightedAverage(EqualSteps):
    """Sweeps in equal steps and answers with the weighted average of the angles, eq. (1).

    Samples below `THRESHOLD` of the largest are left out; the weights of the others are not shifted. Where all
    samples are equal, or all are zero, none stands out, and the answer is the plain mean of the angles.

    Parameters
    ----------
    limits, acquisitions, start_deg
        See `EqualSteps`; a full scan has N = ``acquisitions`` samples.
    early_end
        End as soon as the peak is recorded and passed (`peak_passed`), as in the paper's online analysis. Its offline
        analysis has full scans.

    Raises
    ------
    ConfigError
        If an argument is out of the range given above.
    """

    name = "weighted-average"
    summary = "equal steps, average of the angles weighted by intensity, early end once the peak is passed"
    acquisitions = 57

    def __init__(
        self,
        *,
        limits: Interval = PAPER_RANGE,
        acquisitions: int,
        start_deg: float | None = None,
        early_end: bool = True,
    ) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions, start_deg=start_deg)
        self._early_end = early_end

    def _next_deg(self) -> float | None:
        """Return the next angle of the sweep in degrees; None at its end, or once the peak is passed."""
        intensity = np.array([sample.reading.intensity for sample in self._lit], dtype=np.float64)
        if self._early_end and peak_passed(intensity):
            return None
        return super()._next_deg()

    def estimate(self) -> Found:
        """Return the weighted average of the angles measured so far; the range's middle before the first."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Return the weighted average with the uncertainty of `average_sigma_deg`.

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
            below = curve.intensity[curve.intensity < THRESHOLD * largest]
            # Computed from shares of the largest, because the squares of large intensities overflow.
            noise_sigma = largest * float(np.std(below / largest, ddof=1)) if below.size >= 4 else 0.0
        mean_deg = float(weighted_average(curve.angle_deg, curve.intensity))
        sigma_deg = average_sigma_deg(curve, step_deg=self.step_deg, noise_sigma=noise_sigma)
        return self._found(mean_deg, sigma_deg)


class Exhaustive(EqualSteps):
    """Sweeps in fine steps and answers with the vertex of a parabola through the top of the curve.

    The parabola is fitted by least squares to the samples around the largest that are not below 0.7 of it, at least
    three (`fit_top`); its vertex lies between the first and the last of them. Where there is no vertex (a flat or zero
    curve, the largest sample at an end), the answer is the angle of the largest sample, and the lowest of these
    angles if several are equally large.
    """

    name = "exhaustive"
    summary = "fine equal steps over the whole range, vertex of a parabola through the top"
    acquisitions = 141
    least = 3

    def estimate(self) -> Found:
        """Return the vertex of the parabola through the top; the range's middle before the first sample."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Return the vertex with the uncertainty of the fit.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity; the scatter about the parabola counts where it is larger.
        """
        if not self._lit:
            return self._unmeasured()
        # Where the noise is unknown, the scatter alone counts.
        known_sigma = 0.0 if noise_sigma is None else noise_sigma
        return self._found(*fit_top(curve_of(self._lit), step_deg=self.step_deg, noise_sigma=known_sigma))
