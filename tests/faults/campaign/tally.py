"""Counts over runs, added up run by run and chunk by chunk; a chunk is what a worker process runs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
from scipy.stats import beta

from markerseek.core import Measured

from .checker import OFF_DEG, Verdict, check
from .held_lines import HeldLines
from .runs import SWEPT_POSTERIOR, Campaign, draw_plan

CHUNK = 250
PROMISES = ("P1", "P2", "P3", "P6", "P7", "P8")


class Broken(msgspec.Struct, frozen=True, kw_only=True):
    """A run that broke a promise."""

    promise: str
    run: int
    faults: tuple[str, ...]
    said: str


class Row(msgspec.Struct, kw_only=True):
    """Runs with one and the same fault, or with none, or with two."""

    runs: int = 0
    acted: int = 0
    reported: int = 0
    answers: int = 0
    found: int = 0
    off: int = 0
    covered: int = 0
    excess_deg: float = 0.0
    beyond_deg: float = 0.0
    excess_pulses: int = 0
    moving_pulses: int = 0

    def add(self, other: Row) -> None:
        """Add another's counts."""
        for name in ("runs", "acted", "reported", "answers", "found", "off", "covered"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("excess_deg", "beyond_deg", "excess_pulses", "moving_pulses"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))


class Tally(msgspec.Struct, kw_only=True):
    """Counts over many runs; ``rows`` by "device name" of the only fault, "none" or "two".

    ``swept``: the same of the runs alone that answer by sweeps.
    """

    rows: dict[str, Row] = {}
    swept: dict[str, Row] = {}
    broken: list[Broken] = []
    outcomes: dict[str, int] = {}
    in_fault: int = 0
    accepted: int = 0
    noticed_later: int = 0
    slowest_s: float = 0.0
    longest_s: float = 0.0

    @property
    def runs(self) -> int:
        return sum(row.runs for row in self.rows.values())

    def count_run(
        self,
        verdict: Verdict,
        *,
        number: int,
        faults: tuple[str, ...],
        by_sweeps: bool,
        accepted: int,
        real_s: float,
        virtual_s: float,
    ) -> None:
        """Add one run."""
        key = "none" if not faults else faults[0] if len(faults) == 1 else "two"
        row = Row(
            runs=1,
            acted=verdict.acted,
            reported=verdict.acted and verdict.reported,
            answers=verdict.outcome == "finished",
            found=verdict.found,
            off=verdict.off,
            covered=verdict.covered,
            excess_deg=verdict.excess_deg,
            beyond_deg=max(0.0, verdict.excess_deg - verdict.injected_deg),
            excess_pulses=verdict.excess_pulses,
            moving_pulses=verdict.moving_pulses,
        )
        broken = [
            *verdict.broken[:3],
            *([("P10", f"found, and off by more than {OFF_DEG:g} deg")] if verdict.off else []),
        ]
        self.add(
            Tally(
                rows={key: row},
                swept={key: row} if by_sweeps else {},
                broken=[Broken(promise=each, run=number, faults=faults, said=said[:300]) for each, said in broken],
                outcomes={verdict.outcome: 1},
                in_fault=verdict.outcome == "fault",
                accepted=accepted,
                noticed_later=verdict.noticed_later,
                slowest_s=real_s,
                longest_s=virtual_s,
            )
        )

    def add(self, other: Tally) -> None:
        """Add the counts of another."""
        for own, others in ((self.rows, other.rows), (self.swept, other.swept)):
            for key, row in others.items():
                own.setdefault(key, Row()).add(row)
        for outcome, count in other.outcomes.items():
            self.outcomes[outcome] = self.outcomes.get(outcome, 0) + count
        self.broken += other.broken
        self.in_fault += other.in_fault
        self.accepted += other.accepted
        self.noticed_later += other.noticed_later
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.longest_s = max(self.longest_s, other.longest_s)

    def runs_that_broke(self, promise: str) -> int:
        """Number of runs that broke a promise."""
        return len({broken.run for broken in self.broken if broken.promise == promise})


def summed(rows: Mapping[str, Row], keys: Iterable[str]) -> Row:
    """Sum the rows of these keys."""
    whole = Row()
    for key in keys:
        whole.add(rows.get(key, Row()))
    return whole


def upper95(hits: int, count: int) -> float:
    """Upper 95 % limit (one-sided, Clopper-Pearson) of a share: 3/n where nothing was seen in n."""
    return 1.0 if count == 0 or hits == count else float(beta.ppf(0.95, hits + 1, count - hits))


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
                by_sweeps=plan.method == SWEPT_POSTERIOR,
                accepted=sum(isinstance(entry.event, Measured) for entry in trace.journal.entries),
                real_s=trace.real_s,
                virtual_s=trace.virtual_s,
            )
    return tally


def _ram() -> str | None:
    """Where journals are synchronised without a disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
