"""Writes a journal with every kind of entry: see README.md, which says with whose code."""

from __future__ import annotations

import sys
from pathlib import Path

from every_kind_of_entry import METHOD, SEED, checkpoint, happenings, rig
from markerseek.core import Measured, Started
from markerseek.records.journal import Journal
from markerseek.runs.journalled import configuration_of

version = int(sys.argv[1])
configuration = configuration_of(
    rig(),
    method=METHOD,
    acquisitions=3,
    as_published=True,
    start_deg=-0.1,
    dark_frames=1,
    stay=False,
    seed=SEED,
)
with Journal.create(Path(sys.argv[2]), configuration) as journal:
    for number, event in enumerate(happenings(version), start=1):
        changed = isinstance(event, Started | Measured)
        journal.commit(event, clock_s=0.1 * number, checkpoint=checkpoint(number) if changed else None)
