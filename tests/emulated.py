"""Emulated devices in a process of their own, as ``markerseek emulate`` starts them."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markerseek.records.journal import read_journal

WORLD = """kind = "simulated"
[marker]
angle_deg = 6.4
[stage]
speed_deg_s = 25.0
acceleration_deg_s2 = 25.0
"""
"""A marker, and a stage as fast as it can be; all else as usual."""


def markerseek(*words: object, before: str = "") -> list[str]:
    """The command in a new interpreter; ``before``: Python that runs first."""
    # -P: a file in the current folder must not replace a module.
    return [sys.executable, "-P", "-c", f"{before}\nfrom markerseek.cli import main\nmain()", *map(str, words)]


def ran(*words: object, before: str = "", **options: Any) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, to its end; ``options``: of `subprocess.run`."""
    return subprocess.run(markerseek(*words, before=before), capture_output=True, text=True, check=False, **options)


@dataclass(frozen=True, kw_only=True)
class Emulation:
    """Emulated devices that run."""

    process: subprocess.Popen[str]
    folder: Path
    said: str
    """What the command has printed before they were ready."""

    @property
    def rig(self) -> Path:
        """Rig file of the devices."""
        return self.folder / "rig.toml"

    def ended(self, number: signal.Signals = signal.SIGINT) -> str:
        """End them; what they print then comes back."""
        self.process.send_signal(number)
        _, printed = self.process.communicate(timeout=60)
        assert self.process.returncode == 0, printed
        return printed

    def end(self) -> tuple[float, float, int]:
        """End a bench; the truth comes back: lowest and highest angle of the probe in degrees, and pulses of light."""
        printed = self.ended()
        low, high = re.findall(r"probe was between (\S+) and (\S+) deg", printed)[0]
        return float(low), float(high), int(re.findall(r"(\d+) pulses of light", printed)[0])


@contextmanager
def emulation(
    folder: Path,
    *options: object,
    seed: int = 1,
    pace: float = 0.01,
    text: str = WORLD,
    before: str = "",
) -> Iterator[Emulation]:
    """Emulated devices in ``folder / "bench"``, in a world with one marker; killed at the end if they still run.

    ``before``: Python that runs in their process first.
    """
    world = folder / "world.toml"
    bench = folder / "bench"
    world.write_text(text)
    process = subprocess.Popen(
        markerseek(
            "emulate", "bench", "--dir", bench, "--rig", world, "--seed", seed, "--pace", pace, *options, before=before
        ),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        said = ""
        while "Ctrl-C ends it" not in said:
            line = process.stdout.readline()
            assert line, f"the devices did not start: {said}{process.communicate()[1]}"
            said += line
        yield Emulation(process=process, folder=bench, said=said)
    finally:
        process.kill()
        process.communicate()


@contextmanager
def fixed_bench(folder: Path, *, seed: int) -> Iterator[Emulation]:
    """A bench with as many pulses in each frame: else energy and noise would differ from those of a simulated rig."""
    with emulation(folder, seed=seed) as devices:
        devices.rig.write_text(devices.rig.read_text().replace('frames = "triggered"', 'frames = "fixed"'))
        yield devices


def exit_code_of(process: subprocess.Popen[bytes]) -> int:
    """Exit code of a process once it has ended; it is killed after two minutes."""
    try:
        return process.wait(timeout=120)
    finally:
        process.kill()


def last_event(journal: Path) -> object:
    """The last event of a record."""
    return read_journal(journal).entries[-1].event
