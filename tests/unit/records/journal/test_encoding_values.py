"""Values that JSON cannot hold: non-finite numbers are refused, unusual texts are escaped."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import Asked, ChannelFrame, Measured, RecordError, Refused, Sample
from markerseek.records.journal import Journal, decode, encode
from tests.unit.records.journal.every_kind_of_entry import frame
from tests.unit.records.journal.synthetic_journals import EVENTS, FULL_READING, HEADER, configuration


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
