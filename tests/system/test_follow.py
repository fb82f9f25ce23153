"""``markerseek follow``, from its words to its output, in the simulated room."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from markerseek.following import FollowBegun, FollowedRoom, FollowEnded, TargetPath, follow_record
from markerseek.registration import SessionRecord, SimulatedRoomSettings, newest_pair
from markerseek.sim import STREAMING
from tests import registration_sessions as sessions

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


def test_a_pixel_is_matched_and_the_probe_turns_to_it_once(shell: Shell, tmp_path: Path) -> None:
    record = tmp_path / "run.jsonl"
    code, out, err = shell("follow", "--simulate", "--pixel", 700, 480, "--seconds", 6, "--record", record, "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["states"] == ["resting", "there", "turning", "waiting"]
    # 5.5 deg are two turns, the second of which begins inside the range.
    assert said["turns"] == 2
    assert said["simulation"]["mean_off_deg"] < 1.0
    begun, *steps, ended = follow_record(record, is_over=lambda: True, wait=lambda: None)
    assert isinstance(begun, FollowBegun)
    assert begun.what.startswith("the place at 700, 480 of the left image, 10")
    assert {step.word for step in steps} == set(said["states"])
    assert ended == FollowEnded(said="")


def session_of(folder: Path, made: FollowedRoom) -> None:
    """A simulated session that ended with a registration of this room."""
    begun = structs.replace(sessions.BEGUN, seed=1)
    record = SessionRecord.create(folder, begun)
    record.add(structs.replace(sessions.registered(4), report=made.registration().report))
    record.add(sessions.ENDED)
    record.close()


def test_a_simulated_session_is_followed_with_in_its_own_room(shell: Shell, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    session_of(folder, FollowedRoom(SimulatedRoomSettings(rig=STREAMING), TargetPath(motion="still"), seed=1))
    asked = ("follow", "--simulate", "--registration", folder, "--pixel", 700, 480, "--seconds", 4)
    code, out, err = shell(*asked, "--still-valid", "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["last"]["word"] == "there"
    assert said["simulation"]["mean_off_deg"] < 1.0
    # For those who look on, as a session does it.
    assert newest_pair(folder) is not None
    code, _, err = shell(*asked, "--still-valid", "--seed", 2)
    assert code == 2
    assert "--seed is 2, and " in err
    code, out, err = shell(*asked)
    assert code == 2
    assert "add --still-valid if neither probe nor camera" in " ".join(err.split())


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
        (
            ("--simulate", "--spot", "--tip", "simulated"),
            "--tip, --point and --pixel each name what is followed",
        ),
        (("--simulate", "--pixel", 10, 500), "--pixel is 10, 500, which cannot be followed: the place at 10, 500 of"),
        (("--simulate", "--pixel", 1400, 500), "--pixel is 1400, 500; it must lie in the left image, of 1280 x 1024"),
        (("--simulate", "--still-valid"), "--still-valid needs --registration SESSION of a simulated session"),
        (("--simulate", "--moves", "up"), "--moves up is none of still, sine, steps, jump, lost"),
        (("--simulate", "--tip", "topic:/x"), "with --simulate there is a simulated tip"),
        (("--simulate", "--point", 1, 2, 3), "--point is for a rig of devices"),
        (("--simulate", "--tool-offset-mm", 1, 2, 3), "--tool-offset-mm is of a robot's tip"),
        (("--simulate", "--tip-sigma-mm", 1), "--tip-sigma-mm is of a robot's tip"),
        (("--simulate", "--tip", "simulated", "--tip-sigma-mm", 30), "--tip-sigma-mm is 30.0 mm, it must lie in"),
        (("--simulate", "--tip", "simulated", "--tip-sigma-mm", 2), "the simulated one has its own, leave it out"),
        (("--simulate", "--tip", "simulated", "--tool-offset-mm", 0, 0, 9), "--tool-offset-mm is of a robot's tip"),
        (("--simulate", "--calibration-sigma-px", 0.2), "--calibration-sigma-px belongs to a calibration"),
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
