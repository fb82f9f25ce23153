"""The answer to a recording is from all its angles, wherever it is asked for."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import markerseek
from markerseek.core import MAX_ACQUISITIONS
from markerseek.figures import search_figure
from markerseek.runs import read_marker
from markerseek.show import flat_answer, with_minus
from tests.base_scan import MARKER_DEG, SAMPLING_HZ, base_scan

Shell = Callable[..., tuple[int, str, str]]


Array = npt.NDArray[np.float64]


COMPARED = ("answer", "reason", "angle_deg", "sigma_deg", "interval95_deg", "interval_kind")
"""Keys of an answer, wherever it is printed."""


def table(path: Path, angles_deg: Array, intensities: Array) -> Path:
    """A table of angles and intensities."""
    rows = np.column_stack([angles_deg, np.abs(intensities)])
    np.savetxt(path, rows, delimiter=",", header="angle_deg,intensity", comments="", fmt="%.6f")
    return path


def table_of_peaks(path: Path, *places: tuple[float, float], angles: int = 141) -> Path:
    """A table with a peak (σ 2°) at each place, of an angle in degrees and a height."""
    angles_deg = np.linspace(-35, 35, angles)
    noise = 0.008 * np.random.default_rng(1).normal(size=angles)
    curve = sum((height * np.exp(-(((angles_deg - at) / 2) ** 2) / 2) for at, height in places), 0 * angles_deg)
    return table(path, angles_deg, 1000 * (curve + noise))


def coarse(path: Path, *, step_deg: float = 8.0) -> Path:
    """A table of few angles, over a curve that is 10° wide."""
    angles_deg = np.arange(-40, 40.1, step_deg)
    rng = np.random.default_rng(0)
    curve = 100 * np.exp(-4 * np.log(2) * ((angles_deg - 7.3) / 10) ** 2) * (1 + 0.1 * rng.normal(size=angles_deg.size))
    return table(path, angles_deg, curve + np.abs(rng.normal(size=angles_deg.size)))


RECORDINGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "marker": (lambda path: table_of_peaks(path, (-11.2, 1.0)), "found"),
    "nothing": (table_of_peaks, "not found"),
    "two peaks": (lambda path: table_of_peaks(path, (-5.0, 1.0), (3.0, 0.9)), "ambiguous"),
    "end": (lambda path: table_of_peaks(path, (36.0, 1.0)), "at bound"),
    "coarse": (coarse, "found"),
    "too coarse": (lambda path: coarse(path, step_deg=16.0), "unsure"),
}
"""Makers of a recording of each kind, and the answer from all its angles."""


def replayed(shell: Shell, *words: object) -> tuple[int, dict[str, Any]]:
    """Exit code and JSON of a replay."""
    code, out, err = shell("replay", *words, "--json")
    assert code in (0, 3), err
    return code, json.loads(out)


@cache
def frames_bank(shell: Shell, folder: Path) -> Path:
    """The base scan as a bank of channel data."""
    np.save(folder / "scan.npy", base_scan().frames[::2])
    words = ("--first-deg", base_scan().angles_deg[0], "--step-deg", 2, "--sampling-mhz", SAMPLING_HZ / 1e6)
    code, _, err = shell("bank", "import", folder / "scan.npy", folder / "b.hdf5", *words, "--face-radius-mm", 10)
    assert code == 0, err
    return folder / "b.hdf5"


@pytest.mark.parametrize("kind", RECORDINGS)
def test_a_replay_answers_from_all_angles_whatever_the_method(shell: Shell, tmp_path: Path, kind: str) -> None:
    make, answer = RECORDINGS[kind]
    path = make(tmp_path / "mine.csv")
    results = {}
    for method in ("posterior", "ternary", "weighted-average"):
        code, result = replayed(shell, path, "--method", method)
        assert (code, result["answer"], result["found"]) == (3 if answer != "found" else 0, answer, answer == "found")
        assert (result["reason"] is None) == (answer == "found")
        taken_deg = [each["angle_deg"] for each in result["samples"]]
        assert taken_deg == sorted(set(taken_deg))
        assert result["acquisitions"] == len(result["samples"]) == len(path.read_text().split()) - 1
        searched = result.pop("search")
        assert searched["method"] == method
        assert searched["acquisitions"] == len(searched["samples"])
        assert searched["travel_deg"] > 0
        results[method] = result
    assert results["posterior"] == results["ternary"] == results["weighted-average"]


@pytest.mark.parametrize("kind", RECORDINGS)
def test_text_python_and_bank_info_say_the_same(shell: Shell, tmp_path: Path, kind: str) -> None:
    path = RECORDINGS[kind][0](tmp_path / "mine.csv")
    result = replayed(shell, path)[1]
    found = markerseek.find_marker(markerseek.replayed(path))
    said = json.loads(json.dumps(flat_answer(found.estimate)))
    assert [said[key] for key in COMPARED] == [result[key] for key in COMPARED]
    assert found.search is not None
    assert found.search.acquisitions == result["search"]["acquisitions"]
    info = json.loads(shell("bank", "info", path, "--json")[1])
    assert [info[key] for key in COMPARED] == [result[key] for key in COMPARED]
    lines = " ".join(shell("replay", path)[1].split())
    assert f"answer {result['answer']}" in lines
    assert f"a search would have said posterior, after {found.search.acquisitions} acquisitions and " in lines
    row = " ".join(shell("bank", "info", path)[1].split())
    assert f"answer from all angles {result['answer']}" in row
    for text in (lines, row, " ".join(str(found).split())):
        assert result["reason"] is None or result["reason"] in text


@pytest.mark.parametrize("distance_deg", [8, 9, 12])
@pytest.mark.parametrize("weaker", [0.8, 0.95])
def test_a_search_that_found_the_wrong_peak_does_not_contradict(
    shell: Shell, tmp_path: Path, distance_deg: float, weaker: float
) -> None:
    path = table_of_peaks(tmp_path / "mine.csv", (10.0 - distance_deg, 1.0), (10.0, weaker))
    # A bracket around the weaker peak sees one curve.
    words = (path, "--method", "ternary")
    code, result = replayed(shell, *words)
    assert (code, result["answer"]) == (3, "ambiguous")
    assert result["search"]["answer"] == "found"
    said = " ".join(shell("replay", *words)[1].split())
    assert "a search would have said ternary, after 28 acquisitions and " in said
    assert "; all angles together say ambiguous" in said


def test_a_scan_of_more_angles_than_a_search_may_take_is_answered_from_all(shell: Shell, tmp_path: Path) -> None:
    angles = MAX_ACQUISITIONS + 61
    path = table_of_peaks(tmp_path / "mine.csv", (12.34, 1.0), angles=angles)
    journal = tmp_path / "mine.journal"
    for words in (("--method", "posterior"), ("--method", "exhaustive", "--journal", journal)):
        code, result = replayed(shell, path, *words)
        assert (code, result["acquisitions"]) == (0, angles)
        low_deg, high_deg = result["interval95_deg"]
        assert low_deg < 12.34 < high_deg
    kept = json.loads(shell("journal", "replay", journal, "--json")[1])
    assert kept["recorded"] == kept["from_the_samples"] == kept["from_the_frames"]


def test_as_published_the_method_itself_answers(shell: Shell, tmp_path: Path) -> None:
    path = table_of_peaks(tmp_path / "mine.csv", (-20.0, 1.0), (10.0, 0.3))
    code, result = replayed(shell, path, "--method", "golden-section", "--as-published")
    assert (code, result["method"], result["acquisitions"], result["search"]) == (0, "golden-section", 28, None)
    assert result["angle_deg"] == pytest.approx(10, abs=0.5)
    said = shell("replay", path, "--method", "golden-section", "--as-published")[1]
    assert "golden-section as published" in said
    assert "a search would have said" not in said


def test_a_single_source_may_be_stated_whatever_the_method(shell: Shell, tmp_path: Path) -> None:
    results = [replayed(shell, coarse(tmp_path / "mine.csv"), "--single", "--method", method)[1] for method in METHODS]
    assert [(each["answer"], each["search"]["method"]) for each in results] == [("found", each) for each in METHODS]
    assert len({each["angle_deg"] for each in results}) == 1


METHODS = ("posterior", "ternary", "exhaustive")


def test_the_journal_of_a_replay_has_the_answer_from_all_angles(shell: Shell, tmp_path: Path) -> None:
    path = table_of_peaks(tmp_path / "mine.csv", (1.0, 1.0), (10.0, 0.9))
    journal = tmp_path / "mine.journal"
    code, result = replayed(shell, path, "--method", "ternary", "--journal", journal)
    assert (code, result["answer"], result["search"]["answer"]) == (3, "ambiguous", "found")
    again, out, _ = shell("resume", journal, "--json")
    assert (again, json.loads(out)) == (code, result)
    kept = json.loads(shell("journal", "replay", journal, "--json")[1])
    assert kept["recorded"] == kept["from_the_samples"] == kept["from_the_frames"]
    shown = " ".join(shell("journal", "show", journal)[1].split())
    assert re.search("ambiguous: .*, from all angles; the search alone: found", shown)
    assert shell("journal", "verify", journal)[0] == 0


def test_a_registration_takes_the_marker_from_all_angles(shell: Shell, tmp_path: Path) -> None:
    bank = frames_bank(shell, tmp_path)
    # Four acquisitions are too few, and none is at the marker.
    words = (bank, "--method", "golden-section", "--acquisitions", 4)
    code, result = replayed(shell, *words, "--journal", tmp_path / "point.journal")
    assert (code, result["search"]["answer"]) == (0, "unsure")
    assert result["interval95_deg"][0] < MARKER_DEG < result["interval95_deg"][1]
    (tmp_path / "point.json").write_text(json.dumps(result))
    for source in ("point.json", "point.journal"):
        x_m, y_m, z_m = read_marker(tmp_path / source).position_m
        assert np.degrees(np.arctan2(x_m, z_m)) == pytest.approx(MARKER_DEG, abs=0.1)
        assert y_m == pytest.approx(4e-3, abs=0.3e-3)
    info = json.loads(shell("bank", "info", bank, "--json")[1])
    assert [info[key] for key in COMPARED] == [result[key] for key in COMPARED]


def test_the_picture_has_the_recorded_curve_and_the_answer_from_all_angles(shell: Shell, tmp_path: Path) -> None:
    path = table_of_peaks(tmp_path / "mine.csv", (-20.0, 1.0), (10.0, 0.3))
    out = tmp_path / "out"
    assert shell("replay", path, "--method", "golden-section", "--plot", "--out", out)[0] == 0
    assert (out / "replay.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "replay.html").read_text()
    assert "a search would have said" in page
    assert "all 141 angles of the recording" in page
    result = markerseek.find_marker(markerseek.replayed(path), "golden-section")
    curve, track = search_figure(result).axes[:2]
    named = {each.get_label(): each for each in (*curve.lines, *curve.collections, *curve.patches)}
    assert len(named["recorded"].get_xdata()) == 141
    assert with_minus(f"marker at {result.angle_deg:.2f}°") in named
    assert len(named["acquisitions of a search, numbered where there is room"].get_offsets()) == 28
    assert track.get_xlabel() == "acquisition of a search (0: start)"
    notebook = result._repr_html_()
    assert len(re.findall(r'ms-recorded" points="([^"]*)"', notebook)[0].split()) == 141
    assert "a search would have said" in notebook
    assert len(result.to_dataframe()) == 141
