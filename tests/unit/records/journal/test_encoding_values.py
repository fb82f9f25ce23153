"""Values that JSON cannot hold: non-finite numbers are refused, unusual texts are escaped."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import Asked, ChannelFrame, Failed, Measured, MoveError, RecordError, Refused, Sample, Started
from markerseek.records.journal import Interrupted, Journal, JournalEvent, Resuming, decode, encode, read_journal
from tests.unit.records.journal.every_kind_of_entry import frame
from tests.unit.records.journal.synthetic_journals import EVENTS, FULL_READING, HEADER, RANGE, configuration, measured


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused_by_its_name(number: float) -> None:
    header = replace(HEADER, angle_before_deg=number)
    channels = ChannelFrame(header=header, samples=np.ones((2, 3), np.int16), sampling_hz=40e6)
    for event, name in (
        (Asked(role="search", index=1, angle_deg=number), "angle_deg"),
        (replace(EVENTS["Ambiguous"], travel_deg=number), "travel_deg"),
        (
            Measured(role="search", index=1, sample=Sample(angle_deg=0.0, reading=FULL_READING, frame=channels)),
            "before",
        ),
    ):
        with pytest.raises(RecordError, match=rf"{name}.*not finite and cannot be recorded"):
            encode(event)


def test_a_refused_frame_whose_numbers_are_why_it_was_refused_is_left_out() -> None:
    whole = frame(1)
    broken = replace(whole, header=replace(whole.header, angle_before_deg=math.nan))
    row = encode(Refused(angle_deg=1.0, reason="not finite", frame=broken))
    assert decode(row.kind, row.body, row.samples, confirmation=None) == Refused(angle_deg=1.0, reason="not finite")
    assert row.samples is None


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


def test_a_clock_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    with Journal.create(tmp_path / "run.journal", configuration()) as journal:
        with pytest.raises(RecordError, match=r"the rig's clock is .* not finite"):
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=math.nan)
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
    assert len(read_journal(tmp_path / "run.journal").entries) == 1


ODD, ESCAPED = "the stage said \udcff\ud800 \N{DEGREE SIGN}", "the stage said \\udcff\\ud800 \N{DEGREE SIGN}"


def with_text(text: str) -> list[JournalEvent]:
    return [
        Interrupted(reason=text),
        Resuming(by=text, check_deg=None, fault_reset=False, versions={text: text}),
        replace(measured(1), sample=Sample(angle_deg=0.0, reading=FULL_READING, frame=replace(frame(1), header=replace(
            HEADER, token=text)))),
    ]  # fmt: skip


def test_texts_that_are_no_unicode_are_kept_as_escapes(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration(description=ODD)) as journal:
        for event in (*with_text(ODD), Failed(error=MoveError(ODD))):
            journal.commit(event, clock_s=0.0)
    held = read_journal(path)
    *kept, failed = (entry.event for entry in held.entries)
    assert held.configuration.facts.description == ESCAPED
    assert kept == with_text(ESCAPED)
    assert isinstance(failed, Failed)
    assert str(failed.error) == ESCAPED
    assert isinstance(kept[-1], Measured)
    assert kept[-1].sample.frame is not None
    assert kept[-1].sample.frame.header.token == ESCAPED
