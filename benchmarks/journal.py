"""What a journal costs beside the loop: ``python -m benchmarks.journal [--commits N] [--folder FOLDER]``.

Frames are committed one after the other, as in one long run, each with the command before it; how much of that is the
disk's own flush is told by a bare write of as many bytes. What waits for a commit is a rig that is armed, so that the
slowest ones count, and not the median alone.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from benchmarks import machine
from benchmarks.timing import QUICK, Effort, Single
from markerseek import rigs
from markerseek.core import Asked, ChannelFrame, FrameHeader, Measured, Reading, Sample, SearchPlan
from markerseek.records.journal import Configuration, Journal, read_journal, size_bytes_of
from markerseek.runs.journalled import configuration_of

FRAME = "journal: a frame of 128 × 2080 committed, on the disk"
COMMAND = "journal: a command committed, on the disk"
BARE = "  as many bytes as a frame written to a bare file and flushed"
SHAPE = (128, 2080)
TARGET_MS = 5.0
COMMITS = 300


def main() -> None:
    """Measure, and print one line for each kind of commit."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.journal", description=__doc__)
    parser.add_argument("--commits", type=int, default=COMMITS, help=f"frames that are committed (default {COMMITS})")
    parser.add_argument("--folder", type=Path, help="on the disk to be measured (default: that for temporary files)")
    arguments = parser.parse_args()
    for name, value in machine.describe(cores=os.cpu_count() or 1).items():
        print(f"- {name}: {value}")
    times, remarks = commit_many(arguments.commits, folder=arguments.folder)
    for each in times:
        print(f"- {each.in_words()}")
    for remark in remarks:
        print(f"- {remark}")


def measure(effort: Effort) -> tuple[list[Single], list[str]]:
    """Times of commits in the folder for temporary files, and of a bare write with a flush of as many bytes there."""
    times, remarks = commit_many(100 if effort is QUICK else COMMITS, folder=None)
    return [each.single() for each in times], [*remarks, *(each.in_words() for each in times)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Times:
    """Times of one kind of work in milliseconds, in order: on the clock, and of the processor."""

    work: str
    clock_ms: tuple[float, ...]
    processor_ms: tuple[float, ...]

    def share_ms(self, share: float) -> float:
        """Time on the clock that so large a share of them keeps to."""
        ordered = sorted(self.clock_ms)
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]

    def in_words(self) -> str:
        """Median, 99 of 100, and the largest."""
        found = {"median": self.share_ms(0.5), "99 of 100": self.share_ms(0.99), "all": self.share_ms(1.0)}
        told = ", ".join(f"{name} {'in' if name == 'median' else 'within'} {ms:.2f} ms" for name, ms in found.items())
        late = sum(ms > TARGET_MS for ms in self.clock_ms)
        return f"{self.work.strip()}: {told}; {late} of {len(self.clock_ms)} took more than {TARGET_MS:g} ms"

    def single(self) -> Single:
        """The same for the table of all benchmarks."""
        return Single(
            work=self.work,
            ms=self.share_ms(0.5),
            least_ms=min(self.clock_ms),
            most_ms=max(self.clock_ms),
            processor_ms=float(np.median(self.processor_ms)),
            rounds=len(self.clock_ms),
        )


def commit_many(commits: int, *, folder: Path | None) -> tuple[list[Times], list[str]]:
    """Times of commits of frames, of commands, and of bare writes, and what else there is to say of them."""
    samples = np.random.default_rng(1).integers(-2048, 2048, SHAPE).astype(np.int16)
    configuration = begun_with()
    spans: dict[str, list[tuple[float, float]]] = {FRAME: [], COMMAND: [], BARE: []}
    with tempfile.TemporaryDirectory(dir=folder) as name:
        path = Path(name) / "journal"
        journal = Journal.create(path, configuration)
        with (Path(name) / "bare").open("wb", buffering=0) as bare:
            for index in range(1, commits + 1):
                asked = Asked(role="search", index=index, angle_deg=1.0)
                measured = measured_event(index, samples)
                spans[COMMAND].append(_once_ms(lambda event=asked: journal.commit(event, clock_s=1.0)))
                spans[FRAME].append(_once_ms(lambda event=measured: journal.commit(event, clock_s=1.0)))
                spans[BARE].append(_once_ms(lambda: (bare.write(samples.data), os.fsync(bare.fileno()))))
        journal.close()
        file_mb = size_bytes_of(path) / 1e6
        reading_ms, _ = _once_ms(lambda: read_journal(path, frames=False))
    body = len(msgspec.json.encode(measured_event(1, samples).sample.reading))
    held = f"{samples.nbytes} bytes of samples, {body} of reading"
    end = f"read and checked within {reading_ms:.0f} ms"
    remarks = [f"journal: {held}", f"journal: {file_mb:.0f} MB after {commits} frames, {end}"]
    return [Times(work=work, clock_ms=clock, processor_ms=busy) for work, (clock, busy) in _columns(spans)], remarks


def _columns(spans: dict[str, list[tuple[float, float]]]) -> list[tuple[str, tuple[tuple[float, ...], ...]]]:
    return [(work, tuple(zip(*found, strict=True))) for work, found in spans.items()]


def _once_ms(work: Callable[[], object]) -> tuple[float, float]:
    clock = time.perf_counter()
    processor = time.process_time()
    work()
    return 1e3 * (time.perf_counter() - clock), 1e3 * (time.process_time() - processor)


def begun_with() -> Configuration:
    """Configuration of a search."""
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    return configuration_of(
        rig,
        SearchPlan(method="ternary", acquisitions=None, as_published=False, start_deg=0.0, dark_frames=0, stay=False),
    )


def measured_event(index: int, samples: np.ndarray) -> Measured:
    """An acquisition with a frame."""
    header = FrameHeader(
        sequence=index, token=f"permit-{index}", pulses=16, commanded_deg=1.0, started_s=0.0, ended_s=10.0
    )
    frame = ChannelFrame(header=header, samples=samples, sampling_hz=40e6)
    reading = Reading(intensity=1971.0123456789, lateral_m=0.018, depth_m=0.05, arrival_s=3.2e-5, noise_sigma=20.1)
    return Measured(role="search", index=index, sample=Sample(angle_deg=1.0, reading=reading, frame=frame))


if __name__ == "__main__":
    main()
