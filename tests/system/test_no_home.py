"""A user without a name and without a home folder, as in a container."""

from __future__ import annotations

import json
import pwd
import queue
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from markerseek.bridges import Outcome, Searches, SearchOptions, SearchRequest
from markerseek.bridges.run_images import PicturedEntry, PicturedItem

Shell = Callable[..., tuple[int, str, str]]


QUICK = ("search", "--seed", "1", "--method", "weighted-average", "--acquisitions", "4", "--as-published")


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A user number without a name and without a home folder, as of ``docker run -u 12345``."""
    for name in ("HOME", "XDG_DATA_HOME", "USER", "LOGNAME"):
        monkeypatch.delenv(name, raising=False)

    def unknown(number: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("nobody")
def test_a_user_without_a_home_gets_the_answer_and_is_told_where_a_journal_could_be(
    shell: Shell, tmp_path: Path
) -> None:
    code, out, err = shell(*QUICK, "--json")
    assert (code, json.loads(out)["answer"]) == (0, "found")
    assert "no journal is kept: this user has no home folder" in err
    assert "XDG_DATA_HOME" in err
    assert "--journal FILE" in err
    code, _, err = shell(*QUICK, "--journal", tmp_path / "run.journal")
    assert (code, "no journal is kept" in err) == (0, False)
    code, _, err = shell("journal", "list")
    assert code == 2
    assert "this user has no home folder; set XDG_DATA_HOME" in err
    assert not (tmp_path / "~").exists()


@pytest.mark.usefixtures("nobody")
def test_exposure_without_a_record_is_refused_with_the_cure(shell: Shell, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    parts = "".join(f'[{each}]\ndriver = "simulated"\n' for each in ("stage", "laser", "receiver"))
    rig.write_text(f'kind = "bench"\n{parts}')
    code, _, err = shell("search", "--rig", rig, "--arm")
    assert code == 2
    assert "this user has no home folder; set XDG_DATA_HOME" in err
    assert "--no-journal" in err


@pytest.mark.usefixtures("nobody")
def test_a_search_that_a_client_asks_for_runs_without_a_home() -> None:
    asked = SearchRequest().changed(method="ternary", acquisitions=4, as_published=True)
    items: list[PicturedItem] = []
    ends: queue.Queue[Outcome] = queue.Queue()
    searches = Searches(SearchOptions(), on_start=lambda _: None, on_item=items.append, on_end=ends.put)
    with closing(searches):
        searches.start(asked)
        assert ends.get(timeout=60).answered
    assert any(isinstance(each, PicturedEntry) for each in items)
