"""Chunks of a campaign as module-level functions, so that worker processes can import them."""

from __future__ import annotations

import tempfile
from pathlib import Path

from markerseek.core import Measured

from .bytes_runs import with_frames
from .checker import check
from .held_lines import HeldLines
from .restart_counts import DAQS, Restarts, restarts
from .restarts import DEATHS
from .runs import Campaign, draw_plan
from .tally import Tally

CHUNK, FRAMES_CHUNK, RESTARTS_CHUNK = 250, 10, 20


def readings(seed: int, first: int, count: int) -> Tally:
    """Counts of a chunk of runs with readings."""
    tally = Tally()
    with tempfile.TemporaryDirectory(dir=_ram()) as folder, HeldLines() as lines:
        campaign = Campaign(Path(folder), lines)
        for number in range(first, first + count):
            plan = draw_plan(seed, number)
            trace = campaign.perform(plan)
            tally.count_run(
                check(trace),
                number=number,
                faults=tuple(f"{fault.device} {fault.name}" for fault in plan.faults),
                accepted=sum(isinstance(entry.event, Measured) for entry in trace.journal.entries),
                real_s=trace.real_s,
                virtual_s=trace.virtual_s,
            )
    return tally


def restarts_of(kind: str, seed: int, first: int, count: int) -> Restarts:
    """Counts of a chunk of restarts; the first argument names the data acquisition and the kind of death."""
    daq, death = kind.rsplit(", ", 1)
    with tempfile.TemporaryDirectory(dir=_ram()) as folder:
        # far enough apart that no chunk repeats what another drew: those that do not die are drawn again
        return restarts(
            DAQ_NAMED[daq], DEATH_NAMED[death], seed=seed, first=10 * first, count=count, folder=Path(folder)
        )


RESTART_KINDS = tuple(f"{daq}, {death}" for daq in DAQS for death in DEATHS)
DAQ_NAMED, DEATH_NAMED = {daq: daq for daq in DAQS}, {death: death for death in DEATHS}


def frames(seed: int, first: int, count: int) -> Tally:
    """Counts of a chunk of runs with frames, over emulated devices."""
    with tempfile.TemporaryDirectory(dir=_ram()) as folder:
        return with_frames(seed, first, count, folder=Path(folder))


def _ram() -> str | None:
    """Where journals are synchronised without a disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
