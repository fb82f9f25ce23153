"""The searches that are killed again and again: on intensities, by sweeps, on frames, and on those of a recorded scan.

Each refuses some frames and takes them again, so that refusals are part of what is resumed.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal
from unittest import mock

from markerseek import rigs
from markerseek.acoustics import Probe
from markerseek.core import AcquisitionError, AnyPolicy, Frame, LinearArray, Reader, Reading, SearchPlan
from markerseek.records.banks import read_bank
from markerseek.records.journal import Configuration, Journal
from markerseek.rigs import Rig
from markerseek.runs import configuration_of, scan_bank
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import resumed
from markerseek.search import build_sweeping
from markerseek.sim import GaussianCurve, LaserSettings, ReceiverSettings, SimulatedSettings

from .fuse import Fuse, fused_writes

SEED = 7
MARKER_DEG = 6.3
PERSON = "the campaign"

REFUSED_EVERY = 4
"""One frame in this many is refused."""

SMALL = SimulatedSettings(
    probe=Probe(array=LinearArray(elements=32, pitch_m=0.43e-3)), receiver=ReceiverSettings(samples=2080)
)


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
    """One search: a method on a rig."""

    name: str
    method: str
    acquisitions: int
    rig: Callable[[], Rig]
    sweeps: bool = False

    def begin(self) -> tuple[AnyPolicy, Rig, Configuration]:
        """Policy, rig and what a journal says of them, as they are before the search."""
        rig = self.rig()
        rig.scanner._reader = Moody(rig.scanner._reader)
        plan = SearchPlan(
            method=self.method,
            acquisitions=self.acquisitions,
            as_published=False,
            start_deg=rig.stage.angle_deg,
            dark_frames=0 if self.sweeps else rig.dark_frames,
            stay=False,
            sweep_speed_deg_s=rig.scanner.sweeping.stage.fastest_sweep_deg_s if self.sweeps else None,
        )
        return build_sweeping(plan, limits=rig.limits.search), rig, configuration_of(rig, plan)

    def live(self, journal: Path, *, ack_fd: int, blows_at: int | None, resume: bool) -> int:
        """Begin or resume it in this process, and write a byte for each event that was handed on; its steps."""
        policy, rig, configuration = self.begin()
        fuse = Fuse(blows_at, ack_fd=ack_fd)
        fuse.into(policy, rig)
        with fused_writes(fuse), arming_watched(rig) if resume else ExitStack():
            if resume:
                kept, held = Journal.reopen(journal)
                events = resumed(policy, rig, kept, held, by=PERSON)
            else:
                kept = Journal.create(journal, configuration)
                events = journalled(policy, rig, kept)
            with kept:
                for _ in events:
                    os.write(ack_fd, b".")
                    fuse.step("event handed on", "after")
        return fuse.steps


@cache
def recorded_frames() -> Path:
    """A bank of a few frames with dark frames before, made once in each process that replays it."""
    bank = Path(tempfile.mkdtemp(prefix="kills-bank-")) / "scan.hdf5"
    rig = rigs.simulated(seed=SEED, settings=SMALL, marker_deg=MARKER_DEG)
    for _ in scan_bank(rig, bank, step_deg=3.5):
        pass
    return bank


_read_once = cache(read_bank)


def replayed_frames() -> Rig:
    """A rig that replays it; the file is probed once in each process, not each time."""
    with mock.patch("markerseek.rigs.replay.read_bank", _read_once):
        return rigs.replayed(recorded_frames())


def sweeping_rig(mode: Literal["free-running", "position-triggered"]) -> Rig:
    """A rig whose slow laser gives few pulses a sweep."""
    settings = SimulatedSettings(
        start_deg=-35.0,
        laser=LaserSettings(rate_hz=5.0, sweep_mode=mode),
        receiver=ReceiverSettings(readout_s=0.05, single_pulses=True),
    )
    return rigs.of_intensities(seed=SEED, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=MARKER_DEG, settings=settings)


SEARCHES = {
    search.name: search
    for search in (
        Search(
            name="intensities",
            method="golden-section",
            acquisitions=10,
            rig=lambda: rigs.of_intensities(seed=SEED, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=MARKER_DEG),
        ),
        Search(
            name="frames",
            method="ternary",
            acquisitions=6,
            rig=lambda: rigs.simulated(seed=SEED, settings=SMALL, marker_deg=MARKER_DEG),
        ),
        Search(
            name="replayed frames",
            method="ternary",
            acquisitions=6,
            rig=replayed_frames,
        ),
        *(
            Search(name=name, method="posterior", acquisitions=16, rig=partial(sweeping_rig, mode), sweeps=True)
            for name, mode in (("sweeps", "free-running"), ("triggered sweeps", "position-triggered"))
        ),
    )
}


@contextmanager
def arming_watched(rig: Rig) -> Iterator[None]:
    """Nothing moves and nothing is fired before a person armed the rig; a world that is put back does not move."""
    guard, armed, putting_back = rig.scanner.guard, [], []
    arm = guard.arm

    def after_arming(verb: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any) -> Any:
            assert armed or putting_back, "the rig moved or fired before anybody armed it"
            return verb(*arguments)

        return watched

    def watched_arm(*, by: str) -> None:
        if by != "a rig without hardware":
            armed.append(by)
        arm(by=by)

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(guard, "arm", watched_arm))
        for device, verbs in ((rig.laser, ("fire", "begin_sweep")), (rig.stage, ("move_to", "begin_sweep"))):
            # A recording does not sweep.
            for verb in filter(partial(hasattr, device), verbs):
                stack.enter_context(mock.patch.object(device, verb, after_arming(getattr(device, verb))))
        if rig.world is not None:
            restore = rig.world.restore

            def put_back(state: bytes) -> None:
                putting_back.append(state)
                restore(state)
                putting_back.clear()

            # The world of a simulation has slots, and its stage is put back without a move.
            if rig.facts.kind == "replayed":
                stack.enter_context(mock.patch.object(rig.world, "restore", put_back))
        yield
