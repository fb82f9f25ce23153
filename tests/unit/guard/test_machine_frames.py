"""The guard admits the frames and readings of a run in their order, and forgets them when the run ends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from markerseek.core import AcquisitionError, ChannelFrame, FrameHeader, LimitError, Permit, Reading, ReadingFrame
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from tests.unit.core.damaged import damaged

FOREIGN = Permit(token="foreign", angle_deg=0.0, pulses=1, expires_s=1e9)


def guard() -> Guard:
    """A guard that is armed."""
    made = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission())
    made.arm(by="a test")
    return made


def frame(made: Guard, permit: Permit, *, sequence: int, intensity: float, started_s: float) -> ReadingFrame:
    header = FrameHeader(
        sequence=sequence,
        token=permit.token,
        pulses=permit.pulses,
        commanded_deg=permit.angle_deg,
        started_s=started_s,
        ended_s=started_s,
        angle_before_deg=0.0,
        angle_after_deg=0.0,
    )
    answer = ReadingFrame(header=header, intensity=intensity)
    made.admit_frame(answer, permit=permit, now_s=started_s)
    return answer


def test_frames_are_admitted_in_order_and_a_new_run_begins_anew() -> None:
    made = guard()
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    frame(made, permit, sequence=8, intensity=1.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="frame 8 after 8"):
        frame(made, permit, sequence=8, intensity=2.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="those of the frame before"):
        frame(made, permit, sequence=9, intensity=1.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match=r"permitted at 5\.000 s"):
        frame(made, permit, sequence=9, intensity=2.0, started_s=4.0)
    assert made.state is State.ARMED
    made.disarm()
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    frame(made, permit, sequence=1, intensity=1.0, started_s=5.0)


def test_a_frame_without_any_permit_is_refused() -> None:
    with pytest.raises(AcquisitionError, match="permitted at nan s"):
        frame(guard(), FOREIGN, sequence=1, intensity=1.0, started_s=0.0)


def test_a_reading_of_channels_is_judged_by_its_frame() -> None:
    header = FrameHeader(sequence=1, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    channels = ChannelFrame(header=header, samples=np.zeros((4, 2), np.int16), sampling_hz=40e6)
    with pytest.raises(AcquisitionError, match="1 of 4 channels are dead"):
        guard().admit_reading(Reading(intensity=1.0, dead_channels=(2,)), frame=channels)


def test_a_reading_is_admitted_by_the_rules_given() -> None:
    made = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission(saturated_limit=0.5))
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    answer = frame(made, permit, sequence=1, intensity=1.0, started_s=0.0)
    made.admit_reading(Reading(intensity=1.0, saturated_fraction=0.5), frame=answer)
    for bad in (replace(Reading(intensity=1.0), saturated_fraction=0.75), damaged(intensity=math.nan)):
        with pytest.raises(AcquisitionError):
            made.admit_reading(bad, frame=answer)


def frame_of(*, pulses: int) -> ReadingFrame:
    header = FrameHeader(sequence=1, token="t", pulses=pulses, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    return ReadingFrame(header=header, intensity=1.0)


def test_noise_is_judged_by_the_first_frame_of_its_kind_in_a_run() -> None:
    made = guard()
    lit, dark = frame_of(pulses=1), frame_of(pulses=0)
    for one, sigma in ((dark, 1.0), (lit, 3.0), (dark, 1.9), (lit, 1.6), (dark, 0.6)):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=one)
    for one, sigma in ((dark, 3.0), (lit, 1.0), (lit, 6.5), (dark, 0.4)):
        with pytest.raises(AcquisitionError, match="at first in this run"):
            made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=one)
    made.disarm()
    made.admit_reading(Reading(intensity=1.0, noise_sigma=6.5), frame=lit)


@pytest.mark.parametrize(("dark", "lit", "believed"), [(1.0, 9.0, True), (1.0, 0.5, True), (1.0, 0.49, False)])
def test_a_lit_frame_may_be_noisier_than_the_dark_ones_and_not_quieter(dark: float, lit: float, believed: bool) -> None:
    made = guard()
    made.admit_reading(Reading(intensity=1.0, noise_sigma=dark), frame=frame_of(pulses=0))
    reading = Reading(intensity=1.0, noise_sigma=lit)
    if believed:
        made.admit_reading(reading, frame=frame_of(pulses=16))
    else:
        with pytest.raises(AcquisitionError, match=r"the noise is 0\.49 and was 1 at first"):
            made.admit_reading(reading, frame=frame_of(pulses=16))


@pytest.mark.parametrize(("dark", "believed"), [(0.01, True), (2.0, True), (2.01, False)])
def test_the_first_dark_frame_may_be_quieter_than_the_lit_ones_and_not_noisier(dark: float, believed: bool) -> None:
    made = guard()
    # Single pulses of a sweep are noisier than the mean of 16; no noise is known of one.
    for pulses, sigma in ((1, 4.0), (16, 1.0), (8, None)):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame_of(pulses=pulses))
    reading = Reading(intensity=1.0, noise_sigma=dark)
    if believed:
        made.admit_reading(reading, frame=frame_of(pulses=0))
    else:
        with pytest.raises(AcquisitionError, match=r"the noise is 2\.01 and was 1 at first"):
            made.admit_reading(reading, frame=frame_of(pulses=0))


@pytest.mark.parametrize("pulses", [0, 16])
@pytest.mark.parametrize("sigma", [0.0, 1e-6, 1e6])
def test_the_first_frame_of_a_run_may_be_of_any_noise(pulses: int, sigma: float) -> None:
    guard().admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame_of(pulses=pulses))


def test_noise_may_become_known_in_the_middle_of_a_run() -> None:
    made = guard()
    for sigma in (None, None, 5.0):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame_of(pulses=16))


def test_a_refused_reading_is_no_measure_of_noise() -> None:
    made = guard()
    lit = frame_of(pulses=16)
    for bad in (damaged(intensity=-1.0, noise_sigma=9.0), damaged(noise_sigma=math.nan)):
        with pytest.raises(AcquisitionError):
            made.admit_reading(bad, frame=lit)
    made.admit_reading(Reading(intensity=1.0, noise_sigma=1.0), frame=lit)


def recorded(*, sequence: int, intensity: float, pulses: int) -> ReadingFrame:
    header = FrameHeader(sequence=sequence, token="t", pulses=pulses, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    return ReadingFrame(header=header, intensity=intensity)


def test_a_guard_that_recalls_a_run_refuses_what_the_first_one_would_have() -> None:
    made = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission())
    made.charge(32)
    lit, dark = recorded(sequence=8, intensity=1.0, pulses=1), recorded(sequence=7, intensity=3.0, pulses=0)
    made.recall(dark, Reading(intensity=3.0, noise_sigma=4.0))
    made.recall(lit, Reading(intensity=1.0, noise_sigma=1.0))
    made.recall(lit, Reading(intensity=1.0, noise_sigma=100.0))
    assert made.pulses_permitted == 32
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    with pytest.raises(AcquisitionError, match="frame 8 after 8"):
        frame(made, permit, sequence=8, intensity=2.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="those of the frame before"):
        frame(made, permit, sequence=9, intensity=1.0, started_s=5.0)
    made.admit_reading(Reading(intensity=1.0, noise_sigma=2.0), frame=lit)
    for sigma, of in ((2.1, lit), (1.9, dark), (8.1, dark)):
        with pytest.raises(AcquisitionError, match="the noise is"):
            made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=of)


def test_a_run_that_goes_on_is_recalled_before_the_rig_is_armed() -> None:
    made = guard()
    with pytest.raises(LimitError, match="guard: armed, not allowed to recall"):
        made.recall(recorded(sequence=1, intensity=1.0, pulses=16), Reading(intensity=1.0))


@pytest.mark.parametrize(("pulses", "intensity", "fault"), [(0, 8.0, True), (0, 7.0, False), (16, 8.0, False)])
def test_a_source_in_a_dark_frame_is_a_fault_at_once(pulses: int, intensity: float, fault: bool) -> None:
    made = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission(dark_alarm=1e-6))
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=pulses, now_s=5.0)
    taken = frame(made, permit, sequence=1, intensity=intensity, started_s=5.0)
    reading = Reading(intensity=intensity, noise_sigma=1.0, cells=460_000)
    if not fault:
        made.admit_reading(reading, frame=taken)
        assert made.state is State.ARMED
        return
    with pytest.raises(AcquisitionError, match="restart the data acquisition"):
        made.admit_reading(reading, frame=taken)
    assert made.state is State.FAULT
    assert "holds a source" in (made.fault or "")
