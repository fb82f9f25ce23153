"""Unusual inputs to all commands and options: refused at once in one sentence with exit code 2, or used."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SCAN = EXAMPLES / "simulated_scan.csv"
STUDY = EXAMPLES / "studies" / "quick.toml"

Shell = Callable[..., tuple[int, str, str]]

READERS: tuple[tuple[object, ...], ...] = (
    ("search", "--no-journal", "--rig"),
    ("doctor", "--rig"),
    ("emulate", "bench", "--dir", "emulated", "--rig"),
    ("replay",),
    ("resume",),
    ("frame",),
    ("calibrate",),
    ("study", "--row", "0"),
    ("bank", "info"),
    ("bank", "import", "to.hdf5"),
    ("bank", "export", "to.csv"),
    ("journal", "show"),
    ("journal", "verify"),
    ("journal", "replay"),
    ("reproduce", "fig6", "--out", "paper", "--bank"),
)
"""Commands that read a file, whose name comes last, or, where a file to be written comes last, before it."""

WRITERS: tuple[tuple[object, ...], ...] = (
    ("search", "--method", "weighted-average", "--acquisitions", "2", "--stay", "--journal"),
    ("replay", SCAN, "--plot", "--out"),
    ("bank", "scan", "--step-deg", "40"),
    ("bank", "import", SCAN),
    ("bank", "export", SCAN),
    ("reproduce", "table2", "--out"),
)

NUMBERS: tuple[tuple[tuple[object, ...], tuple[str, ...]], ...] = (
    (("search", "--no-journal"), ("--acquisitions", "--seed", "--pace")),
    (("replay", SCAN), ("--acquisitions", "--reference-deg")),
    (("bank", "scan", "new.hdf5"), ("--step-deg", "--seed", "--wavelength-nm", "--pulse-energy-mj")),
    (("bank", "import", SCAN, "new.hdf5"), ("--first-deg", "--step-deg", "--sampling-mhz", "--face-radius-mm")),
    (("bank", "import", SCAN, "new.hdf5"), ("--reference-deg", "--wavelength-nm", "--pulse-energy-mj")),
    (("bank", "export", SCAN, "new.igs.mha"), ("--face-radius-mm",)),
    (("frame", "frame.npy"), ("--number",)),
    (("calibrate", SCAN), ("--source-deg",)),
    (("journal", "list"), ("--last",)),
    (("reproduce", "fig6", "--bank", SCAN), ("--markers", "--workers", "--seed", "--reference-deg")),
    (("study", STUDY), ("--row", "--workers")),
    (("emulate", "bench", "--dir", "emulated"), ("--seed", "--pace")),
)
"""Commands, and their options that take a number."""


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("frame.npy", np.zeros((128, 2080), np.int16))


def refused(shell: Shell, *words: object) -> None:
    """Run a command: one sentence, which is in its JSON too."""
    as_json = () if words[:1] == ("emulate",) else ("--json",)
    code, out, err = shell(*words, *as_json)
    assert (code, bool(out)) == (2, bool(as_json)), (words, err)
    assert "error" in err.lower(), (words, err)
    assert not as_json or json.loads(out)["error"], (words, out)


def odd_files() -> list[str]:
    """Names of what no command can read; what each reader refuses of a file of its format is tested with it."""
    os.mkfifo("pipe")
    Path("bytes.csv").write_bytes(b"\xe9\xff\x00" * 50)
    return ["nothing", "pipe", "nul\x00", "bytes.csv"]


@pytest.mark.parametrize("words", READERS, ids=lambda words: " ".join(map(str, words[:2])))
def test_what_no_command_can_read_is_refused(shell: Shell, words: tuple[object, ...]) -> None:
    for name in odd_files():
        written = words[:-1] if str(words[-1]).startswith("to.") else words
        after = words[-1:] if written is not words else ()
        refused(shell, *written, name, *after)


@pytest.mark.parametrize("words", WRITERS, ids=lambda words: " ".join(map(str, words[:2])))
def test_where_nothing_can_be_written_nothing_is_begun(shell: Shell, words: tuple[object, ...]) -> None:
    Path("taken").write_text("precious")
    for name in ("taken/a.hdf5", "/proc/a.hdf5", "nul\x00.csv"):
        refused(shell, *words, name)
    assert Path("taken").read_text() == "precious"


def test_a_rig_file_and_a_study_file_in_the_place_of_one_another_are_known(shell: Shell) -> None:
    rig = EXAMPLES / "rigs" / "simulated.toml"
    study = EXAMPLES / "studies" / "quick.toml"
    code, _, err = shell("study", rig)
    assert (code, "it is a rig file; search on it: 'markerseek search'" in err) == (2, True), err
    code, _, err = shell("search", "--rig", study)
    assert (code, "it is a study file; run it: 'markerseek study " in err) == (2, True), err


@pytest.mark.parametrize(("words", "options"), NUMBERS, ids=lambda words: " ".join(map(str, words[:2])))
def test_numbers_that_mean_nothing_are_refused(
    shell: Shell, words: tuple[object, ...], options: tuple[str, ...]
) -> None:
    for option in options:
        for value in ("nan", "1e300"):
            refused(shell, *words, option, value)


@pytest.mark.parametrize("method", ["posterior", "weighted-average", "golden-section"])
def test_the_smallest_numbers_there_are_are_no_marker_and_no_error(shell: Shell, method: str) -> None:
    rows = "".join(f"{angle},5e-324\n" for angle in range(-10, 11))
    Path("scan.csv").write_text(f"angle_deg,intensity\n{rows}", encoding="utf-8")
    code, out, _ = shell("replay", "scan.csv", "--method", method, "--json")
    assert (code, json.loads(out)["found"]) == (3, False)
