"""Time from the death of the real command to DISARM at the laser: ``python -m tests.faults.laser_off --kills 100``.

``markerseek emulate bench`` runs in one process and ``markerseek search --rig RIG --arm`` in another one, started again
for each kill. Between its supervisor and the emulated laser box lies a pseudo-terminal of this program, which passes
the bytes on and notes when DISARM comes. The search is killed (or stopped) at a random moment of a train of pulses.

Two times are noted: when the supervisor has written DISARM (inotify reports a write, to a thread that does nothing
else), and when it came out at the other end. Between them lies the pseudo-terminal: a thread of the kernel without
priority passes its bytes on, and who polls the other end waits for that thread. A real port has an interrupt there.

Promised (P2): 10 ms after a kill in 99 of 100 on a quiet computer, and always the lease and 10 ms.
"""

# ruff: noqa: T201 - a program, which prints

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import random
import select
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.emulated import emulation, markerseek

LEASE_S = 0.1
PROMISED_S = 0.01
DARK_FRAMES = 3
"""Firings without light that every search begins with."""

BUSY = "while True: pass"


@dataclass(kw_only=True)
class Relay:
    """Passes bytes between the search's laser port and the emulated box, and notes what the search's side says."""

    box: int
    far: int
    received: bytes = b""
    fired: int = 0
    disarmed_s: float | None = None

    def once(self, wait_s: float) -> None:
        for fd in select.select([self.far, self.box], [], [], wait_s)[0]:
            data = os.read(fd, 4096)
            now_s = time.monotonic()
            os.write(self.far if fd == self.box else self.box, data)
            if fd == self.far:
                *lines, self.received = (self.received + data).split(b"\n")
                self.fired += sum(line.startswith(b"FIRE") for line in lines)
                if self.disarmed_s is None and any(line.startswith(b"DISARM") for line in lines):
                    self.disarmed_s = now_s


@dataclass(kw_only=True)
class Writes:
    """When the search's side last wrote to the port until `frozen`; a thread of its own notes it."""

    notices: int
    last_s: float = 0.0
    frozen: bool = False

    def watch(self) -> None:
        _hasten()
        with contextlib.suppress(OSError):
            while os.read(self.notices, 4096):
                if not self.frozen:
                    self.last_s = time.monotonic()


@dataclass(frozen=True, kw_only=True)
class Blow:
    """One kill: seconds until DISARM is written, and received; the search's threads and memory, and the load before."""

    written_after_s: float
    after_s: float
    threads: int
    resident_mb: float
    load: float


@dataclass(kw_only=True)
class Bench:
    """The emulated devices of a folder, and a relay on the laser's line."""

    folder: Path
    relay: Relay
    writes: Writes
    rig: Path
    searches: int = 0

    def blow(self, chance: random.Random, how: signal.Signals) -> Blow | None:
        """Start a search, strike it in a lit train, and wait for DISARM; None if it ended by itself."""
        self.searches += 1
        load = os.getloadavg()[0]
        journal = self.folder / f"{self.searches}.journal"
        with (self.folder / "search.txt").open("wb") as said:
            search = subprocess.Popen(
                markerseek("search", "--rig", self.rig, "--arm", "--journal", journal), stdout=said, stderr=said
            )
        relay = self.relay
        try:
            wanted = relay.fired + DARK_FRAMES + chance.randint(1, 3)
            while relay.fired < wanted:
                relay.once(0.1)
                if search.poll() is not None:
                    sys.stderr.write(f"not struck: {(self.folder / 'search.txt').read_text()}\n")
                    return None
            strike_s = time.monotonic() + chance.uniform(0.01, 0.13)
            while (left_s := strike_s - time.monotonic()) > 0:
                relay.once(left_s)
            threads, resident_mb = _size(search.pid)
            relay.disarmed_s = None
            self.writes.frozen = False
            began_s = time.monotonic()
            search.send_signal(how)
            while relay.disarmed_s is None and time.monotonic() < began_s + 10:
                relay.once(0.1)
            self.writes.frozen = True
            after_s = 10.0 if relay.disarmed_s is None else relay.disarmed_s - began_s
        finally:
            search.kill()
            search.wait()
        # The last write is DISARM: a dead search writes nothing, and the supervisor nothing more to the laser.
        written_s = self.writes.last_s
        written_after_s = written_s - began_s if written_s >= began_s else after_s
        return Blow(
            written_after_s=written_after_s, after_s=after_s, threads=threads, resident_mb=resident_mb, load=load
        )


def _hasten() -> None:
    """Give this thread priority, where the user may: the clock of this measurement must not wait for a turn either."""
    with contextlib.suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(2))


def _size(pid: int) -> tuple[int, float]:
    """Threads and resident memory of a process; zeros where the system does not report them."""
    try:
        status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    except OSError:
        return 0, 0.0
    return int(status["Threads"]), int(status["VmRSS"].split()[0]) / 1000


def _watch_writes(path: str) -> int:
    """A file that can be read when something has been written to another one (inotify(7), IN_MODIFY)."""
    libc = ctypes.CDLL(None, use_errno=True)
    watch = int(libc.inotify_init1(os.O_CLOEXEC))
    if watch < 0 or libc.inotify_add_watch(watch, path.encode(), 0x2) < 0:
        raise OSError(ctypes.get_errno(), f"{path} cannot be watched")
    return watch


@contextlib.contextmanager
def bench(folder: Path, *, lease_s: float) -> Iterator[Bench]:
    """Emulated devices, with the relay in the laser's line."""
    far, near = os.openpty()
    tty.setraw(near)
    try:
        with emulation(folder) as devices:
            described = devices.rig.read_text()
            laser = described[described.index("[laser]") :]
            port = laser[laser.index("port = ") :].split('"')[1]
            rig = devices.folder / "relayed.toml"
            described = described.replace(port, os.ttyname(near))
            rig.write_text(described.replace("lease_s = 1.0", f"lease_s = {lease_s}"))
            box = os.open(port, os.O_RDWR | os.O_NOCTTY)
            tty.setraw(box)
            writes = Writes(notices=_watch_writes(os.ttyname(near)))
            # Not joined: it waits for the next write until the program ends.
            threading.Thread(target=writes.watch, daemon=True).start()
            yield Bench(folder=folder, relay=Relay(box=box, far=far), writes=writes, rig=rig)
            os.close(box)
    finally:
        os.close(far)
        os.close(near)


def measure(*, kills: int, seed: int, how: signal.Signals, busy: int, lease_s: float = LEASE_S) -> list[Blow]:
    """Strike so many searches, with so many programs that only compute beside them."""
    chance = random.Random(seed)
    hogs = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(busy)]
    try:
        with tempfile.TemporaryDirectory(prefix="laser-off-") as name, bench(Path(name), lease_s=lease_s) as devices:
            blows: list[Blow] = []
            while len(blows) < kills and devices.searches < 3 * kills:
                blow = devices.blow(chance, how)
                blows += [] if blow is None else [blow]
            return blows
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def report(what: str, blows: list[Blow]) -> str:
    """One line of a table."""
    written_ms = sorted(1e3 * blow.written_after_s for blow in blows)
    took_ms = sorted(1e3 * blow.after_s for blow in blows)
    late = sum(value > 1e3 * (LEASE_S + PROMISED_S) for value in took_ms)
    return (
        f"| {what} | {len(blows)} | {_spread(written_ms)} | {_spread(took_ms)} | {late} | "
        f"{statistics.median(blow.load for blow in blows):.1f} | {max(blow.threads for blow in blows)} | "
        f"{max(blow.resident_mb for blow in blows):.0f} |"
    )


def _spread(times_ms: list[float]) -> str:
    soon = sum(value <= 1e3 * PROMISED_S for value in times_ms)
    longest = ", ".join(f"{value:.1f}" for value in times_ms[-3:])
    return f"{statistics.median(times_ms):.2f} ({longest}) | {soon}"


HEAD = (
    "| struck | times | DISARM written after ms: median (three longest) | within 10 ms | received after ms | "
    "within 10 ms | later than lease + 10 ms | load before | threads | MB |\n|---|---|---|---|---|---|---|---|---|---|"
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=["quiet", "busy", "stopped"])
    words = parser.parse_args()
    _hasten()
    cores = os.cpu_count() or 1
    print(HEAD, flush=True)
    for name, what, how, busy in (
        ("quiet", "SIGKILL", signal.SIGKILL, 0),
        ("busy", f"SIGKILL, {cores} programs computing beside it", signal.SIGKILL, cores),
        ("stopped", "SIGSTOP", signal.SIGSTOP, 0),
    ):
        if words.only in (None, name):
            print(report(what, measure(kills=words.kills, seed=words.seed, how=how, busy=busy)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
