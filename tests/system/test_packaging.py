"""What users get: no tools of development in the environment of the commands, and a page with every licence."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.waiting import wait_until

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def pinned(name: str) -> dict[str, str]:
    """Versions of a list by package."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    return dict(re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE))


def names(requirements: list[object]) -> set[str]:
    """Names of packages in a list of requirements, as the index writes them."""
    return {re.match(r"[\w-]+", each)[0].lower() for each in requirements if isinstance(each, str)}


def test_no_tool_of_development_is_an_extra_or_comes_with_one() -> None:
    groups = PROJECT["dependency-groups"]
    # To build with setuptools, an editable installation needs it.
    tools = set().union(*(names(groups[group]) for group in groups)) - {"setuptools"}
    assert {"pytest", "sphinx", "ruff", "pacfish"} <= tools
    for extra, needed in PROJECT["project"]["optional-dependencies"].items():
        assert not names(needed) & tools, extra
    for name in ("demo", "run"):
        assert not pinned(name).keys() & (tools | {"coverage", "pytest-cov", "myst-parser"}), name


def test_the_lists_agree_on_versions() -> None:
    developers = pinned("dev")
    for name in ("demo", "run"):
        for package, version in pinned(name).items():
            assert developers.get(package, version) == version, package


def test_the_page_of_licences_has_what_is_pinned_and_nothing_under_the_gpl() -> None:
    page = (ROOT / "requirements" / "licences.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\w.-]+) \| (\d\S*) \| (.+) \| (.*) \|$", page, re.MULTILINE)
    assert {name: version for name, version, _, _ in rows} == pinned("run")
    for name, _, licence, remark in rows:
        assert "GPL" not in licence or "does not hold" in remark, name


def test_the_changelog_has_releases_and_a_place_for_the_next_one() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "\n<!-- scriv-insert-here -->\n" in text
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert headings
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", heading) for heading in headings)


def test_the_notes_of_a_release_are_its_section_of_the_changelog() -> None:
    section_of = runpy.run_path(str(ROOT / "release" / "release.py"))["section_of"]
    heads = [f"<a id='changelog-{version}'></a>\n## {version} (2026-01-02)\n\n" for version in ("0.2.0", "0.1.0")]
    text = f"# Changelog\n\n{heads[0]}### Rigs\n\n- new (as said)\n\n{heads[1]}- first\n"
    assert section_of("0.2.0", text) == "### Rigs\n\n- new (as said)"
    assert section_of("0.1.0", text) == "- first"


CHANGES = [path for path in (ROOT / "changelog.d").glob("*.md") if path.name != "README.md"]


@pytest.mark.parametrize("path", CHANGES, ids=lambda path: path.stem)
def test_a_change_has_a_theme_and_bullets_or_a_table(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.startswith("### ")
    assert not re.search(r"^#{1,2} |^#### ", text, re.MULTILINE)
    for theme in text.split("### ")[1:]:
        assert re.search(r"^[-|] ", theme, re.MULTILINE)


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_a_python_that_is_missing_or_too_old_is_said_before_anything_is_made(tmp_path: Path) -> None:
    old = tmp_path / "python3.10"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy2(ROOT / name, tmp_path)
    for python in ("no-such-python", str(old)):
        command = ["make", "demo", f"PYTHON={python}"]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ended.returncode == 2
        assert f"PYTHON is {python}: it is missing, older than 3.11" in ended.stderr
        assert "make demo PYTHON=python3.12" in ended.stderr
        assert not (tmp_path / ".venv").exists()


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_ctrl_c_in_the_set_up_says_how_to_go_on_and_shows_no_traceback(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy2(ROOT / name, tmp_path)
    # Also where the tests themselves run in the background, which ignores Ctrl-C.
    command = ["env", "--default-signal=INT", "make", "demo", f"PYTHON={sys.executable}"]
    # As a person starts it, and not as a part of the `make test` that runs this test.
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, start_new_session=True, **streams) as started:
        said = started.stdout.readline()
        wait_until(lambda: (tmp_path / ".venv" / "bin" / "python").exists() or started.poll() is not None)
        assert started.poll() is None
        os.killpg(started.pid, signal.SIGINT)
        said += started.stdout.read()
    assert started.returncode != 0
    assert not (tmp_path / ".venv" / "demo").exists()
    assert "after Ctrl-C the same command goes on" in said
    assert "Traceback" not in said


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs a clone")
def test_every_folder_of_a_clone_is_in_the_source_distribution() -> None:
    held = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    folders = {name.split("/")[0] for name in held if "/" in name and not name.startswith(".")}
    grafted = set(re.findall(r"^graft (\S+)$", (ROOT / "MANIFEST.in").read_text(encoding="utf-8"), re.MULTILINE))
    assert folders - {"src"} == grafted
