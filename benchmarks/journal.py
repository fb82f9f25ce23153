"""What a journal costs beside the loop: one frame committed, and how much of it is the disk's own flush."""

from __future__ import annotations

import os
import tempfile
from itertools import count
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.timing import Effort, Single, alone
from markerseek import rigs
from markerseek.core import Asked, ChannelFrame, FrameHeader, Measured, Reading, Sample
from markerseek.records.journal import Journal
from markerseek.rigs.journalled import configuration_of

FRAME = "journal: a frame of 128 × 2080 committed, on the disk"
SHAPE = (128, 2080)


def measure(effort: Effort) -> tuple[list[Single], list[str]]:
    """Times of a commit in the folder for temporary files, and of a bare write with a flush of as many bytes there."""
    samples = np.random.default_rng(1).integers(-2048, 2048, SHAPE).astype(np.int16)
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    assert rig.world is not None
    checkpoint = rig.world.checkpoint()
    configuration = configuration_of(
        rig,
        method="ternary",
        acquisitions=None,
        as_published=False,
        start_deg=0.0,
        dark_frames=0,
        stay=False,
        seed=1,
    )
    numbers = count(1)
    with tempfile.TemporaryDirectory() as folder, Journal.create(Path(folder) / "journal", configuration) as journal:

        def commit() -> None:
            journal.commit(_measured(next(numbers), samples), clock_s=1.0, checkpoint=checkpoint)

        def ask() -> None:
            journal.commit(Asked(role="search", index=next(numbers), angle_deg=1.0), clock_s=1.0)

        with (Path(folder) / "bare").open("wb", buffering=0) as bare:

            def flush() -> None:
                bare.write(samples.data)
                os.fsync(bare.fileno())

            singles = [
                alone(FRAME, commit, effort=effort),
                alone("journal: a command committed, on the disk", ask, effort=effort),
                alone("  as many bytes as a frame written to a bare file and flushed", flush, effort=effort),
            ]
    body = len(msgspec.json.encode(_measured(1, samples).sample.reading))
    return singles, [f"journal: {samples.nbytes} bytes of samples, {body} of reading, {len(checkpoint)} of checkpoint"]


def _measured(index: int, samples: np.ndarray) -> Measured:
    header = FrameHeader(
        sequence=index, token=f"permit-{index}", pulses=16, commanded_deg=1.0, started_s=0.0, ended_s=10.0
    )
    frame = ChannelFrame(header=header, samples=samples, sampling_hz=40e6)
    reading = Reading(intensity=1971.0123456789, lateral_m=0.018, depth_m=0.05, arrival_s=3.2e-5, noise_sigma=20.1)
    return Measured(role="search", index=index, sample=Sample(angle_deg=1.0, reading=reading, frame=frame))
