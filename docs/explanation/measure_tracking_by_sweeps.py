"""Let simulated rigs follow markers by sweeps, and print the third table of ``tracking.md``."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from benchmarks.tracking import SweptTrack, track_by_sweeps
from markerseek.runs import TrackQuality
from markerseek.sim import (
    GaussianCurve,
    IntensityCurve,
    LaserSettings,
    OscillatingMotion,
    PowerCurve,
    ReceiverSettings,
    SimulatedSettings,
    StageMotion,
)

RUNS, DURATION_S, FWHM_DEG = 20, 20.0, 5.0
LIMITS, DRIVEN = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0), StageMotion()
CURVE = PowerCurve(fwhm_deg=FWHM_DEG, power=1.2)
Row = tuple[str, StageMotion, float, float, IntensityCurve]
ROWS: list[Row] = [
    row
    for hertz in (100.0, 20.0)
    for row in (
        *((f"PRM1Z8 at its limits, {hertz:g} Hz", LIMITS, hertz, speed, CURVE) for speed in (1.0, 5.0, 10.0)),
        ("the same, curve Gaussian", LIMITS, hertz, 5.0, GaussianCurve(fwhm_deg=FWHM_DEG)),
        ("the same, curve with wider tails", LIMITS, hertz, 5.0, PowerCurve(fwhm_deg=FWHM_DEG, power=0.8)),
        *((f"PRM1Z8 as it is driven, {hertz:g} Hz", DRIVEN, hertz, speed, CURVE) for speed in (1.0, 5.0, 10.0)),
    )
]


def followed(seed: int, row: Row) -> SweptTrack:
    """One run."""
    _, motion, rate_hz, speed_deg_s, curve = row
    settings = SimulatedSettings(
        stage=motion,
        laser=LaserSettings(rate_hz=rate_hz, energy_jitter=0.1, stamp_delay_s=5e-3),
        receiver=ReceiverSettings(readout_s=1 / rate_hz, frame_period_s=1 / rate_hz),
    )
    swing = OscillatingMotion(speed_deg_s=speed_deg_s)
    return track_by_sweeps(curve, fwhm_deg=FWHM_DEG, settings=settings, motion=swing, duration_s=DURATION_S, seed=seed)


def line(row: Row, runs: list[SweptTrack]) -> str:
    """One row of the table."""
    settled, qualities = [each.settled for each in runs], [each.quality for each in runs]
    median_deg = np.median([each.rms_deg for each in settled])
    lag_s, covered = (np.mean([getattr(each, name) for each in settled]) for name in ("lag_s", "covered"))
    rate = np.mean([each.frames for each in runs]) / DURATION_S
    lost, again = sum(each.lost_settled for each in runs), sum(each.lost for each in runs)
    return (
        f"| {row[3]:g}°/s | {row[0]} | {rate:.0f} | {_rms_deg(settled):.2f}° ({median_deg:.2f}°) | {lag_s:.2f} s "
        f"| {covered:.0%} | {lost} of {len(runs)} | {_rms_deg(qualities):.2f}°, {again} |\n"
    )


def _rms_deg(qualities: list[TrackQuality]) -> float:
    """RMS error of all runs, in degrees."""
    return float(np.sqrt(np.mean([each.rms_deg**2 for each in qualities])))


def main() -> None:
    """Print the table, row by row."""
    sys.stdout.write(
        "| marker | rig | frames a second | RMS error (median run) | lag | 95 % covers | lost | with the first 2 s |\n"
        "|---|---|---|---|---|---|---|---|\n"
    )
    with ProcessPoolExecutor(3) as pool:
        for row in ROWS:
            runs = list(pool.map(partial(followed, row=row), range(1, RUNS + 1)))
            sys.stdout.write(line(row, runs))
            sys.stdout.flush()


if __name__ == "__main__":
    main()
