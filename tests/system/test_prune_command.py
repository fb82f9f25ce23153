"""`markerseek journal prune`: what is listed, what is deleted, and what never is."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from markerseek.core import SearchPlan
from markerseek.records.journal import Journal
from markerseek.rigs import simulated
from markerseek.runs import configuration_of

Shell = Callable[..., tuple[int, str, str]]

DAY_S = 86_400.0


def of_age(path: Path, days: float) -> Path:
    """The file, last changed so many days earlier."""
    then_s = path.stat().st_mtime - days * DAY_S
    os.utime(path, (then_s, then_s))
    return path


@pytest.fixture
def folder(shell: Shell, tmp_path: Path) -> Path:
    """Four finished runs of 40, 30, 20 and 0 days ago, and one of 50 days that was begun and never finished."""
    place = tmp_path / "runs"
    place.mkdir()
    words = ("--method", "ternary", "--acquisitions", 4, "--stay")
    assert shell("search", "--seed", 3, *words, "--journal", place / "0.journal")[0] in (0, 3)
    for days in (20, 30, 40):
        of_age(Path(shutil.copyfile(place / "0.journal", place / f"{days}.journal")), days)
    Journal.create(place / "50.journal", configuration_of(simulated(seed=1), SearchPlan(method="ternary"))).close()
    of_age(place / "50.journal", 50)
    return place


def names(folder: Path) -> set[str]:
    return {path.stem for path in folder.glob("*.journal")}


def test_nothing_is_deleted_without_being_asked_for(shell: Shell, folder: Path) -> None:
    before = names(folder)
    code, out, _ = shell("journal", "prune", folder, "--keep", 2)
    assert (code, names(folder)) == (0, before)
    assert "2 journals" in out
    assert "to be deleted (--delete)" in out
    assert "1 old one stays: a run that is not over" in out
    code, _, err = shell("journal", "prune", folder)
    assert (code, names(folder)) == (2, before)
    assert "say which journals go: --keep NUMBER, --older-than-days DAYS" in err


@pytest.mark.parametrize(
    ("words", "left"),
    [
        (("--keep", 1), {"0", "50"}),
        (("--older-than-days", 25), {"0", "20", "50"}),
        (("--keep", 3, "--older-than-days", 35), {"0", "20", "30", "50"}),
        (("--keep", 4, "--older-than-days", 1, "--unfinished"), {"0", "20", "30", "40"}),
    ],
)
def test_old_journals_of_runs_that_are_over_go(
    shell: Shell, folder: Path, words: tuple[object, ...], left: set[str]
) -> None:
    before = names(folder)
    code, out, _ = shell("journal", "prune", folder, *words, "--delete", "--json")
    assert (code, names(folder)) == (0, left)
    assert {Path(path).stem for path in json.loads(out)["journals"]} == before - left
    assert json.loads(out)["bytes"] > 0


def test_a_run_that_is_going_on_is_never_deleted(shell: Shell, folder: Path) -> None:
    running = folder / "running.journal"
    configuration = configuration_of(simulated(seed=1), SearchPlan(method="ternary"))
    with closing(Journal.create(running, configuration)):
        of_age(running, 60)
        code, out, _ = shell("journal", "prune", folder, "--keep", 0, "--unfinished", "--delete", "--json")
        assert (code, names(folder)) == (0, {"running"})
        assert json.loads(out)["kept"] == [str(running)]
