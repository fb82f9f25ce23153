"""Kills searches with -9, resumes them, and compares with the search that nobody killed.

    python tests/faults/kill_campaign.py --kills 1000 --out docs/explanation/kills.txt

Each kill is the death of a process of its own. Where they die:

- step: just before or just after the n-th thing that a search does (an SQLite statement, a move, a firing, a frame, a
  reading, a policy told, an event handed on), for n = 1, 2, 3, ... until a search lives to its end;
- resume: the same, in the process that resumes a search that was killed before;
- write: in the middle of a write to the disk, at a random byte (the kernel kills by SIGXFSZ at that file size);
- time: at a random moment, by SIGKILL from another process, of `markerseek search` itself.

What must hold after each: no acquisition that was acknowledged (handed on by the journal) is missing, nothing was fired
before the rig was armed again, and the resumed search ends with the same result and the same readings and frames, bit
for bit.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import msgspec
import numpy as np

from markerseek import rigs
from markerseek.acoustics import Probe
from markerseek.core import AcquisitionError, Frame, LinearArray, Measured, Policy, Reader, Reading, RecordError
from markerseek.records.journal import Configuration, Journal, Recording, read_journal, result_of
from markerseek.rigs import Rig
from markerseek.rigs.journalled import configuration_of, journalled
from markerseek.rigs.resuming import resumed
from markerseek.search import build
from markerseek.sim import GaussianCurve, ReceiverSettings, SimulatedSettings

PERSON = "the campaign"

REFUSED_EVERY = 4
"""Every so many frames one is refused and taken again, so that refusals are part of what is resumed."""


class Moody:
    """A reader that refuses some frames by their number."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        if frame.header.sequence % REFUSED_EVERY == 0:
            raise AcquisitionError(f"frame {frame.header.sequence} is refused by this test")
        return self._reader.read(frame)


@dataclass(frozen=True)
class Search:
    """One search that is killed again and again."""

    name: str
    method: str
    acquisitions: int
    rig: Callable[[], Rig]

    def begin(self) -> tuple[Policy, Rig, Configuration]:
        rig = self.rig()
        rig.scanner._reader = Moody(rig.scanner._reader)
        policy = build(
            self.method, limits=rig.limits.search, acquisitions=self.acquisitions, start_deg=rig.stage.angle_deg
        )
        configuration = configuration_of(
            rig,
            method=self.method,
            acquisitions=self.acquisitions,
            as_published=False,
            start_deg=rig.stage.angle_deg,
            dark_frames=rig.dark_frames,
            stay=False,
            seed=7,
        )
        return policy, rig, configuration


SMALL = SimulatedSettings(
    probe=Probe(array=LinearArray(elements=32, pitch_m=0.43e-3)), receiver=ReceiverSettings(samples=2080)
)

SEARCHES = {
    "intensities": Search(
        name="intensities",
        method="golden-section",
        acquisitions=10,
        rig=lambda: rigs.of_intensities(seed=7, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=6.3),
    ),
    "frames": Search(
        name="frames",
        method="ternary",
        acquisitions=6,
        rig=lambda: rigs.simulated(seed=7, settings=SMALL, marker_deg=6.3),
    ),
}


class Fuse:
    """Kills this process at the n-th step."""

    def __init__(self, blows_at: int | None) -> None:
        self.steps = 0
        self._blows_at = blows_at

    def step(self) -> None:
        self.steps += 1
        if self.steps == self._blows_at:
            os.kill(os.getpid(), signal.SIGKILL)

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def fused(*args: Any, **named: Any) -> Any:
            self.step()
            answer = call(*args, **named)
            self.step()
            return answer

        return fused

    def into(self, policy: Policy, rig: Rig) -> None:
        """Put it into every step of a search."""
        for part, verbs in (
            (rig.stage, ("move_to", "stop")),
            (rig.laser, ("fire", "disarm")),
            (rig.receiver, ("arm", "acquire")),
            (rig.scanner._reader, ("read",)),
            (policy, ("tell",)),
        ):
            for verb in verbs:
                setattr(part, verb, self.around(getattr(part, verb)))


def fused_sqlite(fuse: Fuse) -> mock._patch[Any]:
    """SQLite whose every statement is two steps."""

    class Connection(sqlite3.Connection):
        def execute(self, *args: Any) -> Any:
            return fuse.around(super().execute)(*args)

        def close(self) -> None:
            fuse.around(super().close)()

    connect = sqlite3.connect
    return mock.patch("sqlite3.connect", lambda *args, **named: connect(*args, factory=Connection, **named))


def live(search: Search, journal: Path, *, told: int, blows_at: int | None, resume: bool) -> int:
    """Begin or resume a search in this process, and write a byte for each event that was handed on; its steps."""
    fuse = Fuse(blows_at)
    policy, rig, configuration = search.begin()
    fuse.into(policy, rig)
    with fused_sqlite(fuse):
        if resume:
            kept, held = Journal.reopen(journal)
            events = resumed(policy, rig, kept, held, by=PERSON)
        else:
            kept = Journal.create(journal, configuration)
            events = journalled(policy, rig, kept)
        with kept:
            for _ in events:
                os.write(told, b".")
                fuse.step()
    return fuse.steps


def in_a_process(work: Callable[..., object]) -> tuple[int, bool]:
    """Do work in a forked process; how many bytes it wrote, and whether it lived to its end, come back."""
    receiving, telling = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receiving)
        try:
            work(told=telling)
        except BaseException as error:  # noqa: BLE001  a forked process must not run on in its parent's work
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
            os._exit(99)
        os._exit(0)
    os.close(telling)
    told = 0
    while data := os.read(receiving, 65536):
        told += len(data)
    os.close(receiving)
    _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) != 0:
        raise SystemExit("a search ended by itself, and not well")
    return told, os.WIFEXITED(status)


def happened(held: Recording) -> list[tuple[object, float, bytes]]:
    """What a run did, without what only names things: event, time, and samples of the frame."""
    rows = []
    for entry in held.entries:
        if type(entry.event).__name__ in ("Interrupted", "Resuming", "Checked"):
            continue
        frame = entry.event.sample.frame if isinstance(entry.event, Measured) else None
        samples = getattr(frame, "samples", np.empty(0, dtype=np.int16))
        rows.append((entry.event, entry.clock_s, samples.tobytes()))
    return rows


class Campaign:
    """Counts what was killed, and stops at the first thing that does not hold."""

    def __init__(self, folder: Path, *, seed: int) -> None:
        self.kills: Counter[str] = Counter()
        self.acknowledged = 0
        self.equal = self.searches = self.begun = self.missing = 0
        self.folder = folder
        self.random = random.Random(seed)
        self._number = 0
        self.whole: dict[str, tuple[bytes, list[tuple[object, float, bytes]]]] = {}
        self.last_step: dict[str, int] = {}
        for name, search in SEARCHES.items():
            path = self.new()
            with Path(os.devnull).open("wb") as nobody:
                self.last_step[name] = live(search, path, told=nobody.fileno(), blows_at=None, resume=False)
            held = read_journal(path)
            self.whole[name] = msgspec.json.encode(result_of(held)[1]), happened(held)

    def new(self) -> Path:
        self._number += 1
        return self.folder / f"{self._number}.journal"

    def died(self, kind: str, search: Search, path: Path, told: int) -> None:
        """Look at what a death left, go on from it, and compare."""
        self.kills[kind] += 1
        self.searches += 1
        self.acknowledged += told
        _, wanted = self.whole[search.name]
        if not path.exists() or (told == 0 and not _begun(path)):
            return
        self.begun += 1
        kept = happened(read_journal(path))
        self.missing += max(told - len(kept), 0)
        assert self.missing == 0, f"{path}: {told} events were acknowledged, {len(kept)} are kept"
        assert kept == wanted[: len(kept)], f"{path}: what is kept is not what happened"
        if len(kept) == len(wanted):
            self.finish(search, path)
            return
        policy, rig, _ = search.begin()
        journal, held = Journal.reopen(path)
        with journal, arming_watched(rig):
            for _ in resumed(policy, rig, journal, held, by=PERSON):
                pass
        self.finish(search, path)

    def finish(self, search: Search, path: Path) -> None:
        wanted_result, wanted = self.whole[search.name]
        held = read_journal(path)
        assert happened(held) == wanted, f"{path}: the resumed search is not the one that nobody killed"
        assert msgspec.json.encode(result_of(held)[1]) == wanted_result, f"{path}: the result differs"
        self.equal += 1
        for left in self.folder.glob(f"{path.name}*"):
            left.unlink()

    def steps(self, search: Search, numbers: Iterable[int]) -> None:
        """Kill at each of these steps, until one is beyond the end."""
        for number in numbers:
            path = self.new()
            told, lived = in_a_process(partial(live, search, path, blows_at=number, resume=False))
            if lived:
                return
            self.died("step", search, path, told)

    def resumes(self, search: Search, numbers: Iterable[int], *, first: int) -> None:
        """Kill at one step, then kill the process that resumes at each of these."""
        for number in numbers:
            path = self.new()
            before, lived = in_a_process(partial(live, search, path, blows_at=first, resume=False))
            assert not lived
            assert before > 0
            told, lived = in_a_process(partial(live, search, path, blows_at=number, resume=True))
            if lived:
                return
            self.kills["step"] += 1
            self.died("resume", search, path, max(before, told))

    def writes(self, search: Search, count: int) -> None:
        """Kill in the middle of a write, at a random size of the file."""
        _, wanted = self.whole[search.name]
        most = 60_000 + sum(len(samples) + 16_384 for *_, samples in wanted)
        done = 0
        while done < count:
            path, size = self.new(), self.random.randrange(1, most)

            def work(*, told: int, path: Path = path, size: int = size) -> None:
                signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
                live(search, path, told=told, blows_at=None, resume=False)

            told, lived = in_a_process(work)
            if not lived:
                done += 1
                self.died("write", search, path, told)

    def times(self, count: int) -> None:
        """Kill `markerseek search` itself at random moments, and resume it by the command."""
        command = ["search", "--seed", "7", "--method", "ternary", "--acquisitions", "8", "--json", "--journal"]
        shell = [sys.executable, "-c", "from markerseek.cli import main; main()"]
        whole = subprocess.run([*shell, *command, str(self.new())], capture_output=True, check=False)
        wanted = json.loads(whole.stdout)
        done = 0
        while done < count:
            path = self.new()
            process = subprocess.Popen(
                [*shell, *command, str(path), "--pace", "0.01"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            while not path.exists() and process.poll() is None:
                time.sleep(0.001)
            try:
                # about as long as the search takes at this pace
                process.wait(self.random.uniform(0.0, 2.0))
            except subprocess.TimeoutExpired:
                process.kill()
            process.communicate()
            if process.returncode != -signal.SIGKILL or not path.exists() or not _begun(path):
                continue
            done += 1
            self.kills["time"] += 1
            self.searches += 1
            self.begun += 1
            command_line = [*shell, "resume", str(path), "--arm", "--json"]
            resumed_one = subprocess.run(command_line, capture_output=True, check=False)
            assert json.loads(resumed_one.stdout) == wanted, (path, resumed_one.stdout, resumed_one.stderr)
            self.equal += 1


def _begun(path: Path) -> bool:
    """Whether the configuration was committed; before that no run exists that could be resumed."""
    try:
        read_journal(path)
    except RecordError as problem:
        if "never begun" in str(problem):
            return False
        raise
    return True


@contextmanager
def arming_watched(rig: Rig) -> Iterator[None]:
    """Nothing moves and nothing is fired before a person armed the rig."""
    guard, armed = rig.scanner.guard, []
    arm, fire, move_to = guard.arm, rig.laser.fire, rig.stage.move_to

    def after_arming(verb: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any) -> Any:
            assert PERSON in armed, "the rig moved or fired before anybody armed it"
            return verb(*arguments)

        return watched

    def watched_arm(*, by: str) -> None:
        armed.append(by)
        arm(by=by)

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(guard, "arm", watched_arm))
        stack.enter_context(mock.patch.object(rig.laser, "fire", after_arming(fire)))
        stack.enter_context(mock.patch.object(rig.stage, "move_to", after_arming(move_to)))
        yield


def spread(count: int, *, last: int) -> list[int]:
    """So many steps from the first to the last, evenly; all of them where there are fewer."""
    return sorted({round(number) for number in np.linspace(1, last, min(count, last))})


def carry_out(campaign: Campaign, kills: int) -> None:
    """About so many kills: at most a third in each search step by step, the rest in resumes, writes and at random."""
    third = kills // 3
    for name, search in SEARCHES.items():
        campaign.steps(search, spread(third, last=campaign.last_step[name]))
    campaign.writes(SEARCHES["intensities"], kills // 20)
    campaign.writes(SEARCHES["frames"], kills // 20)
    campaign.times(kills // 50)
    while (left := kills - campaign.kills.total()) > 0:
        search = SEARCHES[campaign.random.choice(list(SEARCHES))]
        first = campaign.random.randrange(campaign.last_step[search.name] // 4, campaign.last_step[search.name] - 8)
        steps = [campaign.random.randrange(1, campaign.last_step[search.name]) for _ in range(min(left, 5))]
        campaign.resumes(search, steps, first=first)


def report(campaign: Campaign, *, seed: int, took_s: float) -> str:
    """The figures as a text."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--abbrev=12"], capture_output=True, text=True, check=False
    ).stdout.strip()
    total = campaign.kills.total()
    made_by = f"Python {platform.python_version()}, SQLite {sqlite3.sqlite_version}, {platform.machine()}"
    lines = [
        f"Commit {commit}, seed {seed}, {made_by}",
        "",
        f"{'where':<10}{'kills':>8}",
        *(f"{kind:<10}{campaign.kills[kind]:>8}" for kind in ("step", "resume", "write", "time")),
        f"{'all':<10}{total:>8}",
        "",
        f"steps of the whole searches                      {campaign.last_step}",
        f"events acknowledged before a death               {campaign.acknowledged}",
        f"of them missing afterwards                       {campaign.missing}",
        f"searches that died before they had begun         {campaign.searches - campaign.begun}",
        f"searches killed after that, once or twice        {campaign.begun}",
        f"of them resumed and equal to the whole search    {campaign.equal}",
        f"upper limit of the share of others, 95 %         {3 / campaign.begun:.1e}",
        f"took {took_s:.0f} s",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    wanted = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="kills-")))
        began = time.monotonic()
        campaign = Campaign(folder, seed=wanted.seed)
        carry_out(campaign, wanted.kills)
        text = report(campaign, seed=wanted.seed, took_s=time.monotonic() - began)
    sys.stdout.write(text)
    if wanted.out is not None:
        wanted.out.write_text(text)


if __name__ == "__main__":
    main()
