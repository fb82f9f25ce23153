"""Chunks of a campaign as module-level functions, so that worker processes can import them."""

from __future__ import annotations

import tempfile
from pathlib import Path

from markerseek.core import Measured

from .checker import check
from .held_lines import HeldLines
from .runs import Campaign, draw_plan
from .tally import Tally

CHUNK = 250


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


def _ram() -> str | None:
    """Where journals are synchronised without a disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
