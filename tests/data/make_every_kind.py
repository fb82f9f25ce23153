"""Writes a journal with every kind of entry, to be kept as a fixture: see README.md."""

from __future__ import annotations

import sys
from pathlib import Path

from markerseek.core import SearchPlan
from markerseek.records.journal import Journal
from markerseek.runs import configuration_of
from tests.unit.records.journal.synthetic_journals import METHOD, journal_events, rig

configuration = configuration_of(
    rig(), SearchPlan(method=METHOD, acquisitions=3, as_published=True, start_deg=-0.1, dark_frames=1, stay=False)
)
with Journal.create(Path(sys.argv[1]), configuration) as journal:
    for number, event in enumerate(journal_events(), start=1):
        journal.commit(event, clock_s=0.1 * number)
