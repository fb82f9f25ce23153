"""Synthetic journals for tests: events of every kind, runs of any length, a writer that was killed."""

from __future__ import annotations

import os
import signal
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from markerseek.core import (
    Ambiguous,
    Arrival,
    Asked,
    AtBound,
    ChannelFrame,
    Finished,
    Floor,
    Found,
    FrameHeader,
    Interval,
    LocalMaxima,
    Measured,
    NotFound,
    OtherSource,
    Reading,
    ReadingFrame,
    RigFacts,
    Sample,
    SearchPlan,
    Started,
    Unsure,
)
from markerseek.records.journal import Configuration, Entry, Journal, JournalEvent
from markerseek.records.journal.lines import entry_line
from tests.unit.records.changed_configuration import changed

RANGE = Interval(low_deg=-35.0, high_deg=35.0)
OTHER = OtherSource(angle_deg=-8.5, sigma_deg=0.3, relative_db=-9.0, lateral_m=2e-3, depth_m=41e-3)
FLOOR = Floor(level=3.25, source="dark frames")
HEADER = FrameHeader(
    sequence=4,
    token="permit-4",
    pulses=16,
    commanded_deg=1.1,
    started_s=0.1 + 0.2,
    ended_s=10.3,
    angle_before_deg=1.1000000000000003,
    angle_after_deg=1.1,
)
FULL_READING = Reading(
    intensity=1971.0123456789,
    lateral_m=0.018,
    depth_m=0.05,
    arrival_s=3.2e-5,
    noise_sigma=20.1,
    cells=460_000,
    coherence=0.9,
    saturated_fraction=0.0,
    dead_channels=(3, 64),
    arrivals=(
        Arrival(lateral_m=0.018, depth_m=0.05, arrival_s=3.2e-5, intensity=1971.0123456789, coherence=0.9),
        Arrival(lateral_m=-0.002, depth_m=0.04, arrival_s=2.6e-5, intensity=171.5, coherence=0.7),
    ),
    local_maxima=LocalMaxima(
        first_lateral_m=-0.025,
        first_depth_m=0.005,
        lateral_step_m=0.002,
        depth_step_m=0.002,
        columns=2,
        noise_peaks=12.5,
        intensities=struct.pack("<4f", 171.5, 0.0, 1971.0123, 64.5),
    ),
)


def configuration(**changes: object) -> Configuration:
    plain = Configuration(
        plan=SearchPlan(method="golden-section", acquisitions=10, start_deg=0.0, dark_frames=3, tolerance_mm=0.7),
        facts=RigFacts(
            kind="simulated",
            description="a test's rig",
            fingerprint="0" * 32,
            search=RANGE,
            face_radius_m=0.01,
            truth_deg=6.3,
            seed=7,
        ),
        recipe=msgspec.Raw(b"null"),
    )
    return changed(plain, **changes)


def measured(index: int, *, angle_deg: float = 1.1, counts: np.ndarray | None = None) -> Measured:
    frame: ChannelFrame | ReadingFrame
    if counts is None:
        frame = ReadingFrame(header=HEADER, intensity=1971.0123456789, noise_sigma=20.1, cells=460_000)
    else:
        frame = ChannelFrame(header=HEADER, samples=counts, sampling_hz=40e6)
    sample = Sample(angle_deg=angle_deg, reading=FULL_READING, frame=frame)
    return Measured(role="search", index=index, sample=sample)


def counts(channels: int = 8, samples: int = 64, *, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(-2048, 2048, (channels, samples)).astype(np.int16)


def whole_run(path: Path, *, acquisitions: int = 3, counts_of: Callable[[int], np.ndarray] | None = None) -> None:
    """A synthetic run with so many acquisitions."""
    with Journal.create(path, configuration()) as journal:
        write(journal, acquisitions, counts_of)


def write(journal: Journal, acquisitions: int, counts_of: Callable[[int], np.ndarray] | None = None) -> None:
    journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
    for index in range(1, acquisitions + 1):
        journal.commit(Asked(role="search", index=index, angle_deg=1.1), clock_s=float(index))
        event = measured(index, counts=None if counts_of is None else counts_of(index))
        journal.commit(event, clock_s=index + 0.5)
    answer = NotFound(mean_deg=1.0, reason="made up", floor=FLOOR)
    over = Finished(estimate=answer, confirmation=None, acquisitions=acquisitions, travel_deg=1.1, elapsed_s=9.0)
    journal.commit(over, clock_s=9.0)


EVENTS: dict[str, JournalEvent] = {
    "measured channels": measured(2, counts=counts()),
    **{
        type(estimate).__name__: Finished(
            estimate=estimate, confirmation=None, acquisitions=3, travel_deg=70.5, elapsed_s=1 / 7
        )
        for estimate in (
            Found(
                mean_deg=1.0,
                sigma_deg=0.1,
                interval95_deg=RANGE,
                interval_kind="posterior",
                floor=FLOOR,
                others=(OTHER, replace(OTHER, lateral_m=None, depth_m=None)),
                surveyed=0.995,
            ),
            NotFound(mean_deg=1.0, reason="nothing", floor=Floor(level=None, source="unknown")),
            Ambiguous(mean_deg=1.0, modes_deg=(1.0, -7.25)),
            AtBound(mean_deg=-35.0, side="low"),
            Unsure(
                mean_deg=1.0,
                sigma_deg=3.0,
                interval95_deg=RANGE,
                interval_kind="bracket",
                doubt="source",
                reason="wide",
            ),
        )
    },
}


def died(path: Path, write_to: Callable[[Journal], object]) -> None:
    """Let another process write a journal and be killed before it can close it."""
    child = os.fork()
    if child == 0:
        try:
            write_to(Journal.create(path, configuration()))
        finally:
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)


def died_in_commit(path: Path, write_to: Callable[[Journal], object]) -> None:
    """Let another process write a journal, and be killed when half of an entry is in the file."""

    def work(journal: Journal) -> None:
        write_to(journal)
        data = entry_line(Entry(number=journal._tail.entry.number + 1, written="", clock_s=9.0, event=measured(9)))
        os.pwrite(journal._descriptor, data[: len(data) // 2], journal._tail.end)

    died(path, work)
