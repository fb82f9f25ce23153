"""Speed of sound and range from the moveout: how much later the sound of a point reaches the outer channels.

The pitch of the array is the measure of length. Only differences between the channels of one frame count, so that
neither the trigger's offset nor the shape of the wave enters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from markerseek.core import Float64, SearchError

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
    """Speed of sound and range from frames of one point source, taken near its plane.

    In each frame t(y) = t0 + sqrt((y - y0)² + r²)/c; near the plane c and r are common, t0 and y0 its own.

    ``arrivals_s``: arrival at each channel, one array a frame, NaN where there is none; at least 3 frames.
    ``element_m``: positions of the elements along the array.
    """
    if len(arrivals_s) < 3:
        raise SearchError(
            f"{len(arrivals_s)} angles near the strongest show one clear wave front, at least 3 are needed; step finer "
            "there, average more pulses, and check that the source is one point and --probe is right"
        )
    single = [_fit_frame(arrival, element_m) for arrival in arrivals_s]
    information = np.array([each.information for each in single])
    if np.linalg.matrix_rank(information.sum(axis=0)) < 2:
        raise SearchError(
            "the wave fronts do not bend, as if the source were infinitely far away; check that the channels are those "
            "of an array, and that --probe is right"
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
            "source is one point and --probe is right"
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
    """Time at which a frame's wave would reach an element right above the point, in seconds.

    ``moveout``: result of the frames near the plane. ``plane_s``: the same time of a frame in the plane, for a frame
    off it, where a delay means a longer range. None: this frame is in the plane.
    """
    used = np.isfinite(arrival_s)
    offset_m = element_m[used] - moveout.lateral_m
    # Fixed-point iteration off the plane: the curvature depends on the range, and the range on the apex.
    range_m, apex = moveout.range_m, 0.0
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
    element_mm, arrival_us = 1e3 * element_m[used], 1e6 * arrival_s[used]
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
