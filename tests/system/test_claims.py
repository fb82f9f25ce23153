"""What a command claims of a search: nothing where the method claims nothing, and nothing of noise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"

Shell = Callable[..., tuple[int, str, str]]


NOTHING = ("search", "--no-marker", "--no-journal")


def test_the_paper_s_form_claims_nothing(shell: Shell, tmp_path: Path) -> None:
    words = (*NOTHING, "--method", "golden-section", "--as-published", "--acquisitions", 8)
    code, out, _ = shell(*words, "--plot", "--out", tmp_path)
    page = (tmp_path / "search.html").read_text(encoding="utf-8")
    assert code == 0
    for text in (out, page):
        assert "always answers, also where there is no marker" in " ".join(text.split())
        for word in ("confirm", "95 %", "±", "marker angle"):
            assert word not in text.replace('"confirm', "").replace("&#34;confirm", ""), word
    result = json.loads(shell(*words, "--json")[1])
    assert [result[name] for name in ("confirmed", "sigma_deg", "interval95_deg", "interval_kind")] == [None] * 4


def test_a_bracket_is_not_called_an_interval_of_95_percent(shell: Shell) -> None:
    _, out, _ = shell("search", "--seed", 2, "--method", "golden-section", "--no-journal")
    assert "last bracket" in out
    assert "95 %" not in out


def test_no_angle_is_printed_where_nothing_was_detected(shell: Shell) -> None:
    code, out, _ = shell(*NOTHING)
    assert code == 3
    assert "not found" in out
    for word in ("points at", "best guess", "marker angle", "°,"):
        assert word not in out


def test_the_noise_floor_names_the_acquisitions_on_which_it_depends(shell: Shell) -> None:
    _, out, _ = shell("search", "--seed", 1, "--no-journal")
    said = " ".join(out.split())
    for word in ("simulated rig", "marker angle", "±", "95 % interval", "acquisitions", "rotation", "time", "error"):
        assert word in said
    result = json.loads(shell("search", "--seed", 1, "--no-journal", "--json")[1])
    searches = f"1000 searches of {result['acquisitions']} acquisitions"
    assert f"from dark frames; noise alone exceeds it in at most one of {searches}" in said
    known_s = result["known_s"]
    elapsed_s = result["elapsed_s"]
    at_marker = f"{elapsed_s:.1f} s with the probe at the marker, on the simulated clock"
    assert f"{known_s:.1f} s to the answer, {at_marker}" in said


def test_a_doubt_whether_there_is_another_source_names_the_option_that_states_it(shell: Shell) -> None:
    code, out, _ = shell("search", "--seed", 3, "--no-journal", "--acquisitions", 4)
    said = " ".join(out.split())
    assert (code, "unsure: the probability that another source is the marker is" in said) == (3, True)
    assert "the marker; --single states that there is none" in said
    _, out, _ = shell("search", "--seed", 1, "--no-journal", "--acquisitions", 4)
    assert "--single" not in out


def test_a_recording_is_not_asked_for_more_acquisitions(shell: Shell) -> None:
    scan = EXAMPLES / "simulated_scan.csv"
    code, out, _ = shell("replay", scan, "--method", "golden-section", "--acquisitions", 4)
    # The answer is from all angles; only the search beside it had four.
    answer, _, searched = " ".join(out.split()).partition("a search would have said")
    assert (code, "take more" in answer, "more acquisitions" in answer) == (0, False, False)
    assert "take more" not in searched
    assert "more acquisitions, or more pulses in each, reduce it; best guess" in searched
    assert "not claimed; all angles together say found" in searched
