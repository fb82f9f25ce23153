"""Studies with every parameter drawn: the draws, the rows, the summary, and the figure of errors."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import structs
from scipy import stats

from markerseek.core import ConfigError
from markerseek.sim import MarkerSettings, NoiseSettings, SimulatedSettings
from markerseek.studies import (
    Row,
    Study,
    cells,
    columns,
    error_figure,
    read_rows,
    run_row,
    study_policy,
    summarise,
    unknowns,
    values_of,
)
from markerseek.studies.runner import as_csv
from markerseek.studies.worlds import draw_trial, expected_angle_deg, former_rig

TERNARY = study_policy(method="ternary", acquisitions=6, as_published=True)
AVERAGE = study_policy(method="weighted-average", acquisitions=9, as_published=True)
POSTERIOR = study_policy(method="posterior", acquisitions=4, early_end=False)
DRAWN = Study(
    name="drawn",
    policies=(TERNARY, AVERAGE, POSTERIOR),
    trials=3,
    level="frames",
    drawn="everything",
    marks=(2, 4, 8),
)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"level": "curves"}, 'level "curves" cannot have drawn = "everything"'),
        ({"marks": (2, 2)}, "must be positive and rise"),
        ({"marks": (0, 2)}, "must be positive and rise"),
        (
            {"rig": SimulatedSettings(marker=MarkerSettings(radius_m=50e-3))},
            "radius_m is drawn in each trial",
        ),
    ],
)
def test_what_cannot_be_studied_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        structs.replace(DRAWN, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("setting", "label"),
    [
        ({"cues": ("intensity",)}, "posterior, 4, no early end, intensity only"),
        ({"others": 0.0}, "posterior, 4, no early end, single"),
        ({"prior": True}, "posterior, 4, no early end, with prior"),
        ({"near_sigma_deg": 2.0, "near_off_deg": 15.0}, "posterior, 4, no early end, near ± 2°, 15° off"),
    ],
)
def test_some_settings_are_the_posteriors(setting: dict[str, object], label: str) -> None:
    assert str(study_policy(method="posterior", acquisitions=4, early_end=False, **setting)) == label
    with pytest.raises(ConfigError, match="only the posterior has this setting"):
        study_policy(method="ternary", acquisitions=6, as_published=True, **setting)


@pytest.mark.long
def test_a_prior_is_the_curve_of_another_marker_on_the_same_rig() -> None:
    # A tolerance that the curve of the former marker helps to reach.
    policy = study_policy(method="posterior", others=0.0, tolerance_mm=0.2)
    study = structs.replace(
        DRAWN, policies=(policy, structs.replace(policy, prior=True)), marks=(), trials=12, stay=True
    )
    cell = cells(study)[0]
    former = former_rig(study, cell, 0)
    drawn = draw_trial(study, cell, 0)
    assert former.facts.truth_deg != drawn.marker_deg
    rows = [run_row(study, row) for row in range(study.rows)]
    without = rows[::2]
    with_prior = rows[1::2]
    # the same marker and the same first angle, then another search
    assert [row.truth_deg for row in without] == [row.truth_deg for row in with_prior]
    assert sum(a.mean_deg != b.mean_deg for a, b in zip(without, with_prior, strict=True)) >= 8
    assert sum(row.acquisitions or 0 for row in with_prior) <= sum(row.acquisitions or 0 for row in without)


def test_a_prior_over_the_angle_errs_as_it_says_and_is_off_besides() -> None:
    cell = cells(DRAWN)[0]
    off = []
    for trial in range(400):
        truth_deg = draw_trial(DRAWN, cell, trial).marker_deg
        expected_deg = expected_angle_deg(DRAWN, cell, trial, truth_deg=truth_deg, sigma_deg=2.0, off_deg=15.0)
        # Inwards, where it stays in the range.
        off.append((expected_deg - truth_deg) * (-1 if truth_deg > 0 else 1))
    assert np.mean(off) == pytest.approx(15.0, abs=0.35)
    assert np.std(off) == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"near_off_deg": 5.0}, "near_off_deg is 5.0 deg without near_sigma_deg"),
        ({"near_sigma_deg": 0.0}, "near: sigma_deg is 0.0 deg"),
        ({"near": "12±2"}, "policies.near"),
    ],
)
def test_a_prior_over_the_angle_that_cannot_be_used_is_refused(keys: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        study_policy(method="posterior", **keys)


def test_everything_is_drawn_over_the_ranges_of_the_table() -> None:
    cell = cells(DRAWN)[0]
    drawn = [draw_trial(DRAWN, cell, trial) for trial in range(1500)]
    rigs = [draw.unknowns for draw in drawn]
    assert all(rig is not None for rig in rigs)
    # type: ignore[union-attr]
    probes = [rig.model.probe for rig in rigs]
    media = [rig.model.medium for rig in rigs]
    even = {
        unknowns.ELEMENT_HEIGHT_M: [probe.element_height_m for probe in probes],
        unknowns.FOCUS_M: [f for probe in probes if (f := probe.elevation_focus_m) is not None],
        unknowns.FACE_RADII_M: [probe.face_radius_m for probe in probes],
        unknowns.SOUND_SPEEDS_M_S: [medium.sound_speed_m_s for medium in media],
        unknowns.ATTENUATION_DB_CM_MHZ: [medium.attenuation_db_cm_mhz for medium in media],
        unknowns.TRIGGER_OFFSET_S: [rig.model.trigger_offset_s for rig in rigs],  # type: ignore[union-attr]
        unknowns.CENTRE_HZ: [rig.model.band.centre_hz for rig in rigs],  # type: ignore[union-attr]
        unknowns.MARKER_RADIUS_M: [rig.marker.radius_m for rig in rigs],  # type: ignore[union-attr]
        (-35.0, 35.0): [rig.marker.angle_deg for rig in rigs],  # type: ignore[union-attr]
        tuple(map(math.log, unknowns.SOURCE_RADIUS_M)): [
            math.log(rig.marker.source.radius_m)  # type: ignore[union-attr]
            for rig in rigs
        ],
    }
    for (low, high), values in even.items():
        assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 1e-3, (low, high)
    pulses = [rig.pulses for rig in rigs]  # type: ignore[union-attr]
    assert (min(pulses), max(pulses)) == (1, 128)
    assert np.median(pulses) == pytest.approx(math.sqrt(128), rel=0.2)
    assert np.mean([probe.elevation_focus_m is None for probe in probes]) == pytest.approx(0.2, abs=0.04)


def test_rows_keep_marks_and_intervals_and_are_read_back(tmp_path: Path) -> None:
    rows = [run_row(DRAWN, row) for row in range(DRAWN.rows)]
    assert [run_row(DRAWN, row) for row in (1, 5)] == [rows[1], rows[5]]
    for row in rows:
        assert len(row.marks_deg) == 3
        assert row.low_deg is None or row.low_deg <= row.mean_deg <= row.high_deg  # type: ignore[operator]
        if row.acquisitions <= 8:  # type: ignore[operator]
            assert row.marks_deg[-1] == row.mean_deg
    # a bracket after four acquisitions is that of a search of four
    short = structs.replace(
        DRAWN,
        policies=(structs.replace(TERNARY, plan=structs.replace(TERNARY.plan, acquisitions=4)),),
        marks=(),
    )
    for trial in range(3):
        assert run_row(short, trial).mean_deg == rows[3 * trial].marks_deg[1]
    path = tmp_path / "rows.csv"
    path.write_bytes(as_csv([columns(DRAWN), *(values_of(row) for row in rows)]))
    assert list(read_rows(path, DRAWN)) == rows


def made(**changes: object) -> Row:
    row = {
        "study": "", "row": 0, "cell": 0, "trial": 0, "policy": 0, "settings": (), "method": "ternary",
        "acquisitions_most": 6, "as_published": True, "early_end": True, "noise_seed": 0, "answer": "found",
        "mean_deg": 1.0, "truth_deg": 0.0, "error_deg": 1.0, "sigma_deg": 0.2, "low_deg": 0.5, "high_deg": 1.5,
        "marks_deg": (4.0, 2.0), "acquisitions": 6, "refused": 0, "travel_deg": 70.0, "elapsed_s": 1.0,
    }  # fmt: skip
    return Row(**{**row, **changes})  # type: ignore[arg-type]


def test_every_marker_counts_whatever_the_answer() -> None:
    study = structs.replace(DRAWN, policies=(TERNARY,), marks=(2, 4), trials=7)
    rows = [
        made(),
        made(mean_deg=0.1, error_deg=0.1, low_deg=-0.2, high_deg=0.3),
        made(answer="not found", mean_deg=6.0, error_deg=6.0, low_deg=None, high_deg=None, sigma_deg=None),
        made(answer="unsure", mean_deg=-3.0, error_deg=3.0, low_deg=-5.0, high_deg=0.5),
        made(answer="found", mean_deg=5.0, error_deg=5.0, low_deg=4.0, high_deg=6.0),
        made(mean_deg=1.9, error_deg=1.9, low_deg=1.5, high_deg=2.4, tolerance_deg=0.9),
        made(answer="failed", mean_deg=None, error_deg=None, low_deg=None, high_deg=None, marks_deg=()),
    ]
    rows = [msgspec.structs.replace(row, trial=trial) for trial, row in enumerate(rows)]
    (said,) = summarise(study, rows).policies
    assert said.any_error_deg.mean == pytest.approx(np.mean([1, 0.1, 6, 3, 5, 1.9]))
    assert (said.missed.hits, said.missed.count) == (1, 7)
    # Beyond twice the tolerance, which is an angle at the marker's own distance from the axis.
    assert said.wrong_claims.hits == 2
    assert (said.covered.hits, said.covered.count) == (2, 5)
    assert said.false_found.count == 0
    assert [mean.mean for mean in said.marks_deg] == [4.0, 2.0]
    nothing = [made(truth_deg=None, error_deg=None), made(truth_deg=None, error_deg=None, answer="not found", trial=1)]
    (said,) = summarise(study, nothing).policies
    assert (said.false_found.hits, said.false_found.count, said.missed.count) == (1, 2, 0)


def test_the_figure_has_a_line_for_each_policy_and_the_bound() -> None:
    pytest.importorskip("matplotlib")
    study = structs.replace(
        DRAWN,
        policies=(TERNARY, AVERAGE, study_policy(method="weighted-average", acquisitions=5, as_published=True)),
        marks=(2, 4),
        trials=2,
    )
    summary = summarise(study, [run_row(study, row) for row in range(study.rows)])
    figure = error_figure([(study, summary)], bounds={0: ((2, 4), (0.1, 0.05))})
    (axes,) = figure.axes
    drawn = {tuple(line.get_xdata()) for line in axes.get_lines()}
    assert {(2.0, 4.0, 6.0), (5.0, 9.0), (2.0, 4.0)} <= drawn
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["ternary as published", "weighted-average as published", "bound, best angles"]


def test_policies_of_one_number_of_acquisitions_stand_side_by_side_in_the_figure() -> None:
    pytest.importorskip("matplotlib")
    others = [study_policy(method=method, acquisitions=6) for method in ("golden-section", "weighted-average")]
    study = structs.replace(DRAWN, policies=(TERNARY, *others), marks=(), trials=2)
    (axes,) = error_figure([(study, summarise(study, [run_row(study, row) for row in range(study.rows)]))]).axes
    at = sorted(float(line.get_xdata()[0]) for line in axes.get_lines() if line.get_marker() in "osD")
    assert at == pytest.approx([5.9, 6.0, 6.1])


def test_without_a_marker_there_is_no_truth() -> None:
    nothing = SimulatedSettings(marker=MarkerSettings(present=False), noise=NoiseSettings(peak_snr_db=30.0))
    row = run_row(structs.replace(DRAWN, rig=nothing, marks=()), 2)
    assert (row.truth_deg, row.error_deg) == (None, None)
    assert row.answer == "not found"


def test_the_timing_is_drawn_beside_everything_else_and_the_rig_knows_nothing_of_it() -> None:
    settings = SimulatedSettings()
    drawn = [unknowns.with_timing(settings, np.random.default_rng(seed)) for seed in range(200)]
    for name, (low, high) in (
        ("stamp_delay_s", unknowns.STAMP_DELAY_S),
        ("stamp_jitter_s", unknowns.STAMP_JITTER_S),
        ("energy_drift_per_min", unknowns.DRIFT_PER_MIN),
    ):
        values = [getattr(each.laser, name) for each in drawn]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    backlash_deg = [each.stage.backlash_deg for each in drawn]
    assert 0.05 <= min(backlash_deg) < 0.07 < 0.18 < max(backlash_deg) <= 0.2
    assert {each.stage.stated_backlash_deg for each in drawn} == {settings.stage.backlash_deg}
    assert {(each.laser.without_light, each.laser.stamp_delay_sigma_s) for each in drawn} == {(0.01, None)}
