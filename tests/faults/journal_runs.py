"""Journals whose frames can be computed again from their number, for tests of damage and of full disks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from markerseek import rigs
from markerseek.core import (
    Asked,
    ChannelFrame,
    FrameHeader,
    Interval,
    Measured,
    Reading,
    RecordError,
    Sample,
    SearchPlan,
    Started,
)
from markerseek.records.journal import Configuration, Journal, read_journal
from markerseek.runs.journalled import configuration_of

RANGE = Interval(low_deg=-35.0, high_deg=35.0)


def configuration() -> Configuration:
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    return configuration_of(
        rig, SearchPlan(method="ternary", acquisitions=6, as_published=False, start_deg=0.0, dark_frames=0, stay=False)
    )


def measured(index: int, *, channels: int = 32) -> Measured:
    header = FrameHeader(sequence=index, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=1.0)
    counts = np.random.default_rng(index).integers(-2048, 2048, (channels, 520)).astype(np.int16)
    frame = ChannelFrame(header=header, samples=counts, sampling_hz=40e6)
    sample = Sample(angle_deg=0.0, reading=Reading(intensity=1.0), frame=frame)
    return Measured(role="search", index=index, sample=sample)


def commit(journal: Journal, index: int, *, channels: int = 32) -> None:
    """One acquisition, asked for and made."""
    journal.commit(Asked(role="search", index=index, angle_deg=0.0), clock_s=float(index))
    journal.commit(measured(index, channels=channels), clock_s=float(index))


def fill(path: Path, *, most: int = 10_000) -> int:
    """Commit frames until it fails; the number of those that were acknowledged comes back."""
    acknowledged = 0
    try:
        with Journal.create(path, configuration()) as journal:
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
            for index in range(1, most):
                commit(journal, index)
                acknowledged += 1
    except RecordError as problem:
        said = str(problem)
    else:
        said = "all of it was written"
    assert "cannot be written" in said
    assert "make room on the disk" in said
    return acknowledged


def kept(path: Path) -> list[Measured]:
    return [entry.event for entry in read_journal(path).entries if isinstance(entry.event, Measured)]


def require_all(path: Path, acknowledged: int) -> None:
    events = kept(path)
    assert len(events) >= acknowledged > 5
    for event in events:
        wanted = measured(event.index).sample.frame
        assert isinstance(wanted, ChannelFrame)
        assert isinstance(event.sample.frame, ChannelFrame)
        np.testing.assert_array_equal(event.sample.frame.samples, wanted.samples)
