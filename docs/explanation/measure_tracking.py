"""Follow simulated markers at several speeds and frame rates, and write the table of ``tracking.md``."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from benchmarks.tracking import track
from markerseek.runs import stage_period_s
from markerseek.sim import GaussianCurve, IntensityCurve, PowerCurve, StageMotion

RUNS, DURATION_S, FWHM_DEG, SNR_DB = 20, 20.0, 5.0, 40.0
SPEEDS_DEG_S, RATES_HZ = (1.0, 5.0, 10.0), (30.0, 10.0, 5.0, 2.0, 1.0)
STAGES = {
    "PRM1Z8 as it is driven, 10°/s and 10°/s²": StageMotion(),
    "its limits, 25°/s and 25°/s²": StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
}
FRAME_S = 0.2
CURVE = PowerCurve(fwhm_deg=FWHM_DEG, power=1.2)
OTHER_CURVES: dict[str, IntensityCurve] = {
    "Gaussian": GaussianCurve(fwhm_deg=FWHM_DEG),
    "with wider tails": PowerCurve(fwhm_deg=FWHM_DEG, power=0.8),
}
BEGIN, END = "<!-- table -->", "<!-- end of table -->"


def row(name: str, speed_deg_s: float, period_s: float, curve: IntensityCurve = CURVE) -> str:
    """One row of the table: the runs of one condition."""
    runs = [
        track(
            curve,
            fwhm_deg=FWHM_DEG,
            peak_snr_db=SNR_DB,
            speed_deg_s=speed_deg_s,
            period_s=period_s,
            duration_s=DURATION_S,
            rng=np.random.Generator(np.random.PCG64([1, run])),
        )
        for run in range(RUNS)
    ]
    rms_deg = float(np.sqrt(np.mean([each.quality.rms_deg**2 for each in runs])))
    within = float(np.mean([each.quality.within_1_deg for each in runs]))
    lag_s = float(np.mean([each.quality.lag_s for each in runs]))
    covered = float(np.mean([each.quality.covered for each in runs]))
    lost = sum(each.lost for each in runs)
    # The error and lag of a marker that was lost say nothing.
    numbers = f"{rms_deg:.2f}° | {within:.0%} | {lag_s:.2f} s | {covered:.0%}" if lost <= RUNS / 2 else "– | – | – | –"
    return f"| {speed_deg_s:g}°/s | {name} | {numbers} | {lost} of {RUNS} |"


def main() -> None:
    """Write the table into the page."""
    lines = ["| marker | frames | RMS error | within 1° | lag | 95 % covers | lost |", "|---|---|---|---|---|---|---|"]
    for speed_deg_s in SPEEDS_DEG_S:
        lines += [row(f"{rate_hz:g} a second", speed_deg_s, 1 / rate_hz) for rate_hz in RATES_HZ]
        lines += [row(f"10 a second, curve {name}", speed_deg_s, 0.1, curve) for name, curve in OTHER_CURVES.items()]
    for name, motion in STAGES.items():
        for speed_deg_s in SPEEDS_DEG_S:
            period_s = stage_period_s(motion, fwhm_deg=FWHM_DEG, speed_deg_s=speed_deg_s, frame_s=FRAME_S)
            if period_s == math.inf:
                lines.append(f"| {speed_deg_s:g}°/s | none, the stage is not faster: {name} | – | – | – | – | all |")
            else:
                lines.append(row(f"one each {period_s:.1f} s: {name}", speed_deg_s, period_s))
    page = Path(__file__).with_name("tracking.md")
    text = page.read_text(encoding="utf-8")
    before, after = text[: text.index(BEGIN) + len(BEGIN)], text[text.index(END) :]
    page.write_text("\n".join([before, "", *lines, "", after]), encoding="utf-8")


if __name__ == "__main__":
    main()
