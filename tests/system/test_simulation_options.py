"""Options of `markerseek search` that set the simulation, and the comparison of methods in one world."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from markerseek.rigs import draw_scene, simulated
from markerseek.sim import MarkerSettings, SimulatedSettings

Shell = Callable[..., tuple[int, str, str]]


def test_the_marker_and_its_snr_are_set(shell: Shell) -> None:
    code, out, err = shell("search", "--marker-deg", -7.5, "--snr-db", 50, "--json", "--no-journal")
    result = json.loads(out)
    assert (code, err, result["truth_deg"]) == (0, "", -7.5)
    assert result["error_deg"] < 0.25
    # The confirmation is at the marker; the default is 40 dB.
    peak = result["confirmation"]["intensity"] / result["samples"][0]["noise_sigma"]
    assert 20 * np.log10(peak) == pytest.approx(50, abs=2.0)


def test_without_a_marker_none_is_found(shell: Shell) -> None:
    code, out, _ = shell("search", "--no-marker", "--json", "--no-journal")
    result = json.loads(out)
    assert (code, result["answer"], result["truth_deg"]) == (3, "not found", None)
    code, out, _ = shell("search", "--marker-deg", 90, "--no-journal")
    assert (code, "truth (simulated) 90.000°, not found" in " ".join(out.split())) == (3, True)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--no-marker", "--marker-deg", 3), "--no-marker contradicts --marker-deg"),
        (("--marker-deg", 200), "marker: angle_deg is 200.0 deg, it must lie between -90 and 90"),
        (("--snr-db", "nan"), "peak_snr_db is nan dB"),
        (("--compare", "ternary,ternary"), "two or more different methods are needed"),
        (("--compare", "ternary,nothing"), "method: 'nothing' is unknown"),
        (("--compare", "ternary,posterior", "--journal", "x.journal"), "keeps no journals"),
        (("--compare", "ternary,posterior", "--events", "x.events"), "writes no --events"),
    ],
)
def test_what_cannot_be_is_a_sentence(shell: Shell, words: tuple[object, ...], said: str) -> None:
    code, _, err = shell("search", *words)
    assert (code, said in " ".join(err.split())) == (2, True)


def test_a_second_marker_is_as_strong_as_the_first_and_elsewhere_along_the_array() -> None:
    settings = SimulatedSettings(marker=MarkerSettings(angle_deg=10.0))
    alone = draw_scene(settings, np.random.default_rng(5))
    both = draw_scene(structs.replace(settings, second=MarkerSettings(angle_deg=-12.0)), np.random.default_rng(5))
    assert (alone.second, both.marker, both.absorbers[0].lateral_m) == (None, alone.marker, alone.marker.lateral_m)
    assert both.second is not None
    assert abs(both.second.lateral_m - both.marker.lateral_m) > 10e-3
    largest = [
        np.abs(both.model.channel_data(both.absorbers, angle_deg=angle_deg)).max() for angle_deg in (10.0, -12.0)
    ]
    assert largest == pytest.approx([both.peak_counts] * 2, rel=0.02)
    rig = simulated(seed=5, settings=structs.replace(settings, second=MarkerSettings(angle_deg=-12.0)))
    assert "a second marker at -12.00 deg" in rig.facts.description
    between, on_second = (rig.scanner.measure(angle_deg).reading for angle_deg in (-1.0, -12.0))
    assert on_second.intensity > 5 * between.intensity
    assert on_second.lateral_m == pytest.approx(both.second.lateral_m, abs=0.5e-3)


def test_methods_are_compared_in_the_same_world(shell: Shell, tmp_path: Path) -> None:
    words = ("--compare", "ternary,golden-section-reuse", "--acquisitions", 12, "--seed", 4)
    code, out, _ = shell("search", *words, "--json", "--plot", "--out", tmp_path)
    compared = json.loads(out)
    alone = [
        json.loads(shell("search", "--method", method, *words[2:], "--json", "--no-journal")[1])
        for method in ("ternary", "golden-section-reuse")
    ]
    assert compared == alone
    assert code == (0 if all(each["found"] for each in alone) else 3)
    assert (tmp_path / "compare.png").read_bytes().startswith(b"\x89PNG")
    _, out, _ = shell("search", *words)
    for word in ("golden-section-reuse", "ternary", "acquisitions", f"{alone[0]['angle_deg']:.3f}°", "simulated rig"):
        assert word in out
