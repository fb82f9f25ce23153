"""A process that is killed in the middle of any write of a bank loses nothing that was acknowledged, invents nothing,
and blocks nothing."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from markerseek.records.banks import BankFacts, read_bank
from markerseek.records.banks.ipasc.writer import whole_bank

if not hasattr(os, "fork"):
    pytest.skip("needs fork", allow_module_level=True)

from tests.unit.records.banks.ipasc.bank_kills import PLANNED, TAKEN, sample

ROOT = Path(__file__).parents[5]
ANGLES = [10.0 - seed for seed in range(TAKEN)]


def killed(folder, moment, count):
    """What each kill left; the first process lives."""
    program = (sys.executable, "-m", "tests.unit.records.banks.ipasc.bank_kills", str(folder), moment, str(count))
    ended = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    unharmed, *others = [json.loads(line) for line in ended.stdout.splitlines()]
    assert (unharmed["status"], unharmed["angles"], unharmed["files"]) == (0, ANGLES[::-1], ["a.hdf5"])
    assert all(each["status"] == signal.SIGKILL for each in others)
    assert len(others) >= min(count, int(unharmed["done"]))
    return unharmed, others


def judge(each):
    """Every acknowledged acquisition is there, unchanged; at most the one under way is there too."""
    if each["acknowledged"] < 3 and (not each["there"] or "refused" in each):
        assert "at least 3 are needed" in each.get("refused", "at least 3 are needed"), each
        return
    assert "refused" not in each, each
    held = sorted(each["angles"], reverse=True)
    assert held == ANGLES[: len(held)], each
    assert each["acknowledged"] <= len(held) <= each["acknowledged"] + 1, each
    assert all(each["frames"]), each
    assert each["dark"] == [True, True], each


@pytest.mark.parametrize(("moment", "count"), [("scanning", 12), ("adding", 24), ("closing", 12)])
def test_a_scan_that_is_killed_at_any_write(tmp_path, moment, count):
    unharmed, others = killed(tmp_path, moment, count)
    assert unharmed["planned"] == (PLANNED if moment == "adding" else TAKEN)
    for each in others:
        judge(each)
        assert each["there"] or each["acknowledged"] == 0
    if moment == "closing":
        assert all(each["there"] and each["planned"] in {TAKEN, PLANNED} for each in others)


def test_an_import_that_is_killed_at_any_write_leaves_a_whole_bank_or_none_and_can_be_made_again(tmp_path):
    _, others = killed(tmp_path, "importing", 12)
    for each in others:
        assert not each["there"] or (each["angles"], all(each["frames"])) == (ANGLES[::-1], True), each
    there = [each["there"] for each in others]
    assert True in there
    assert False in there
    path = tmp_path / str(others[0]["place"]) / "a.hdf5"
    with whole_bank(path, angles=3, facts=BankFacts()) as writer:
        for angle in (1.0, 2.0, 3.0):
            writer.add(sample(angle))
    assert read_bank(path).angles_deg == (1.0, 2.0, 3.0)
