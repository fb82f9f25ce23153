"""Sessions of registration in tissue that breathes: four markers by sweeps, with cameras that see textured tissue.

``python -m benchmarks.registration.breathing --sessions 8 --out docs/data/sessions-breathing.csv`` runs the sessions
that the file does not have yet, and prints the table. The breath is that of the simulated rig, or one with which
nothing was built: a saw, or a trace with breaths of uneven length and depth, heartbeat and drift
(`benchmarks.moving_tissue`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time
from typing import cast

import numpy as np
from msgspec import structs

from benchmarks.moving_tissue import Saw, Trace
from benchmarks.registration.session_rows import SessionOutcome, run_missing, session_parser
from markerseek.core import MarkerseekError
from markerseek.registration import RegistrationSession, SessionPlan, SimulatedRoom, SimulatedRoomSettings, SpotRefused
from markerseek.sim import STREAMING, TissueMotion

FIRST_SEED = 90_001
"""Seed of the first session of each row; nothing was chosen on these."""

MARKERS = 4
"""Markers of a session."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """How the tissue of a row moves."""

    title: str
    amplitude_mm: float = 0.0
    others: bool = False
    """Whether it moves as a saw (odd seeds) or as a trace, in any direction; else as the simulated rig has it."""


ROWS = {
    "still": Row(title="at rest"),
    "1 mm": Row(title="± 1 mm", amplitude_mm=1.0),
    "2 mm": Row(title="± 2 mm", amplitude_mm=2.0),
    "1 mm, others": Row(title="± 1 mm, saws and traces in any direction", amplitude_mm=1.0, others=True),
    "2 mm, others": Row(title="± 2 mm, saws and traces in any direction", amplitude_mm=2.0, others=True),
}
"""The rows, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome(SessionOutcome):
    """What came of one session; lengths in millimetres."""

    registered: bool
    said: str
    """How the session ended, in words."""
    rig_s: float
    """Time on the rig's clock from the first spot to the end, with searches that were done again."""
    acquisitions: int
    markers: int
    refused: int
    """Spots that were refused."""
    target_error_mm: float | None
    tre_mm: float | None
    tre95_mm: float | None
    cpu_s: float
    commit: str


def run(name: str, seed: int, *, commit: str) -> Outcome:
    """Run one session of a row."""
    row = ROWS[name]
    began_s = process_time()
    breath = TissueMotion() if row.others else TissueMotion(breathing_mm=row.amplitude_mm)
    settings = SimulatedRoomSettings(rig=structs.replace(STREAMING, motion=breath), textured=True)
    motion = None
    if row.others:
        # What the simulation asks of a motion, they have.
        kind = Saw if seed % 2 else Trace
        motion = cast("TissueMotion", kind(np.random.default_rng((seed, 7)), row.amplitude_mm))
    room = SimulatedRoom(settings, seed=seed, motion=motion)
    session = RegistrationSession(room, plan=SessionPlan(sweep=True, markers=MARKERS))
    refused = 0
    broken = ""
    try:
        for step in session.steps():
            refused += isinstance(step, SpotRefused)
    except MarkerseekError as problem:
        broken = f"{type(problem).__name__}: {problem}; "
    view = session.view
    report = None if view.registration is None else view.registration.report
    error_m = room.truth(view).target_error_m
    return Outcome(
        row=name,
        seed=seed,
        registered=report is not None,
        said=broken + view.said,
        rig_s=round(room.rig.scanner.clock.now_s(), 2),
        acquisitions=sum(marker.acquisitions for marker in view.markers),
        markers=len(view.markers),
        refused=refused,
        target_error_mm=None if error_m is None else round(1e3 * error_m, 4),
        tre_mm=None if report is None else round(1e3 * report.tre_m, 4),
        tre95_mm=None if report is None else round(1e3 * report.tre95_m, 4),
        cpu_s=round(process_time() - began_s, 1),
        commit=commit,
    )


def table(found: Sequence[Outcome]) -> str:
    """The table of all rows as Markdown."""
    lines = [
        "| tissue | sessions | registered | TRE mean; median, mm | expected, mm | 95 % covers | rig, s |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name, row in ROWS.items():
        mine = [each for each in found if each.row == name]
        if mine:
            lines.append(f"| {row.title} | {len(mine)} | {' | '.join(_cells(mine))} |")
    return "\n".join(lines) + "\n"


def _cells(mine: Sequence[Outcome]) -> list[str]:
    known = [
        (each.target_error_mm, each.tre_mm, each.tre95_mm)
        for each in mine
        if each.target_error_mm is not None and each.tre_mm is not None and each.tre95_mm is not None
    ]
    time = f"{np.mean([each.rig_s for each in mine]):.0f}"
    if not known:
        return [f"0 of {len(mine)}", "", "", "", time]
    error_mm, tre_mm, tre95_mm = np.array(known).T
    return [
        f"{len(known)} of {len(mine)}",
        f"{error_mm.mean():.2f}; {np.median(error_mm):.2f}",
        f"{tre_mm.mean():.2f}",
        f"{np.count_nonzero(error_mm <= tre95_mm)} of {len(known)}",
        time,
    ]


def main() -> None:
    """Run what is missing, and print the table."""
    asked = session_parser("benchmarks.registration.breathing", __doc__, ROWS, sessions=8).parse_args()
    sys.stdout.write(table(run_missing(asked, run, Outcome, first_seed=FIRST_SEED)))


if __name__ == "__main__":
    main()
