"""What single pulses allow, and sweeps that follow other motions: two tables of ``tracking.md``."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from benchmarks.tracking import SweptTrack, track_by_sweeps
from markerseek.runs import TrackQuality
from markerseek.search import Tracker, flank_deg
from markerseek.sim import (
    SWING_DEG,
    TURN_S,
    IntensityCurve,
    LaserSettings,
    OscillatingMotion,
    PowerCurve,
    ReceiverSettings,
    SechCurve,
    SimulatedSettings,
    StageMotion,
    swing_deg,
)

FWHM_DEG, PERIOD_S, DURATION_S = 5.0, 0.05, 20.0
PEAK, JITTER, CURVE_ERROR, CELLS = 25.0, 0.1, 0.05, 300
DARK_FROM_S = 0.5
SINES_HZ = (0.09, 0.16, 0.27)


class Sine(OscillatingMotion):
    """A sine of 2π seconds, as fast as stated at 0."""

    def moved_deg(self, at_s: float) -> float:
        """Angle by which it has moved."""
        if self._began_s is None or at_s < self._began_s:
            return 0.0
        return self.speed_deg_s * math.sin(at_s - self._began_s)


class ThreeSines(OscillatingMotion):
    """Three sines, together up to 1.8 times as fast as stated."""

    def __init__(self, *, speed_deg_s: float, seed: int) -> None:
        super().__init__(speed_deg_s=speed_deg_s)
        self._phases = np.random.Generator(np.random.PCG64(seed)).uniform(0, 2 * math.pi, len(SINES_HZ))

    def moved_deg(self, at_s: float) -> float:
        """Angle by which it has moved."""
        if self._began_s is None or at_s < self._began_s:
            return 0.0
        turned = 2 * math.pi * np.array(SINES_HZ)
        now = np.sin(turned * (at_s - self._began_s) + self._phases) - np.sin(self._phases)
        return float(np.sum(self.speed_deg_s / 1.7 / turned * now))


def without_inertia(seed: int, *, speed_deg_s: float, dark_s: float) -> tuple[float, bool]:
    """RMS error of a probe that is at the right flank at each pulse, dark for some time in each turn; whether lost."""
    rng = np.random.Generator(np.random.PCG64(seed))
    curve, straight_s = PowerCurve(fwhm_deg=FWHM_DEG, power=1.2), SWING_DEG / speed_deg_s
    tracker = Tracker(
        angle_deg=0.1 * rng.standard_normal(),
        sigma_deg=0.1,
        fwhm_deg=FWHM_DEG * math.exp(CURVE_ERROR * rng.standard_normal()),
        peak=PEAK * math.exp(CURVE_ERROR * rng.standard_normal()),
        rng=rng.spawn(1)[0],
        most_speed_deg_s=1.5 * speed_deg_s,
        acceleration_deg_s2=2 * speed_deg_s / TURN_S,
    )
    errors, lost, last_s = [], False, 0.0
    for number in range(1, round(DURATION_S / PERIOD_S) + 1):
        now_s = number * PERIOD_S
        truth_deg = swing_deg(straight_s / 2 + now_s, speed_deg_s)
        ways, within_s = divmod(straight_s / 2 + now_s, straight_s + TURN_S)
        turned_s = within_s - straight_s if within_s >= straight_s else within_s + TURN_S if ways else math.inf
        if DARK_FROM_S <= turned_s < DARK_FROM_S + dark_s:
            continue
        probe_deg = flank_deg(tracker, after_s=now_s - last_s, side=1.0 if number % 2 else -1.0)
        height = PEAK * curve.peaks(probe_deg - truth_deg)[0] * (1 + JITTER * rng.standard_normal())
        noise = math.sqrt(-2 * math.log(1 - rng.random() ** (1 / CELLS)))
        intensity = max(math.hypot(height + rng.standard_normal(), rng.standard_normal()), noise)
        tracker.tell(probe_deg, intensity, after_s=now_s - last_s, noise_sigma=1.0, cells=CELLS)
        errors.append(tracker.mean_deg - truth_deg)
        lost, last_s = lost or tracker.lost, now_s
    return math.sqrt(np.mean(np.square(errors))), lost


def swung(_seed: int, speed_deg_s: float) -> OscillatingMotion:
    """To and fro at an even speed."""
    return OscillatingMotion(speed_deg_s=speed_deg_s)


def sine(_seed: int, speed_deg_s: float) -> OscillatingMotion:
    """A sine."""
    return Sine(speed_deg_s=speed_deg_s)


def three_sines(seed: int, speed_deg_s: float) -> OscillatingMotion:
    """Three sines, whose phases belong to the seed."""
    return ThreeSines(speed_deg_s=speed_deg_s, seed=seed)


SECH = SechCurve(fwhm_deg=FWHM_DEG)
POWER_12, POWER_16 = (PowerCurve(fwhm_deg=FWHM_DEG, power=power) for power in (1.2, 1.6))
Row = tuple[str, Callable[[int, float], OscillatingMotion], float, IntensityCurve]
ROWS: list[Row] = [
    ("to and fro, 5°/s, 1/cosh", swung, 5.0, SECH),
    ("to and fro, 5°/s, power 1.6", swung, 5.0, POWER_16),
    ("sine, up to 5°/s, power 1.2", sine, 5.0, POWER_12),
    ("three sines, up to 9°/s, 1/cosh", three_sines, 5.0, SECH),
    ("sine, up to 10°/s, 1/cosh", sine, 10.0, SECH),
    ("three sines, up to 18°/s, power 1.2", three_sines, 10.0, POWER_12),
    ("to and fro, 10°/s, power 1.6", swung, 10.0, POWER_16),
]


def followed(seed: int, row: Row, rate_hz: float) -> SweptTrack:
    """One run on a PRM1Z8 at its limits."""
    _, motion, speed_deg_s, curve = row
    settings = SimulatedSettings(
        stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
        laser=LaserSettings(rate_hz=rate_hz, energy_jitter=JITTER, stamp_delay_s=5e-3),
        receiver=ReceiverSettings(readout_s=1 / rate_hz, frame_period_s=1 / rate_hz),
    )
    return track_by_sweeps(
        curve,
        fwhm_deg=FWHM_DEG,
        settings=settings,
        motion=motion(seed, speed_deg_s),
        duration_s=DURATION_S,
        seed=seed,
    )


def main() -> None:
    """Print both tables, row by row."""
    out = sys.stdout
    with ProcessPoolExecutor(3) as pool:
        out.write("| marker | no inertia | 0.3 s without light in each turn | 0.8 s |\n|---|---|---|---|\n")
        for speed_deg_s in (1.0, 5.0, 10.0):
            cells = []
            for dark_s in (0.0, 0.3, 0.8):
                one = partial(without_inertia, speed_deg_s=speed_deg_s, dark_s=dark_s)
                runs = list(pool.map(one, range(10)))
                rms_deg = math.sqrt(np.mean([error_deg**2 for error_deg, _ in runs]))
                cells.append(f"{rms_deg:.2f}°, {sum(lost for _, lost in runs)} of 10 lost")
            out.write(f"| {speed_deg_s:g}°/s | {' | '.join(cells)} |\n")
            out.flush()
        out.write("\n| RMS error (median run), covered, runs above 3° | 20 Hz | 100 Hz | without the first 2 s |\n")
        out.write("|---|---|---|---|\n")
        for row in ROWS:
            slow, fast = (
                list(pool.map(partial(followed, row=row, rate_hz=rate_hz), range(201, 217)))
                for rate_hz in (20.0, 100.0)
            )
            columns = ([run.quality for run in slow], [run.quality for run in fast], [run.settled for run in fast])
            out.write(f"| {row[0]} | {' | '.join(map(_said, columns))} |\n")
            out.flush()


def _said(qualities: list[TrackQuality]) -> str:
    """RMS error of all runs and of the median run, covered, and how many runs are off by more than 3°."""
    each_deg = np.array([quality.rms_deg for quality in qualities])
    covered = np.mean([quality.covered for quality in qualities])
    rms_deg = math.sqrt(np.mean(each_deg**2))
    return f"{rms_deg:.2f}° ({np.median(each_deg):.2f}°), {covered:.0%}, {sum(each_deg > 3)}"


if __name__ == "__main__":
    main()
