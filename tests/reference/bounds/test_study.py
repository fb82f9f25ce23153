"""A study compared with the bound of its markers: errors, curves and what has none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs

from benchmarks.bounds.study import compare_with_bound, marker_curve, mean_bounds
from markerseek.core import ConfigError
from markerseek.sim import LaserSettings, NoiseSettings, SimulatedSettings
from markerseek.studies import Study, cells, run_row, study_policy
from markerseek.studies.worlds import draw_trial, study_rig

DRAWN = Study(
    name="drawn",
    policies=(study_policy(method="posterior", acquisitions=4, early_end=False),),
    trials=3,
    level="frames",
    drawn="everything",
    marks=(2, 4, 8),
)


def test_a_policy_is_set_against_the_bound_of_each_marker() -> None:
    # The confirmation of a marker that is found changes its angle, and is no part of the comparison.
    study = structs.replace(DRAWN, stay=True)
    cell = cells(study)[0]
    against = compare_with_bound(study, cell, policy=0, markers=3)
    rows = [run_row(study, trial) for trial in range(3)]
    rmse_deg = math.sqrt(np.mean([row.error_deg**2 for row in rows]))  # type: ignore[operator]
    assert against.rmse_deg == pytest.approx(rmse_deg, rel=1e-6)
    assert 0 < against.best_deg < against.taken_deg
    assert against.ratio_to_best == pytest.approx(against.rmse_deg / against.best_deg)
    bounds = mean_bounds(study, cell, markers=3, acquisitions=(2, 4, 8))
    assert bounds[0] > bounds[1] > bounds[2] > 0


def test_a_curve_is_that_of_the_marker() -> None:
    cell = cells(DRAWN)[0]
    drawn = draw_trial(DRAWN, cell, 1)
    assert drawn.unknowns is not None
    curve = marker_curve(drawn.unknowns)
    assert curve.value(np.zeros(1)) == pytest.approx([1.0])
    assert marker_curve(drawn.unknowns) is curve
    quiet = SimulatedSettings(noise=NoiseSettings(peak_snr_db=45.0), laser=LaserSettings(energy_jitter=0.0))
    study = structs.replace(DRAWN, rig=quiet)
    measure = study_rig(study, cells(study)[0], drawn).scanner.measure
    top, *others = (measure(drawn.marker_deg + off_deg).reading.intensity for off_deg in (0.0, 1.5, 5.0))
    # 45 dB: 0.6 % of the peak.
    assert curve.value(np.array([1.5, 5.0])) == pytest.approx(np.array(others) / top, rel=0.05, abs=0.01)


def test_the_bound_needs_drawn_markers_and_a_probe_at_rest() -> None:
    """A policy that sweeps was searched without its sweeps, and named as sweeping."""
    plain = structs.replace(DRAWN, level="curves", drawn="marker")
    sweeping = structs.replace(DRAWN, policies=(study_policy(method="posterior", sweep=True),))
    for study, cure in ((plain, 'drawn = "everything"'), (sweeping, "leave the policies that sweep out")):
        with pytest.raises(ConfigError, match=cure):
            mean_bounds(study, cells(study)[0], markers=1, acquisitions=(4,))
        with pytest.raises(ConfigError, match=cure):
            compare_with_bound(study, cells(study)[0], policy=0, markers=1)
