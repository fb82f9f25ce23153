"""The benchmark: frozen worlds, scores of known rows, and entries beside our methods."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from markerseek.core import ConfigError, MissingExtraError
from markerseek.studies import benchmark
from markerseek.studies.benchmark import WORLDS, Entry, run_benchmark, worlds_hash
from markerseek.studies.policies import PolicySettings
from markerseek.studies.study import cells
from markerseek.studies.trial import run_trial

EXAMPLE = Path(__file__).parents[3] / "examples" / "benchmark_entry.py"


def test_the_worlds_are_frozen():
    """A change of a world is another benchmark: its results cannot be compared with those of before."""
    assert worlds_hash() == "b9d3572f6eefe97a9b69618decd56e45892b2c916423659aef66f66999361bf9"
    assert {world.tier: sum(each.tier == world.tier for each in WORLDS) for world in WORLDS} == {
        "intensities": 5,
        "block maxima": 3,
        "raw channels": 6,
    }


def world(tier, name):
    (found,) = [each for each in WORLDS if (each.tier, each.name) == (tier, name)]
    return found


def test_the_example_is_short_knows_nothing_of_us_and_finds_markers():
    text = EXAMPLE.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 30
    assert "import" not in text
    settings = benchmark._as_policy(Entry.named(f"{EXAMPLE}:Steps"), "intensities")
    study = world("intensities", "one").study("test", (settings,), searches=4)
    rows = [run_trial(study, cells(study)[0], trial, 0) for trial in range(4)]
    assert [row.answer for row in rows].count("found") >= 3
    assert all(row.error_deg is None or row.error_deg < 2.5 for row in rows if row.answer == "found")
    study = world("intensities", "none").study("test", (settings,), searches=1)
    assert run_trial(study, cells(study)[0], 0, 0).answer == "not found"


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is missing (apt-get install octave)")
def test_the_example_in_octave_finds_a_marker():
    entry = Entry.named(f"octave-cli --quiet --no-init-file {EXAMPLE.with_suffix('.m')}")
    study = world("intensities", "one").study("test", (benchmark._as_policy(entry, "intensities"),), searches=2)
    for trial in range(2):
        row = run_trial(study, cells(study)[0], trial, 0)
        assert (row.answer, row.acquisitions) == ("found", 29)
        assert row.error_deg < 2.6


def test_an_entry_is_told_the_channel_data_in_the_last_tier_only():
    entry = Entry.named("python3")
    assert {world.tier for world in WORLDS if benchmark._as_policy(entry, world.tier).channels} == {"raw channels"}


def test_scipys_optimiser_is_among_the_methods_and_finds_a_marker_whose_curve_it_sees():
    settings = PolicySettings(method=benchmark.METHODS[-1])
    assert str(settings).startswith("bounded-minimiser")
    study = world("intensities", "one").study("test", (settings,), searches=12)
    rows = [run_trial(study, cells(study)[0], trial, 0) for trial in range(12)]
    found = [row for row in rows if row.answer == "found"]
    assert found
    assert all(row.error_deg < 2.0 for row in found)


def test_a_row_is_the_same_whatever_else_is_run():
    """Common random numbers: a method meets the same marker alone, beside others, and in a larger benchmark."""
    one, others = (
        (PolicySettings(method="ternary"),),
        (PolicySettings(method="manual"), PolicySettings(method="ternary")),
    )
    small = world("intensities", "one").study("a", one, searches=1)
    large = world("intensities", "one").study("b", others, searches=9)
    alone, beside = run_trial(small, cells(small)[0], 0, 0), run_trial(large, cells(large)[0], 0, 1)
    assert (alone.truth_deg, alone.mean_deg, alone.elapsed_s) == (beside.truth_deg, beside.mean_deg, beside.elapsed_s)


def test_another_seed_is_another_benchmark():
    assert worlds_hash(7) != worlds_hash()
    policies = (PolicySettings(method="ternary"),)
    rows = []
    for given in ({}, {"seed": 7}):
        study = world("intensities", "one").study("a", policies, searches=1, **given)
        rows.append(run_trial(study, cells(study)[0], 0, 0))
    assert rows[0].truth_deg != rows[1].truth_deg


def test_the_bound_is_of_worlds_with_one_point_that_has_a_distance():
    bounds = [each for one in WORLDS for each in benchmark._bounds(one, searches=2, seed=benchmark.SEED)]
    assert {(each.tier, each.world, each.markers) for each in bounds} == {
        ("block maxima", "one", 2),
        ("raw channels", "one", 2),
    }
    less, more = (each.error_deg for each in bounds[:2])
    assert 0 < more < less < 0.2


@pytest.mark.parametrize("scale", [0, -1, math.nan])
def test_a_scale_that_is_none_is_refused_before_anything_is_announced(shell, scale):
    code, _, err = shell("benchmark", "--scale", scale)
    assert (code, err) == (
        2,
        f"error: scale is {scale}, it must lie in (0, 1000]; 1 takes the usual number of searches\n",
    )


@pytest.mark.long
def test_an_optimiser_of_another_package_is_scored_if_it_is_asked_for(two_worlds, tmp_path):
    pytest.importorskip("skopt", reason="scikit-optimize is not installed")
    results = run_benchmark(tmp_path, optimisers=["scikit-optimize"], scale=0.02, workers=1)
    assert [each.method for each in results.scores if each.world == "one"][-1] == "scikit-optimize, 16"
    with pytest.raises(ConfigError, match="--optimiser nope is unknown; there are: scikit-optimize, botorch"):
        run_benchmark(tmp_path, optimisers=["nope"])


@pytest.mark.long
@pytest.mark.skipif(find_spec("botorch") is not None, reason="BoTorch is installed")
def test_a_package_that_is_missing_is_named_by_worker_processes_too(two_worlds, tmp_path):
    with pytest.raises(MissingExtraError, match=r"the method botorch needs the package botorch.*markerseek\[botorch\]"):
        run_benchmark(tmp_path, optimisers=["botorch"], scale=0.02, workers=2)


@pytest.fixture
def two_worlds(monkeypatch):
    monkeypatch.setattr(benchmark, "WORLDS", (world("intensities", "none"), world("intensities", "one")))
    monkeypatch.setattr(benchmark, "METHODS", ("ternary", "exhaustive"))


GOOD = """
import json, sys
for line in map(json.loads, sys.stdin):
    print(json.dumps({"angle_deg": 0} if line["type"] == "search" else {"answer": "not found"}), flush=True)
"""


def test_entries_are_scored_beside_our_methods_and_a_failed_one_is_said(two_worlds, tmp_path, shell):
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "bad.py").write_text("input()\nprint('hello')")
    words = [f"{sys.executable} {tmp_path / name}.py" for name in ("good", "bad")]
    entries = [part for each in words for part in ("--entry", each)]
    command = ("benchmark", *entries, "--scale", 0.04, "--workers", 1, "--out", tmp_path / "out")
    code, _, err = shell(*command)
    assert code == 1
    assert "failed entry: bad.py, 64: in intensities, none: EntryError: it replied b'hello'" in " ".join(err.split())
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    scores = {(each["world"], each["method"]): each for each in results["scores"]}
    assert len(scores) == 6
    assert scores["none", "good.py, 64"]["right"]["share"] == 1.0
    assert scores["one", "good.py, 64"]["missed"]["share"] == 1.0
    assert scores["one", "good.py, 64"]["acquisitions"] is None
    assert scores["one", "exhaustive, 141"]["right"]["share"] == 1.0
    assert scores["one", "exhaustive, 141"]["acquisitions"] == 141.0
    assert scores["one", "exhaustive, 141"]["travel_deg"]["mean"] > 60
    assert [bool(each["failure"]) for each in results["entries"]] == [False, True]
    for name, digest in results["files"].items():
        summed = subprocess.run(["sha256sum", tmp_path / "out" / name], capture_output=True, text=True, check=True)
        assert summed.stdout.split()[0] == digest
    # What is there is not computed again.
    before = (tmp_path / "out" / "results.json").read_bytes()
    assert shell(*command, "--json")[0] == 1
    assert (tmp_path / "out" / "results.json").read_bytes() == before


def test_another_content_of_an_entry_is_another_entry(tmp_path):
    place = tmp_path / "mine.py"
    place.write_text("1")
    first = Entry.named(f"python3 {place}")
    place.write_text("2")
    assert first.label == "mine.py"
    assert first.group != Entry.named(f"python3 {place}").group


@pytest.mark.parametrize("text", ["", "'", "nowhere.py:Steps", "picture.png", "no-such-program --fast"])
def test_what_names_no_entry_is_refused(text):
    with pytest.raises(ConfigError, match="--entry"):
        Entry.named(text)
