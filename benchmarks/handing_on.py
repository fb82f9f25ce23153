"""How an image gets from the process that searches to the one that shows it: bytes and milliseconds of each way.

Run ``python -m benchmarks.handing_on``. The ways take turns, so that what else the computer does is in all of them. An
entry is flushed to the disk in any case; a file beside the journal and a ring in memory come on top of that.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
import zlib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from markerseek import rigs
from markerseek.core import ChannelFrame, Measured
from markerseek.records.journal import JournalEntry
from markerseek.records.journal.lines import entry_line
from markerseek.runs import ImageRing


class Way(NamedTuple):
    """A way from process to process: what each of the two does for one image, and the bytes that a disk gets for it."""

    put: Callable[[int], object]
    get: Callable[[int], object]
    disk_bytes: int


def ways(folder: Path, ends: ExitStack) -> dict[str, Way]:
    """All ways, for the same acquisition of a simulated rig."""
    rig = rigs.simulated(seed=1)
    sample = rig.scanner.measure(5.0)
    frame = sample.frame
    imaging = rig.imaging
    assert isinstance(frame, ChannelFrame)
    assert imaging is not None
    image = imaging.picture(frame)
    pixels = image.envelope.tobytes()
    entry = JournalEntry(number=1, written="", clock_s=0.0, event=Measured(role="search", index=1, sample=sample))
    line = entry_line(entry)
    flushed, both, grown = (
        ends.enter_context(tempfile.TemporaryFile(dir=folder, buffering=0))  # noqa: SIM115
        for _ in range(3)
    )
    ring = ends.enter_context(ImageRing.create())

    def journal(file: int, data: bytes, number: int) -> None:
        os.pwrite(file, data, number * len(data))
        os.fdatasync(file)

    def beside(number: int) -> None:
        zlib.crc32(image.envelope)
        os.pwrite(grown.fileno(), image.envelope, number * len(pixels))

    def read(file: int, size: int, number: int, *, stride: int) -> np.ndarray:
        data = os.pread(file, size, number * stride)
        zlib.crc32(data)
        return np.frombuffer(data, "<f4")

    # `picture` of a frame that was read last would give the image that is there already.
    other = ChannelFrame(header=frame.header, samples=frame.samples.copy(), sampling_hz=frame.sampling_hz)
    frames = (frame, other)
    return {
        "the entry with its samples, beamformed again": Way(
            lambda number: journal(flushed.fileno(), line, number),
            lambda number: imaging.picture(frames[number % 2]),
            len(line),
        ),
        "the entry with samples and image": Way(
            lambda number: journal(both.fileno(), line + pixels, number),
            lambda number: read(both.fileno(), len(pixels), number, stride=len(line) + len(pixels)),
            len(line) + len(pixels),
        ),
        "beside it: a file": Way(
            beside,
            lambda number: read(grown.fileno(), len(pixels), number, stride=len(pixels)),
            len(pixels),
        ),
        "beside it: a ring in memory": Way(
            lambda number: ring.put(number, image),
            ring.get,
            0,
        ),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    given = parser.parse_args()
    with ExitStack() as ends:
        all_ways = ways(given.folder, ends)
        spent_ms: dict[str, list[tuple[float, float]]] = {name: [] for name in all_ways}
        for number in range(given.frames + 10):
            # Another one first in each round: a flush writes what was written before it.
            for name in sorted(all_ways, key=lambda name: (list(all_ways).index(name) + number) % len(all_ways)):
                way = all_ways[name]
                began_s = time.perf_counter()
                way.put(number)
                put_s = time.perf_counter()
                way.get(number)
                spent_ms[name].append((1e3 * (put_s - began_s), 1e3 * (time.perf_counter() - put_s)))
    print(f"load average {os.getloadavg()[0]:.1f}, {given.frames} frames; median, 99 of 100")
    print("| way | bytes on the disk | written, ms | got, ms |\n|---|---|---|---|")
    for name, way in all_ways.items():
        # The first load and compile.
        columns = [sorted(each) for each in zip(*spent_ms[name][10:], strict=True)]
        said = [f"{statistics.median(each):.2f}, {each[int(0.99 * len(each))]:.2f}" for each in columns]
        print(f"| {name} | {way.disk_bytes:,} | {said[0]} | {said[1]} |")


if __name__ == "__main__":
    main()
