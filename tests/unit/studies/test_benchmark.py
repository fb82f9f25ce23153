"""The benchmark: frozen worlds, scores of known rows, and entries beside our methods."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from markerseek.core import ConfigError
from markerseek.studies import Share, benchmark
from markerseek.studies.benchmark import WORLDS, Entry, run_benchmark, worlds_hash
from markerseek.studies.policies import study_policy
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


def test_another_seed_is_another_benchmark():
    assert worlds_hash(7) != worlds_hash()
    policies = (study_policy(method="ternary"),)
    rows = []
    for given in ({}, {"seed": 7}):
        study = world("intensities", "one").study("a", policies, searches=1, **given)
        rows.append(run_trial(study, cells(study)[0], 0, 0))
    assert rows[0].truth_deg != rows[1].truth_deg


@pytest.mark.parametrize("scale", [0, -1, math.nan])
def test_a_scale_that_is_none_is_refused_before_anything_is_announced(shell, scale):
    code, _, err = shell("benchmark", "--scale", scale)
    assert (code, err) == (
        2,
        f"error: scale is {scale}, it must lie in (0, 1000]; 1 takes the usual number of searches\n",
    )


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
    code, out, err = shell(*command)
    assert code == 1
    assert "EntryError: it replied b'hello'" in " ".join(err.split())
    # Where nobody looks on: what is done, line by line.
    assert "searches: 32 to do" in err
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert f"seed: {results['seed']}" in out
    assert results["seed"] != benchmark.SEED
    scores = {(each["world"], each["method"]): each for each in results["scores"]}
    assert len(scores) == 6
    assert scores["none", "good.py, 64"]["right"]["share"] == 1.0
    assert scores["one", "good.py, 64"]["missed"]["share"] == 1.0
    assert scores["one", "good.py, 64"]["acquisitions"] is None
    assert scores["one", "exhaustive, 141"]["acquisitions"] == 141.0
    assert scores["one", "exhaustive, 141"]["travel_deg"]["mean"] > 60
    totals = {each["method"]: each for each in results["totals"]}
    assert (totals["good.py, 64"]["searches"], totals["good.py, 64"]["right"]["hits"]) == (8, 4)
    assert totals["exhaustive, 141"]["acquisitions"] == 141.0
    assert [bool(each["failure"]) for each in results["entries"]] == [False, True]
    for name, digest in results["files"].items():
        summed = subprocess.run(["sha256sum", tmp_path / "out" / name], capture_output=True, text=True, check=True)
        assert summed.stdout.split()[0] == digest
    # What is there is not computed again.
    before = (tmp_path / "out" / "results.json").read_bytes()
    assert shell(*command, "--json")[0] == 1
    assert (tmp_path / "out" / "results.json").read_bytes() == before
    # The same seed gives the same rows.
    again = run_benchmark(
        tmp_path / "again", entries=[Entry.named(words[0])], scale=0.04, seed=results["seed"], workers=1
    )
    assert again.worlds == results["worlds"]
    assert {each.right for each in again.scores} == {
        msgspec.convert(each["right"], Share, strict=False) for each in results["scores"]
    }


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
