"""Calibration from one scan of a point source: angle zero, face radius, speed of sound, trigger offset. Pure.

Speed of sound and range come from the moveout: how much later the sound of a point reaches the outer channels. The
pitch of the array is the measure of length. Only differences between the channels of one frame count, so that neither
the trigger's offset nor the shape of the wave enters.

Angle zero, face radius and trigger offset come from the waves at many angles of the probe. Off the image plane sound
arrives later, and at different times over the height of an element: the wave there is the wave in the plane, delayed
and smeared by the geometry. All waves are fitted at once, the element's height and lens included: the smear alone would
be mistaken for a delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import msgspec
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import hilbert

from markerseek.core import Float64, Sample, SearchError

_OUTLIER_S = 5e-9
"""Residual in seconds beyond which a channel counts less: a fifth of a sample at 40 MHz."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moveout:
    """Speed of sound and range from the wave fronts of some frames."""

    sound_speed_m_s: float
    range_m: float
    """Distance of the point from the array."""
    covariance: Float64[np.ndarray, "2 2"]
    """Covariance of these two, from the scatter between the frames."""
    lateral_m: float
    """Position of the point along the array."""


def fit_moveout(
    arrivals_s: Sequence[Float64[np.ndarray, " channels"]], element_m: Float64[np.ndarray, " channels"]
) -> Moveout:
    """Return the speed of sound and range from frames of one point source, taken near its plane.

    In each frame t(y) = t0 + sqrt((y - y0)² + r²)/c; near the plane c and r are common, t0 and y0 its own.

    ``arrivals_s``: arrival at each channel, one array a frame, NaN where there is none; at least 3 frames.
    ``element_m``: positions of the elements along the array.
    """
    if len(arrivals_s) < 3:
        raise SearchError(
            f"{len(arrivals_s)} angles near the strongest show one clear wave front, at least 3 are needed; step finer "
            "there, average more pulses, and check that the source is one point and `probe` is right"
        )
    single = [_fit_frame(arrival, element_m) for arrival in arrivals_s]
    information = np.array([each.information for each in single])
    if np.linalg.matrix_rank(information.sum(axis=0)) < 2:
        raise SearchError(
            "the wave fronts do not bend, as if the source were infinitely far away; check that the channels are those "
            "of an array, and that `probe` is right"
        )
    # Mean of the frames weighted by their information: speed and range of one frame are strongly correlated.
    total = np.linalg.inv(information.sum(axis=0))
    mean = total @ np.einsum("fij,fj->i", information, np.array([each.value for each in single]))
    # Errors of the channels of one frame are correlated: the scatter is that between frames, not channels.
    pull = np.einsum("ij,fjk,fk->fi", total, information, np.array([each.value for each in single]) - mean)
    frames = len(single)
    covariance = pull.T @ pull * frames / (frames - 1)
    speed = float(mean[0])
    if not 1.3 <= speed <= 1.8:
        raise SearchError(
            f"the wave fronts bend as with {1e3 * speed:.0f} m/s, and tissue has 1300 to 1800 m/s; check that the "
            "source is one point and `probe` is right"
        )
    unit = np.array([1e3, 1e-3])
    return Moveout(
        sound_speed_m_s=1e3 * speed,
        range_m=1e-3 * float(mean[1]),
        covariance=covariance * np.outer(unit, unit),
        lateral_m=float(np.median([each.lateral_m for each in single])),
    )


def apex_s(
    arrival_s: Float64[np.ndarray, " channels"],
    element_m: Float64[np.ndarray, " channels"],
    moveout: Moveout,
    *,
    plane_s: float | None = None,
) -> float:
    """Return the time at which a frame's wave would reach an element right above the point, in seconds.

    ``moveout``: result of the frames near the plane. ``plane_s``: the same time of a frame in the plane, for a frame
    off it, where a delay means a longer range. None: this frame is in the plane.
    """
    used = np.isfinite(arrival_s)
    offset_m = element_m[used] - moveout.lateral_m
    # Fixed-point iteration off the plane: the curvature depends on the range, and the range on the apex.
    range_m = moveout.range_m
    apex = 0.0
    for _ in range(1 if plane_s is None else 4):
        bend_s = (np.hypot(offset_m, range_m) - range_m) / moveout.sound_speed_m_s
        apex = float(np.median(arrival_s[used] - bend_s))
        if plane_s is not None:
            range_m = moveout.range_m + moveout.sound_speed_m_s * (apex - plane_s)
    return apex


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FrameFit:
    """Fit of one frame: speed in mm/µs and range in mm, their information matrix, and the point's position."""

    value: Float64[np.ndarray, " 2"]
    information: Float64[np.ndarray, "2 2"]
    lateral_m: float


def _fit_frame(arrival_s: Float64[np.ndarray, " channels"], element_m: Float64[np.ndarray, " channels"]) -> _FrameFit:
    used = np.isfinite(arrival_s)
    element_mm = 1e3 * element_m[used]
    arrival_us = 1e6 * arrival_s[used]
    first = int(np.argmin(arrival_us))

    def residual(parameters: Float64[np.ndarray, " 4"]) -> Float64[np.ndarray, " used"]:
        speed, distance, place, late = parameters
        path = np.hypot(element_mm - place, distance) - distance
        return np.asarray((path / speed + late - arrival_us) / (1e6 * _OUTLIER_S))

    # Millimetres and microseconds: all four parameters are of the order of 1 to 100.
    start = np.array([1.54, 1.54 * arrival_us[first], element_mm[first], arrival_us[first]])
    fit = least_squares(residual, start, loss="soft_l1", x_scale=np.maximum(np.abs(start), 1.0))
    # Pseudo-inverse: far from the array a front is nearly flat, and the speed hardly determined.
    jacobian = np.asarray(fit.jac)
    spread = np.linalg.pinv(jacobian.T @ jacobian)[:2, :2]
    return _FrameFit(value=fit.x[:2], information=np.linalg.pinv(spread), lateral_m=1e-3 * float(fit.x[2]))


_MIN_ANGLES = 8
"""Fewest angles that receive the source well."""

BESIDE = 2
"""Fewest of these angles on each side of the strongest."""

RECEIVED_RATIO = 8.0
"""Intensity over the noise from which a source is received well."""

_CURE = "scan one small source from 12 deg below it to 12 deg above, in steps of at most 1 deg"


def require_peak(samples: Sequence[Sample], *, saturated_limit: float) -> None:
    """Refuse a scan whose intensities alone show that it cannot be used for calibration.

    ``samples``: one for each angle, in the order of the angles. ``saturated_limit``: largest share of saturated
    channels at the strongest angle; clipping changes the shape of the wave.
    """
    intensity = np.array([sample.reading.intensity for sample in samples])
    # Exactly equal intensities cannot be measured: noise alone makes any two of them differ.
    if np.ptp(intensity) == 0:
        raise SearchError(
            f"the intensity is {intensity[0]:.4g} at every one of {len(samples)} angles, so that nothing turned or "
            f"nothing was recorded; {_CURE}"
        )
    best = int(np.argmax(intensity))
    strongest = samples[best]
    noise = strongest.reading.noise_sigma
    if noise is not None and not intensity[best] > RECEIVED_RATIO * noise:
        raise SearchError(
            f"no source at any angle: the strongest, at {strongest.angle_deg:g} deg, is {intensity[best] / noise:.2g} "
            f"times the noise, more than {RECEIVED_RATIO:g} are needed; check laser and gain, or average more pulses"
        )
    # Only the strongest: it is the first to clip, and its wave is the template of the fit.
    clipped = strongest.reading.saturated_fraction
    if clipped is not None and not clipped <= saturated_limit:
        raise SearchError(
            f"{clipped:.0%} of the channels are saturated at {strongest.angle_deg:g} deg, at most "
            f"{saturated_limit:.0%} may be, because the shape of the wave is fitted; reduce the gain or the laser's "
            "energy, and scan again"
        )


# Gauss-Legendre over the height of an element: the delay is smooth there, so that few nodes suffice.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

_MODEL_SHARE = 0.03
"""Error of the model over a wave's height; it limits the weight of waves with little noise."""

_MIN_ERROR = np.array([1.5e-3, 0.1])
"""Error of the wave front's speed in mm/µs and range in mm that more frames do not reduce.

Oblique waves are smeared differently from straight ones; measured on simulated point sources with known truth, and
pulses of 60 to 600 ns.
"""

_MIN_FACE_MM = 0.1
"""The same for the face radius, in mm: the wave in the plane is itself smeared, and holds the noise of one frame."""

_Wave: TypeAlias = tuple[Float64[np.ndarray, " fine"], Float64[np.ndarray, " fine"]]
"""Times in µs and values of a finely sampled wave."""

_NAMES = ("source_deg", "range_mm", "face_mm", "arrival_us", "height_mm", "bend_1_m", "speed_mm_us")
"""Parameters of the fit. Range and arrival in the plane are what the waves show. Radius and trigger offset follow from
them with the speed: with those as parameters the minimum is a long narrow valley, in which the fit did not get to the
end."""

_SIGNIFICANT = 0.02
"""Share of the largest power below which the wave in the plane counts as noise when its middle is computed."""

_FACES_MM = (10.0, 6.0, 15.0)
_BEND_1_M = 13.0
_HEIGHTS_MM = (3.5, 4.25, 5.0, 6.0)
"""Starts of the fit. Several heights are tried, because from a wrong one the fit may end a cycle of the carrier away.
The second face, and the third, is tried where no fit from the one before explains the waves."""

MIN_FACE_M = 3e-3
"""Least face radius that is tried, in metres."""

_LOW = (-90.0, 5.0, 1e3 * MIN_FACE_M, -math.inf, 1.0, -20.0, 1.3)
_HIGH = (90.0, 147.0, 20.0, math.inf, 10.0, 100.0, 1.8)


class Fitted(msgspec.Struct, frozen=True, kw_only=True):
    """A number with its standard deviation, in the unit of its name."""

    value: float
    sigma: float

    @property
    def interval95(self) -> tuple[float, float]:
        """Interval of ±1.96 standard deviations."""
        return self.value - 1.96 * self.sigma, self.value + 1.96 * self.sigma


class Geometry(msgspec.Struct, frozen=True, kw_only=True):
    """Position of the source and geometry of the probe."""

    source_deg: Fitted
    """Probe angle at which the source lies in the image plane."""
    source_radius_m: Fitted
    """Distance of the source from the axis of rotation."""
    face_radius_m: Fitted
    """Distance of the array's face from the axis."""
    trigger_offset_s: Fitted
    """Time from the trigger to the middle of the laser's pulse."""
    element_height_m: Fitted
    sound_speed_m_s: Fitted
    """Speed of sound in m/s, with the wave fronts' value as prior."""
    misfit: float
    """Root mean square of the residual, over the height of the waves."""
    excess: float
    """The same over what noise and the error of the model explain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SourceWaves:
    """The waves of one source, one for each angle."""

    angle_deg: Float64[np.ndarray, " frames"]
    arrival_s: Float64[np.ndarray, " frames"]
    """When the middle of each wave reaches an element right above the source."""
    wave: Float64[np.ndarray, "frames window"] = field(repr=False)
    """The waves, in any unit."""
    sigma: Float64[np.ndarray, " frames"] = field(repr=False)
    """Standard deviation of their noise in that unit."""
    sampling_hz: float

    @property
    def time_s(self) -> Float64[np.ndarray, " window"]:
        """Time of each sample after the arrival, in seconds."""
        window = self.wave.shape[1]
        return np.asarray((np.arange(window) - window // 2) / self.sampling_hz)


def fit_geometry(waves: SourceWaves, moveout: Moveout) -> Geometry:
    """Fit the geometry under which one wave, delayed and smeared, explains all waves.

    ``waves``: waves on both sides of the strongest; at least 8. ``moveout``: speed of sound and range, from the wave
    fronts near the plane.
    """
    height = np.abs(waves.wave).max(axis=1)
    best = int(np.argmax(height))
    if len(height) < _MIN_ANGLES:
        raise SearchError(
            f"{len(height)} angles receive the source well, at least {_MIN_ANGLES} are needed; scan in finer steps, "
            "or average more pulses"
        )
    if not BESIDE <= best < len(height) - BESIDE:
        raise SearchError(
            f"the source's wave is highest at {waves.angle_deg[best]:g} deg, at an end of the angles that receive "
            f"it well ({waves.angle_deg[0]:g} to {waves.angle_deg[-1]:g} deg); scan over one small source, 12 deg "
            "beyond it on both sides"
        )
    plane, middle_us = _in_plane(waves, best, height)
    # Millimetres and microseconds inside the fit: in metres and seconds the Jacobian would span many decades.
    speed = 1e-3 * moveout.sound_speed_m_s
    distance = 1e3 * moveout.range_m
    arrival_us = 1e6 * float(waves.arrival_s[best]) + middle_us
    # The residual has a minimum for every cycle of the carrier; only the lowest is the right one. From a face far from
    # the true one no fit may reach it, and what is left says so.
    for face_mm in _FACES_MM:
        fits = [
            _fit(
                waves,
                plane,
                height,
                [float(waves.angle_deg[best]), distance, face_mm, arrival_us, tall, _BEND_1_M, speed],
                moveout,
            )
            for tall in _HEIGHTS_MM
        ]
        fit = min(fits, key=lambda each: float(each.cost))
        if _excess(fit) <= MOST_EXCESS:
            break
    misfit = float(np.sqrt(np.mean(_residual(fit.x, waves, plane, height, weighted=False) ** 2)))
    covariance = _covariance(fit, frames=len(height))
    sigma = np.sqrt(np.diag(covariance))
    value = {name: Fitted(value=float(x), sigma=float(s)) for name, x, s in zip(_NAMES, fit.x, sigma, strict=True)}
    # The interval of the face radius is widened: its error does not fall with the number of frames.
    face = value["face_mm"]
    range_mm = value["range_mm"].value
    speed = value["speed_mm_us"].value
    radius = _derived(range_mm + face.value, [0, 1, 1, 0, 0, 0, 0], covariance)
    late = _derived(
        value["arrival_us"].value - range_mm / speed, [0, -1 / speed, 0, 1, 0, 0, range_mm / speed**2], covariance
    )
    return Geometry(
        source_deg=value["source_deg"],
        source_radius_m=_scaled(radius, 1e-3),
        face_radius_m=Fitted(value=1e-3 * face.value, sigma=1e-3 * math.hypot(face.sigma, _MIN_FACE_MM)),
        trigger_offset_s=_scaled(late, 1e-6),
        element_height_m=_scaled(value["height_mm"], 1e-3),
        sound_speed_m_s=_scaled(value["speed_mm_us"], 1e3),
        misfit=misfit,
        excess=_excess(fit),
    )


def _excess(fit: OptimizeResult) -> float:
    """Return the residual over what noise and the error of the model explain."""
    return math.sqrt(2 * float(fit.cost) / fit.fun.size)


def _derived(value: float, gradient: Sequence[float], covariance: Float64[np.ndarray, "n n"]) -> Fitted:
    """Return a number that follows from the parameters, with the error that it has from theirs."""
    return Fitted(value=value, sigma=math.sqrt(float(np.array(gradient) @ covariance @ gradient)))


def _scaled(value: Fitted, unit: float) -> Fitted:
    return Fitted(value=value.value * unit, sigma=value.sigma * unit)


def _in_plane(waves: SourceWaves, best: int, height: Float64[np.ndarray, " frames"]) -> tuple[_Wave, float]:
    """Return the wave in the image plane over the time in µs from its middle, and the time of the middle."""
    time_us = waves.time_s * 1e6
    wave = waves.wave[best] / height[best]
    middle = float(_middle(wave, time_us, share=_SIGNIFICANT))
    # Finely sampled once by a spline, so that the fit may interpolate linearly.
    fine_us = np.linspace(time_us[0], time_us[-1], 16 * len(time_us))
    return (fine_us - middle, np.asarray(CubicSpline(time_us, wave)(fine_us))), middle


def _covariance(fit: OptimizeResult, *, frames: int) -> Float64[np.ndarray, "n n"]:
    """Return the covariance of the parameters: inverse information plus a sandwich estimate clustered by wave."""
    # The samples of a wave have correlated errors, by its arrival and by what the model leaves out. Counted one by one
    # they would give a sigma many times too small, so the cluster is the wave (Liang & Zeger 1986). The last two
    # residuals are the wave front's, and each is a cluster of its own.
    weight = (1 + np.asarray(fit.fun) ** 2) ** -0.25  # root of soft_l1's weight; SciPy scales the Jacobian by it too
    jacobian = np.asarray(fit.jac)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    product = jacobian * (weight * fit.fun)[:, None]
    pulls = np.vstack([product[:-2].reshape(frames, -1, jacobian.shape[1]).sum(axis=1), product[-2:]])
    sandwich = inverse @ (pulls.T @ pulls) @ inverse * frames / (frames - 1)
    return np.asarray(inverse + sandwich)


def _fit(
    waves: SourceWaves,
    plane: _Wave,
    height: Float64[np.ndarray, " frames"],
    start: list[float],
    moveout: Moveout,
) -> OptimizeResult:
    # Whitened by the Cholesky factor of the inverse covariance, the wave fronts' result is two more residuals.
    unit = np.array([1e-3, 1e3])
    prior = unit * [moveout.sound_speed_m_s, moveout.range_m]
    covariance = moveout.covariance * np.outer(unit, unit) + np.diag(_MIN_ERROR**2)
    whiten = np.linalg.cholesky(np.linalg.inv(covariance)).T

    def residual(parameters: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " m"]:
        left = _residual(parameters, waves, plane, height, weighted=True).ravel()
        front = parameters[[6, 1]]
        return np.concatenate([left, whiten @ (front - prior)])

    return least_squares(
        residual, np.clip(start, _LOW, _HIGH), bounds=(_LOW, _HIGH), loss="soft_l1",
        x_scale=[0.1, 0.3, 1.0, 0.03, 0.3, 10.0, 0.003], max_nfev=100,
    )  # fmt: skip


def _residual(
    parameters: Float64[np.ndarray, " n"],
    waves: SourceWaves,
    plane: _Wave,
    height: Float64[np.ndarray, " frames"],
    *,
    weighted: bool,
) -> Float64[np.ndarray, "frames window"]:
    """Return the residual of each wave, scaled to height 1, with its amplitude fitted."""
    source_deg, distance, face, arrival_us, tall, bend, speed = parameters
    radius = distance + face
    turn = np.radians(waves.angle_deg - source_deg)
    elevation = radius * np.sin(turn)
    axial = radius * np.cos(turn) - face
    eta = tall / 2 * _NODES
    # The lens takes away the delay of a focus at 1/bend; in the plane the same smear is in the wave already.
    lens = bend * 1e-3 * eta**2 / 2
    path = np.hypot(elevation[:, None] - eta, axial[:, None]) - lens
    # From the middle of the wave in the plane, which is smeared too.
    still = np.hypot(eta, distance) - lens
    delay_us = (path - float(_WEIGHTS @ still) / 2) / speed + arrival_us
    time_us = waves.arrival_s[:, None] * 1e6 + waves.time_s * 1e6
    # np.interp and no spline: it is called in every step of the fit, and the wave is finely sampled already.
    shape = np.interp(time_us[:, :, None] - delay_us[:, None, :], *plane) @ (_WEIGHTS / 2)
    wave = waves.wave / height[:, None]
    # The amplitude of each wave is fitted in closed form: the directivity is no part of this model.
    gain = np.einsum("fw,fw->f", shape, wave) / np.maximum(np.einsum("fw,fw->f", shape, shape), 1e-12)
    left = wave - gain[:, None] * shape
    if not weighted:
        return np.asarray(left)
    return np.asarray(left / np.hypot(waves.sigma / height, _MODEL_SHARE)[:, None])


_MIN_SHARE = 0.5
"""Least ratio of the delay of the waves' middles to that of the fitted geometry; on simulated scans it is 1.6 to 5.

It is more than 1 because the sound off the plane is also spread over the height of the elements, to later times.
"""

MOST_EXCESS = 1.4
"""Largest residual over what noise and the error of the model explain: on simulated scans it is 0.2 to 0.9, and 2 or
more in the minimum of another cycle."""

_STRONG_SHARE = 0.05
"""Power over a wave's largest below which a sample counts as noise."""


def require_delays(waves: SourceWaves, geometry: Geometry) -> None:
    """Refuse a fit of waves that do not arrive later off the image plane, where their way is longer.

    Frames that were aligned, scaled or copied from one angle to another have no such delay, and the fit alone would
    still return numbers.
    """
    predicted_s = _path_delay_s(waves.angle_deg, geometry)
    measured_s = waves.arrival_s + _middle(waves.wave, waves.time_s, share=_STRONG_SHARE)
    # Weighted least squares of the measured times on the predicted delay: the weaker waves scatter more.
    weight = np.abs(waves.wave).max(axis=1)
    slope = float(np.polyfit(predicted_s, measured_s, 1, w=weight)[0])
    if not slope >= _MIN_SHARE:
        span_ns = 1e9 * float(np.ptp(predicted_s))
        raise SearchError(
            f"off the image plane the sound arrives {slope * span_ns:.0f} ns later, {span_ns:.0f} ns or more are "
            "expected of a probe that turns about its axis: these frames do not hold the delays from which face radius "
            "and trigger offset follow; calibrate with the channel data as they were recorded at each angle, not "
            "aligned, scaled or copied"
        )
    if not geometry.excess <= MOST_EXCESS:
        raise SearchError(
            f"the waves differ from those of one point by {geometry.misfit:.0%} of their height in any geometry that "
            "was tried; check that the source is one point and stays in its place, and step finer"
        )
    low_m, _ = geometry.face_radius_m.interval95
    if not low_m > MIN_FACE_M:
        raise SearchError(
            f"the face radius is {1e3 * geometry.face_radius_m.value:.1f} mm or less, which this scan does not "
            f"determine; {_CURE}"
        )


def _path_delay_s(angle_deg: Float64[np.ndarray, " frames"], geometry: Geometry) -> Float64[np.ndarray, " frames"]:
    """Return the delay of the way from the source to the face, over that in the image plane, in seconds."""
    radius_m = geometry.source_radius_m.value
    face_m = geometry.face_radius_m.value
    turn = np.radians(angle_deg - geometry.source_deg.value)
    path_m = np.hypot(radius_m * np.sin(turn), radius_m * np.cos(turn) - face_m)
    return np.asarray((path_m - (radius_m - face_m)) / geometry.sound_speed_m_s.value)


def _middle(
    wave: Float64[np.ndarray, "*frames window"], time: Float64[np.ndarray, " window"], *, share: float
) -> Float64[np.ndarray, "*frames"]:
    """Return the time of the middle of the power of each wave, without what is below a share of its largest power."""
    power = np.abs(hilbert(wave, axis=-1)) ** 2
    power = np.where(power > share * power.max(axis=-1, keepdims=True), power, 0.0)
    return np.asarray(power @ time / power.sum(axis=-1))
