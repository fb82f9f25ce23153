"""Plans, facts, ranges and sweeps are checked when made; errors cross from one process to another with their words."""

from __future__ import annotations

import math
import pickle

import msgspec
import pytest

from markerseek.acoustics import Absorber
from markerseek.core import (
    MAX_ACQUISITIONS,
    PAPER_RANGE,
    ByHand,
    ConfigError,
    Interval,
    MarkerCurve,
    MarkerseekError,
    MissingExtraError,
    Reading,
    RigFacts,
    Sample,
    SearchPlan,
    Sweep,
    SweepTiming,
    errors,
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


@pytest.mark.parametrize("wrong", [None, NAN, math.inf, "3", True])
def test_a_field_without_a_number_is_refused(wrong: object) -> None:
    for make, name in (
        (lambda: MarkerCurve(fwhm_deg=wrong, peak=10.0), "fwhm_deg"),
        (lambda: ByHand(step_deg=wrong), "step_deg"),
        (lambda: Absorber(angle_deg=0.0, radius_m=0.05, strength=wrong), "strength"),
    ):
        # In the long run beartype refuses the type before the limits are asked.
        with pytest.raises(Exception, match=name) as refused:
            make()
        assert not isinstance(refused.value, AttributeError)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"acquisitions": -1}, "acquisitions is -1, it must be a whole number between 0 and 500"),
        ({"acquisitions": MAX_ACQUISITIONS + 1}, "acquisitions is 501"),
        ({"start_deg": NAN}, "start_deg is nan deg"),
        ({"others": 1.5}, "others is 1.5, it must be a probability from 0 to below 1"),
        ({"dark_frames": -1}, "dark_frames is -1, it must lie between 0 and 100"),
        *(({"sweep_speed_deg_s": speed}, "sweep_speed_deg_s") for speed in (0.0, -1.0, NAN)),
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


KINDS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, MarkerseekError)]


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_arrives_in_another_process_as_it_was(kind: type[MarkerseekError]) -> None:
    """One that cannot be made again there ends the pool, which then blames a lack of memory."""
    words = ("botorch", "botorch", "the method botorch") if kind is MissingExtraError else ("the stage is at 3 deg",)
    error = kind(*words)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (kind, str(error))
    assert words[-1] in str(again)


@pytest.mark.parametrize("ends_deg", [(-35.0, 9000.0), (-1e300, 35.0), (0.0, 361.0)])
def test_a_range_beyond_a_turn_is_no_range_of_a_rig(ends_deg: tuple[float, float]) -> None:
    """As a journal may hold it; a search in it would have no end."""
    low_deg, high_deg = ends_deg
    with pytest.raises(ConfigError, match=r"search: an end is .* deg, it must lie in \[-360, 360\] deg"):
        RigFacts(kind="bench", description="", fingerprint="", search=Interval(low_deg=low_deg, high_deg=high_deg))
