"""Motion of the marker during a search: what the frames show of it, and what they leave open along the turn.

An intensity depends on the angle between probe and marker. So a sample that was taken while the marker was displaced by
δ along the turn is one at the angle θ − δ/ρ, and only this part of a motion moves the answer. The other two parts are
seen in every frame: the marker's lateral position v and its depth d, less what the slant range (4) makes of the angle.
About their means both scatter by a known noise n, with the tails of a Student distribution, and by the motion,

    v_i ~ t₄(v̄, n_i² + σ_v²),        d_i ~ t₄(d̄, n_i² + σ_d²).                                              (16)

Tissue moves to and fro along a line that may have any direction: with σ the standard deviation of the displacement
along it, and c a unit vector, σ_v = σ|c_v|, σ_d = σ|c_d|, and along the turn σ_t = σ|c_t|. (16) with a prior over σ,
flat in ln σ, and over c, gives the probability of each σ_t (`along_turn`). c is flat over the sphere, but for a part of
all motions that is just along the turn: a probe that turns takes the tissue along that it touches. If nothing is seen
in the other two directions, the marker rests, or it is one of these.

An acquisition that averages pulses for longer than half a breath shows the mean place of the breath, each time the
same, and no motion. Its pulses are out of phase, too, so that it is weaker. The search does not know how long it took.

What is not seen is a nuisance: a displacement of each sample at rest, or of each pass of a sweep, that is normal with
σ_t, and the displacement of the place in the pause from the mean over the samples. In the usual model of breathing,
cos⁴ and cos⁶ of the phase, the latter is 1.03 and 0.87 of the former's standard deviation; it is taken as normal with
σ_t. The intensities weigh the σ_t in turn, by their evidence (`inference`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek.core import USUAL_FACE_RADIUS_M, USUAL_SOUND_SPEED_M_S, Float64, Sample, displacement_sigmas
from markerseek.search.posterior.arrival import LOBE_DEG, off_plane

SIGMAS_M = 1e-3 * np.array([0.0, 0.05, 0.1, 0.17, 0.3, 0.5, 0.85, 1.5, 2.6])
"""σ_t that are considered: at rest, and moving."""

OVERALL_M = np.geomspace(0.05e-3, 3e-3, 15)
"""σ that are considered: those of ± 0.07 to ± 4 mm."""

MOVES = 0.1
"""Prior probability that the marker moves, where nothing is stated of it: phantoms rest, a patient breathes."""

_JUST_ALONG_TURN = 0.2
"""Part of the motions that are only along the turn, where frames show nothing of them."""

STATED_FACTOR = 1.5
"""By which factor, as a standard deviation of ln σ, a motion that the rig states may be larger or smaller."""

SIGMA_OF_AMPLITUDE = 0.72
"""Standard deviation of breathing over its amplitude: 0.73 for cos⁴, 0.715 for cos⁶, 0.707 for a sine."""

MIN_TOP_SHARE = 0.08
"""Intensity over the strongest one's from which the motion is judged by the place of a sample."""

MIN_PLACE_SNR = 8.0
"""Intensity over the noise from which a sample shows where the marker is."""

MIN_PLACES = 2
"""Samples at rest, or passes of sweeps, from which a motion is seen."""

REST_SIGMAS = 2.0
"""Distance of a place from the mean of all, over its noise, below which nothing speaks for a motion."""

MAX_REST_PROBABILITY = 0.1
"""Probability of rest below which the displacements that are seen are taken for those of a motion."""

MIN_LOG_RATIO = 3.0
"""ln of the likelihood ratio from which a motion is said to be seen: 1 in 80 of places at rest has it."""

OFF_LINE = 0.3
"""Displacement beside the line, over that along it, as a standard deviation: tissue that breathes moves on narrow
loops, and σ_t is considered in steps."""

POSITION_M = 8e-6
"""Standard deviation of the lateral position of a point from frame to frame: of 308 samples of 60 simulated points."""

POSITION_NOISE_M = 0.55e-3
"""Standard deviation of the lateral position by noise, times the SNR: of the samples of `POSITION_M`."""

EDGE_M = (0.05e-3, 0.15e-3)
"""Standard deviations of lateral position and depth where the edges of the element are stronger than its face: of the
samples of `POSITION_M`."""

GRAINS_M = 0.4e-3
"""Standard deviation of the position of a spot whose sound is not in phase: its brightest grain is at another place for
each angle."""

UNKNOWN_COHERENCE = 0.97
"""Coherence at the best focus that is assumed where no frame tells it."""

_LEAST_PERIOD_S = 2.0
"""Shortest period of a motion that is considered."""

_MOST_PERIOD_S = 10.0
"""Longest period of a motion that is considered."""

_FALSE_PERIOD = 0.01
"""Probability, of noise alone, from which a period is none."""

DIRECTIONS = 240
"""Directions in an octant of the sphere that stand for all."""

PLACE_SIGMAS_M = np.concatenate([[0.0], np.geomspace(2e-6, OVERALL_M[-1], 40)])
"""σ_v and σ_d at which (16) is computed; linear in between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnMotion:
    """What the frames say of the motion of a marker."""

    probability: Float64[np.ndarray, " sigmas"]
    """Probability of each of `SIGMAS_M`, before the intensities say more."""
    lateral_m: float | None
    depth_m: float | None
    """``lateral_m`` and ``depth_m``: amplitude of the motion along the array and in depth; None: it cannot be
    seen, because the frames give no places, or too few."""
    relative_displacement: Float64[np.ndarray, " samples"]
    """Displacement at each sample in the other two directions, over its standard deviation; 0 where it is not known."""
    relative_sigma: Float64[np.ndarray, " samples"]
    """Standard deviation of the displacement along the turn that this leaves, over σ_t; 1 where it says nothing."""
    period_s: float | None = None
    """Period of the motion, where the times of the samples show one."""

    @property
    def rests(self) -> bool:
        """Whether the marker certainly rests: nothing of a motion can be seen, or the rig states that there is none."""
        return bool(self.probability[0] == 1)

    @property
    def looked_at(self) -> bool:
        """Whether a motion in the other two directions would have been seen."""
        return self.lateral_m is not None

    @property
    def is_seen(self) -> bool:
        """Whether the frames show that the marker moves."""
        return max(self.lateral_m or 0.0, self.depth_m or 0.0) > 0

    @property
    def turn_sigma_m(self) -> float:
        """Root mean square of σ_t."""
        return math.sqrt(float(self.probability @ SIGMAS_M**2))


AGAIN_WIDTHS = 0.02
AGAIN_DEG = 0.1
"""Distance of two samples, over the full width of the curve at half maximum, and in degrees for a narrow curve, within
which they are of one angle: what differs between them is no matter of the curve."""


def measured_twice(angles_deg: Sequence[float], *, fwhm_deg: float) -> bool:
    """Return whether two samples at these angles are of one."""
    apart_deg = np.diff(np.sort(angles_deg))
    return bool((apart_deg <= max(AGAIN_WIDTHS * fwhm_deg, AGAIN_DEG)).any())


def motion_of(samples: Sequence[Sample], *, mean_deg: float, sigma: float, stated_m: float | None = None) -> TurnMotion:
    """Return what samples of one marker say of its motion.

    ``mean_deg``: angle of the marker. ``sigma``: noise of one quadrature of readings that do not state theirs.
    ``stated_m``: amplitude that the rig states; None: nothing.
    """
    moments = _moments(samples, mean_deg=mean_deg, sigma=sigma)
    clear = [each for each in moments if each.clear]
    relative_displacement = np.zeros(len(samples))
    relative_sigma = np.ones(len(samples))
    if len(clear) < MIN_PLACES:
        # What cannot be seen is not assumed, unless it is stated: the answer says that it was not seen.
        known = along_turn(overall_prior(stated_m or 0.0), None)
        return TurnMotion(
            probability=known,
            lateral_m=None,
            depth_m=None,
            relative_displacement=relative_displacement,
            relative_sigma=relative_sigma,
        )
    if stated_m is None and _scatter(clear) < REST_SIGMAS:
        # The usual case, in which (16) need not be computed: a decision must not wait for it.
        return TurnMotion(
            probability=_none_seen(),
            lateral_m=0.0,
            depth_m=0.0,
            relative_displacement=relative_displacement,
            relative_sigma=relative_sigma,
        )
    logs = _log_likelihoods_of(clear)
    probability = along_turn(overall_prior(stated_m), logs)
    lateral_m = _amplitude_m(logs[0])
    depth_m = _amplitude_m(logs[1])
    period_s = None
    if probability[0] < MAX_REST_PROBABILITY:
        relative_displacement, relative_sigma = _displacements(moments, count=len(samples))
    if lateral_m or depth_m:
        period_s = _period_of(clear, samples)
    return TurnMotion(
        probability=probability,
        lateral_m=lateral_m,
        depth_m=depth_m,
        relative_displacement=relative_displacement,
        relative_sigma=relative_sigma,
        period_s=period_s,
    )


@lru_cache(maxsize=1)
def _none_seen() -> Float64[np.ndarray, " sigmas"]:
    """Return the probability of each of `SIGMAS_M` where the other two directions rest, and nothing is stated."""
    at_rest = np.where(PLACE_SIGMAS_M > 0, -np.inf, 0.0)
    return along_turn(overall_prior(None), (at_rest, at_rest))


def _period_of(moments: Sequence[_Moment], samples: Sequence[Sample]) -> float | None:
    """Return the period of the places along the line of motion; None where their times show none, or are not known."""
    times_s = []
    for each in moments:
        headers = [frame.header for number in each.samples if (frame := samples[number].frame) is not None]
        if not headers:
            return None
        times_s.append(float(np.mean([header.started_s for header in headers])))
    place_m = np.array([each.place_m for each in moments])
    noise_m = np.array([each.noise_m for each in moments])
    line = _line_of(place_m - place_m.mean(axis=0))
    return period_s(np.array(times_s), place_m @ line, np.sqrt(noise_m**2 @ line**2))


def period_s(
    times_s: Float64[np.ndarray, " moments"],
    place_m: Float64[np.ndarray, " moments"],
    noise_m: Float64[np.ndarray, " moments"],
) -> float | None:
    """Return the period of places, from the periodogram of a sine with a mean; None where noise may have made it.

    The probability that noise has so large a power at any frequency is bounded as by Baluev (Mon. Not. R. Astron. Soc.
    385, 1279, 2008, equations 5 and 6, with the γ of many samples).
    """
    # Here: scipy.signal lengthens the start of every search, and few see a motion.
    from scipy.signal import lombscargle

    # Mean, amplitude, phase, and two more, without which any period fits.
    lasts_s = float(np.ptp(times_s))
    if times_s.size < 6 or lasts_s < 1.5 * _LEAST_PERIOD_S:
        return None
    frequencies_hz = np.arange(1 / min(_MOST_PERIOD_S, lasts_s), 1 / _LEAST_PERIOD_S, 0.1 / lasts_s)
    power = lombscargle(
        times_s,
        place_m,
        2 * np.pi * frequencies_hz,
        weights=noise_m**-2.0,
        floating_mean=True,
        normalize=True,
    )
    best = int(np.argmax(power))
    peak = np.clip(power, 0.0, 1.0)
    freedom = times_s.size - 3
    width = float(np.ptp(frequencies_hz)) * math.sqrt(4 * math.pi * float(np.var(times_s)))
    crossings = width * (1 - peak) ** ((freedom - 1) / 2) * np.sqrt((times_s.size - 1) * peak / 2)
    by_noise = (1 - peak) ** (freedom / 2) + crossings
    if by_noise[best] > _FALSE_PERIOD:
        return None
    # Samples at equal distances repeat each period at another one.
    elsewhere = np.abs(frequencies_hz - frequencies_hz[best]) > 1 / lasts_s
    if elsewhere.any() and float(by_noise[elsewhere].min()) < float(by_noise[best]) / _FALSE_PERIOD:
        return None
    return 1 / float(frequencies_hz[best])


def _line_of(away_m: Float64[np.ndarray, "moments 2"]) -> Float64[np.ndarray, " 2"]:
    """Return the direction in which places lie apart the most."""
    # The eigenvector of the largest eigenvalue.
    return np.asarray(np.linalg.eigh(away_m.T @ away_m)[1][:, -1])


def _scatter(moments: Sequence[_Moment]) -> float:
    """Return the largest distance of a place from the mean of all, in either direction, over its noise."""
    place_m = np.array([each.place_m for each in moments])
    noise_m = np.array([each.noise_m for each in moments])
    mean_m = np.average(place_m, axis=0, weights=noise_m**-2.0)
    return float((np.abs(place_m - mean_m) / noise_m).max())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """Place of the marker at a sample at rest, or during a pass of a sweep."""

    samples: tuple[int, ...]
    """Numbers of its samples."""
    place_m: tuple[float, float]
    """Lateral position and depth."""
    noise_m: tuple[float, float]
    """Their standard deviations by noise."""
    clear: bool
    """Whether the motion is judged by it: near the top of the curve."""


def _log_likelihoods_of(
    moments: Sequence[_Moment],
) -> tuple[Float64[np.ndarray, " sigmas"], Float64[np.ndarray, " sigmas"]]:
    place_m = np.array([each.place_m for each in moments])
    noise_m = np.array([each.noise_m for each in moments])
    return log_likelihoods(place_m[:, 0], noise_m[:, 0]), log_likelihoods(place_m[:, 1], noise_m[:, 1])


def _displacements(
    moments: Sequence[_Moment], *, count: int
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Return the relative displacements of a motion along the line that explains most of the places, and what is left.

    They are ``relative_displacement`` and ``relative_sigma`` of `TurnMotion`.
    """
    place_m = np.array([each.place_m for each in moments])
    noise_m = np.array([each.noise_m for each in moments])
    clear = np.array([each.clear for each in moments])
    away_m = place_m - np.average(place_m[clear], axis=0, weights=noise_m[clear] ** -2.0)
    line = _line_of(away_m[clear])
    along_m = away_m @ line
    along_m -= along_m[clear].mean()
    spread_m = math.sqrt(float(np.mean(along_m[clear] ** 2)))
    error = np.sqrt(noise_m**2 @ line**2) / spread_m
    displacement = np.zeros(count)
    left = np.ones(count)
    for each, by, sigma in zip(moments, (along_m / spread_m).tolist(), error.tolist(), strict=True):
        # Where noise hides the displacement, it is the mean.
        weight = 1 / (1 + sigma**2)
        displacement[list(each.samples)] = weight * by
        left[list(each.samples)] = math.hypot(OFF_LINE, sigma * math.sqrt(weight))
    return displacement, np.minimum(left, 1.0)


def overall_prior(stated_m: float | None) -> Float64[np.ndarray, " overall"]:
    """Return the prior probability that the marker rests, and of each of `OVERALL_M`."""
    if stated_m == 0:
        moving = 0.0
        shares = np.ones(OVERALL_M.size)
    elif stated_m is None:
        moving = MOVES
        shares = np.ones(OVERALL_M.size)
    else:
        moving = 1.0
        shares = np.exp(-0.5 * (np.log(OVERALL_M / (SIGMA_OF_AMPLITUDE * stated_m)) / math.log(STATED_FACTOR)) ** 2)
    return np.concatenate([[1 - moving], moving * shares / shares.sum()])


def log_likelihoods(
    place_m: Float64[np.ndarray, " moments"], noise_m: Float64[np.ndarray, " moments"]
) -> Float64[np.ndarray, " sigmas"]:
    """Return ln of the likelihood (16) of places for each motion of `PLACE_SIGMAS_M`, the mean place integrated out."""
    # A mean beyond the places is less probable than one at their ends.
    middle_m = np.linspace(place_m.min() - noise_m.min(), place_m.max() + noise_m.min(), 41)
    scale_m = np.hypot(noise_m, PLACE_SIGMAS_M[:, None])[:, None, :]
    away = (place_m - middle_m[:, None]) / scale_m
    log_p = -(np.log(scale_m) + 2.5 * np.log1p(away**2 / 4)).sum(axis=-1)
    largest = log_p.max(axis=-1)
    return np.asarray(largest + np.log(np.exp(log_p - largest[:, None]).mean(axis=-1)))


@lru_cache(maxsize=1)
def _directions() -> Float64[np.ndarray, "directions 3"]:
    """Return the unit vectors, evenly over an octant: along the turn, along the array, in depth."""
    number = np.arange(DIRECTIONS) + 0.5
    # Points of equal areas on a spiral (Fibonacci's lattice), with the signs left out.
    along = number / DIRECTIONS
    around = np.pi * (1 + math.sqrt(5)) * number
    across = np.sqrt(1 - along**2)
    return np.asarray(np.abs(np.stack([along, across * np.cos(around), across * np.sin(around)], axis=1)))


def along_turn(
    prior: Float64[np.ndarray, " overall"],
    logs: tuple[Float64[np.ndarray, " places"], Float64[np.ndarray, " places"]] | None,
) -> Float64[np.ndarray, " sigmas"]:
    """Return the probability of each of `SIGMAS_M`, from the prior over σ and the likelihoods of (16).

    ``logs``: of the lateral positions and of the depths; None: not known.
    """
    directions = _directions()
    sigma_m = OVERALL_M[:, None, None] * directions
    log_moving = np.zeros(sigma_m.shape[:2])
    log_rest = 0.0
    if logs is not None:
        for log, part_m in zip(logs, (sigma_m[:, :, 1], sigma_m[:, :, 2]), strict=True):
            log_moving += np.interp(part_m, PLACE_SIGMAS_M, log)
            log_rest += float(log[0])
    largest = max(log_rest, float(log_moving.max()))
    moving = (1 - _JUST_ALONG_TURN) * prior[1:, None] * np.exp(log_moving - largest) / directions.shape[0]
    at_rest = math.exp(log_rest - largest)
    by_turn = _on_grid(sigma_m[:, :, 0], moving) + _on_grid(OVERALL_M, _JUST_ALONG_TURN * prior[1:] * at_rest)
    total = np.concatenate([[prior[0] * at_rest], by_turn])
    return np.asarray(total / total.sum())


def _on_grid(
    sigma_m: Float64[np.ndarray, "*n"], probability: Float64[np.ndarray, "*n"]
) -> Float64[np.ndarray, " moving"]:
    """Return the probability of each of `SIGMAS_M` but the first, from that of some σ_t.

    Each is shared between its neighbours on the grid, so that σ_t² is kept on average; one outside the grid counts at
    the nearest end of it.
    """
    place = np.interp(sigma_m**2, SIGMAS_M[1:] ** 2, np.arange(SIGMAS_M.size - 1.0))
    left = np.minimum(place.astype(np.int64), SIGMAS_M.size - 3)
    share = place - left
    by_turn = np.bincount(left.ravel(), (probability * (1 - share)).ravel(), minlength=SIGMAS_M.size - 1)
    return by_turn + np.bincount(left.ravel() + 1, (probability * share).ravel(), minlength=SIGMAS_M.size - 1)


def _amplitude_m(log: Float64[np.ndarray, " sigmas"]) -> float:
    """Return the likeliest amplitude of motion in one direction; 0 where rest explains the places about as well."""
    best = int(np.argmax(log))
    if log[best] - log[0] < MIN_LOG_RATIO:
        return 0.0
    return float(PLACE_SIGMAS_M[best]) / SIGMA_OF_AMPLITUDE


def _moments(samples: Sequence[Sample], *, mean_deg: float, sigma: float) -> list[_Moment]:
    """Return where the marker was at each sample at rest and during each pass of a sweep, as far as frames show it."""
    known = [
        (number, each)
        for number, each in enumerate(samples)
        if each.reading.lateral_m is not None and each.reading.depth_m is not None
    ]
    if not known:
        return []
    strongest = max((sample.reading for _, sample in known), key=lambda reading: reading.intensity)
    coherences = [each for _, sample in known if (each := sample.reading.focused_coherence) is not None]
    incoherent = 1 - (float(np.mean(coherences)) if coherences else UNKNOWN_COHERENCE)
    grains_m = GRAINS_M * min(max(incoherent, 0.0), 1.0)
    passes: dict[tuple[int, int, bool], list[tuple[int, Sample, float]]] = {}
    for number, sample in known:
        snr = sample.reading.intensity / (sample.reading.noise_sigma or sigma)
        if snr >= MIN_PLACE_SNR:
            # All pulses of a pass are of about one moment.
            timing = sample.sweep
            key = (0, number, False) if timing is None else (1, timing.number, timing.speed_deg_s > 0)
            passes.setdefault(key, []).append((number, sample, snr))
    depth_m = float(strongest.depth_m or 0.0)
    least = MIN_TOP_SHARE * strongest.intensity
    return [
        _moment(each, mean_deg=mean_deg, depth_m=depth_m, grains_m=grains_m, least=least) for each in passes.values()
    ]


def _moment(
    together: Sequence[tuple[int, Sample, float]], *, mean_deg: float, depth_m: float, grains_m: float, least: float
) -> _Moment:
    """Return the mean place of the samples of a moment: their number, the sample, and its intensity over the noise.

    ``depth_m``: depth of the marker. ``grains_m``: of `GRAINS_M`. ``least``: least intensity of a clear sample.
    """
    clear = any(sample.reading.intensity >= least for _, sample, _ in together)
    counted = [each for each in together if not clear or each[1].reading.intensity >= least]
    places_m = np.array([_place(sample, mean_deg=mean_deg, depth_m=depth_m) for _, sample, _ in counted])
    snr = np.array([each for _, _, each in counted])
    lobes = np.array([((sample.angle_deg - mean_deg) / LOBE_DEG) ** 2 for _, sample, _ in counted])
    edges = (lobes / (1 + lobes))[:, None]
    noise_m = np.hypot(np.hypot(POSITION_M, POSITION_NOISE_M / snr)[:, None], np.array(EDGE_M) * edges)
    weight = noise_m**-2.0
    lateral, depth = ((weight * places_m).sum(axis=0) / weight.sum(axis=0)).tolist()
    # The motion that cameras saw is taken out already; their error is not.
    camera_errors = [displacement_sigmas(sample) for _, sample, _ in counted]
    camera_m = np.mean([(each.lateral_m, each.depth_m) for each in camera_errors], axis=0)
    # What two pulses beside one another have in common does not shrink with their number.
    own_m = np.hypot(weight.sum(axis=0) ** -0.5, math.hypot(POSITION_M, grains_m))
    lateral_noise, depth_noise = np.hypot(own_m, camera_m).tolist()
    return _Moment(
        samples=tuple(number for number, _, _ in together),
        place_m=(lateral, depth),
        noise_m=(lateral_noise, depth_noise),
        clear=clear,
    )


def _place(sample: Sample, *, mean_deg: float, depth_m: float) -> tuple[float, float]:
    """Return the lateral position of the marker, and its depth as it would be in its plane, in metres."""
    reading = sample.reading
    lateral_m = float(reading.lateral_m or 0.0)
    slant_m = float(reading.depth_m or 0.0)
    if reading.spot is not None:
        lateral_m = reading.spot.lateral_m
        slant_m = reading.spot.depth_m
    late_s, _ = off_plane(np.array([sample.angle_deg - mean_deg]), USUAL_FACE_RADIUS_M, max(depth_m, 5e-3))
    return lateral_m, slant_m - USUAL_SOUND_SPEED_M_S * float(late_s[0])
