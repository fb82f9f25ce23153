"""Journals for tests: a run with every kind of entry, as ``tests/data/format-2.journal``; runs of any length."""

from __future__ import annotations

import os
import signal
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from markerseek import rigs
from markerseek.acoustics import Probe
from markerseek.core import (
    Ambiguous,
    Arrival,
    Asked,
    AtBound,
    ChannelFrame,
    Failed,
    Finished,
    Floor,
    Found,
    FrameHeader,
    Interval,
    LinearArray,
    LocalMaxima,
    Measured,
    MoveError,
    NotFound,
    OtherSource,
    Reading,
    ReadingFrame,
    Refused,
    RigFacts,
    Sample,
    SearchPlan,
    Started,
    Turning,
    Unsure,
)
from markerseek.records.journal import (
    Checked,
    Configuration,
    Interrupted,
    Journal,
    JournalEntry,
    JournalEvent,
    Resuming,
    encode_entry,
)
from markerseek.records.journal.entries import StoredEntry
from markerseek.records.journal.lines import entry_line
from markerseek.rigs import Rig
from markerseek.sim import ReceiverSettings, SimulatedSettings


def changed(configuration: Configuration, **changes: Any) -> Configuration:
    """With other values of its plan, its facts, or its own fields, by their names."""
    plan = {
        field.name: changes.pop(field.name) for field in msgspec.structs.fields(SearchPlan) if field.name in changes
    }
    facts = {field.name: changes.pop(field.name) for field in msgspec.structs.fields(RigFacts) if field.name in changes}
    return msgspec.structs.replace(
        configuration,
        plan=msgspec.structs.replace(configuration.plan, **plan),
        facts=msgspec.structs.replace(configuration.facts, **facts),
        **changes,
    )


RANGE = Interval(low_deg=-35.0, high_deg=35.0)
OTHER = OtherSource(angle_deg=-8.5, sigma_deg=0.3, relative_db=-9.0, lateral_m=2e-3, depth_m=41e-3)
FLOOR = Floor(level=3.25, source="dark frames")
READING = Reading(
    intensity=1971.0123456789,
    lateral_m=0.018,
    depth_m=0.05,
    arrival_s=3.2e-5,
    centroid_s=3.3e-5,
    spread_s=4e-7,
    noise_sigma=20.1,
    cells=460_000,
    coherence=0.9,
    saturated_fraction=0.0,
    dead_channels=(1, 3),
)


def header(sequence: int, *, pulses: int = 16) -> FrameHeader:
    return FrameHeader(
        sequence=sequence,
        token=f"permit-{sequence}",
        pulses=pulses,
        commanded_deg=0.1 * sequence,
        started_s=0.1 + 0.2,
        ended_s=10.0 + sequence,
        angle_before_deg=1.1000000000000003,
        angle_after_deg=-1.1,
    )


HEADER = replace(header(4), commanded_deg=1.1, ended_s=10.3, angle_after_deg=1.1)
FULL_READING = replace(
    READING,
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


def died_in_commit(path: Path, write_to: Callable[[Journal], object]) -> None:
    """Let another process write a journal, and be killed when half of an entry is in the file."""
    child = os.fork()
    if child == 0:
        try:
            journal = Journal.create(path, configuration())
            write_to(journal)
            data = entry_line(JournalEntry(number=journal._last.number + 1, written="", clock_s=9.0, event=measured(9)))
            os.pwrite(journal._lines._descriptor, data[: len(data) // 2], journal._lines.end)
            os.kill(os.getpid(), signal.SIGKILL)
        finally:
            # Only an error comes here.
            os._exit(1)
    assert os.WIFSIGNALED(os.waitpid(child, 0)[1])


METHOD = "ternary"
SEED = 13
MARKER_DEG = 6.3
VERSIONS = {"markerseek": "0.0.0", "python": "3.11.7", "numpy": "2.0.0", "scipy": "1.13.0", "machine": "x86_64"}


def rig() -> Rig:
    """A simulated rig, whose recipe the journal holds."""
    settings = SimulatedSettings(
        probe=Probe(array=LinearArray(elements=32, pitch_m=0.43e-3)), receiver=ReceiverSettings(samples=2080)
    )
    return rigs.simulated(seed=SEED, settings=settings, marker_deg=MARKER_DEG)


def journal_events() -> list[JournalEvent]:
    """What happened, in order; entry n was committed at 0.1 n seconds."""
    events: list[JournalEvent] = [
        Started(start_deg=-0.1, limits=Interval(low_deg=-35.0, high_deg=35.0)),
        Asked(role="dark", index=1, angle_deg=-0.1),
        Measured(role="dark", index=1, sample=sample(1, angle_deg=-0.1, pulses=0)),
        Asked(role="search", index=1, angle_deg=1 / 3),
        REFUSED,
        Measured(role="search", index=1, sample=sample(3, angle_deg=0.3334)),
        Asked(role="search", index=2, angle_deg=7.25),
        Turning(target_deg=7.25, angle_deg=5.5),
        Failed(error=MoveError("the stage did not arrive at 7.25°")),
        resuming(fault_reset=True),
        Checked(reading=READING, difference=None),
        Checked(reading=READING, difference=None, frame=frame(5)),
        Measured(role="search", index=2, sample=sample(6, angle_deg=7.25)),
        Asked(role="search", index=3, angle_deg=6.5),
        Turning(target_deg=6.5, angle_deg=None),
        Interrupted(reason="SIGTERM"),
        resuming(fault_reset=False),
        Checked(reading=Reading(intensity=1.5), difference=None),
        Measured(role="search", index=3, sample=reading_sample(8, angle_deg=6.5)),
        Asked(role="confirmation", index=1, angle_deg=6.25),
        Measured(role="confirmation", index=1, sample=sample(9, angle_deg=6.251)),
    ]
    return [*events, finished()]


def resuming(*, fault_reset: bool) -> Resuming:
    return Resuming(by="a person", check_deg=1 / 3, fault_reset=fault_reset, versions=VERSIONS)


def finished() -> Finished:
    answer = Found(
        mean_deg=6.25,
        sigma_deg=0.125,
        interval95_deg=Interval(low_deg=6.0, high_deg=6.5),
        interval_kind="bracket",
        floor=Floor(level=3.5, source="dark frames"),
    )
    over = sample(9, angle_deg=6.251)
    return Finished(estimate=answer, confirmation=over, acquisitions=3, travel_deg=14.7, elapsed_s=1 / 7)


def frame(sequence: int, *, pulses: int = 16) -> ChannelFrame:
    """Four channels of 16 counts, with the least and the greatest."""
    counts = (np.arange(64, dtype=np.int64).reshape(4, 16) * 1031 * sequence % 65536 - 32768).astype(np.int16)
    counts[0, :2] = -32768, 32767
    return ChannelFrame(header=header(sequence, pulses=pulses), samples=counts, sampling_hz=40e6)


def sample(sequence: int, *, angle_deg: float, pulses: int = 16) -> Sample:
    kept = frame(sequence, pulses=pulses)
    return Sample(angle_deg=angle_deg, reading=READING, dark=pulses == 0, frame=kept)


def reading_sample(sequence: int, *, angle_deg: float) -> Sample:
    kept = ReadingFrame(header=header(sequence), intensity=1.5, noise_sigma=0.25, cells=77)
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=1.5), frame=kept)


REFUSED = Refused(angle_deg=1 / 3, reason='channel 7 says "nothing", 5 % off', frame=frame(2))


def stored(event: JournalEvent) -> tuple[StoredEntry, bytes | memoryview]:
    """The event as the first entry of a journal."""
    return encode_entry(JournalEntry(number=1, written="", clock_s=0.0, event=event))
