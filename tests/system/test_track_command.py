"""``markerseek track``: the rig finds a marker, the marker moves, and the rig follows it."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pytest

RIGS = Path(__file__).parents[2] / "examples" / "rigs"


def test_a_marker_is_followed_and_drawn(shell, tmp_path):
    words = ("track", "--rig", RIGS / "direct-drive.toml", "--speed-deg-per-s", 10, "--duration-s", 2)
    code, out, err = shell(*words, "--plot", "--out", tmp_path, "--json")
    report = json.loads(out)
    assert (code, report["lost"]) == (0, False), err
    assert report["rms_error_deg"] < 0.4
    assert report["frames_per_s"] > 5
    errors = [each["angle_deg"] - each["truth_deg"] for each in report["track"]]
    assert report["rms_error_deg"] == pytest.approx((sum(each**2 for each in errors) / len(errors)) ** 0.5)
    # It moves to and fro, and turns within two seconds.
    assert max(each["truth_deg"] for each in report["track"]) > 10
    assert (tmp_path / "track.png").stat().st_size > 10_000


@pytest.mark.long
@pytest.mark.parametrize(("rig", "most_hz"), [("prm1z8-limits.toml", 20), ("prm1z8-100-hz.toml", 100)])
def test_a_marker_is_followed_while_the_probe_turns(shell, tmp_path, rig, most_hz):
    words = ("track", "--sweep", "--rig", RIGS / rig, "--speed-deg-per-s", 1, "--duration-s", 3)
    code, out, err = shell(*words, "--plot", "--out", tmp_path, "--json")
    report = json.loads(out)
    assert (code, report["lost"], report["swept"]) == (0, False, True), err
    assert report["rms_error_deg"] < 0.6
    assert 0.5 * most_hz < report["frames_per_s"] <= most_hz
    errors = [abs(each["angle_deg"] - each["truth_deg"]) for each in report["track"]]
    covered = [error <= 1.96 * each["sigma_deg"] for error, each in zip(errors, report["track"], strict=True)]
    assert report["covered"] == pytest.approx(sum(covered) / len(covered))
    # The probe turns from frame to frame.
    probe = [each["probe_deg"] for each in report["track"]]
    assert sum(before != after for before, after in pairwise(probe)) > 0.9 * len(probe)
    assert (tmp_path / "track.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--sweep", "--readout-s", 10), "reads its frames for 10 s after each sweep"),
        (("--speed-deg-per-s", "nan"), "moving marker: speed_deg_s is nan deg/s"),
        (("--speed-deg-per-s", 21), "moving marker: speed_deg_s is 21"),
        (("--duration-s", 0), "--duration-s is 0"),
        (("--marker-deg", 30), "out of the search range"),
        (("--rig", RIGS / "bench.toml"), "only a simulated marker can be made to move"),
    ],
)
def test_what_cannot_be_followed_is_refused(shell, words, said):
    code, _, err = shell("track", *words)
    assert code == 2, err
    assert said in " ".join(err.split())
