"""A user's own policy in a study: found by its name, run as any other, and its errors are reported as its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError, SearchError
from markerseek.studies import read_rows, read_study, run_row, run_study
from tests.notes import noted

pytestmark = pytest.mark.usefixtures("notes_allowed")

Shell = Callable[..., tuple[int, str, str]]

EXAMPLES = Path(__file__).parents[3] / "examples"

STUDY = """
version = 1
trials = 3
[[policies]]
method = "{method}"
{more}
[[policies]]
method = "weighted-average"
"""

MODULE = """
import numpy as np
from msgspec.structs import replace
from markerseek.search import WeightedAverage

class Numpys(WeightedAverage):
    def estimate(self):
        found = super().estimate()
        return replace(found, mean_deg=np.float64(found.mean_deg))

class Failing(WeightedAverage):
    def _next_deg(self):
        return {}["no angle"]

class Outside(WeightedAverage):
    def _next_deg(self):
        return 80.0

class Outside_at_times(WeightedAverage):
    # Of the strongest sample the last digits are as good as drawn.
    def _next_deg(self):
        strongest = max((sample.reading.intensity for sample in self._lit), default=0.0)
        return 80.0 if len(self._lit) == 4 and int(strongest * 1e9) % 2 else super()._next_deg()

class Endless(WeightedAverage):
    def _next_deg(self):
        return 1.0

def made(*, limits, acquisitions):
    return WeightedAverage(limits=limits, acquisitions=acquisitions)

def nothing(*, limits, acquisitions):
    return None

def without_arguments():
    return None
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine_of_this_test.py").write_text(MODULE)
    (tmp_path / "broken_of_this_test.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def study_of(folder: Path, method: str, more: str = "acquisitions = 9") -> Path:
    path = folder / "study.toml"
    path.write_text(STUDY.format(method=method, more=more))
    return path


@pytest.mark.parametrize("name", ["Numpys", "made"])
def test_a_policy_of_one_s_own_is_run_as_the_method_of_the_same_rule(folder: Path, name: str) -> None:
    # as published: without dark frames, after which the noise would be another
    published = "acquisitions = 9\nas_published = true\n"
    own = read_study(study_of(folder, f"mine_of_this_test:{name}", published))
    same = read_study(study_of(folder, "weighted-average", published + "early_end = false\n"))
    finish = run_study(own, folder / "out", workers=1)
    rows = [row for row in read_rows(finish.rows, own) if row.policy == 0]
    assert [row.method for row in rows] == [f"mine_of_this_test:{name}"] * 3
    for number, row in enumerate(rows):
        assert row.mean_deg == run_row(same, 2 * number).mean_deg
    assert finish.summary.policies[0].label == f"mine_of_this_test:{name} as published, 9"


@pytest.mark.parametrize(
    ("method", "more", "said"),
    [
        (
            "no_such_module:Mine",
            "acquisitions = 9",
            "no module no_such_module is installed",
        ),
        ("mine_of_this_test:Mine", "acquisitions = 9", "mine_of_this_test has no class or function Mine"),
        (
            "broken_of_this_test:Mine",
            "acquisitions = 9",
            "importing broken_of_this_test failed: ZeroDivisionError",
        ),
        ("mine_of_this_test:nothing", "acquisitions = 9", "it made None, which has not all of ask, tell and estimate"),
        ("mine_of_this_test:without_arguments", "acquisitions = 9", "calling it with limits and acquisitions failed"),
        ("mine_of_this_test:made", "", "acquisitions is None, and the class states no number of them"),
        ("mine_of_this_test:made", "acquisitions = 0", "acquisitions is 0"),
        ("mine_of_this_test:made", "acquisitions = 9\nearly_end = false", "early_end is False, a policy of your own"),
        ("mine_of_this_test:made", "acquisitions = 9\nsweep = true", "sweep is True, a policy of your own"),
        ("mine_of_this_test:made", "acquisitions = 9\nprior = true", "prior is True, a policy of your own"),
        ("unheard-of", "", "in a study also a policy of your own as module:name"),
    ],
)
def test_what_cannot_be_a_policy_is_refused_when_the_study_is_read(
    folder: Path, method: str, more: str, said: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        read_study(study_of(folder, method, more))
    assert said in str(refused.value)
    assert "$" not in str(refused.value)


def test_a_study_says_what_it_imports_before_it_does(folder: Path) -> None:
    with (
        noted("^broken_of_this_test:Mine: the study imports the module broken_of_this_test and"),
        pytest.raises(ConfigError, match="importing broken_of_this_test failed"),
    ):
        read_study(study_of(folder, "broken_of_this_test:Mine"))


def test_an_error_of_the_policy_is_reported_under_its_name(folder: Path) -> None:
    study = read_study(study_of(folder, "mine_of_this_test:Failing"))
    with pytest.raises(SearchError) as failed:
        run_row(study, 0)
    said, *_, own = str(failed.value).splitlines()
    assert said == "mine_of_this_test:Failing: the policy failed: KeyError: 'no angle'"
    assert "mine_of_this_test.py, line " in own
    assert ", in _next_deg:" in own


def test_a_policy_that_never_ends_is_named(folder: Path) -> None:
    study = read_study(study_of(folder, "mine_of_this_test:Endless"))
    with pytest.raises(SearchError, match=r"^mine_of_this_test:Endless: the policy asked for more than 500 acq"):
        run_row(study, 0)


def test_a_policy_of_which_every_search_fails_ends_the_command_with_the_reason(folder: Path, shell: Shell) -> None:
    study = study_of(folder, "mine_of_this_test:Outside")
    out = folder / "out"
    for _ in ("run", "read"):
        code, text, err = shell("study", study, "--out", out, "--workers", 1)
        assert code == 1
        assert "rows:" in text
        assert (
            "mine_of_this_test:Outside, 9: all searches failed, the first one (row 0) by: LimitError: angle 80" in err
        )
    code, text, _ = shell("study", study, "--out", out, "--json")
    assert code == 1
    assert list(json.loads(text)["faults"]) == ["mine_of_this_test:Outside, 9"]


def test_the_policy_of_the_examples_finds_markers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES)
    study = read_study(EXAMPLES / "studies" / "own-policy.toml")
    errors = [run_row(study, row).error_deg for row in range(1, 40, 4)]
    assert np.mean([error for error in errors if error is not None]) < 0.5
