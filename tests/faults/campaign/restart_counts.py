"""Counts over restarts at rest and in bursts, and the table of them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Literal

import msgspec

from .burst_restarts import BurstRestart
from .restarts import AT_REST, AtRest, DeathName, Outcome, Restart

OFF_DEG = 1.0

BURSTS: Literal["late bursts of sweeps"] = "late bursts of sweeps"

DaqName = AtRest | Literal["late bursts of sweeps"]
DAQS: tuple[DaqName, ...] = (*AT_REST, BURSTS)


class Restarts(msgspec.Struct, kw_only=True):
    """Counts over restarts; an ``accepted`` one has frames of other triggers in it that were believed."""

    runs: int = 0
    answers: dict[str, int] = {}
    said: dict[str, int] = {}
    accepted: int = 0
    accepted_unreported: int = 0
    off: int = 0
    largest_off_deg: float = 0.0

    def count_run(self, outcome: Outcome) -> None:
        """Add a restart."""
        self.runs += 1
        self.answers[outcome.answer] = self.answers.get(outcome.answer, 0) + 1
        for said in {_kind(said) for said in outcome.said}:
            self.said[said] = self.said.get(said, 0) + 1
        self.accepted += outcome.foreign > 0
        self.accepted_unreported += outcome.foreign > 0 and outcome.answer != "fault"
        if outcome.off_deg is not None:
            self.largest_off_deg = max(self.largest_off_deg, outcome.off_deg)
            self.off += outcome.off_deg > OFF_DEG

    def add(self, other: Restarts) -> None:
        """Add the counts of another."""
        for mine, others in ((self.answers, other.answers), (self.said, other.said)):
            for name, count in others.items():
                mine[name] = mine.get(name, 0) + count
        self.runs += other.runs
        self.accepted += other.accepted
        self.accepted_unreported += other.accepted_unreported
        self.off += other.off
        self.largest_off_deg = max(self.largest_off_deg, other.largest_off_deg)


def _kind(said: str) -> str:
    for words in (
        "files have arrived",
        "stale files",
        "holds a source",
        "pulses, ",
        "noise is",
        "change although",
        "stale frame",
    ):
        if words in said:
            return words.strip(", ")
    return said[:60]


def restarts(
    daq: DaqName, death: DeathName, *, seed: int, count: int, folder: Path, first: int = 0, bare: bool = False
) -> Restarts:
    """Restarts under one data acquisition and one kind of death.

    ``bare`` leaves out what decision 16 brought: the settled folder, the watermark, the look at dark frames, the
    confirmation that counts; of bursts what decision 75 brought, their numbers.
    """
    counts = Restarts()
    number = first
    while counts.runs < count:
        place = folder / f"restart-{number}"
        restart: Restart | BurstRestart
        if daq == BURSTS:
            restart = BurstRestart(place, seed=seed, number=number, death=death, bare=bare)
        else:
            restart = Restart(place, seed=seed, number=number, daq=daq, death=death, bare=bare)
        outcome = restart.perform()
        shutil.rmtree(place)
        number += 1
        if outcome.died:
            counts.count_run(outcome)
    return counts


def lines(rows: dict[str, Restarts]) -> list[str]:
    """Table of restarts."""
    table = [
        (
            "| data acquisition, death | restarts | answers | reported | with frames of other triggers accepted | of "
            "these not ended by a fault | found and off by more than 1° | largest error of found, deg |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        answers = ", ".join(f"{count} {answer}" for answer, count in sorted(row.answers.items()))
        said = "; ".join(f"{count} × {words}" for words, count in sorted(row.said.items()))
        table.append(
            f"| {name} | {row.runs} | {answers} | {said} | {row.accepted} | {row.accepted_unreported} | {row.off} | "
            f"{row.largest_off_deg:.2f} |"
        )
    return table
