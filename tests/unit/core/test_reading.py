"""Frames and images: their checks, their place in a journal, where pixels are, and the local maxima of blocks."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import (
    Arrival,
    ChannelFrame,
    ConfigError,
    LocalMaxima,
    Measured,
    PaImage,
    RecordError,
    Refused,
    Sample,
    ScanGeometry,
)
from markerseek.records.journal import Checked, Journal, JournalEvent, decode_entry, read_journal
from tests.sizes import examples
from tests.unit.records.journal.synthetic_journals import FULL_READING, HEADER, configuration, stored

GEOMETRY = ScanGeometry(first_lateral_m=-0.02, lateral_step_m=1e-4, first_depth_m=0.01, depth_step_m=2e-4)
COUNTS = np.arange(-17, 18, dtype=np.int16).reshape(7, 5)
FRAMES = [
    ChannelFrame(header=HEADER, samples=COUNTS, sampling_hz=40e6),
    # A slice of a larger array, as a driver may hand it over: its rows are not side by side in memory.
    ChannelFrame(header=HEADER, samples=np.asfortranarray(COUNTS), sampling_hz=40e6),
]


def assert_same(one: object, other: object) -> None:
    """Frames, their arrays and images are equal, number by number."""
    assert type(one) is type(other)
    if not isinstance(other, ChannelFrame):
        np.testing.assert_array_equal(one, other)  # type: ignore[arg-type]
        return
    for field in structs.fields(other):
        assert_same(getattr(one, field.name), getattr(other, field.name))


@pytest.mark.parametrize("frame", FRAMES, ids=["rows", "columns"])
def test_a_journal_holds_a_frame_wherever_it_may_be(frame: ChannelFrame, tmp_path: Path) -> None:
    events: list[JournalEvent] = [
        Refused(angle_deg=1.0, reason="moved", frame=frame),
        Measured(role="search", index=1, sample=Sample(angle_deg=1.0, reading=FULL_READING, frame=frame)),
        Checked(reading=FULL_READING, difference=None, frame=frame),
    ]
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        for event in events:
            journal.commit(event, clock_s=0.0)
    held = [entry.event for entry in read_journal(path).entries]
    assert isinstance(held[0], Refused)
    assert isinstance(held[1], Measured)
    assert isinstance(held[2], Checked)
    for again in (held[0].frame, held[1].sample.frame, held[2].frame):
        assert_same(again, frame)


@pytest.mark.parametrize("frame", FRAMES, ids=["rows", "columns"])
def test_a_row_with_another_array_than_its_body_names_is_refused(frame: ChannelFrame) -> None:
    line, whole = stored(Refused(angle_deg=1.0, reason="moved", frame=frame))
    assert line.block == len(whole) > 0
    for samples, found in ((b"", "a frame of"), (whole[:-1], "a frame of"), (bytes(whole) + b"0", "1 by")):
        with pytest.raises(RecordError, match=f"an entry that cannot be read: {found}"):
            decode_entry(line, samples, confirmation=None)
    for here, there in ((b"<i2", b"<f2"), (b'"shape":[', b'"shape":[-')):
        body = bytes(line.body)
        assert here in body
        changed = structs.replace(line, body=msgspec.Raw(body.replace(here, there)))
        with pytest.raises(RecordError, match="an entry that cannot be read"):
            decode_entry(changed, whole, confirmation=None)


def test_arrays_of_another_kind_are_no_frame() -> None:
    with pytest.raises(ConfigError, match=r"channel frame: samples are .*int16 of shape \(channels, samples\)"):
        ChannelFrame(header=HEADER, samples=np.zeros((2, 3)), sampling_hz=40e6)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"channel frame: sampling_hz is nan Hz"):
        ChannelFrame(header=HEADER, samples=COUNTS, sampling_hz=math.nan)


@pytest.mark.parametrize("name", ScanGeometry.__struct_fields__)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_geometry_that_is_not_finite_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"scan geometry: {name}"):
        structs.replace(GEOMETRY, **{name: value})


def test_a_step_is_positive() -> None:
    for step in (0.0, -1e-4):
        with pytest.raises(ConfigError, match="it must be positive"):
            structs.replace(GEOMETRY, depth_step_m=step)


@given(row=st.floats(-1e3, 1e3), column=st.floats(-1e3, 1e3))
def test_position_and_pixel_are_inverse(row: float, column: float) -> None:
    lateral_m, depth_m = GEOMETRY.position_m(row=row, column=column)
    assert GEOMETRY.pixel(lateral_m=lateral_m, depth_m=depth_m) == pytest.approx((row, column), abs=1e-6)


def test_the_geometry_of_a_photoacoustic_image_is_that_of_its_axes() -> None:
    lateral_m = np.linspace(-0.02, 0.02, 81)
    depth_m = 0.005 + 0.1e-3 * np.arange(300)
    image = PaImage(envelope=np.zeros((300, 81), np.float32), lateral_m=lateral_m, depth_m=depth_m)
    for row, column in ((0, 0), (299, 80), (17, 42)):
        assert image.geometry.position_m(row=row, column=column) == pytest.approx((lateral_m[column], depth_m[row]))
    # Half a pixel beyond the middles of the outermost ones.
    assert image.geometry.edges_mm(300, 81) == pytest.approx((-20.25, 20.25, 34.95, 4.95))


ROWS = 7
COLUMNS = 5
HEIGHTS = np.random.default_rng(3).uniform(1, 9, (ROWS, COLUMNS)).astype("<f4")
MAXIMA = LocalMaxima(
    first_lateral_m=-4e-3,
    first_depth_m=5e-3,
    lateral_step_m=2e-3,
    depth_step_m=2.5e-3,
    columns=COLUMNS,
    noise_peaks=12.0,
    intensities=HEIGHTS.tobytes(),
)


@settings(max_examples=examples(200), deadline=None)
@given(lateral_mm=st.floats(-9, 9), low_mm=st.floats(0, 30), deep_mm=st.floats(0, 12), within_mm=st.floats(0.0, 4.0))
def test_the_window_touches_the_blocks_that_overlap_it(
    lateral_mm: float, low_mm: float, deep_mm: float, within_mm: float
) -> None:
    """Against a test of each block by itself; windows that end within a nanometre of a block's edge are left out."""
    sides = (lateral_mm - within_mm, lateral_mm + within_mm, low_mm, low_mm + deep_mm)
    touched = np.zeros((ROWS, COLUMNS), dtype=bool)
    for row, column in np.ndindex(ROWS, COLUMNS):
        left = -5 + 2 * column
        top = 3.75 + 2.5 * row
        edges = (left, left + 2, top, top + 2.5)
        if any(abs(side - edge) < 1e-6 for side in sides for edge in edges):
            return
        touched[row, column] = sides[0] < edges[1] and sides[1] > edges[0] and sides[2] < edges[3] and sides[3] > top
    found = MAXIMA.near(
        lateral_m=lateral_mm * 1e-3,
        low_depth_m=low_mm * 1e-3,
        high_depth_m=(low_mm + deep_mm) * 1e-3,
        within_m=within_mm * 1e-3,
    )
    if not touched.any():
        assert found is None
        return
    assert found is not None
    height, cells = found
    assert height == HEIGHTS[touched].max()
    # M is the solution of M = ρ(u² − 1) with M·exp(−u²/2) = ln 2, whatever way it is found.
    u_squared = 2 * math.log(cells / math.log(2))
    assert cells == pytest.approx(12.0 * touched.sum() * (u_squared - 1), rel=0.02)


def test_the_number_of_rows_follows() -> None:
    assert MAXIMA.rows == ROWS
    assert structs.replace(MAXIMA) == MAXIMA
    assert "intensities" in repr(MAXIMA)


@pytest.mark.parametrize(
    "change",
    [
        {"intensities": b""},
        {"intensities": HEIGHTS.tobytes()[:-4]},
        {"intensities": np.full(COLUMNS, np.nan, "<f4").tobytes()},
        {"intensities": np.full(COLUMNS, -1, "<f4").tobytes()},
        {"columns": 0},
        {"noise_peaks": 0.0},
        {"first_lateral_m": math.nan},
        {"first_depth_m": 11.0},
        {"lateral_step_m": 0.0},
    ],
)
def test_impossible_maxima_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="local maxima"):
        structs.replace(MAXIMA, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [{"lateral_m": math.nan}, {"low_depth_m": math.nan}, {"high_depth_m": 1e-3}, {"within_m": -1e-3}],
)
def test_an_impossible_window_is_refused(change: dict[str, float]) -> None:
    window = {"lateral_m": 0.0, "low_depth_m": 5e-3, "high_depth_m": 6e-3, "within_m": 0.0}
    assert MAXIMA.near(**window) is not None
    with pytest.raises(ConfigError, match=next(iter(change))):
        MAXIMA.near(**{**window, **change})


@pytest.mark.parametrize("name", ["lateral_m", "depth_m", "arrival_s", "intensity", "coherence"])
def test_an_arrival_refuses_what_is_no_number(name: str) -> None:
    arrival = Arrival(lateral_m=0.0, depth_m=0.05, arrival_s=3e-5, intensity=7.0, coherence=0.5)
    with pytest.raises(ConfigError, match=name):
        structs.replace(arrival, **{name: math.nan})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lateral_m": 1e200}, "lateral_m is 1e\\+200, it must lie between -10 and 10"),
        ({"depth_m": -40.0}, "depth_m is -40.0, it must lie between -10 and 10"),
        ({"arrival_s": 7e5}, "arrival_s is 700000.0, it must lie between -1 and 1"),
        ({"spread_s": -1e-6}, "spread_s is -1e-06, it must lie between 0 and 1"),
        ({"noise_sigma": 1e250}, "noise_sigma is 1e\\+250, it must lie between 0 and 1e\\+60"),
        ({"cells": -3}, "cells is -3, it must lie between 0"),
        ({"focused_coherence": 1e12}, "focused_coherence is 1000000000000.0, it must lie between"),
        ({"coherence": 1.01}, "coherence is 1.01"),
        ({"saturated_fraction": 300}, "saturated_fraction is 300"),
        (
            {"arrivals": [{"lateral_m": 0, "depth_m": 1e300, "arrival_s": 0, "intensity": 1, "coherence": None}]},
            "depth_m",
        ),
    ],
)
def test_features_that_no_frame_has_are_refused_when_a_journal_is_read(change: dict[str, object], said: str) -> None:
    """Its check sums say that it was not damaged, not that its numbers are possible."""
    event = Measured(role="search", index=1, sample=Sample(angle_deg=1.0, reading=FULL_READING))
    line, _ = stored(event)
    held = msgspec.json.decode(line.body)
    held["sample"]["reading"] |= change
    changed = structs.replace(line, body=msgspec.Raw(msgspec.json.encode(held)))
    with pytest.raises(RecordError, match=f"an entry that cannot be read: .*{said}"):
        decode_entry(changed, b"", confirmation=None)


@pytest.mark.parametrize("angle_deg", [1e300, -2e4])
def test_an_angle_that_no_stage_reaches_is_refused_when_a_journal_is_read(angle_deg: float) -> None:
    event = Measured(role="search", index=1, sample=Sample(angle_deg=angle_deg, reading=FULL_READING))
    line, _ = stored(event)
    with pytest.raises(RecordError, match=r"the angle of a sample is .* deg, it must lie in \[-10000, 10000\] deg"):
        decode_entry(line, b"", confirmation=None)


def test_a_share_may_be_rounded_above_one() -> None:
    assert structs.replace(FULL_READING, coherence=1 + 1e-12).coherence == 1 + 1e-12
