"""Which tests `make test-changed` runs, in a clone of a few files."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.changed import changed_since, chosen_for

FILES = {
    "src/markerseek/sim/stage.py": "",
    "src/markerseek/sim/laser.py": "",
    "src/markerseek/acoustics/_kernel.py": "",
    "tests/helper.py": "",
    "tests/unit/sim/test_stage.py": "",
    "tests/unit/sim/test_stage_sweeps.py": "",
    "tests/unit/sim/test_stages.py": "from tests.helper import each\n",
    "tests/reference/sim/test_stage.py": "",
    "tests/reference/acoustics/test_kernel.py": "",
}

CASES = {
    "a module with tests of its own": (
        "src/markerseek/sim/stage.py",
        ["tests/reference/sim/test_stage.py", "tests/unit/sim/test_stage.py", "tests/unit/sim/test_stage_sweeps.py"],
    ),
    "one without": ("src/markerseek/sim/laser.py", ["tests/unit/sim"]),
    "a private one": ("src/markerseek/acoustics/_kernel.py", ["tests/reference/acoustics/test_kernel.py"]),
    "a test": ("tests/unit/sim/test_stages.py", ["tests/unit/sim/test_stages.py"]),
    "a test that is gone": ("tests/unit/sim/test_gone.py", []),
    "a helper": ("tests/helper.py", ["tests/unit/sim/test_stages.py"]),
    "a page": ("docs/index.md", []),
}


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("case", CASES)
def test_a_changed_file_has_its_tests(clone: Path, case: str) -> None:
    changed, expected = CASES[case]
    assert chosen_for([changed], root=clone) == expected


def test_changed_is_what_differs_from_where_the_branch_began(clone: Path) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        subprocess.run(["git", *who, *words], cwd=clone, check=True, capture_output=True)

    git("init", "--initial-branch", "main")
    git("add", ".")
    git("commit", "--message", "first")
    git("switch", "--create", "mine")
    (clone / "tests" / "helper.py").write_text("each = 1\n", encoding="utf-8")
    git("commit", "--all", "--message", "mine")
    (clone / "new.py").write_text("", encoding="utf-8")
    git("switch", "main")
    (clone / "others.py").write_text("", encoding="utf-8")
    git("add", "others.py")
    git("commit", "--message", "of others")
    git("switch", "mine")
    assert changed_since("main", root=clone) == ["new.py", "tests/helper.py"]
