"""Fig. 5 from curves: a full scan drawn at once equals the one made by the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import SearchPlan
from markerseek.search import build
from markerseek.sim import CurveWorld, LaserSettings, MarkerSettings, NoiseSettings, PowerCurve, SimulatedSettings
from markerseek.studies import CurveSettings, cells
from markerseek.studies.paper import curve_runs
from markerseek.studies.paper.curve_runs import Condition, answers_of_trial, study_of
from markerseek.studies.paper.section import Answer
from markerseek.studies.trial import searched
from markerseek.studies.worlds import draw_trial, study_rig


@pytest.mark.parametrize("present", [True, False])
def test_a_scan_holds_the_intensities_of_the_frames_one_by_one(present: bool) -> None:
    settings = SimulatedSettings(
        start_deg=-35.0,
        marker=MarkerSettings(present=present),
        noise=NoiseSettings(peak_snr_db=25.0),
        laser=LaserSettings(energy_jitter=0.3),
    )
    curve = PowerCurve(fwhm_deg=6.0, power=1.3) if present else None
    rig = rigs.of_intensities(seed=5, curve=curve, marker_deg=-4.0, settings=settings)
    one_by_one = [rig.scanner.measure(float(angle_deg)) for angle_deg in np.linspace(-30, 30, 23)]
    world = CurveWorld.of_settings(
        settings, curve=curve, marker_deg=-4.0, cells=rigs.USUAL_CELLS, rng=np.random.default_rng(5)
    )
    angles = np.array([sample.angle_deg for sample in one_by_one])
    short, whole = world.scans([angles[:7], angles], pulses=settings.laser.pulses)
    assert whole == pytest.approx([sample.reading.intensity for sample in one_by_one], rel=1e-12)
    assert short.tolist() == whole[:7].tolist()
    assert np.unique(whole).size == whole.size


@pytest.mark.parametrize("peak_snr_db", [20.0, 60.0])
def test_full_scans_answer_as_those_of_the_loop(monkeypatch: pytest.MonkeyPatch, peak_snr_db: float) -> None:
    """Markers anywhere, both ends of the range among them, where the encoder's steps matter most."""
    condition = Condition(source_radius_m=0.4e-3, peak_snr_db=peak_snr_db)
    study = replace(
        study_of(condition, seed=3, trials=4, sweeps=(8, 15, 28)), curve=CurveSettings(family="power", fwhm_deg=9.0)
    )
    for marker_deg in (None, -35.0, 35.0):
        here = replace(study, rig=replace(study.rig, marker=replace(study.rig.marker, angle_deg=marker_deg)))
        quick = [answers_of_trial((here, trial)) for trial in range(here.trials)]
        for trial, answers in enumerate(quick):
            cell = cells(here)[0]
            draw = draw_trial(here, cell, trial)
            for settings in here.policies[2:]:
                policy = build(
                    SearchPlan(
                        method=settings.plan.method,
                        acquisitions=settings.plan.acquisitions,
                        as_published=True,
                        early_end=settings.plan.early_end,
                    )
                )
                found = searched(policy, study_rig(here, cell, draw).scanner)
                by_loop = abs(found.finished.estimate.mean_deg - draw.marker_deg)
                assert answers["WA", settings.most].error_deg == pytest.approx(by_loop, abs=1e-9)
    monkeypatch.setattr(curve_runs, "_full_scans", lambda *_: {("WA", 8): Answer(error_deg=60.0)})
    assert answers_of_trial((study, 0))["WA", 8].error_deg == 60.0
