"""A search whose tissue is followed, in its record: the displacements are kept, and give the same answer again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from markerseek.core import Measured, SearchPlan
from markerseek.records.journal import Journal, read_journal
from markerseek.rigs import of_intensities
from markerseek.runs import answer_again, new_run, plan_on
from markerseek.sim import GaussianCurve
from tests.unit.scan.breathing_tissue import BreathingTissue


def test_the_record_of_a_search_in_tissue_that_is_followed_gives_its_answer_again(tmp_path: Path) -> None:
    rig = of_intensities(seed=1, curve=GaussianCurve(fwhm_deg=8.0), marker_deg=5.0)
    # Nothing waits for a pause, so that samples are displaced.
    tissue = BreathingTissue(rig.scanner.clock, breath_s=None)
    run = new_run(rig, plan_on(rig, SearchPlan(stay=True)), tissue=tissue)
    path = tmp_path / "run.journal"
    with Journal.create(path, run.configuration) as journal:
        run = replace(run, journal=journal)
        for _ in run.events():
            pass
    recorded = read_journal(path)
    samples = [each.event.sample for each in recorded.entries if isinstance(each.event, Measured)]
    seen = [each.displacement for each in samples if not each.dark]
    assert len(seen) > 3
    assert None not in seen
    assert len({each.mm for each in seen if each is not None}) > 3
    assert run.view.finished is not None
    estimate = run.view.finished.estimate
    assert answer_again(recorded, read_frames=True) == estimate
    assert estimate.motion is not None
    assert (estimate.motion.cameras_mm or 0.0) > 0.3
