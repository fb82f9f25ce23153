"""The values of a sweep."""

from __future__ import annotations

import math

import pytest

from markerseek.core import ConfigError, Reading, Sample, SearchPlan, Sweep, SweepTiming


@pytest.mark.parametrize(
    "wrong",
    [
        {"to_deg": math.nan},
        {"speed_deg_s": 0.0},
        {"speed_deg_s": math.nan},
        {"back_deg": math.inf},
    ],
)
def test_a_sweep_that_no_stage_can_make_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"sweep: {next(iter(wrong))}"):
        Sweep(**({"to_deg": 35.0, "speed_deg_s": 10.0} | wrong))


@pytest.mark.parametrize(
    "wrong",
    [{"number": 0}, {"speed_deg_s": math.inf}, {"delay_sigma_s": -1e-3}, {"play_sigma_deg": math.nan}],
)
def test_timing_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"sweep timing: {next(iter(wrong))}"):
        SweepTiming(**({"number": 1, "speed_deg_s": -12.5} | wrong))


def test_a_sample_with_a_negative_sigma_is_refused() -> None:
    with pytest.raises(ConfigError, match="angle_sigma_deg"):
        Sample(angle_deg=0.0, reading=Reading(intensity=1.0), angle_sigma_deg=-0.01)


@pytest.mark.parametrize("speed_deg_s", [0.0, -1.0, math.nan])
def test_a_plan_with_a_speed_that_is_no_speed_is_refused(speed_deg_s: float) -> None:
    with pytest.raises(ConfigError, match="sweep_speed_deg_s"):
        SearchPlan(method="posterior", sweep_speed_deg_s=speed_deg_s)
