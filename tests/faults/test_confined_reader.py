"""A parser that a foreign file has taken control of: it reads that file and the libraries, and reaches nothing else."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from markerseek.records.sandbox import Sandbox
from tests.faults.hostile_readers import attempts

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or ctypes.CDLL(None).syscall(444, None, ctypes.c_size_t(0), 1) < 1,
    reason="needs Linux with Landlock",
)
MAY = {"reads its file", "imports a library"}


WITHOUT = """
import sys
from pathlib import Path
from tests.faults.hostile_readers import attempts
print(sum(bool(each[0]) for each in attempts(Path(sys.argv[1])).values()))
"""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A file of the user, and a foreign one that is after it."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    secret, foreign = tmp_path / "own" / "thesis.tex", tmp_path / "foreign.mat"
    secret.parent.mkdir()
    secret.write_text("four years\n")
    foreign.write_text(f"{secret}\n")
    return secret, foreign


def test_a_parser_inside_opens_no_other_file_no_socket_and_no_program(files: tuple[Path, Path]) -> None:
    secret, foreign = files
    with Sandbox() as sandbox:
        # Twice: the child that forks is not confined itself, and serves on.
        for _ in range(2):
            found = {name: bool(value[0]) for name, value in sandbox.read(attempts, foreign).items()}
            assert {name for name, done in found.items() if done} == MAY
    assert (secret.read_text(), list(secret.parent.iterdir())) == ("four years\n", [secret])


def test_without_the_confinement_it_would(files: tuple[Path, Path]) -> None:
    """Else the test above could not fail."""
    secret, foreign = files
    done = subprocess.run([sys.executable, "-c", WITHOUT, foreign], capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(MAY) + 9
    assert not secret.exists()
