"""The settings of a study, the draws of its trials, its rows and its summary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy import stats

from markerseek.core import ConfigError
from markerseek.sim import MarkerSettings, NoiseSettings, SimulatedSettings
from markerseek.studies import (
    Axis,
    CurveSettings,
    Row,
    Study,
    cells,
    read_study,
    run_row,
    run_trial,
    study_policy,
    summarise,
    values_of,
)
from markerseek.studies.runner import as_csv, chunks, run_chunk
from markerseek.studies.summary import compared_pairs
from markerseek.studies.worlds import draw_trial

EXAMPLES = Path(__file__).parents[3] / "examples" / "studies"

TERNARY = study_policy(method="ternary", acquisitions=8, as_published=True)
AVERAGE = study_policy(method="weighted-average", acquisitions=15, as_published=True)
SMALL = Study(
    name="small",
    policies=(TERNARY, AVERAGE),
    trials=5,
    curve=CurveSettings(family="sech", fwhm_deg=8.0),
    vary=(Axis(key="rig.noise.peak_snr_db", values=(30.0, 50.0)),),
)


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def all_rows(study: Study) -> list[Row]:
    return [run_row(study, row) for row in range(study.rows)]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
@pytest.mark.usefixtures("notes_allowed")
def test_the_examples_are_studies(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(path.parents[1])
    study = read_study(path)
    assert study.name == path.stem
    assert study.rows == len(cells(study)) * study.trials * len(study.policies)


def test_a_file_becomes_the_study_that_it_says(tmp_path: Path) -> None:
    text = """
    version = 1
    trials = 5
    [[policies]]
    method = "ternary"
    acquisitions = [8, 10]
    as_published = true
    [curve]
    family = "sech"
    fwhm_deg = 8
    [rig.noise]
    coloured = 0.5
    [vary]
    rig.noise.peak_snr_db = [30, 50.0]
    "rig.probe.elevation_focus_m" = [0.03, "none"]
    """
    study = read_study(write(tmp_path, text))
    assert study == Study(
        name="mine",
        policies=(TERNARY, study_policy(method="ternary", acquisitions=10, as_published=True)),
        trials=5,
        curve=CurveSettings(family="sech", fwhm_deg=8.0),
        rig=SimulatedSettings(noise=NoiseSettings(coloured=0.5)),
        vary=(
            Axis(key="rig.noise.peak_snr_db", values=(30, 50.0)),
            Axis(key="rig.probe.elevation_focus_m", values=(0.03, None)),
        ),
    )
    assert [cell.world.rig.noise.peak_snr_db for cell in cells(study)] == [30.0, 30.0, 50.0, 50.0]
    assert [cell.world.rig.probe.elevation_focus_m for cell in cells(study)] == [0.03, None, 0.03, None]
    assert all(cell.world.rig.noise.coloured == 0.5 for cell in cells(study))


POLICY = '[[policies]]\nmethod = "ternary"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there are no policies"),
        (POLICY + POLICY, "a policy is named twice"),
        ("trails = 5\n" + POLICY, "key trails is unknown; did you mean trials?"),
        ('[[policies]]\nmehtod = "ternary"\n', "key policies.mehtod is unknown; did you mean policies.method?"),
        ('[[policies]]\nmethod = "ternery"\n', "did you mean ternary?"),
        ('[[policies]]\nmethod = "ternary"\nacquisitions = [16, 1]\n', "acquisitions is 1, at least 2"),
        ('[[policies]]\nmethod = "ternary"\nacquisitions = []\n', "acquisitions of ternary is an empty list; give at"),
        ('policies = "ternary"\n', r"headed \[\[policies\]\]"),
        (POLICY + "[rig.nois]\n", "key rig.nois is unknown; did you mean rig.noise?"),
        (POLICY + '[curve]\nfamily = "cosine"\n', "curve.family is 'cosine', it must be one of: acoustic, "),
        (POLICY + "[curve]\nfwhm_deg = nan\n", "fwhm_deg is nan"),
        (POLICY + "[curve]\ndraws = 0\n", "draws is 0"),
        (POLICY + "[vary]\nrig.noise.peak_snr = [30]\n", "rig.noise.peak_snr is unknown; did you mean"),
        (POLICY + '[vary]\nrig.noise.peak_snr_db = ["loud"]\n', "peak_snr_db is text, it must be a number"),
        (POLICY + "[vary]\nrig.noise.peak_snr_db = 30\n", "a list of values is needed"),
        (POLICY + "[vary]\nrig.noise.peak_snr_db = []\n", "has no values"),
        (POLICY + "[vary]\nrig.noise.peak_snr_db = [30, 30.0]\n", "names a value twice"),
        (POLICY + "[vary]\nrig.noise.peak_snr_db = [300]\n", "must lie in \\[-20, 100\\] dB"),
        (POLICY + "[vary]\nrig.tissue.x = [1]\n", "tissue has no settings of its own"),
        (POLICY + "[rig.noise.bursts]\nframe_probability = 0.1\n", 'set level = "frames"'),
        ('level = "frames"\n' + POLICY + "[vary]\ncurve.power = [1.0]\n", "have no effect at the level frames"),
        ("trials = 0\n" + POLICY, "trials is 0"),
        ("seed = -1\n" + POLICY, "seed is -1"),
        ("version = 2\n" + POLICY, "version is 2, this package reads version 1"),
        ("trials = 1.5\n" + POLICY, "trials is a number, it must be a whole number"),
    ],
)
def test_a_study_with_a_fault_is_refused_with_file_key_and_cure(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read_study(write(tmp_path, text))
    assert "mine.toml" in str(caught.value)


def test_the_hash_covers_the_settings_of_the_study_and_nothing_else() -> None:
    again = structs.replace(SMALL, vary=(Axis(key="rig.noise.peak_snr_db", values=(30.0, 50.0)),))
    assert again.digest == SMALL.digest
    others = [
        structs.replace(SMALL, seed=2),
        structs.replace(SMALL, trials=6),
        structs.replace(SMALL, policies=(AVERAGE, TERNARY)),
        structs.replace(SMALL, rig=SimulatedSettings(marker=MarkerSettings(radius_m=0.05))),
    ]
    assert len({SMALL.digest, *(other.digest for other in others)}) == 5


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**40),
    trial=st.integers(0, 4),
    policies=st.permutations([TERNARY, AVERAGE, study_policy(method="manual")]),
)
def test_the_draws_of_a_trial_depend_only_on_seed_cell_and_number(
    seed: int, trial: int, policies: list[study_policy]
) -> None:
    one = structs.replace(SMALL, seed=seed)
    other = structs.replace(
        one,
        name="other",
        trials=77,
        level="frames",
        policies=tuple(policies),
        vary=(Axis(key="rig.noise.peak_snr_db", values=(20.0, 50.0, 30.0)),),
    )
    assert draw_trial(one, cells(one)[0], trial) == draw_trial(other, cells(other)[2], trial)
    assert draw_trial(one, cells(one)[0], trial) != draw_trial(one, cells(one)[1], trial)
    assert draw_trial(one, cells(one)[0], trial) != draw_trial(one, cells(one)[0], trial + 1)


def test_markers_are_drawn_uniformly_over_the_search_range() -> None:
    cell = cells(SMALL)[0]
    drawn = [draw_trial(SMALL, cell, trial) for trial in range(2000)]
    assert stats.kstest([draw.marker_deg for draw in drawn], stats.uniform(-35, 70).cdf).pvalue > 0.01
    assert stats.kstest([draw.lateral_m for draw in drawn], stats.uniform(-0.02, 0.04).cdf).pvalue > 0.01
    assert len({draw.noise_seed for draw in drawn}) == 2000


def test_policies_of_one_trial_search_in_the_same_world() -> None:
    """Also in noise: two policies whose first angle is the same receive the same frame there."""
    same = structs.replace(
        SMALL,
        policies=(
            AVERAGE,
            study_policy(method="weighted-average", acquisitions=15, as_published=True, early_end=False),
        ),
        vary=(),
        trials=8,
    )
    for trial in range(8):
        early, full = (run_trial(same, cells(same)[0], trial, policy) for policy in (0, 1))
        assert early.truth_deg == full.truth_deg
        assert early.noise_seed == full.noise_seed
        assert early.acquisitions is not None
        assert full.acquisitions == 15 >= early.acquisitions


def test_a_fault_of_a_device_is_a_row_without_an_angle() -> None:
    """A converter that is filled sixteen times over refuses every frame near the marker."""
    saturating = SimulatedSettings()
    saturating = structs.replace(
        saturating,
        marker=MarkerSettings(angle_deg=0.0, lateral_m=0.0),
        receiver=structs.replace(saturating.receiver, peak_counts=30_000.0),
    )
    study = Study(name="loud", level="frames", trials=1, policies=(TERNARY,), rig=saturating)
    row = run_row(study, 0)
    assert (row.answer, row.mean_deg, row.error_deg, row.acquisitions) == ("failed", None, None, None)
    assert row.truth_deg == 0.0
    assert "full scale" in (row.fault or "")


def test_chunks_cover_every_trial_once_and_in_order() -> None:
    study = structs.replace(SMALL, trials=1203, policies=(TERNARY, AVERAGE))
    assert [trial for piece in chunks(study) for trial in piece] == list(range(2406))
    lines = b"".join(run_chunk(SMALL, piece) for piece in chunks(SMALL))
    assert lines == as_csv(values_of(row) for row in all_rows(SMALL))


def test_a_summary_agrees_with_its_rows() -> None:
    study = structs.replace(SMALL, trials=40)
    rows = all_rows(study)
    summary = summarise(study, rows)
    assert summary.rows == study.rows
    for said in summary.policies:
        mine = [row for row in rows if (row.cell, row.policy) == (said.cell, said.policy)]
        errors = [row.error_deg for row in mine]
        assert said.trials == len(mine) == 40
        assert said.error_deg.mean == pytest.approx(np.mean(errors))  # type: ignore[arg-type]
        assert said.error_deg.interval95 == pytest.approx(
            stats.t.interval(0.95, 39, loc=np.mean(errors), scale=stats.sem(errors))  # type: ignore[arg-type]
        )
        assert said.wrong_claims.hits == sum(error > 2 * mine[0].tolerance_deg for error in errors)  # type: ignore[operator]
        assert said.travel_deg.mean == pytest.approx(np.mean([row.travel_deg for row in mine]))  # type: ignore[arg-type]
        assert said.answers["found"].share == 1.0
    for pair in summary.differences:
        one, other = (
            np.array([row.error_deg for row in rows if (row.cell, row.policy) == (pair.cell, policy)])
            for policy in (pair.policy, pair.other)
        )
        paired = stats.ttest_rel(one, other).confidence_interval(0.95)
        assert pair.error_deg.interval95 == pytest.approx((paired.low, paired.high))


def test_a_marker_found_where_there_is_none_is_counted_and_has_no_error() -> None:
    checked = study_policy(method="weighted-average", acquisitions=29)
    nothing = SimulatedSettings(marker=MarkerSettings(present=False))
    study = Study(
        name="nothing", trials=10, policies=(TERNARY, checked), rig=nothing, curve=CurveSettings(family="sech")
    )
    published_row, checked_row = summarise(study, all_rows(study)).policies
    assert (published_row.false_found.hits, published_row.false_found.count, published_row.error_deg.count) == (
        10,
        10,
        0,
    )
    assert checked_row.answers["not found"].hits == 10
    assert (checked_row.false_found.hits, checked_row.false_found.count) == (0, 10)


def test_many_policies_are_compared_at_equal_acquisitions() -> None:
    many = tuple(
        study_policy(method=method, acquisitions=number)
        for method in ("ternary", "golden-section")
        for number in (8, 12, 16, 20)
    )
    assert compared_pairs(many) == [(0, 4), (1, 5), (2, 6), (3, 7)]
    assert len(compared_pairs(many[:6])) == 15
