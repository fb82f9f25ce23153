"""What a tutorial shows is what its commands print."""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
ENDINGS = {0, 3}  # found, and any other answer


def shown(page: Path) -> list[tuple[str, str]]:
    """Commands of a page's console blocks in their order, each with what the page shows of its output."""
    blocks = re.findall(r"^```console\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [
        (command, output)
        for block in blocks
        for command, output in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE)
    ]


@pytest.mark.parametrize("page", [page for page in PAGES if shown(page)], ids=lambda page: page.stem)
def test_a_tutorial_shows_what_its_commands_print(page: Path, tmp_path: Path) -> None:
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


def test_the_method_of_the_tutorial_searches(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / "docs" / "tutorials" / "own-policy.md").read_text(encoding="utf-8")
    searching = re.findall(r"^```python\n(import markerseek\n.*?)^```", text, re.MULTILINE | re.DOTALL)[0]
    monkeypatch.syspath_prepend(ROOT / "examples")
    exec(compile(searching, "own-policy.md", "exec"), {})
    assert capsys.readouterr().out.startswith("Found(mean_deg=")


def test_the_method_of_the_tutorial_keeps_the_contract(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorials" / "own-policy.md").read_text(encoding="utf-8")
    (saved,) = re.findall(r"`(test_\w+\.py)` beside.*?^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (tmp_path / saved[0]).write_text(saved[1], encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT / "examples")}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", saved[0]]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout
    assert re.search(r"^[5-9] passed|^\d\d passed", ended.stdout, re.MULTILINE), ended.stdout
