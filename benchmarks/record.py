"""Containers for the record of a run, in turn: ``python -m benchmarks.record [--commits N] [--folder FOLDER]``.

SQLite, MCAP by its own library, and the journal are given events, a small one with a belief and a frame of 128 × 2080
counts in turn, each to be on the disk before the next (decision 53). MCAP closes a chunk for each event; otherwise its
writer keeps events in memory, and they are lost with the process.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from benchmarks import machine
from benchmarks.journal import SHAPE, begun_with, measured_event
from markerseek.core import AngleBelief, Asked, NotFound
from markerseek.records.journal import Journal, read_journal

ANGLES_DEG = tuple(each / 10 for each in range(-50, 50))
BELIEF = AngleBelief(
    estimate=NotFound(mean_deg=0.0, reason="nothing is above the noise"),
    angles_deg=ANGLES_DEG,
    density_per_deg=tuple(abs(each) / 25 for each in ANGLES_DEG),
)
BODY = msgspec.json.encode(msgspec.to_builtins(Asked(role="search", index=1, angle_deg=-12.3456789, belief=BELIEF)))


class Sqlite:
    """Rollback journal that persists, exclusive lock, one transaction an event."""

    def __init__(self, path: Path) -> None:
        self.path, self._number = path, 0
        self._connection = sqlite3.connect(path, isolation_level=None)
        for pragma in ("page_size=16384", "locking_mode=EXCLUSIVE", "journal_mode=PERSIST", "synchronous=FULL"):
            self._connection.execute(f"PRAGMA {pragma}")
        self._connection.execute("CREATE TABLE events (number INTEGER PRIMARY KEY, body TEXT, crc INTEGER, blob BLOB)")
        self._connection.execute("CREATE TABLE run (entries INTEGER, crc INTEGER)")
        self._connection.execute("INSERT INTO run VALUES (0, 0)")

    def commit(self, body: bytes, blob: memoryview | None) -> None:
        """One event, on the disk."""
        self._number += 1
        crc = zlib.crc32(blob or b"", zlib.crc32(body))
        self._connection.execute("BEGIN IMMEDIATE")
        self._connection.execute("INSERT INTO events VALUES (?, ?, ?, ?)", (self._number, body.decode(), crc, blob))
        self._connection.execute("UPDATE run SET entries = ?, crc = ?", (self._number, crc))
        self._connection.execute("COMMIT")

    def close(self) -> None:
        """Release the file."""
        self._connection.close()

    def read(self) -> int:
        """Number of events, each with its checksum compared."""
        rows = sqlite3.connect(self.path).execute("SELECT body, crc, blob FROM events ORDER BY number")
        return sum(zlib.crc32(blob or b"", zlib.crc32(body.encode())) == crc for body, crc, blob in rows)


class Mcap:
    """One closed chunk an event, with its checksum; the frame is a message of a channel of its own."""

    def __init__(self, path: Path) -> None:
        self.path, self._number = path, 0
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=1, compression=CompressionType.NONE)
        self._writer.start(library="markerseek")
        schema = self._writer.register_schema("event", "jsonschema", b'{"type":"object"}')
        self._events = self._writer.register_channel("event", "json", schema)
        self._frames = self._writer.register_channel("frame", "", 0)

    def commit(self, body: bytes, blob: memoryview | None) -> None:
        """One event, on the disk."""
        self._number += 1
        now_ns = time.time_ns()
        if blob is not None:
            self._writer.add_message(self._frames, now_ns, bytes(blob), now_ns, self._number)
        self._writer.add_message(self._events, now_ns, body, now_ns, self._number)
        self._file.flush()
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Write the summary."""
        self._writer.finish()
        self._file.close()

    def read(self) -> int:
        """Number of events; the library checks the sum of each chunk."""
        with self.path.open("rb") as file:
            messages = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
            return sum(channel.id == self._events for _, channel, _ in messages)


class Lines:
    """The journal as it is; the time of encoding the event is counted here, and not in the others."""

    def __init__(self, path: Path) -> None:
        self.path, self._number = path, 0
        self._checkpoint, configuration = begun_with()
        self._journal = Journal.create(path, configuration)

    def commit(self, _: bytes, blob: memoryview | None) -> None:
        """One event, on the disk."""
        self._number += blob is not None
        if blob is None:
            self._journal.commit(Asked(role="search", index=self._number, angle_deg=1.0, belief=BELIEF), clock_s=1.0)
        else:
            samples = np.frombuffer(blob, "<i2").reshape(SHAPE)
            self._journal.commit(measured_event(self._number, samples), clock_s=1.0, checkpoint=self._checkpoint)

    def close(self) -> None:
        """Release the file."""
        self._journal.close()

    def read(self) -> int:
        """Number of events, each with its checksum compared, and decoded."""
        return len(read_journal(self.path, frames=False).entries)


def main() -> None:
    """Measure in turn, and print one line for each container."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.record", description=__doc__)
    parser.add_argument("--commits", type=int, default=300, help="frames that are committed (default 300)")
    parser.add_argument("--folder", type=Path, help="on the disk to be measured (default: that for temporary files)")
    arguments = parser.parse_args()
    for name, value in machine.describe(cores=os.cpu_count() or 1).items():
        print(f"- {name}: {value}")
    frame = np.random.default_rng(1).integers(-2048, 2048, SHAPE).astype("<i2").data.cast("B")
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        kinds = [kind(Path(folder) / kind.__name__) for kind in (Sqlite, Mcap, Lines)]
        times: dict[tuple[str, str], list[float]] = {}
        for _ in range(arguments.commits):
            for name, blob in (("small", None), ("frame", frame)):
                for each in kinds:
                    took_ms = _took_ms(lambda each=each, blob=blob: each.commit(BODY, blob))
                    times.setdefault((type(each).__name__, name), []).append(took_ms)
        for each in kinds:
            each.close()
        print("\n| container | event | median | 99 of 100 | all within, ms | read all, ms | MB |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
        for each in kinds:
            for name in ("small", "frame"):
                found = np.array(times[type(each).__name__, name])
                shares = " | ".join(f"{value:.2f}" for value in np.quantile(found, (0.5, 0.99, 1)))
                read_ms = _took_ms(each.read)
                assert each.read() == 2 * arguments.commits
                size = each.path.stat().st_size / 1e6
                print(f"| {type(each).__name__} | {name} | {shares} | {read_ms:.0f} | {size:.1f} |")


def _took_ms(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began)


if __name__ == "__main__":
    main()
