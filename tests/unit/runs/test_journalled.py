"""What a run hands out is in its journal before."""

from __future__ import annotations

import shutil
from contextlib import closing
from pathlib import Path

from markerseek import rigs
from markerseek.core import SearchPlan
from markerseek.records.journal import Journal, read_journal
from markerseek.runs import configuration_of
from markerseek.runs.journalled import journalled
from markerseek.search import build


def test_each_event_is_on_the_disk_when_it_is_handed_out(tmp_path: Path) -> None:
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    policy = build(SearchPlan(method="ternary", start_deg=0.0, acquisitions=6), limits=rig.limits.search)
    plan = SearchPlan(method="ternary", acquisitions=6, as_published=False, start_deg=0.0, dark_frames=0, stay=False)
    path, copy = tmp_path / "run.journal", tmp_path / "copy.journal"
    with Journal.create(path, configuration_of(rig, plan)) as journal, closing(journalled(policy, rig, journal)) as run:
        for count, event in enumerate(run, start=1):
            shutil.copyfile(path, copy)
            kept = read_journal(copy).entries
            assert len(kept) == count
            assert kept[-1].event == event
