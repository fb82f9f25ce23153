"""The commands as a user types them: output, exit codes, and messages for wrong input."""

from __future__ import annotations

import html
import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import ChannelFrame, Tolerance
from markerseek.records.journal import read_journal
from markerseek.wire.sonixdaq import element_of_file

EXAMPLES = Path(__file__).parents[2] / "examples"


Shell = Callable[..., tuple[int, str, str]]


def test_a_search_finds_the_simulated_marker_and_answers_programs_with_one_object(shell: Shell) -> None:
    code, out, err = shell("search", "--seed", 1, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["found"] is True
    assert result["rig"] == "simulated"
    assert result["error_deg"] == pytest.approx(abs(result["angle_deg"] - result["truth_deg"]))
    assert result["error_deg"] < 0.75
    low, high = result["interval95_deg"]
    assert low < result["angle_deg"] < high
    assert result["interval_kind"] == "posterior"
    assert len(result["samples"]) == result["acquisitions"]
    # It is weighed as a sample, so that the answer may move by a little after it.
    assert result["confirmation"]["angle_deg"] == pytest.approx(result["angle_deg"], abs=0.1)
    assert result["others"] == []
    assert result["surveyed"] >= 0.99
    assert result["floor"]["source"] == "dark frames"
    x, _y, z = result["marker_trus_m"]
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(result["angle_deg"])
    # The higher of the two peaks that the 500 ns pulse makes is off by 0.39 mm; the centroid of both is not.
    assert np.hypot(x, z) == pytest.approx(0.060, abs=0.05e-3)
    assert all(0 < sigma_m < 0.3e-3 for sigma_m in result["marker_sigma_m"])


def test_the_same_seed_gives_the_same_search_and_another_seed_another(shell: Shell) -> None:
    first, again, other = (shell("search", "--seed", seed, "--json", "--stay")[1] for seed in (4, 4, 5))
    assert first == again
    assert json.loads(first)["truth_deg"] != json.loads(other)["truth_deg"]


def test_pictures_are_a_png_and_a_page_that_loads_nothing(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("search", "--seed", 1, "--plot", "--out", tmp_path / "new")
    assert code == 0
    png = tmp_path / "new" / "search.png"
    page = tmp_path / "new" / "search.html"
    assert str(png) in out.replace("\n", "")
    assert png.read_bytes().startswith(b"\x89PNG")
    text = page.read_text(encoding="utf-8")
    assert "Simulated rig: this is no measurement on hardware." in text
    assert "data:image/png;base64," in text
    # The picture itself may hold these four letters by chance; a namespace is a name, and loads nothing.
    loaded = re.sub(r"base64,[A-Za-z0-9+/=]+|xmlns=.http://www.w3.org/2000/svg.", "", text)
    assert "http" not in loaded.replace("http-equiv", "")
    embedded = html.unescape(text[text.index("<pre>") + 5 : text.index("</pre>")])
    assert msgspec.json.decode(embedded)["seed"] == 1


def test_an_angle_that_is_not_within_the_tolerance_is_printed_with_its_interval(shell: Shell, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    spot = ("search", "--seed", 1, "--tissue", "muscle", "--single", "--tolerance-mm", 0.3)
    code, out, _ = shell(*spot, "--journal", journal)
    assert code == 3
    said = " ".join(out.split())
    assert "mm at the marker, and 0.3 mm is tolerated; more acquisitions will not narrow it" in said
    assert re.search(r"best guess 0\.\d{3}° ± 0\.\d{3}°, not claimed", said)
    assert re.search(r"95 % interval \[0\.\d{3}°, \d\.\d{3}°\], within 0\.\d+ mm at the marker", said)
    held = read_journal(journal)
    assert held.configuration.plan.tolerance == Tolerance(mm=0.3)
    assert held.configuration.plan.others == 0
    code, out, _ = shell(*spot, "--no-journal", "--json")
    result = json.loads(out)
    assert (code, result["answer"], result["doubt"]) == (3, "unsure", "width")
    assert result["interval95_deg"][0] < result["angle_deg"] < result["interval95_deg"][1]
    assert 0.3e-3 < result["half_width_m"] < 1e-3


def test_the_page_of_a_replay_names_the_form_and_the_last_acquisition_and_has_no_empty_columns(
    shell: Shell, tmp_path: Path
) -> None:
    words = ("--method", "golden-section", "--as-published", "--plot", "--out", tmp_path, "--json")
    assert shell("replay", EXAMPLES / "simulated_scan.csv", *words)[0] == 0
    text = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert "<h1>golden-section as published on a replayed rig: " in text
    assert "<tr><th></th><th>angle [deg]</th><th>intensity</th></tr>" in text
    assert "<tr><td>acquisition at that angle</td><td>" in text


@pytest.fixture(scope="module")
def scan_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan of the simulated rig as SonixDAQ folders, one angle a folder; older layout below 0 deg, newer above."""
    folder = tmp_path_factory.mktemp("scan")
    rig = rigs.simulated(seed=11, marker_deg=2.0)
    for angle_deg in np.arange(-8.0, 12.01, 1.0):
        frame = rig.scanner.measure(float(angle_deg)).frame
        assert isinstance(frame, ChannelFrame)
        acquisition = folder / f"angle_{angle_deg:+.1f}deg"
        acquisition.mkdir()
        for number in range(128):
            line = frame.samples[element_of_file(number)]
            header = struct.pack("<2i", 1, 2080) if angle_deg < 0 else struct.pack("<3i", number, 1, 2080)
            name = f"CH{number:03d}-0000.daq" if angle_deg < 0 else f"CH{number:03d}.daq"
            (acquisition / name).write_bytes(header + line.astype("<i2").tobytes())
    return folder


def test_a_scan_in_sonixdaq_folders_of_both_layouts_is_searched(shell: Shell, scan_folder: Path) -> None:
    words = ("replay", scan_folder, "--method", "weighted-average", "--acquisitions", 21)
    words += ("--reference-deg", 2.0, "--json", "--as-published")
    code, out, _ = shell(*words)
    result = json.loads(out)
    assert code == 0
    assert result["error_deg"] < 0.3
    assert result["samples"][0]["depth_m"] == pytest.approx(0.05, abs=2e-3)


def test_a_frame_reports_its_source_as_text_and_as_json(shell: Shell, scan_folder: Path, tmp_path: Path) -> None:
    folder = scan_folder / "angle_+2.0deg"
    code, out, _ = shell("frame", folder, "--probe", "BPL9-5/55", "--plot", "--out", tmp_path, "--json")
    report = json.loads(out)
    assert code == 0
    assert report["found"]
    assert report["depth_m"] == pytest.approx(0.05, abs=1e-3)
    assert (tmp_path / "angle_+2.0deg.png").exists()
    code, out, _ = shell("frame", folder, "--probe", "BPL9-5/55")
    assert "source found" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("search", "--acquisitions", 1),
            "error: --acquisitions is '1', it must be at least 2; see 'markerseek search --help'",
        ),
        (("search", "--seed=x"), "--seed is 'x', it must be a whole number"),
        (
            ("calibrate", "scan.hdf5", "--direction", "up"),
            "--direction is 'up', it must be one of 'forward', 'reverse'",
        ),
        (("bank", "scan"), "missing argument 'OUT'; see 'markerseek bank scan --help'"),
        (("search", "--method", "ternery"), "did you mean ternary"),
        (("search", "--tissue", "beef"), "the simulated ones are"),
        (("ros2", "sim", "--write-rig", "/none/a.toml"), "/none/a.toml: it cannot be written: No such file"),
        (("search", "--colour", "red"), "no such option: --colour"),
        # What a bridge uses is not in the help, and is not proposed.
        (("search", "--heartbeet", "x"), "no such option: --heartbeet; see"),
        (("register", "--aksed-by", "x"), "no such option: --aksed-by"),
        (("search", "--sead", "1"), "--seed"),
        (("search", "--tolerance-mm", 0), "--tolerance-mm is 0.0, it must be a positive number"),
        (("search", "--others", 0.1, "--single"), "--others is 0.1, and --single states that it is 0"),
        (("search", "--out", "pictures"), "--out pictures: only pictures go there, and none is asked for; add --plot"),
        (("replay", EXAMPLES / "simulated_scan.csv", "--probe", "L3-8"), "--probe is L3-8, and"),
        (("frame", "nowhere.npy", "--probe", "L99"), "L99"),
        (("seek",), "no such command 'seek'"),
    ],
)
def test_wrong_usage_is_met_with_a_sentence_and_exit_code_2(
    shell: Shell, words: tuple[object, ...], message: str
) -> None:
    code, _, err = shell(*words)
    assert code == 2
    assert message in " ".join(err.replace("│", " ").split())


def test_a_journal_is_not_replayed_as_a_scan_and_the_command_for_it_is_given(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    shell("search", "--method", "ternary", "--acquisitions", 8, "--journal", path, "--json")
    code, out, err = shell("replay", path)
    assert (code, out) == (2, "")
    assert err.split("error: ")[1].count("\n") == 1
    assert "it is the journal of a run and no bank" in err
    for words in (("journal", "replay", path), ("bank", "import", path, "frames.hdf5")):
        assert f"'markerseek {' '.join(map(str, words))}'" in err
    assert shell("journal", "replay", path)[0] == 0
    assert shell("bank", "import", path, tmp_path / "frames.hdf5")[0] == 0
    assert json.loads(shell("bank", "info", tmp_path / "frames.hdf5", "--json")[1])["angles"] >= 7


def test_a_fault_ends_without_an_angle_and_with_exit_code_1(shell: Shell, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n[marker]\nangle_deg = 3.0\n[receiver]\npeak_counts = 9000.0\n')
    code, out, err = shell("search", "--rig", rig, "--json")
    assert code == 1
    assert "saturated" in err
    assert json.loads(out)["kind"] == "SaturationError"


@pytest.mark.parametrize(
    ("words", "number", "completed"), [("markerseek se", 1, "search"), ("markerseek search --method ter", 3, "ternary")]
)
def test_the_shell_completes_commands_and_methods(words: str, number: int, completed: str) -> None:
    asked = {"_MARKERSEEK_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(number)}
    program = "import sys; sys.argv = ['markerseek']; from markerseek.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program], env=os.environ | asked, capture_output=True, check=False)
    assert done.stdout.decode().split() == [completed]


@pytest.mark.long
def test_the_first_run_reports_that_it_compiles_and_the_second_does_not(tmp_path: Path) -> None:
    command = [Path(sys.executable).with_name("markerseek"), "frame", tmp_path / "noise.npy", "--probe", "BPL9-5/55"]
    np.save(tmp_path / "noise.npy", np.random.default_rng(3).normal(0, 40, (128, 2080)).astype(np.int16))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    first, second = (subprocess.run(command, check=False, capture_output=True, env=environment) for _ in range(2))
    assert b"compiling" in first.stderr
    assert second.stderr == b""
    assert first.stdout == second.stdout


def test_a_folder_that_cannot_take_pictures_is_refused_before_anything_is_measured(
    shell: Shell, tmp_path: Path
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("", encoding="utf-8")
    code, out, said = shell("search", "--plot", "--out", taken, "--journal", tmp_path / "run.journal")
    assert code == 2
    assert "no picture can be written there: it is a file; choose another folder" in said
    assert not out
    assert not (tmp_path / "run.journal").exists()
