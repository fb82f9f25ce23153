"""Kills of `markerseek search` and `resume` on an emulated bench whose devices keep running.

What must hold: nothing acknowledged is lost, the search is resumed to its end, its checks repeat the kept readings, and
the emulator has counted as many pulses of light as were permitted.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from markerseek.core import Asked, Measured, Refused
from markerseek.records.journal import Checked, RecordedRun, read_journal, run_state
from tests.emulated import emulation

from .ground import begun, own_entries
from .problems import watched
from .processes import Death, End, MismatchError, ended, listen
from .tally import Tally

KIND = "bench"
MARKER_DEG, CLOSE_DEG = 6.4, 3.0
PULSES = 16
UNDER_WAY = (PULSES, 2 * PULSES)
"""Most pulses that one death leaves nothing of: one acquisition of a search; both checks of a resume, which are kept
when both are measured."""

EVENTS = 19
"""Events of the search that is killed: its start, eight acquisitions, the confirmation."""

METHOD = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--json")


def command(*words: object, out: Path, death: Death | None = None) -> End:
    """`markerseek` in a new interpreter."""
    receiving, ack_fd = os.pipe()
    program = [sys.executable, "-m", "tests.faults.kills.acknowledging", str(ack_fd), *map(str, words)]
    began_s = time.monotonic()
    with Path(f"{out}.out").open("wb") as printed, Path(f"{out}.err").open("wb") as complained:
        process = subprocess.Popen(program, stdout=printed, stderr=complained, pass_fds=[ack_fd])
    os.close(ack_fd)
    received, _ = listen(receiving, process.pid, death)
    code = process.wait()
    return ended(received, -code if code < 0 else code << 8, took_s=time.monotonic() - began_s)


def on_benches(seed: int, first: int, count: int) -> Tally:
    """Kill searches on emulated benches at random times; every second one again while it is resumed."""
    tally = Tally()
    for number in range(first, first + count):
        chance = random.Random(f"{seed} bench {number}")
        folder = Path(tempfile.mkdtemp(prefix="kills-bench-"))
        path = folder / "run.journal"
        with watched(tally, path, f"{KIND}, run {number}"):
            _once(chance, path, tally, seed=number, twice=number % 2 == 1)
        shutil.rmtree(folder)
    return tally


def _once(chance: random.Random, path: Path, tally: Tally, *, seed: int, twice: bool) -> None:
    with emulation(path.parent, seed=seed) as devices:
        search = ("search", "--rig", devices.rig, "--arm", *METHOD, "--journal", path)
        acknowledged, kills, lost_pulses = 0, 0, 0
        for again in (False, True)[: 1 + twice]:
            row = tally.row(KIND, "random time of the resume" if again else "random time")
            words = ("resume", path, "--rig", devices.rig, "--arm", "--json") if again else search
            # What was acknowledged before is repeated at once: a resume must die at an event that is new.
            after = chance.randrange(acknowledged + 1, EVENTS) if acknowledged + 1 < EVENTS else EVENTS
            end = command(*words, out=path, death=Death(after, chance.uniform(0.0, 1.0)))
            if not end.killed:
                _require(end.code in (0, 3), f"it ended by itself: {Path(f'{path}.err').read_text()}")
                break
            kills += 1
            lost_pulses += UNDER_WAY[again]
            acknowledged = max(acknowledged, end.acknowledged)
            row.kills, row.acknowledged = row.kills + 1, row.acknowledged + end.acknowledged
            _require(begun(path), "its journal has not begun")
            row.begun += 1
            kept = len(own_entries(read_journal(path, frames=False)))
            row.lost += max(acknowledged - kept, 0)
            _require(acknowledged <= kept, f"{acknowledged} events were acknowledged, {kept} are kept")
        before = read_journal(path, frames=False)
        if run_state(before.entries).state != "finished":
            unarmed = command("resume", path, "--json", out=path)
            _require(unarmed.code == 4, f"an unarmed resume ended with exit code {unarmed.code}")
        if end.killed:
            end = command("resume", path, "--rig", devices.rig, "--arm", "--json", out=path)
            _require(end.code in (0, 3), f"the resume failed: {Path(f'{path}.err').read_text()}")
        _, _, pulses = devices.end()
    printed = json.loads(Path(f"{path}.out").read_text())
    _require(abs(printed["angle_deg"] - MARKER_DEG) < CLOSE_DEG, f"it was found at {printed['angle_deg']} deg")
    held = read_journal(path)
    _require_continued(before, held)
    fired = PULSES * _acquisitions(held)
    _require(
        fired <= pulses <= fired + lost_pulses,
        f"{pulses} pulses of light, {fired} are kept and at most {lost_pulses} were under way in {kills} deaths",
    )
    tally.note("bench: pulses of light", pulses)
    tally.note("bench: of them in acquisitions and checks that are kept", fired)
    for place in ("random time", "random time of the resume")[:kills]:
        tally.row(KIND, place).equal += 1


def _require_continued(before: RecordedRun, held: RecordedRun) -> None:
    """Require that kept entries are unchanged and that every check measured the same as before."""
    kept = [(entry.clock_s, entry.written, type(entry.event)) for entry in before.entries]
    now = [(entry.clock_s, entry.written, type(entry.event)) for entry in held.entries]
    _require(now[: len(kept)] == kept, "the resume changed what was kept")
    differences = [entry.event.difference for entry in held.entries if isinstance(entry.event, Checked)]
    _require(differences == [None] * len(differences), f"checks differ: {differences}")


def _acquisitions(held: RecordedRun) -> int:
    """Acquisitions with light whose outcome is in the journal."""
    lit, count = False, 0
    for entry in held.entries:
        match entry.event:
            case Asked(role=role):
                lit = role != "dark"
            case Measured() | Refused():
                count += lit
            case Checked():
                count += 1
    return count


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise MismatchError(otherwise)
