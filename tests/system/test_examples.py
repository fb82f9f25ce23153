"""The examples run unchanged, and the committed scan is the output of its script."""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import numpy as np
import pytest
import typer

from markerseek.cli.app import app
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
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```$", own, re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(block) for block in found]


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*/*.md"))]


def test_the_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    for block in blocks(ROOT / "README.md", "python"):
        exec(compile(block, "README.md", "exec"), {})
    assert "Found(mean_deg=" in capsys.readouterr().out


def test_the_python_that_finds_a_laser_spot_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The page's own block, on simulated images of a spot at a known pixel."""
    looks = {"size_px": (320, 240), "settings": EndoscopeSettings(), "rng": np.random.default_rng(1)}
    given = {"frames": spot_images(np.array([150.0, 100.0]), **looks), "dark": spot_images(None, **looks)}
    _, block = blocks(ROOT / "docs" / "how-to" / "register-the-robot.md", "python")
    exec(compile(block, "register-the-robot.md", "exec"), given)
    x_px, y_px, sigma_px = map(float, capsys.readouterr().out.split())
    assert np.hypot(x_px - 150, y_px - 100) < max(5 * sigma_px, 0.5)


def test_the_python_that_reads_a_journal_reads_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole_run(tmp_path / "run.journal", acquisitions=3, counts_of=lambda index: counts(seed=index))
    monkeypatch.chdir(tmp_path)
    (block,) = blocks(ROOT / "docs" / "reference" / "journal-format.md", "python")
    exec(compile(block, "journal-format.md", "exec"), {})
    printed = [tuple(map(float, line.split())) for line in capsys.readouterr().out.splitlines()]
    samples = [each.event.sample for each in read_journal(Path("run.journal")).entries if hasattr(each.event, "sample")]
    assert printed == [(each.angle_deg, each.reading.intensity, each.frame.samples.std()) for each in samples]
    assert len(printed) == 3


def test_the_python_that_lists_events_lists_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole_run(tmp_path / "run.journal", acquisitions=3, counts_of=lambda index: counts(seed=index))
    monkeypatch.chdir(tmp_path)
    (block,) = blocks(ROOT / "docs" / "reference" / "events.md", "python")
    exec(compile(block, "events.md", "exec"), {})
    printed = [line.split()[1] for line in capsys.readouterr().out.splitlines()]
    assert (printed[0], printed[-1], printed.count("Measured")) == ("Started", "Finished", 3)


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
    lines += [line for line in re.findall(r"`(markerseek [^`]+)`", table) if "|" not in line]
    return sorted({re.split(r"\s+#", line)[0] for line in lines})


@pytest.mark.parametrize("line", console_lines())
def test_the_commands_of_the_pages_are_understood(line: str) -> None:
    """Parsed as the shell and the command would, and not run."""
    command, words = typer.main.get_command(app), shlex.split(line)[1:]
    # Typer has a Click of its own, so that isinstance would not know a group.
    while hasattr(command, "commands"):
        name = words.pop(0)
        assert name in command.commands, f"{name} is no command"
        command = command.commands[name]
    command.make_context(command.name, words)
