"""``markerseek follow``, from its words to its output, in the simulated room."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

Shell = Callable[..., tuple[int, str, str]]


def test_a_tip_is_followed_and_drawn(shell: Shell, tmp_path: Path) -> None:
    code, out, err = shell("follow", "--simulate", "--seconds", 12, "--plot", "--out", tmp_path, "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["last"]["word"] in ("there", "turning", "resting")
    assert said["turns"] >= 3
    assert said["simulation"]["mean_off_deg"] < 1.0
    assert said["simulation"]["inside"] > 0.8
    assert len(said["last"]["davinci_to_trus"]) == 4
    assert (tmp_path / "follow.png").stat().st_size > 10_000


@pytest.mark.parametrize("motion", ["lost", "jump"])
def test_a_target_that_is_gone_or_jumps_is_said_by_its_name(shell: Shell, motion: str) -> None:
    code, out, err = shell("follow", "--simulate", "--moves", motion, "--seconds", 11)
    word = {"lost": "lost", "jump": "jumped"}[motion]
    assert code == 0
    assert f"{word}: the target" in err
    assert err.count("follows the target") == 2
    assert word in out


@pytest.mark.long
def test_a_spot_confirms_the_registration(shell: Shell) -> None:
    code, out, err = shell("follow", "--simulate", "--spot", "--moves", "still", "--seconds", 10, "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["states"] == ["resting", "there", "turning", "waiting"]
    # The last frame agrees with the registration, too.
    assert said["confirmed"].startswith("the source is")
    assert said["last"]["davinci_to_trus"] is not None
    assert said["simulation"]["mean_off_deg"] < 4.0


def test_a_permit_that_is_over_needs_a_person(shell: Shell) -> None:
    code, out, _ = shell("follow", "--simulate", "--minutes", 0.05, "--json")
    assert code == 3
    said = json.loads(out)
    assert said["last"]["word"] == "expired"
    assert "a person must renew it" in said["ended"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "nothing to follow with: name a registration by --registration FOLDER and a rig by --rig RIG.toml"),
        (("--simulate", "--spot", "--tip", "simulated"), "--spot, --tip and --point each name what is followed"),
        (("--simulate", "--moves", "up"), "--moves up is none of still, sine, steps, jump, lost"),
        (("--simulate", "--tip", "topic:/x"), "with --simulate there is a simulated tip"),
        (("--simulate", "--point", 1, 2, 3), "--point is for a rig of devices"),
        (("--simulate", "--tool-offset-mm", 1, 2, 3), "--tool-offset-mm is of a robot's tip"),
        (("--simulate", "--within-deg", 0.1), "--within-deg is 0.1 deg, it must lie in [0.2, 20] deg"),
        (("--simulate", "--speed-deg-s", 30), "speed_deg_s is 30 deg/s, this stage turns with at most 25 deg/s"),
        (("--registration", "x", "--rig", "examples/rigs/bench.toml"), "nothing to follow: name it by --spot, --tip"),
        (("--simulate", "--seconds", -1), "--seconds is -1.0 s, it must lie in [0, 86400] s"),
        (("--simulate", "--endoscope-held"), "--endoscope-held is for a rig of devices"),
        (
            ("--registration", "x", "--rig", "examples/rigs/bench.toml", "--point", 1, 2, 3, "--images", "a b"),
            "--cameras FILE and --images 'LEFT RIGHT' belong together",
        ),
        (
            ("--registration", "x", "--rig", "examples/rigs/bench.toml", "--point", 1, 2, 3, "--error-mm", 1),
            "options of a simulation, and examples/rigs/bench.toml is a rig",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_cure(shell: Shell, words: tuple[object, ...], said: str) -> None:
    code, out, err = shell("follow", *words)
    assert code == 2
    assert out == ""
    assert said in " ".join(err.split())
