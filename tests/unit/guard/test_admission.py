"""Which frames and readings are believed, case by case, each refused by its name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    Frame,
    FrameHeader,
    Permit,
    Reading,
    ReadingFrame,
    SaturationError,
    SpotEnergy,
)
from markerseek.guard import Admission
from tests.unit.core.damaged import damaged

NAN = math.nan
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
BEFORE = replace(FRAME, header=replace(HEADER, sequence=3, token="permit-6"), samples=SAMPLES + np.int16(1))
INTENSITY = ReadingFrame(header=HEADER, intensity=5.0)
INTENSITY_BEFORE = replace(INTENSITY, header=BEFORE.header, intensity=6.0)
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
        admit(replace(FRAME, header=replace(HEADER, **changes)))
    assert str(refusal.value) == message


def test_the_probe_may_move_by_the_limit() -> None:
    admit(replace(FRAME, header=replace(HEADER, angle_after_deg=3.0625)))


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
    frame = replace(FRAME, header=replace(HEADER, started_s=started_s, ended_s=ended_s))
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
        (replace(BEFORE, samples=SAMPLES[:, :7]), "of shape (128, 7) at 4e+07 Hz"),
        (replace(BEFORE, samples=SAMPLES[:127]), "of shape (127, 8) at 4e+07 Hz"),
        (replace(BEFORE, sampling_hz=20e6), "of shape (128, 8) at 2e+07 Hz"),
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
        (FRAME, replace(BEFORE, samples=SAMPLES.copy())),
        (replace(FRAME, samples=np.full((128, 8), 3, np.int16)), None),
        (replace(FRAME, samples=np.zeros((128, 8), np.int16)), BEFORE),
        (replace(FRAME, samples=np.zeros((0, 8), np.int16)), None),
        (INTENSITY, replace(INTENSITY_BEFORE, intensity=5.0)),
        (replace(INTENSITY, intensity=0.0), None),
        (replace(INTENSITY, intensity=0.0), INTENSITY_BEFORE),
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
    admit(replace(FRAME, samples=nearly), previous=None)
    admit(replace(FRAME, samples=nearly), previous=replace(BEFORE, samples=np.zeros((128, 8), np.int16)))


FEATURES = ("lateral_m", "depth_m", "arrival_s", "noise_sigma", "coherence", "saturated_fraction")


@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, np.float32("nan")])
@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_that_is_no_number_is_refused(name: str, value: float) -> None:
    reading = replace(READING)
    # Past the type check of the tests, which a reader outside of the package does not have.
    object.__setattr__(reading, name, value)
    with pytest.raises(AcquisitionError) as refusal:
        Admission().admit_reading(reading, frame=FRAME, usual_sigma=None)
    assert str(refusal.value) == f"{name} is {value}, it must be finite; take it again"


@pytest.mark.parametrize("intensity", [NAN, math.inf, -1.0, -1e-300])
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


def test_the_factor_of_the_noise_can_be_chosen() -> None:
    rules = Admission(noise_ratio=3.0)
    rules.admit_reading(Reading(intensity=10.0, noise_sigma=1.5), frame=FRAME, usual_sigma=0.5)
    with pytest.raises(AcquisitionError, match=r"the noise is 1\.6 and was 0\.5 at first"):
        rules.admit_reading(Reading(intensity=10.0, noise_sigma=1.6), frame=FRAME, usual_sigma=0.5)


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
    reading = replace(DARK, **changes)  # type: ignore[arg-type]
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
