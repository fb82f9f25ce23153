"""The rules of the guard, case by case; NaN and infinity among the cases of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    FrameHeader,
    Interval,
    LimitError,
    Permit,
    Reading,
)
from markerseek.guard import Admission, FiringLimits, Limits, Permits

PERMIT = Permit(token="permit-7", angle_deg=3.0, pulses=16, expires_s=100.0)
HEADER = FrameHeader(
    sequence=4,
    token="permit-7",
    pulses=16,
    commanded_deg=3.0,
    started_s=1.0,
    ended_s=2.0,
    angle_before_deg=3.0,
    angle_after_deg=3.01,
)
FRAME = ChannelFrame(header=HEADER, samples=np.zeros((128, 8), np.int16), sampling_hz=40e6)
READING = Reading(intensity=10.0)


@given(angle_deg=st.floats(allow_nan=True, allow_infinity=True))
def test_an_angle_is_let_through_exactly_when_it_is_inside(angle_deg: float) -> None:
    limits = Limits()
    inside = -35 <= angle_deg <= 35
    if inside:
        limits.require_search(angle_deg)
    else:
        with pytest.raises(LimitError, match="nothing was moved"):
            limits.require_search(angle_deg)


def test_a_search_range_outside_the_travel_is_refused() -> None:
    with pytest.raises(ConfigError, match="widen the travel"):
        Limits(search=Interval(low_deg=-40, high_deg=35))


def test_permits_are_named_once_and_expire() -> None:
    permits = Permits(FiringLimits(lifetime_s=5.0))
    first = permits.issue(angle_deg=1.0, pulses=16, now_s=10.0)
    second = permits.issue(angle_deg=1.0, pulses=16, now_s=10.0)
    assert first.token != second.token
    assert (first.pulses, first.expires_s) == (16, 15.0)
    assert permits.pulses_permitted == 32


@pytest.mark.parametrize("pulses", [-1, 129])
def test_one_acquisition_has_a_limit_of_pulses(pulses: int) -> None:
    permits = Permits(FiringLimits())
    with pytest.raises(LimitError, match="128"):
        permits.issue(angle_deg=0.0, pulses=pulses, now_s=0.0)
    assert permits.pulses_permitted == 0


def test_the_session_has_a_limit_of_pulses_and_counts_what_was_permitted() -> None:
    permits = Permits(FiringLimits(pulses_per_session=40))
    permits.issue(angle_deg=0.0, pulses=30, now_s=0.0)
    with pytest.raises(LimitError, match="new session"):
        permits.issue(angle_deg=0.0, pulses=11, now_s=0.0)
    permits.issue(angle_deg=0.0, pulses=10, now_s=0.0)
    assert permits.pulses_permitted == 40


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (replace(HEADER, token="permit-6"), "stale frame"),
        (replace(HEADER, sequence=3), "out of order"),
        (replace(HEADER, sequence=2), "out of order"),
        (replace(HEADER, pulses=15), "15 pulses were seen"),
        (replace(HEADER, pulses=0), "0 pulses were seen"),
        (replace(HEADER, angle_after_deg=3.06), "moved by 0.060 deg"),
        (replace(HEADER, angle_after_deg=float("nan")), "moved by nan deg"),
        (replace(HEADER, angle_before_deg=None), "no readback"),
    ],
)
def test_a_frame_that_is_not_the_answer_is_refused_by_name(header: FrameHeader, message: str) -> None:
    with pytest.raises(AcquisitionError, match=message):
        Admission().admit_frame(replace(FRAME, header=header), permit=PERMIT, previous_sequence=3)


def test_the_answer_to_the_permit_is_admitted() -> None:
    Admission().admit_frame(FRAME, permit=PERMIT, previous_sequence=3)
    Admission().admit_frame(FRAME, permit=PERMIT, previous_sequence=None)
    Admission().admit_reading(READING, frame=FRAME)


@pytest.mark.parametrize(
    ("reading", "message"),
    [
        (Reading(intensity=float("nan")), "intensity is nan"),
        (Reading(intensity=float("inf")), "intensity is inf"),
        (Reading(intensity=-1.0), "intensity is -1"),
        (Reading(intensity=1.0, saturated_fraction=0.06), "saturated: 6%"),
        (Reading(intensity=1.0, saturated_fraction=float("nan")), "saturated"),
        (Reading(intensity=1.0, dead_channels=tuple(range(7))), "7 of 128 channels are dead"),
    ],
)
def test_a_reading_that_is_no_measurement_is_refused_by_name(reading: Reading, message: str) -> None:
    with pytest.raises(AcquisitionError, match=message):
        Admission().admit_reading(reading, frame=FRAME)


def test_a_few_saturated_or_dead_channels_are_borne() -> None:
    reading = Reading(intensity=1.0, saturated_fraction=0.05, dead_channels=(3, 17))
    Admission().admit_reading(reading, frame=FRAME)


@pytest.mark.parametrize(
    "make",
    [
        lambda: FiringLimits(pulses_per_permit=0),
        lambda: FiringLimits(lifetime_s=float("nan")),
        lambda: Admission(settled_deg=0.0),
        lambda: Admission(saturated_limit=1.5),
        lambda: Admission(dead_limit=float("nan")),
    ],
)
def test_limits_that_limit_nothing_are_refused(make: object) -> None:
    with pytest.raises(ConfigError):
        make()  # type: ignore[operator]
