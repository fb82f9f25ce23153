"""A search on emulated devices, sent a signal in each phase: laser off, stage in limits, journal whole.

The devices' truth is in this process, the search in another. ``python -m tests.faults.test_signals 20`` sends each
signal in each phase 20 times, on a quiet machine, and prints the times to the last pulse and to rest.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from markerseek.cli.emulate import _rig_toml
from markerseek.core import RecordError
from markerseek.drivers import SystemClock
from markerseek.emulators import EmulatedBench, serve_bench
from markerseek.records.journal import RecordedRun, is_journal, read_journal
from markerseek.sim import LaserSettings, MarkerSettings, ReceiverSettings, SimulatedSettings, StageMotion
from tests.faults import laser_off

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL", "SIGSTOP")
PHASES = ("idle", "moving", "firing", "acquiring")
PULSES = 16
WAIT_S = 60.0
ATTEMPTS = 5
STILL_S = 1.5
"""Time after which everything must have come to rest: far sooner than the pulses or the move would end."""


def settings_for(phase: str) -> SimulatedSettings:
    """Devices that take their time in that phase, and are fast in all others."""
    return SimulatedSettings(
        marker=MarkerSettings(angle_deg=6.4),
        laser=LaserSettings(pulses=PULSES, rate_hz=10.0 if phase == "firing" else 100.0),
        receiver=ReceiverSettings(readout_s=2.0 if phase == "acquiring" else 0.2),
        stage=StageMotion(speed_deg_s=10.0, acceleration_deg_s2=25.0),
        start_deg=-30.0,
    )


SEARCH = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--arm", "--json")


class HeldUpError(Exception):
    """The search ended before it was struck: a busy computer held it up for longer than the lease."""


@dataclass(frozen=True, kw_only=True)
class Struck:
    """Result of a signal: seconds to the last pulse and until the motor stood, both 0 if there was none."""

    code: int | None
    last_pulse_s: float
    moved_s: float
    pulses: int
    rested: bool
    range_deg: tuple[float, float]
    entries: int
    last_entry: str


def strike(folder: Path, phase: str, number: signal.Signals) -> Struck:
    """Search, strike in that phase, and look at the truth; again if the computer held the search up."""
    for attempt in itertools.count(1):
        place = folder / str(attempt)
        place.mkdir()
        try:
            return strike_once(place, phase, number)
        except HeldUpError as held_up:
            if not any(said in str(held_up) for said in ("lease", "no answer")):
                raise
            if attempt == ATTEMPTS:
                pytest.skip(f"the computer is too busy for leases of 0.1 s: {held_up}")
    raise AssertionError


def strike_once(folder: Path, phase: str, number: signal.Signals) -> Struck:
    """Search, strike in that phase, and look at the truth."""
    settings = settings_for(phase)
    bench = EmulatedBench(settings=settings, rng=np.random.default_rng(3), folder=folder / "daq")
    clock = SystemClock()
    over = threading.Event()
    journal = folder / "run.journal"
    described = _rig_toml(folder, settings, pace=1.0, emulated=bench).replace("triggered", "fixed")
    # the lease of a real rig, by which everything must have come to rest
    (folder / "rig.toml").write_text(described.replace("lease_s = 1.0", "lease_s = 0.1"))
    with ExitStack() as opened:
        lines = [
            opened.enter_context(bench.line("stage", clock=clock, link=folder / "stage")),
            opened.enter_context(bench.line("laser", clock=clock, link=folder / "laser")),
        ]
        serving = threading.Thread(
            target=serve_bench,
            kwargs={"lines": lines, "clock": clock, "pace": 1.0, "daq": bench.daq, "until": over.is_set},
        )
        serving.start()
        search = subprocess.Popen(
            [sys.executable, "-c", "from markerseek.cli import main; main()", "search",
             "--rig", str(folder / "rig.toml"), "--journal", str(journal), *SEARCH],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        try:
            _wait(_now_in(phase, bench, journal), search)
            before = len(bench.laser_box.pulses)
            struck_s = time.monotonic()
            search.send_signal(number)
            moved_s = 0.0
            last_s = 0.0
            while (gone_s := time.monotonic() - struck_s) < STILL_S:
                if bench.stage.moving:
                    moved_s = gone_s
                if len(bench.laser_box.pulses) > before:
                    before = len(bench.laser_box.pulses)
                    last_s = gone_s
                time.sleep(1e-3)
            rested = not bench.stage.moving and not bench.laser_box.permitted
            if number is signal.SIGSTOP:
                search.kill()
            search.communicate(timeout=WAIT_S)
        finally:
            search.kill()
            search.wait()
            over.set()
            serving.join()
    held = _held(journal)
    return Struck(
        code=search.returncode,
        last_pulse_s=last_s,
        moved_s=moved_s,
        pulses=before,
        rested=rested,
        range_deg=bench.stage.truth_range_deg,
        entries=0 if held is None else len(held.entries),
        last_entry="none" if held is None or not held.entries else type(held.entries[-1].event).__name__,
    )


def _held(journal: Path) -> RecordedRun | None:
    """What the journal holds; None where the run was struck before it had begun."""
    try:
        return read_journal(journal)
    except RecordError as error:
        if "its run was never begun" in str(error) or "there is no such journal" in str(error):
            return None
        raise


def _now_in(phase: str, bench: EmulatedBench, journal: Path) -> Callable[[], bool]:
    """Whether the search is in that phase, by the truth of its devices."""
    return {
        "idle": lambda: journal.exists() and is_journal(journal),
        "moving": lambda: bench.stage.moving and len(bench.laser_box.pulses) > 0,
        "firing": lambda: bench.laser_box.permitted and len(bench.laser_box.pulses) % PULSES > 4,
        "acquiring": lambda: bool(bench.daq._queue) and not bench.laser_box.permitted,
    }[phase]


def _wait(until: Callable[[], bool], search: subprocess.Popen[str]) -> None:
    ends_s = time.monotonic() + WAIT_S
    while not until():
        if search.poll() is not None:
            raise HeldUpError(search.communicate()[1])
        assert time.monotonic() < ends_s, "the phase never came"
        time.sleep(1e-3)


@pytest.mark.parametrize(
    ("phase", "name"),
    [("firing", "SIGHUP"), ("moving", "SIGKILL"), ("moving", "SIGSTOP"), ("acquiring", "SIGTERM"), ("idle", "SIGINT")],
)  # fmt: skip
def test_a_strike_leaves_the_laser_off_the_stage_inside_and_the_journal_whole(
    tmp_path: Path, phase: str, name: str
) -> None:
    number = signal.Signals[name]
    seen = strike(tmp_path, phase, number)
    assert seen.rested
    assert seen.last_pulse_s < 1.0
    assert seen.moved_s < 1.0
    assert -36.5 <= seen.range_deg[0] <= seen.range_deg[1] <= 36.6
    politely = number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    assert seen.code == (128 + number if politely else -signal.SIGKILL)
    if phase != "idle":
        assert seen.entries >= 2
        assert (seen.last_entry == "Interrupted") is politely


def test_the_real_command_s_laser_is_disarmed_soon_after_a_kill() -> None:
    """How soon is measured on a quiet machine: `python -m tests.faults.laser_off --kills 100`."""
    (blow,) = laser_off.measure(kills=1, seed=1, how=signal.SIGKILL, busy=0, lease_s=1.0)
    assert blow.after_s < 1.0
    assert blow.threads > 1


if __name__ == "__main__":
    for where, how in itertools.product(PHASES, SIGNALS):
        times = []
        for _ in range(int(sys.argv[1])):
            with tempfile.TemporaryDirectory() as place:
                times.append(strike(Path(place), where, signal.Signals[how]))
        assert all(each.rested and -36.5 <= each.range_deg[0] <= each.range_deg[1] <= 36.6 for each in times)
        lit_ms, moved_ms = (1e3 * max(getattr(each, name) for each in times) for name in ("last_pulse_s", "moved_s"))
        sys.stdout.write(
            f"| {where} | {how} | {len(times)} | {lit_ms:.0f} | {moved_ms:.0f} | "
            f"{', '.join(sorted({each.last_entry for each in times}))} |\n"
        )
        sys.stdout.flush()
    os._exit(0)
