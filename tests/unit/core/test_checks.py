"""Plans, facts and ranges are checked when made; NaN passes no limit."""

from __future__ import annotations

import math

import msgspec
import pytest

from markerseek.core import (
    MAX_ACQUISITIONS,
    PAPER_RANGE,
    ConfigError,
    RigFacts,
    SearchPlan,
    require_range,
)

NAN = math.nan


@pytest.mark.parametrize(
    ("value", "options", "message"),
    [
        (0.0, {"low": 0.1, "high": 25, "unit": "deg/s"}, "x is 0.0 deg/s, it must lie in [0.1, 25] deg/s"),
        (NAN, {"low": 0.1, "high": 25}, "x is nan, it must lie in [0.1, 25]"),
        (0, {"low": 0, "high": 1, "open_low": True, "unit": "m"}, "x is 0 m, it must lie in (0, 1] m"),
        (-1, {"low": 0, "high": math.inf}, "x is -1, it must lie in [0, inf)"),
        (3, {"low": 0, "high": 1, "cure": "scan again"}, "x is 3, it must lie in [0, 1]; scan again"),
    ],
)
def test_a_number_outside_is_refused_with_value_unit_limits_and_cure(
    value: float, options: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        require_range("x", value, **options)  # type: ignore[arg-type]
    assert str(refused.value) == message


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"acquisitions": -1}, "acquisitions is -1, it must be a whole number between 0 and 500"),
        ({"acquisitions": MAX_ACQUISITIONS + 1}, "acquisitions is 501"),
        ({"start_deg": NAN}, "start_deg is nan deg"),
        ({"others": 1.5}, "others is 1.5, it must be a probability from 0 to below 1"),
        ({"dark_frames": -1}, "dark_frames is -1, it must lie between 0 and 100"),
    ],
)
def test_a_plan_with_a_number_that_cannot_be_used_is_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SearchPlan(method="posterior", **wrong)  # type: ignore[arg-type]


def test_the_angle_of_a_simulation_goes_before_one_found_otherwise() -> None:
    facts = RigFacts(kind="replayed", description="", fingerprint="", search=PAPER_RANGE, reference_deg=2.0)
    assert facts.known_deg == 2.0
    both = RigFacts(
        kind="simulated", description="", fingerprint="", search=PAPER_RANGE, truth_deg=1.0, reference_deg=2.0
    )
    assert both.known_deg == 1.0


def test_plan_and_facts_come_back_from_json_and_are_checked_again() -> None:
    plan = SearchPlan(method="ternary", acquisitions=8, early_end=False, start_deg=-3.0, closing_dark=True)
    assert msgspec.json.decode(msgspec.json.encode(plan), type=SearchPlan) == plan
    with pytest.raises(msgspec.ValidationError, match="dark_frames is 101"):
        msgspec.json.decode(b'{"method":"ternary","dark_frames":101}', type=SearchPlan)


@pytest.mark.parametrize(("angle_deg", "nearest_deg"), [(-40.0, -35.0), (-35.0, -35.0), (3.5, 3.5), (math.inf, 35.0)])
def test_the_nearest_angle_of_an_interval(angle_deg: float, nearest_deg: float) -> None:
    assert PAPER_RANGE.nearest(angle_deg) == nearest_deg
    assert math.isnan(PAPER_RANGE.nearest(NAN))
