"""`markerseek search --sweep`: how it searches, what it says before it moves, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

Shell = Callable[..., tuple[int, str, str]]


def test_a_marker_is_found_by_a_sweep_and_the_journal_holds_each_pulse(shell: Shell, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    words = ("--marker-deg", 12, "--readout-s", 0.05, "--seed", 3, "--journal", journal)
    code, out, err = shell("search", "--sweep", *words, "--json")
    result = json.loads(out)
    assert (code, result["answer"]) == (0, "found")
    assert result["error_deg"] < 0.3
    assert result["confirmed"] is True
    assert result["acquisitions"] == len(result["samples"]) > 50
    said = " ".join(err.split())
    assert "sweeps from 0 deg to -35 deg and 35 deg at 25.0 deg/s, at most 20 frames a second: 6.2 s at most" in said
    assert result["elapsed_s"] < 12
    code, out, _ = shell("journal", "verify", journal)
    assert code == 0
    code, out, _ = shell("journal", "show", journal)
    assert "sweeps to" in out
    assert "the sweep is over after" in out


def test_a_receiver_that_is_slow_to_read_is_read_once_a_sweep(shell: Shell) -> None:
    code, out, err = shell("search", "--sweep", "--marker-deg", 12, "--readout-s", 10, "--json", "--no-journal")
    result = json.loads(out)
    assert (code, result["answer"]) == (0, "found")
    said = " ".join(err.split())
    assert "turns to -35 deg without light, then sweeps from -35 deg to 35 deg" in said
    assert "at most 10 s after each to read its frames while it waits at 0 deg" in said
    # Of the 40 s are 20 two read-outs.
    assert result["elapsed_s"] < 40


GUIDED = Path(__file__).parents[2] / "examples" / "rigs" / "guided.toml"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--method", "ternary"), "ternary: it asks for one angle after another; only posterior sweeps"),
        (("--compare", "ternary,posterior"), "leave --sweep out"),
        (("--arm", "--rig", GUIDED), "its stage (GuidedStage) only works with the probe at rest; leave --sweep out"),
    ],
)
def test_what_cannot_sweep_says_why(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], said: str
) -> None:
    pytest.importorskip("serial", reason="needs the extra devices")
    monkeypatch.chdir(tmp_path)
    code, _, err = shell("search", "--sweep", "--no-journal", *words)
    assert code == 2
    assert said in " ".join(err.split())
