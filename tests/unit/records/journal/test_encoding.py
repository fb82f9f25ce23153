"""Journal entries as bytes: they come back equal; non-finite numbers are refused, unusual texts are escaped."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import Asked, ChannelFrame, Measured, RecordError, Refused, Sample
from markerseek.records.journal import Journal, JournalEvent, decode_entry, read_journal
from markerseek.records.journal.entries import StoredEntry
from tests.unit.records.journal.synthetic_journals import (
    EVENTS,
    FULL_READING,
    HEADER,
    configuration,
    counts,
    frame,
    stored,
    whole_run,
)


@pytest.mark.parametrize("event", EVENTS.values(), ids=EVENTS.keys())
def test_answers_and_frames_are_read_back_equal(event: JournalEvent, tmp_path: Path) -> None:
    """Every other kind of event: `test_lines`."""
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(event, clock_s=0.1 + 0.2)
    (entry,) = read_journal(path).entries
    assert entry.event == event
    assert (entry.number, entry.clock_s) == (1, 0.1 + 0.2)
    if isinstance(event, Measured):
        assert isinstance(entry.event, Measured)
        frame = entry.event.sample.frame
        written = event.sample.frame
        assert isinstance(frame, ChannelFrame)
        assert isinstance(written, ChannelFrame)
        assert (frame.header, frame.sampling_hz, frame.samples.dtype) == (HEADER, 40e6, np.int16)
        np.testing.assert_array_equal(frame.samples, written.samples)


def test_samples_lie_in_the_file_as_little_endian_integers_that_any_program_can_read(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    samples = counts(3, 5)
    whole_run(path, acquisitions=1, counts_of=lambda _: samples)
    # As any program reads it: a line, and behind it the bytes that it announces.
    found = next(each for each in path.read_bytes().splitlines(keepends=True) if b'"kind":"measured"' in each)
    at = path.read_bytes().index(found) + len(found)
    held = msgspec.json.decode(found)
    blob = path.read_bytes()[at : at + held["block"]]
    body = msgspec.json.encode(held["body"])
    assert msgspec.json.decode(body)["sample"]["frame"]["samples"] == {"dtype": "<i2", "shape": [3, 5]}
    values = [int.from_bytes(blob[2 * k : 2 * k + 2], "little", signed=True) for k in range(15)]
    assert values == samples.ravel().tolist()


@given(st.binary(max_size=400))
def test_any_bytes_are_a_row_or_a_record_error(body: bytes) -> None:
    for kind in ("started", "asked", "measured", "refused", "finished", "failed", "resuming", "checked", "other"):
        try:
            event = decode_entry(StoredEntry(kind=kind, body=msgspec.Raw(body)), b"", confirmation=None)
        except RecordError:
            continue
        assert stored(event)[0].kind == kind


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused_by_its_name(number: float) -> None:
    header = structs.replace(HEADER, angle_before_deg=number)
    channels = ChannelFrame(header=header, samples=np.ones((2, 3), np.int16), sampling_hz=40e6)
    for event, name in (
        (Asked(role="search", index=1, angle_deg=number), "angle_deg"),
        (structs.replace(EVENTS["Ambiguous"], travel_deg=number), "travel_deg"),
        (
            Measured(role="search", index=1, sample=Sample(angle_deg=0.0, reading=FULL_READING, frame=channels)),
            "before",
        ),
    ):
        with pytest.raises(RecordError, match=rf"{name}.*not finite and cannot be recorded"):
            stored(event)


def test_a_refused_frame_whose_numbers_are_why_it_was_refused_is_left_out() -> None:
    whole = frame(1)
    broken = structs.replace(whole, header=structs.replace(whole.header, angle_before_deg=math.nan))
    line, samples = stored(Refused(angle_deg=1.0, reason="not finite", frame=broken))
    assert decode_entry(line, samples, confirmation=None) == Refused(angle_deg=1.0, reason="not finite")
    assert samples == b""


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"face_radius_m": math.nan}, "not finite"), ({"versions": {"numpy": 2}}, "cannot be recorded: .*versions")],
)
def test_a_configuration_that_could_not_be_read_again_is_refused_and_no_file_is_left(
    changes: dict[str, object], said: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordError, match=said):
        Journal.create(tmp_path / "run.journal", configuration(**changes))
    assert list(tmp_path.iterdir()) == []
