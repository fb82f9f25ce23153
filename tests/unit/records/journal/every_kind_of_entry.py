"""A run with every kind of journal entry, stored in ``tests/data/format-2.journal``."""

from __future__ import annotations

import numpy as np

from markerseek import rigs
from markerseek.acoustics import Probe
from markerseek.core import (
    Asked,
    ChannelFrame,
    Failed,
    Finished,
    Floor,
    Found,
    FrameHeader,
    Interval,
    LinearArray,
    Measured,
    MoveError,
    Reading,
    ReadingFrame,
    Refused,
    Sample,
    Started,
    Turning,
)
from markerseek.records.journal import Checked, Interrupted, JournalEvent, Resuming
from markerseek.rigs import Rig
from markerseek.sim import ReceiverSettings, SimulatedSettings

METHOD, SEED, MARKER_DEG = "ternary", 13, 6.3
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
