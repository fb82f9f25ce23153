"""Every number that the guard is given: text, None, complex, arrays, truth values, NaN and infinity never pass."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    FrameHeader,
    LaserError,
    LimitError,
    MoveError,
    Reading,
    ReadingFrame,
    is_finite,
    is_whole,
)
from markerseek.guard import Admission, FiringLimits, Lease, Limits, Permits, State
from tests.unit.guard.guards import armed, disarmed
from tests.unit.records.journal.synthetic_journals import FULL_READING

NO_NUMBERS: list[Any] = [
    "3", b"3", None, 3 + 0j, [3.0], (3.0,), {}, np.array(3.0), np.array([3.0, 3.0]), np.complex128(3), True,
    np.True_, math.nan, math.inf, -math.inf, np.float32("nan"), 10**400, object(),
]  # fmt: skip
NUMBERS: list[Any] = [3, 3.0, np.float64(3), np.float32(3), np.int16(3), np.uint8(3), Fraction(3)]

FEATURES = ("lateral_m", "depth_m", "arrival_s", "noise_sigma", "coherence", "saturated_fraction", "cells")
FRAME = ReadingFrame(
    header=FrameHeader(sequence=1, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0), intensity=1.0
)

no_number = pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: f"{type(value).__name__}")
number = pytest.mark.parametrize("value", NUMBERS, ids=lambda value: f"{type(value).__name__}")
NO_COUNTS = [*NO_NUMBERS[:-2], 3.0, 2.5, 5e-324, np.float64(3)]
no_count = pytest.mark.parametrize("value", NO_COUNTS, ids=lambda value: f"{type(value).__name__}")


@no_number
def test_what_is_no_number_is_no_angle_to_move_to(value: Any) -> None:
    made = armed()
    with pytest.raises(LimitError, match="outside the search range"):
        made.begin_move(value)
    assert made.state is State.ARMED


@number
def test_numbers_of_every_kind_are_angles(value: Any) -> None:
    made = armed()
    made.begin_move(value)
    made.end_move(value)
    assert made.state is State.ARMED
    reached = made.readback(value)
    assert (type(reached), reached) == (float, 3.0)
    made.redeem(made.issue(angle_deg=value, pulses=1, now_s=value), angle_deg=value, now_s=value)


@no_number
def test_a_move_that_ends_at_no_number_is_a_fault(value: Any) -> None:
    made = armed()
    made.begin_move(3.0)
    with pytest.raises(LimitError, match="the stage reads"):
        made.end_move(value)
    assert made.state is State.FAULT


def test_the_distance_of_a_fraction_is_given_in_degrees() -> None:
    made = armed()
    made.begin_move(Fraction(3))  # type: ignore[arg-type]
    with pytest.raises(MoveError, match=r"sent to 3.000 deg and the probe is at 5.000 deg"):
        made.end_move(Fraction(5))  # type: ignore[arg-type]
    made = armed()
    with pytest.raises(MoveError, match=r"holds at 3.000 deg and the probe is at 5.000 deg"):
        made.redeem(made.issue(angle_deg=3.0, pulses=1, now_s=0.0), angle_deg=Fraction(5), now_s=0.0)  # type: ignore[arg-type]


@no_number
def test_a_readback_before_firing_that_is_no_number_is_a_fault(value: Any) -> None:
    made = armed()
    permit = made.issue(angle_deg=3.0, pulses=1, now_s=0.0)
    with pytest.raises(LimitError, match="the stage reads"):
        made.redeem(permit, angle_deg=value, now_s=0.0)
    assert made.state is State.FAULT


@no_number
def test_a_time_of_firing_that_is_no_number_is_a_fault(value: Any) -> None:
    made = armed()
    permit = made.issue(angle_deg=3.0, pulses=1, now_s=0.0)
    with pytest.raises(LaserError, match="has expired"):
        made.redeem(permit, angle_deg=3.0, now_s=value)
    assert made.state is State.FAULT


@pytest.mark.parametrize("permit", [None, "permit-1", [], {}, 1])
def test_what_is_no_permit_fires_nothing_and_is_a_fault(permit: Any) -> None:
    made = armed()
    made.issue(angle_deg=3.0, pulses=1, now_s=0.0)
    with pytest.raises(LaserError) as refusal:
        made.redeem(permit, angle_deg=3.0, now_s=0.0)
    assert str(refusal.value) == (f"the permit {permit!r} is not open: used, voided or never issued; nothing was fired")
    assert made.state is State.FAULT


@no_count
def test_pulses_that_are_no_whole_number_are_not_permitted(value: Any) -> None:
    permits = Permits(FiringLimits())
    with pytest.raises(LimitError) as refusal:
        permits.issue(angle_deg=1.5, pulses=value, now_s=2.5)
    assert str(refusal.value) == f"{value!r} pulses at 1.5 deg, 2.5 s: no number; nothing was permitted"
    assert permits.pulses_permitted == 0


@no_number
@pytest.mark.parametrize("name", ["angle_deg", "now_s"])
def test_a_permit_needs_an_angle_and_a_time(name: str, value: Any) -> None:
    made = armed()
    with pytest.raises(LimitError, match="nothing was permitted"):
        made.issue(**({"angle_deg": 0.0, "pulses": 1, "now_s": 0.0} | {name: value}))
    assert made.pulses_permitted == 0
    assert made.state is State.ARMED


@pytest.mark.parametrize("value", [*NO_COUNTS, -1], ids=str)
def test_pulses_of_before_that_are_no_whole_number_are_refused(value: Any) -> None:
    made = armed()
    with pytest.raises(ConfigError) as refusal:
        made.charge(value)
    assert str(refusal.value) == f"permits: {value} pulses cannot have been permitted before; count them again"
    assert made.pulses_permitted == 0


@no_count
def test_a_count_of_fired_pulses_that_is_no_whole_number_is_a_fault(value: Any) -> None:
    made = armed()
    made.redeem(made.issue(angle_deg=0.0, pulses=3, now_s=0.0), angle_deg=0.0, now_s=0.0)
    with pytest.raises(LaserError, match="3 were permitted"):
        made.end_fire(value)
    assert made.state is State.FAULT


def test_a_count_of_numpy_is_a_count() -> None:
    made = armed()
    made.redeem(made.issue(angle_deg=0.0, pulses=np.int64(3), now_s=0.0), angle_deg=0.0, now_s=0.0)  # type: ignore[arg-type]
    made.end_fire(np.uint16(3))  # type: ignore[arg-type]
    assert made.state is State.ARMED


@pytest.mark.parametrize("value", [*NO_COUNTS, 0, -1], ids=str)
@pytest.mark.parametrize("name", ["pulses_per_permit", "pulses_per_second", "pulses_per_session"])
def test_firing_limits_are_whole_numbers(name: str, value: Any) -> None:
    with pytest.raises(ConfigError) as refusal:
        FiringLimits(**{name: value})
    assert str(refusal.value) == f"firing limits: {name} is {value}, it must be a whole number of at least 1"
    assert getattr(FiringLimits(**{name: 1}), name) == 1


@no_number
def test_lifetime_lease_and_arrival_are_numbers(value: Any) -> None:
    with pytest.raises(ConfigError, match="lifetime_s is"):
        FiringLimits(lifetime_s=value)
    with pytest.raises(ConfigError, match="period_s is"):
        Lease(period_s=value)
    with pytest.raises(ConfigError, match="arrival_deg is"):
        disarmed(arrival_deg=value)


@no_number
def test_a_lease_whose_time_is_no_number_has_lapsed(value: Any) -> None:
    lease = Lease(period_s=0.5)
    lease.hold(now_s=value)
    assert lease.lapsed(now_s=0.0)
    lease.release()
    lease.hold(now_s=0.0)
    assert lease.lapsed(now_s=value)
    lease.beat(1, now_s=value)
    assert lease.ends_s == 0.5


@no_count
def test_a_step_that_is_no_whole_number_renews_no_lease(value: Any) -> None:
    lease = Lease(period_s=0.5)
    lease.hold(now_s=0.0)
    lease.beat(value, now_s=0.25)
    assert lease.ends_s == 0.5
    lease.beat(1, now_s=0.25)
    assert lease.ends_s == 0.75


@no_number
@pytest.mark.parametrize("name", FEATURES)
def test_a_reading_is_made_of_numbers(name: str, value: Any) -> None:
    if value is None:
        return  # not known
    reading = Reading(intensity=1.0)
    # Past the type check of the tests, which a reader outside of the package does not have.
    structs.force_setattr(reading, name, value)
    with pytest.raises(AcquisitionError) as refusal:
        Admission().admit_reading(reading, frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == f"{name} is {value}, it must be finite; take it again"


@no_number
def test_an_intensity_is_a_number(value: Any) -> None:
    reading = Reading(intensity=1.0)
    structs.force_setattr(reading, "intensity", value)
    with pytest.raises(AcquisitionError) as refusal:
        Admission().admit_reading(reading, frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == f"intensity is {value}: it must be finite and at least 0; take it again"


def test_a_reading_with_all_its_parts_is_admitted() -> None:
    assert FULL_READING.arrivals
    assert FULL_READING.local_maxima is not None
    Admission().admit_reading(FULL_READING, frame=FRAME, usual_sigma=None)


@pytest.mark.parametrize(
    ("angle_deg", "words"), [(40, "40 deg"), (math.nan, "nan deg"), (3 + 0j, "a complex (no angle)")]
)
def test_an_angle_that_is_refused_is_given_in_degrees_if_it_is_a_number(angle_deg: Any, words: str) -> None:
    with pytest.raises(LimitError) as refusal:
        Limits().require_search(angle_deg)
    assert str(refusal.value).startswith(f"angle {words} is outside the search range")


@no_number
def test_what_is_no_number_is_neither_finite_nor_whole(value: Any) -> None:
    assert not is_finite(value)
    assert is_whole(value) is (type(value) is int)
