"""Frames: their checks, their place in a journal, and where the pixels of an image are."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import (
    ChannelFrame,
    ConfigError,
    Measured,
    PaImage,
    RecordError,
    Refused,
    Sample,
    ScanGeometry,
)
from markerseek.records.journal import Checked, Journal, JournalEvent, read_journal
from markerseek.records.journal.entries import decode, encode
from tests.unit.records.journal.synthetic_journals import FULL_READING, HEADER, configuration

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
    for field in fields(other):
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
    row = encode(Refused(angle_deg=1.0, reason="moved", frame=frame))
    assert row.samples is not None
    for samples, found in ((None, "a frame of"), (row.samples[:-1], "a frame of"), (bytes(row.samples) + b"0", "1 by")):
        with pytest.raises(RecordError, match=f"an entry that cannot be read: {found}"):
            decode(row.kind, row.body, samples, confirmation=None)
    for here, there in ((b"<i2", b"<f2"), (b'"shape":[', b'"shape":[-')):
        if here in row.body:
            with pytest.raises(RecordError, match="an entry that cannot be read"):
                decode(row.kind, row.body.replace(here, there), row.samples, confirmation=None)


def test_arrays_of_another_kind_are_no_frame() -> None:
    with pytest.raises(ConfigError, match=r"channel frame: samples are .*int16 of shape \(channels, samples\)"):
        channel_frame(np.zeros((2, 3)))
    with pytest.raises(ConfigError, match=r"channel frame: sampling_hz is nan Hz"):
        channel_frame(COUNTS, sampling_hz=math.nan)


def channel_frame(samples: object, *, sampling_hz: float = 40e6) -> None:
    """A frame past the type check of the tests, which a driver outside of the package does not have."""
    made = object.__new__(ChannelFrame)
    for name, value in {"header": HEADER, "samples": samples, "sampling_hz": sampling_hz}.items():
        object.__setattr__(made, name, value)
    made.__post_init__()


@pytest.mark.parametrize("name", [field.name for field in fields(ScanGeometry)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_geometry_that_is_not_finite_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"scan geometry: {name}"):
        replace(GEOMETRY, **{name: value})


def test_a_step_is_positive() -> None:
    for step in (0.0, -1e-4):
        with pytest.raises(ConfigError, match="it must be positive"):
            replace(GEOMETRY, depth_step_m=step)


@given(row=st.floats(-1e3, 1e3), column=st.floats(-1e3, 1e3))
def test_position_and_pixel_are_inverse(row: float, column: float) -> None:
    lateral_m, depth_m = GEOMETRY.position_m(row=row, column=column)
    assert GEOMETRY.pixel(lateral_m=lateral_m, depth_m=depth_m) == pytest.approx((row, column), abs=1e-6)


def test_the_geometry_of_a_photoacoustic_image_is_that_of_its_axes() -> None:
    lateral_m, depth_m = np.linspace(-0.02, 0.02, 81), 0.005 + 0.1e-3 * np.arange(300)
    image = PaImage(envelope=np.zeros((300, 81), np.float32), lateral_m=lateral_m, depth_m=depth_m)
    for row, column in ((0, 0), (299, 80), (17, 42)):
        assert image.geometry.position_m(row=row, column=column) == pytest.approx((lateral_m[column], depth_m[row]))
    # Half a pixel beyond the middles of the outermost ones.
    assert image.geometry.edges_mm(300, 81) == pytest.approx((-20.25, 20.25, 34.95, 4.95))
