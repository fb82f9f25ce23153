"""A search method of one's own by the commands `search` and `replay`, and by `find_marker`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import markerseek
from markerseek.bridges import SearchRequest
from markerseek.core import ConfigError, Interval, Sample, SearchPlan
from markerseek.search import WeightedAverage

Shell = Callable[..., tuple[int, str, str]]
EXAMPLES = Path(__file__).parents[2] / "examples"

METHODS = """
from markerseek.search import WeightedAverage

class Nine(WeightedAverage):
    acquisitions = 9
    least = 3

    def __init__(self, *, limits, acquisitions):
        super().__init__(limits=limits, acquisitions=acquisitions, early_end=False)

class Failing(WeightedAverage):
    def _next_deg(self):
        return {}["no angle"]

def unstated(*, limits, acquisitions):
    return WeightedAverage(limits=limits, acquisitions=acquisitions)

def nothing(*, limits, acquisitions):
    return None
"""


@pytest.fixture(autouse=True)
def _beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory holds the method's file, and Python's path does not name it."""
    shutil.copy(EXAMPLES / "own_policy.py", tmp_path)
    (tmp_path / "methods_of_this_test.py").write_text(METHODS)
    monkeypatch.chdir(tmp_path)


def test_a_search_by_a_class_in_the_working_directory_finds_the_marker(shell: Shell) -> None:
    words = ("--method", "own_policy:CentreOfMass", "--acquisitions", 24)
    code, out, err = shell("search", "--seed", 1, "--no-journal", "--json", *words)
    assert code == 0, err
    result = json.loads(out)
    assert (result["method"], result["acquisitions"]) == ("own_policy:CentreOfMass", 24)
    assert result["angle_deg"] == pytest.approx(result["truth_deg"], abs=1.5)


def test_a_class_states_how_many_acquisitions_it_makes(shell: Shell) -> None:
    code, out, _ = shell("search", "--seed", 1, "--no-journal", "--json", "--method", "methods_of_this_test:Nine")
    assert (code, json.loads(out)["acquisitions"]) == (0, 9)


def test_a_recording_is_answered_from_all_its_angles_and_the_search_is_that_of_the_class(shell: Shell) -> None:
    bank = EXAMPLES / "simulated_scan.csv"
    code, out, err = shell("replay", bank, "--json", "--method", "own_policy:CentreOfMass", "--acquisitions", 16)
    assert code == 0, err
    own = json.loads(out)
    usual = json.loads(shell("replay", bank, "--json")[1])
    assert own["angle_deg"] == usual["angle_deg"]
    assert own["search"]["method"] == "own_policy:CentreOfMass"
    assert own["search"]["acquisitions"] == 16


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--method", "no_such_module:Mine"),
            "no module no_such_module is installed; correct the name",
        ),
        (("--method", "methods_of_this_test:Mine"), "methods_of_this_test has no class or function Mine"),
        (("--method", "methods_of_this_test.py:Nine"), 'it must be "module:Class"'),
        (("--method", "methods_of_this_test:unstated"), "acquisitions is None, and the class states no number of them"),
        (("--method", "methods_of_this_test:Nine", "--acquisitions", 2), "acquisitions is 2"),
        (
            ("--method", "methods_of_this_test:Nine", "--sweep"),
            "sweep is True, a policy of your own has no such",
        ),
        (("--method", "methods_of_this_test:nothing", "--acquisitions", 9), "which has not all of ask, tell and est"),
    ],
)
def test_what_cannot_be_a_method_is_refused_before_the_rig_is_opened(
    shell: Shell, words: tuple[object, ...], said: str
) -> None:
    code, _, err = shell("search", "--no-journal", *words)
    assert (code, said in " ".join(err.split())) == (2, True), err


def test_an_error_of_the_class_is_reported_under_its_name(shell: Shell) -> None:
    code, _, err = shell("search", "--no-journal", "--method", "methods_of_this_test:Failing", "--acquisitions", 9)
    assert code == 1
    said = " ".join(err.split())
    assert "methods_of_this_test:Failing: the policy failed: KeyError: 'no angle'" in said
    assert "methods_of_this_test.py, line" in said


def test_a_journal_and_a_request_never_name_code_that_is_run(shell: Shell, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    words = ("--seed", 1, "--method", "methods_of_this_test:Nine", "--journal", journal)
    assert shell("search", *words)[0] == 0
    assert shell("journal", "verify", journal)[0] == 0
    code, _, err = shell("journal", "replay", journal)
    assert (code, "not from a record or a request" in " ".join(err.split())) == (2, True), err
    with pytest.raises(ConfigError, match="not from a record or a request"):
        SearchRequest(plan=SearchPlan(method="methods_of_this_test:Nine", acquisitions=9))


class Noting(WeightedAverage):
    """Keeps what it is told."""

    def __init__(self, limits: Interval) -> None:
        super().__init__(limits=limits, acquisitions=15)
        self.told: list[Sample] = []

    def tell(self, sample: Sample) -> None:
        super().tell(sample)
        self.told.append(sample)


def test_find_marker_takes_a_policy() -> None:
    rig = markerseek.simulated(seed=1)
    policy = Noting(rig.limits.search)
    result = markerseek.find_marker(rig, policy=policy)
    assert result.method.endswith(":Noting")
    assert result.acquisitions == len([each for each in policy.told if not each.dark]) > 5
    assert result.angle_deg == policy.estimate().mean_deg


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"policy": 3}, "policy: it made 3, which has not all of ask, tell and estimate"),
        ({"policy": Noting}, r"policy: it is the class Noting, and no policy; make one, Noting\(…\)"),
        ({"policy": Noting(Interval(low_deg=-35, high_deg=35)), "method": "ternary"}, "leave one of them out"),
    ],
)
def test_find_marker_refuses_what_is_no_policy_and_two_methods(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        markerseek.find_marker(markerseek.simulated(seed=1), **arguments)  # type: ignore[arg-type]
