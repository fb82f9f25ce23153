"""Kills searches that hand on events before committing them, and prints how many were detected as lost."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from unittest import mock

from markerseek.core import Event, Policy, RunPlan
from markerseek.records.journal import Journal
from markerseek.rigs import Rig
from markerseek.runs.journalled import commit_event
from markerseek.scan import run

from .at_steps import at_steps


def hasty(policy: Policy, rig: Rig, journal: Journal) -> Iterator[Event]:
    for event in run(policy, rig.scanner, RunPlan(dark_frames=journal.configuration.plan.dark_frames)):
        yield event
        commit_event(event, rig.scanner.clock, rig, journal)


if __name__ == "__main__":
    with mock.patch("tests.faults.kills.searches.journalled", hasty):
        tally = at_steps("intensities", range(40, 320, 25))
    row = tally.row("intensities", "every step")
    sys.stdout.write(f"{row.kills} {row.lost} {len(tally.wrong)}\n")
