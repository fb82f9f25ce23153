"""The examples, the Python of the pages and the tutorials run unchanged, and give what is committed or shown."""

from __future__ import annotations

import doctest
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import numpy as np
import pytest

from markerseek.cli.app import all_commands
from markerseek.core import ConfigError
from markerseek.drivers import bench_settings_from
from markerseek.records.journal import read_journal
from markerseek.sim import EndoscopeSettings
from tests.spot_images import spot_images
from tests.unit.records.journal.synthetic_journals import counts, whole_run

ROOT = Path(__file__).parents[2]


def test_the_example_finds_the_marker_by_both_loops(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "examples" / "find_a_marker.py"))
    out = capsys.readouterr().out
    found = [float(number) for number in re.findall(r"Found\(mean_deg=(-?[\d.]+)", out)]
    truth = float(re.findall(r"truth: (-?[\d.]+) deg", out)[0])
    assert len(found) == 2
    assert np.abs(np.array(found) - truth).max() < 0.75


@pytest.mark.long
def test_the_committed_scans_are_those_that_their_script_makes(tmp_path: Path) -> None:
    script = tmp_path / "make_simulated_scan.py"
    script.write_text((ROOT / "examples" / "make_simulated_scan.py").read_text(encoding="utf-8"), encoding="utf-8")
    subprocess.run([sys.executable, script], check=True)
    for name in ("simulated_scan.csv", "two_sources.csv"):
        kept, made = (np.loadtxt(path / name, delimiter=",", skiprows=1) for path in (ROOT / "examples", tmp_path))
        np.testing.assert_allclose(made, kept, rtol=1e-3, atol=0.02)


def blocks(path: Path, language: str) -> list[str]:
    """Code blocks of a page in this language, without their indentation, but for files and pieces that it shows."""
    own = re.sub(r"<!-- (from )?\S+ -->\n```\w*\n.*?\n```\n", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    found = re.findall(r"^ *```(\w*)\n(.*?)^ *```$", own, re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(block) for name, block in found if name == language]


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*/*.md"))]


def run_python(page: str, number: int, given: dict[str, object] | None = None) -> None:
    """Run one block of a page as it stands there."""
    exec(compile(blocks(ROOT / page, "python")[number], page, "exec"), given or {})


def test_the_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(len(blocks(ROOT / "README.md", "python"))):
        run_python("README.md", number)
    assert "Found(mean_deg=" in capsys.readouterr().out


def test_the_python_that_finds_a_laser_spot_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The page's own block, on simulated images of a spot at a known pixel."""
    looks = {"size_px": (320, 240), "settings": EndoscopeSettings(), "rng": np.random.default_rng(1)}
    given = {"frames": spot_images(np.array([150.0, 100.0]), **looks), "dark": spot_images(None, **looks)}
    run_python("docs/how-to/read-a-registration.md", 1, given)
    x_px, y_px, sigma_px = map(float, capsys.readouterr().out.split())
    assert np.hypot(x_px - 150, y_px - 100) < max(5 * sigma_px, 0.5)


def test_the_python_that_reads_a_journal_and_its_events_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole_run(tmp_path / "run.journal", acquisitions=3, counts_of=lambda index: counts(seed=index))
    monkeypatch.chdir(tmp_path)
    run_python("docs/reference/journal-format.md", 0)
    printed = [tuple(map(float, line.split())) for line in capsys.readouterr().out.splitlines()]
    samples = [each.event.sample for each in read_journal(Path("run.journal")).entries if hasattr(each.event, "sample")]
    assert printed == [(each.angle_deg, each.reading.intensity, each.frame.samples.std()) for each in samples]
    assert len(printed) == 3
    run_python("docs/reference/journal-format.md", 1)
    kinds = [line.split()[1] for line in capsys.readouterr().out.splitlines()]
    assert (kinds[0], kinds[-1], kinds.count("Measured")) == ("Started", "Finished", 3)


def test_no_other_python_of_the_pages_is_left_unread() -> None:
    """What needs another program, as 3D Slicer's Python, is at least Python."""
    for path in PAGES:
        for block in blocks(path, "python"):
            compile(block, path.name, "exec")


def test_the_keys_of_rig_files_on_the_pages_exist() -> None:
    tables = [tomllib.loads(block) for path in PAGES for block in blocks(path, "toml")]
    tables = [table for table in tables if "project" not in table]
    assert len(tables) >= 2
    for name, part in (each for table in tables for each in table.items() if each[0] != "kind"):
        # A page shows some keys of a table: that others are missing is found last, after all that are unknown.
        with pytest.raises(ConfigError, match=r"^the key \S+ is missing"):
            bench_settings_from({name: part})


def console_lines() -> list[str]:
    """The lines of the console blocks and of the table of commands that call the command; joined where they go on."""
    lines = []
    for path in PAGES:
        text = "".join(blocks(path, "")).replace("\\\n", " ")
        lines += re.findall(r"^(?:\$ )?(markerseek .*)$", text, re.MULTILINE)
    table = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    # Below its tables the page has the options of all commands.
    tables = table.partition("<!-- made: ")[0]
    lines += [line for line in re.findall(r"`(markerseek [^`]+)`", tables) if "|" not in line]
    return sorted({re.split(r"\s+#", line)[0] for line in lines})


@pytest.mark.parametrize("line", console_lines())
def test_the_commands_of_the_pages_are_understood(line: str) -> None:
    """Parsed as the shell and the command would, and not run."""
    command = all_commands()
    words = shlex.split(line)[1:]
    # Typer has a Click of its own, so that isinstance would not know a group.
    while hasattr(command, "commands"):
        name = words.pop(0)
        assert name in command.commands, f"{name} is no command"
        command = command.commands[name]
    command.make_context(command.name, words)


ENDINGS = {0, 3}  # found, and any other answer


def shown(page: Path) -> list[tuple[str, str]]:
    """Commands of a page's console blocks in their order, each with what the page shows of its output."""
    blocks = re.findall(r"^```console\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [
        (command, output)
        for block in blocks
        for command, output in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE)
    ]


STUDY = ROOT / "docs" / "how-to" / "run-a-study.md"
"""A page whose commands compute for minutes."""

SHOWN = [
    pytest.param(page, marks=pytest.mark.long if page == STUDY else (), id=page.stem)
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if shown(page)
]


@pytest.mark.parametrize("page", SHOWN)
def test_a_page_shows_what_its_commands_print(page: Path, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "COLUMNS": "120", "XDG_STATE_HOME": str(tmp_path / "state")}
    for command, expected in shown(page):
        ended = subprocess.run(
            ["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert ended.returncode in ENDINGS, f"{command}\n{ended.stderr}"
        as_shown = doctest.OutputChecker().check_output(
            expected, ended.stdout, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        )
        assert as_shown, f"{page.name}: {command}\nshown:\n{expected}\nprinted:\n{ended.stdout}\n{ended.stderr}"


def test_a_scan_of_ones_own_is_searched_in_python(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / "docs" / "tutorials" / "replay-your-scan.md").read_text(encoding="utf-8")
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        exec(compile(block, "replay-your-scan.md", "exec"), names)
        assert getattr(names["result"], "answer", None) == "found"
    assert capsys.readouterr().out.startswith("recording of 141 angles\nanswer: found\n")


def ran_beside(folder: Path, *words: object) -> str:
    """Output of Python in a folder that holds the method of the tutorial and nothing else of the examples."""
    shutil.copy(ROOT / "examples" / "own_policy.py", folder)
    ended = subprocess.run([sys.executable, *map(str, words)], cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_the_method_of_the_tutorial_searches_from_a_script_beside_it(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorials" / "own-policy.md").read_text(encoding="utf-8")
    (searching,) = re.findall(r"^```python\n(import markerseek\n.*?)^```", text, re.MULTILINE | re.DOTALL)
    (tmp_path / "mine.py").write_text(searching, encoding="utf-8")
    assert re.search(r"^answer: found$", ran_beside(tmp_path, "mine.py"), re.MULTILINE)


def test_the_method_of_the_tutorial_keeps_the_contract(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorials" / "own-policy.md").read_text(encoding="utf-8")
    (saved,) = re.findall(r"`(test_\w+\.py)` beside.*?^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (tmp_path / saved[0]).write_text(saved[1], encoding="utf-8")
    out = ran_beside(tmp_path, "-m", "pytest", "-q", "-p", "no:cacheprovider", saved[0])
    assert re.search(r"^[5-9] passed|^\d\d passed", out, re.MULTILINE), out
