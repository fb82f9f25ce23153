"""The intensity curve of a former marker is a prior for the next search on the rig."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import Found, MarkerCurve, Reading, RecordError, Sample, SearchPlan
from markerseek.records.journal import Journal
from markerseek.runs import former_curve, new_run, plan_on, read_marker, rebuild_policy
from markerseek.search.curve import log_curve
from markerseek.search.posterior import Posterior
from markerseek.search.posterior.shapes import LOG_WIDTH_SIGMA, family, shapes_with
from markerseek.show import flat_result
from markerseek.sim import SechCurve


def rig(seed: int = 4) -> rigs.Rig:
    return rigs.of_intensities(seed=seed, curve=SechCurve(fwhm_deg=6.0), marker_deg=7.5)


def test_curve_and_marker_are_read_from_a_result_that_an_earlier_version_has_printed() -> None:
    path = Path(__file__).parents[2] / "data" / "result-0.4.json"
    curve = former_curve(path)
    marker = read_marker(path)
    assert (curve.fwhm_deg, curve.peak) == (3.6110303834739037, 1978.393150125062)
    assert marker.position_m == (0.0009319876735345835, 0.018031829449839238, 0.05999077182852456)


def test_the_curve_is_read_from_the_result_and_from_the_journal(tmp_path: Path) -> None:
    run = new_run(rig(), plan_on(rig(), SearchPlan(method="posterior", start_deg=-35.0)))
    path = tmp_path / "run.journal"
    with Journal.create(path, run.configuration) as journal:
        run = replace(run, journal=journal)
        list(run.events())
    result = run.result()
    (tmp_path / "result.json").write_bytes(msgspec.json.encode(flat_result(result)))
    curve = former_curve(tmp_path / "result.json")
    assert isinstance(result.estimate, Found)
    assert curve == former_curve(path) == result.estimate.curve
    assert curve.fwhm_deg == pytest.approx(6.0, rel=0.25)
    strongest = max(sample.reading.intensity for sample in result.samples)
    assert curve.peak == pytest.approx(strongest, rel=0.15)


def test_a_plan_with_a_prior_survives_the_journal(tmp_path: Path) -> None:
    curve = MarkerCurve(fwhm_deg=6.0, peak=100.0)
    plan = plan_on(rig(), SearchPlan(method="posterior", start_deg=-35.0, prior=curve, others=0.0))
    run = new_run(rig(), plan)
    path = tmp_path / "run.journal"
    Journal.create(path, run.configuration).close()
    journal, held = Journal.reopen(path)
    journal.close()
    assert held.configuration.plan == plan
    rebuilt = rebuild_policy(held.configuration)
    assert rebuilt.ask() == run.policy.ask()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "it found no marker whose curve it knows"),
        ('{"curve": null}', "it found no marker whose curve it knows"),
        ('{"curve": {"fwhm_deg": -1, "peak": 3}}', "fwhm_deg"),
        ('{"curve": {"fwhm_deg": 5, "peak": 1e999}}', "Number out of range"),
        ("no JSON", "the journal of a search or its result as JSON is expected"),
    ],
)
def test_a_file_that_says_nothing_of_a_curve_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(text)
    with pytest.raises(RecordError, match=message):
        former_curve(path)


def test_the_prior_of_the_width_is_that_of_the_former_marker() -> None:
    shapes = shapes_with(family(), MarkerCurve(fwhm_deg=6.0, peak=1.0))
    share = np.exp(shapes.log_prior)
    assert share.sum() == pytest.approx(1.0)
    near = np.abs(np.log(shapes.fwhm_deg / 6.0)) <= 2 * LOG_WIDTH_SIGMA
    assert 0.85 < share[near].sum() < 0.97
    assert share[~near].min() > 0


@pytest.mark.long
def test_a_second_marker_takes_fewer_acquisitions() -> None:
    counts = {}
    for prior in (None, MarkerCurve(fwhm_deg=5.0, peak=100.0)):
        rng = np.random.default_rng(3)
        taken = []
        errors = []
        for _ in range(64):
            marker_deg = rng.uniform(-30, 30)
            peak = 100 * math.exp(0.3 * rng.standard_normal())
            fwhm_deg = 5.0 * math.exp(0.15 * rng.standard_normal())
            policy = Posterior(others=0.0, prior=prior, target_sigma_deg=0.1)
            while (angle_deg := policy.ask()) is not None:
                away_deg = np.array([angle_deg - marker_deg])
                signal = peak * float(np.exp(log_curve(away_deg, fwhm_deg=fwhm_deg, tail=1.4, knee=2.2)[0]))
                envelope = max(abs(signal + complex(*rng.standard_normal(2))), 4.3 + 0.3 * rng.standard_normal())
                reading = Reading(intensity=envelope, noise_sigma=1.0, cells=12_800)
                policy.tell(Sample(angle_deg=angle_deg, reading=reading))
            taken.append(len(policy._lit))
            errors.append(abs(policy.estimate().mean_deg - marker_deg))
        assert np.mean(errors) < 0.1
        counts[prior is None] = np.mean(taken)
    assert counts[False] < counts[True] - 0.2
