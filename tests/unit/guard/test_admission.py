"""Which frames and readings are believed, each refused by its name, and which of a run the guard compares them with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    Frame,
    FrameHeader,
    LimitError,
    Permit,
    Reading,
    ReadingFrame,
    SaturationError,
    SpotEnergy,
)
from markerseek.guard import Admission, Guard, State
from tests.unit.core.damaged import damaged
from tests.unit.guard.guards import armed, disarmed

NAN = math.nan
FOREIGN = Permit(token="foreign", angle_deg=0.0, pulses=1, expires_s=1e9)
PERMIT = Permit(token="permit-7", angle_deg=3.0, pulses=16, expires_s=100.0)
HEADER = FrameHeader(
    sequence=4,
    token="permit-7",
    pulses=16,
    commanded_deg=3.0,
    started_s=1.0,
    ended_s=2.0,
    angle_before_deg=3.0,
    angle_after_deg=3.05,
)
SAMPLES = np.arange(128 * 8, dtype=np.int16).reshape(128, 8)
FRAME = ChannelFrame(header=HEADER, samples=SAMPLES, sampling_hz=40e6)
BEFORE = structs.replace(
    FRAME, header=structs.replace(HEADER, sequence=3, token="permit-6"), samples=SAMPLES + np.int16(1)
)
INTENSITY = ReadingFrame(header=HEADER, intensity=5.0)
INTENSITY_BEFORE = structs.replace(INTENSITY, header=BEFORE.header, intensity=6.0)
READING = Reading(intensity=10.0)


def admit(
    frame: Frame,
    *,
    previous: Frame | None = BEFORE,
    issued_s: float = 1.0,
    now_s: float = 2.5,
    rules: Admission | None = None,
) -> None:
    rules = rules or Admission(settled_deg=0.0625)
    rules.admit_frame(frame, permit=PERMIT, issued_s=issued_s, now_s=now_s, previous=previous)


def test_the_answer_to_the_permit_is_admitted() -> None:
    admit(FRAME)
    admit(FRAME, previous=None)
    admit(INTENSITY, previous=None)
    admit(INTENSITY, previous=INTENSITY_BEFORE)
    Admission().admit_reading(READING, frame=FRAME, usual_sigma=None)
    Admission().admit_reading(Reading(intensity=0.0), frame=INTENSITY, usual_sigma=None)
    # What a spot holds was checked when it was made.
    spot = SpotEnergy(amplitude=10.0, relative_sigma=0.1, lateral_m=0.0, depth_m=0.05)
    Admission().admit_reading(Reading(intensity=10.0, spot=spot), frame=FRAME, usual_sigma=None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"token": "permit-6"},
            "stale frame: of 'permit-6', not of 'permit-7'; take it again",
        ),
        ({"sequence": 3}, "frame 3 after 3: out of order; try again"),
        ({"sequence": 2}, "frame 2 after 3: out of order; try again"),
        ({"pulses": 15}, "15 pulses were seen, 16 were permitted; check the laser"),
        ({"pulses": 0}, "0 pulses were seen, 16 were permitted; check the laser"),
        ({"pulses": 17}, "17 pulses were seen, 16 were permitted; check the laser"),
        ({"commanded_deg": 2.0}, "the frame is of 2.0 deg, not of 3.0 deg; take it again"),
        ({"commanded_deg": NAN}, "the frame is of nan deg, not of 3.0 deg; take it again"),
        ({"angle_before_deg": None}, "the frame carries no readback of the angle; the scanner must add it"),
        ({"angle_after_deg": None}, "the frame carries no readback of the angle; the scanner must add it"),
        (
            {"angle_after_deg": 3.0626},
            "the probe moved by 0.063 deg during the acquisition, the limit is 0.0625 deg; let it settle",
        ),
        (
            {"angle_after_deg": 2.9},
            "the probe moved by 0.100 deg during the acquisition, the limit is 0.0625 deg; let it settle",
        ),
        (
            {"angle_after_deg": NAN},
            "the probe moved by nan deg during the acquisition, the limit is 0.0625 deg; let it settle",
        ),
    ],
)
def test_a_frame_that_is_not_the_answer_is_refused_by_name(changes: dict[str, float], message: str) -> None:
    with pytest.raises(AcquisitionError) as refusal:
        admit(structs.replace(FRAME, header=structs.replace(HEADER, **changes)))
    assert str(refusal.value) == message


def test_the_probe_may_move_by_the_limit() -> None:
    admit(structs.replace(FRAME, header=structs.replace(HEADER, angle_after_deg=3.0625)))


@pytest.mark.parametrize(
    ("issued_s", "started_s", "ended_s", "now_s", "fresh"),
    [
        (1.0, 1.0, 1.0, 1.0, True),
        (1.0, 1.5, 2.0, 7.0, True),
        (1.0, 1.5, 2.0, 7.25, False),  # old
        (1.0, 0.75, 2.0, 2.5, False),  # begun before it was permitted
        (1.0, 2.0, 1.5, 2.5, False),  # ended before it began
        (1.0, 1.5, 2.5, 2.0, False),  # from the future
        (NAN, 1.5, 2.0, 2.5, False),
        (1.0, NAN, 2.0, 2.5, False),
        (1.0, 1.5, NAN, 2.5, False),
        (1.0, 1.5, 2.0, NAN, False),
    ],
)
def test_a_frame_is_of_its_own_time(
    issued_s: float, started_s: float, ended_s: float, now_s: float, fresh: bool
) -> None:
    frame = structs.replace(FRAME, header=structs.replace(HEADER, started_s=started_s, ended_s=ended_s))
    if fresh:
        admit(frame, issued_s=issued_s, now_s=now_s)
    else:
        with pytest.raises(AcquisitionError) as refusal:
            admit(frame, issued_s=issued_s, now_s=now_s)
        assert str(refusal.value) == (
            f"stale frame: taken {started_s:.3f} to {ended_s:.3f} s, permitted at {issued_s:.3f} s, now {now_s:.3f} s; "
            "the limit of age is 5.0 s; take it again"
        )


@pytest.mark.parametrize(
    ("previous", "was"),
    [
        (structs.replace(BEFORE, samples=SAMPLES[:, :7]), "of shape (128, 7) at 4e+07 Hz"),
        (structs.replace(BEFORE, samples=SAMPLES[:127]), "of shape (127, 8) at 4e+07 Hz"),
        (structs.replace(BEFORE, sampling_hz=20e6), "of shape (128, 8) at 2e+07 Hz"),
        (INTENSITY_BEFORE, "a number"),
    ],
)
def test_a_frame_keeps_its_shape_within_a_run(previous: Frame, was: str) -> None:
    with pytest.raises(AcquisitionError) as refusal:
        admit(FRAME, previous=previous)
    assert str(refusal.value) == f"the frame is of shape (128, 8) at 4e+07 Hz, not {was}; was a setting changed?"


@pytest.mark.parametrize(
    ("frame", "previous"),
    [
        (FRAME, structs.replace(BEFORE, samples=SAMPLES.copy())),
        (structs.replace(FRAME, samples=np.full((128, 8), 3, np.int16)), None),
        (structs.replace(FRAME, samples=np.zeros((128, 8), np.int16)), BEFORE),
        (structs.replace(FRAME, samples=np.zeros((0, 8), np.int16)), None),
        (INTENSITY, structs.replace(INTENSITY_BEFORE, intensity=5.0)),
        (structs.replace(INTENSITY, intensity=0.0), None),
        (structs.replace(INTENSITY, intensity=0.0), INTENSITY_BEFORE),
    ],
)
def test_old_data_under_a_new_header_are_refused_unless_they_were_recorded(frame: Frame, previous: Frame) -> None:
    with pytest.raises(AcquisitionError) as refusal:
        admit(frame, previous=previous)
    assert str(refusal.value) == "stale frame: its data are constant, 0, or those of the frame before; take it again"
    admit(frame, previous=previous, rules=Admission(repeats=True))


def test_data_that_differ_in_one_sample_are_new() -> None:
    nearly = np.zeros((128, 8), np.int16)
    nearly[127, 7] = 1
    admit(structs.replace(FRAME, samples=nearly), previous=None)
    admit(
        structs.replace(FRAME, samples=nearly), previous=structs.replace(BEFORE, samples=np.zeros((128, 8), np.int16))
    )


@pytest.mark.parametrize("intensity", [-1.0, -1e-300])
def test_an_intensity_that_is_no_measurement_is_refused(intensity: float) -> None:
    with pytest.raises(AcquisitionError) as refusal:
        Admission().admit_reading(damaged(intensity=intensity), frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == f"intensity is {intensity}: it must be finite and at least 0; take it again"


def test_too_many_saturated_channels_are_refused() -> None:
    with pytest.raises(SaturationError) as refusal:
        Admission().admit_reading(Reading(intensity=1.0, saturated_fraction=0.0625), frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == (
        "saturated: 6% of the channels are at full scale in the marker's window, the limit is 5%; "
        "reduce the gain or the laser's energy"
    )


def test_too_many_dead_channels_are_refused() -> None:
    with pytest.raises(AcquisitionError) as refusal:
        Admission().admit_reading(Reading(intensity=1.0, dead_channels=tuple(range(7))), frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == "7 of 128 channels are dead, the limit is 5%; check the probe's connector"
    Admission().admit_reading(Reading(intensity=1.0, dead_channels=tuple(range(7))), frame=INTENSITY, usual_sigma=None)


def test_a_few_saturated_or_dead_channels_are_borne() -> None:
    Admission().admit_reading(
        Reading(intensity=1.0, saturated_fraction=0.05, dead_channels=(3, 17)), frame=FRAME, usual_sigma=None
    )
    rules = Admission(dead_limit=0.5)
    rules.admit_reading(Reading(intensity=1.0, dead_channels=tuple(range(64))), frame=FRAME, usual_sigma=None)
    with pytest.raises(AcquisitionError, match="65 of 128"):
        rules.admit_reading(Reading(intensity=1.0, dead_channels=tuple(range(65))), frame=FRAME, usual_sigma=None)


@pytest.mark.parametrize(
    ("sigma", "usual_sigma", "believed"),
    [
        (0.5, 0.25, True),
        (0.25, 0.5, True),
        (0.501, 0.25, False),
        (0.249, 0.5, False),
        (8.0, 0.25, False),
        (1e-300, 0.25, False),
        (None, 0.25, True),
        (8.0, None, True),
        (0.0, 0.25, False),
        (8.0, 0.0, True),
    ],
)
def test_a_frame_is_as_noisy_as_the_first_of_its_kind(
    sigma: float | None, usual_sigma: float | None, believed: bool
) -> None:
    reading = Reading(intensity=10.0, noise_sigma=sigma)
    if believed:
        Admission().admit_reading(reading, frame=FRAME, usual_sigma=usual_sigma)
    else:
        with pytest.raises(AcquisitionError) as refusal:
            Admission().admit_reading(reading, frame=FRAME, usual_sigma=usual_sigma)
        assert str(refusal.value) == (
            f"the noise is {sigma:.3g} and was {usual_sigma:.3g} at first in this run, by more than a factor of 2; "
            "take it again, and find what disturbs the receiver"
        )
        rules = Admission(noise_ratio=math.inf)
        rules.admit_reading(reading, frame=FRAME, usual_sigma=usual_sigma)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("noise_ratio", 1.0, "it must lie in (1, inf)"),
        ("noise_ratio", 0.5, "it must lie in (1, inf)"),
        ("noise_ratio", NAN, "it must lie in (1, inf)"),
        ("settled_deg", 0.0, "it must lie between 0 and 1 deg"),
        ("settled_deg", 1.0, "it must lie between 0 and 1 deg"),
        ("settled_deg", NAN, "it must lie between 0 and 1 deg"),
        ("age_s", 0.0, "it must lie in (0, 60] s"),
        ("age_s", 60.5, "it must lie in (0, 60] s"),
        ("age_s", NAN, "it must lie in (0, 60] s"),
        ("saturated_limit", 1.5, "it must lie in [0, 1]"),
        ("saturated_limit", -0.5, "it must lie in [0, 1]"),
        ("dead_limit", NAN, "it must lie in [0, 1]"),
    ],
)
def test_rules_that_refuse_nothing_are_refused(name: str, value: float, message: str) -> None:
    unit = {"settled_deg": " deg", "age_s": " s"}.get(name, "")
    with pytest.raises(ConfigError) as refusal:
        Admission(**{name: value})
    assert str(refusal.value) == f"admission: {name} is {value}{unit}, {message}"


def test_the_ends_of_the_rules_are_allowed() -> None:
    Admission(age_s=0.5)
    Admission(age_s=60, saturated_limit=1, dead_limit=0)
    Admission(saturated_limit=0, dead_limit=1)


DARK = Reading(intensity=1.0, noise_sigma=1.0, cells=460_000)
MAX_NOISE = math.sqrt(2 * math.log(460_000 / 1e-6))


@pytest.mark.parametrize(
    ("changes", "believed"),
    [
        ({"intensity": MAX_NOISE}, True),
        ({"intensity": math.nextafter(MAX_NOISE, 99)}, False),
        ({"intensity": 2.0 * MAX_NOISE, "noise_sigma": 2.0}, True),
        ({"intensity": 2.0 * MAX_NOISE, "noise_sigma": 1.99}, False),
        ({"intensity": 5.0, "cells": 1}, True),
        ({"intensity": 5.3, "cells": 1}, False),
        ({"intensity": 99.0, "noise_sigma": None}, True),
        ({"intensity": 99.0, "noise_sigma": 0.0}, True),
        ({"intensity": 99.0, "cells": None}, True),
    ],
)
def test_a_dark_frame_holds_no_more_than_noise_reaches(changes: dict[str, float], believed: bool) -> None:
    reading = structs.replace(DARK, **changes)  # type: ignore[arg-type]
    said = Admission(dark_alarm=1e-6).source_in_dark(reading)
    assert (said is None) == believed
    assert Admission().source_in_dark(reading) is None
    if said is not None:
        assert reading.noise_sigma is not None
        assert reading.cells is not None
        limit = reading.noise_sigma * math.sqrt(2 * math.log(reading.cells / 1e-6))
        assert said == (
            f"the frame was taken without light, yet it holds a source of {reading.intensity:.4g}, while noise alone "
            f"reaches {limit:.4g}; it is of another acquisition, or light came: restart the data acquisition, and "
            "begin a new search"
        )


@pytest.mark.parametrize("dark_alarm", [0.0, -1e-6, 0.011, NAN, math.inf])
def test_a_probability_that_is_none_is_refused(dark_alarm: float) -> None:
    with pytest.raises(ConfigError, match="dark_alarm is"):
        Admission(dark_alarm=dark_alarm)
    assert Admission(dark_alarm=0.01).dark_alarm == 0.01


def admitted(made: Guard, permit: Permit, *, sequence: int, intensity: float, started_s: float) -> ReadingFrame:
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
    made = armed()
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    admitted(made, permit, sequence=8, intensity=1.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="frame 8 after 8"):
        admitted(made, permit, sequence=8, intensity=2.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="those of the frame before"):
        admitted(made, permit, sequence=9, intensity=1.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match=r"permitted at 5\.000 s"):
        admitted(made, permit, sequence=9, intensity=2.0, started_s=4.0)
    assert made.state is State.ARMED
    made.disarm()
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    admitted(made, permit, sequence=1, intensity=1.0, started_s=5.0)


def test_a_frame_without_any_permit_is_refused() -> None:
    with pytest.raises(AcquisitionError, match="permitted at nan s"):
        admitted(armed(), FOREIGN, sequence=1, intensity=1.0, started_s=0.0)


def test_a_reading_of_channels_is_judged_by_its_frame() -> None:
    channels = structs.replace(FRAME, samples=np.zeros((4, 2), np.int16))
    with pytest.raises(AcquisitionError, match="1 of 4 channels are dead"):
        armed().admit_reading(Reading(intensity=1.0, dead_channels=(2,)), frame=channels)


def test_a_reading_is_admitted_by_the_rules_given() -> None:
    made = armed(admission=Admission(saturated_limit=0.5))
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    answer = admitted(made, permit, sequence=1, intensity=1.0, started_s=0.0)
    made.admit_reading(Reading(intensity=1.0, saturated_fraction=0.5), frame=answer)
    for bad in (structs.replace(Reading(intensity=1.0), saturated_fraction=0.75), damaged(intensity=math.nan)):
        with pytest.raises(AcquisitionError):
            made.admit_reading(bad, frame=answer)


def frame_of(*, pulses: int, sequence: int = 1, intensity: float = 1.0) -> ReadingFrame:
    header = FrameHeader(sequence=sequence, token="t", pulses=pulses, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    return ReadingFrame(header=header, intensity=intensity)


def test_noise_is_judged_by_the_first_frame_of_its_kind_in_a_run() -> None:
    made = armed()
    lit = frame_of(pulses=1)
    dark = frame_of(pulses=0)
    for one, sigma in ((dark, 1.0), (lit, 3.0), (dark, 1.9), (lit, 1.6), (dark, 0.6)):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=one)
    for one, sigma in ((dark, 3.0), (lit, 1.0), (lit, 6.5), (dark, 0.4)):
        with pytest.raises(AcquisitionError, match="at first in this run"):
            made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=one)
    made.disarm()
    made.admit_reading(Reading(intensity=1.0, noise_sigma=6.5), frame=lit)


@pytest.mark.parametrize(("dark", "lit", "believed"), [(1.0, 9.0, True), (1.0, 0.5, True), (1.0, 0.49, False)])
def test_a_lit_frame_may_be_noisier_than_the_dark_ones_and_not_quieter(dark: float, lit: float, believed: bool) -> None:
    made = armed()
    made.admit_reading(Reading(intensity=1.0, noise_sigma=dark), frame=frame_of(pulses=0))
    reading = Reading(intensity=1.0, noise_sigma=lit)
    if believed:
        made.admit_reading(reading, frame=frame_of(pulses=16))
    else:
        with pytest.raises(AcquisitionError, match=r"the noise is 0\.49 and was 1 at first"):
            made.admit_reading(reading, frame=frame_of(pulses=16))


@pytest.mark.parametrize(("dark", "believed"), [(0.01, True), (2.0, True), (2.01, False)])
def test_the_first_dark_frame_may_be_quieter_than_the_lit_ones_and_not_noisier(dark: float, believed: bool) -> None:
    made = armed()
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
    armed().admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame_of(pulses=pulses))


def test_noise_may_become_known_in_the_middle_of_a_run() -> None:
    made = armed()
    for sigma in (None, None, 5.0):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame_of(pulses=16))


def test_a_refused_reading_is_no_measure_of_noise() -> None:
    made = armed()
    lit = frame_of(pulses=16)
    for bad in (damaged(intensity=-1.0, noise_sigma=9.0), damaged(noise_sigma=math.nan)):
        with pytest.raises(AcquisitionError):
            made.admit_reading(bad, frame=lit)
    made.admit_reading(Reading(intensity=1.0, noise_sigma=1.0), frame=lit)


def test_a_guard_that_recalls_a_run_refuses_what_the_first_one_would_have() -> None:
    made = disarmed()
    made.charge(32)
    lit = frame_of(sequence=8, intensity=1.0, pulses=1)
    dark = frame_of(sequence=7, intensity=3.0, pulses=0)
    made.recall(dark, Reading(intensity=3.0, noise_sigma=4.0))
    made.recall(lit, Reading(intensity=1.0, noise_sigma=1.0))
    made.recall(lit, Reading(intensity=1.0, noise_sigma=100.0))
    assert made.pulses_permitted == 32
    made.arm(by="a test")
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=5.0)
    with pytest.raises(AcquisitionError, match="frame 8 after 8"):
        admitted(made, permit, sequence=8, intensity=2.0, started_s=5.0)
    with pytest.raises(AcquisitionError, match="those of the frame before"):
        admitted(made, permit, sequence=9, intensity=1.0, started_s=5.0)
    made.admit_reading(Reading(intensity=1.0, noise_sigma=2.0), frame=lit)
    for sigma, of in ((2.1, lit), (1.9, dark), (8.1, dark)):
        with pytest.raises(AcquisitionError, match="the noise is"):
            made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=of)


def test_a_run_that_goes_on_is_recalled_before_the_rig_is_armed() -> None:
    made = armed()
    with pytest.raises(LimitError, match="guard: armed, not allowed to recall"):
        made.recall(frame_of(sequence=1, intensity=1.0, pulses=16), Reading(intensity=1.0))


@pytest.mark.parametrize(("pulses", "intensity", "fault"), [(0, 8.0, True), (0, 7.0, False), (16, 8.0, False)])
def test_a_source_in_a_dark_frame_is_a_fault_at_once(pulses: int, intensity: float, fault: bool) -> None:
    made = armed(admission=Admission(dark_alarm=1e-6))
    permit = made.issue(angle_deg=0.0, pulses=pulses, now_s=5.0)
    taken = admitted(made, permit, sequence=1, intensity=intensity, started_s=5.0)
    reading = Reading(intensity=intensity, noise_sigma=1.0, cells=460_000)
    if not fault:
        made.admit_reading(reading, frame=taken)
        assert made.state is State.ARMED
        return
    with pytest.raises(AcquisitionError, match="restart the data acquisition"):
        made.admit_reading(reading, frame=taken)
    assert made.state is State.FAULT
    assert "holds a source" in (made.fault or "")
