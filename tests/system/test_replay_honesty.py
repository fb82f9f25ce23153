"""Intervals of replayed searches cover the marker: coarse scans with known markers, through the whole loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from markerseek import Finished, Found, Unsure, build, replayed, run
from markerseek.core import SearchPlan
from markerseek.search import method_named

SCANS = 25


@pytest.mark.parametrize(
    ("method", "step_deg", "fwhm_deg"),
    [("weighted-average", 5.0, 4.0), ("exhaustive", 5.0, 4.0), ("golden-section", 1.0, 8.0), ("ternary", 1.0, 8.0)],
)
def test_the_interval_holds_the_marker_of_a_coarse_scan(
    tmp_path: Path, method: str, step_deg: float, fwhm_deg: float
) -> None:
    rng = np.random.default_rng(17)
    angles = np.arange(-35, 35 + step_deg / 2, step_deg)
    path = tmp_path / "scan.csv"
    held = 0
    answered = 0
    for marker_deg in rng.uniform(-30, 30, SCANS).tolist():
        curve = 1 / (1 + (2 * (angles - marker_deg) / fwhm_deg) ** 2)
        measured = curve + np.abs(0.02 + 0.005 * rng.standard_normal(angles.size))
        np.savetxt(path, np.c_[angles, measured], delimiter=",", header="angle_deg,intensity", comments="")
        rig = replayed(path)
        most = min(method_named(method).acquisitions, len(angles))
        policy = build(
            SearchPlan(method=method, acquisitions=most, start_deg=rig.stage.angle_deg), limits=rig.limits.search
        )
        finished = next(event for event in run(policy, rig.scanner) if isinstance(event, Finished))
        estimate = finished.estimate
        if isinstance(estimate, Found):
            assert abs(estimate.mean_deg - marker_deg) < 1
        if isinstance(estimate, Found | Unsure):
            answered += 1
            held += marker_deg in estimate.interval95_deg
    assert answered >= SCANS // 2
    assert held >= 0.85 * answered
