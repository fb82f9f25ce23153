"""Where output goes and who may read it: closed and full standard output, rights of files, odd names."""

from __future__ import annotations

import os
import stat
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.emulated import markerseek, ran

Shell = Callable[..., tuple[int, str, str]]
SEARCH = ("search", "--seed", "1", "--method", "weighted-average", "--acquisitions", "4", "--as-published")


def ended(tmp_path: Path, redirected: str) -> subprocess.CompletedProcess[str]:
    """A search whose standard streams a shell has changed."""
    command = markerseek(*SEARCH, "--journal", tmp_path / "run.journal")
    shell = ["sh", "-c", f'exec "$@" {redirected}', "sh", *command]
    return subprocess.run(shell, capture_output=True, text=True, check=False)


def test_a_good_search_with_its_output_closed_ends_well(tmp_path: Path, shell: Shell) -> None:
    done = ended(tmp_path, ">&-")
    assert (done.returncode, done.stderr) == (0, f"journal: {tmp_path / 'run.journal'}\n")
    # Nothing was printed into the file that would have got the number of standard output.
    code, out, _ = shell("journal", "verify", tmp_path / "run.journal")
    assert (code, "faults" not in out) == (0, True)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_good_search_whose_output_is_full_says_so_in_one_sentence(tmp_path: Path) -> None:
    done = ended(tmp_path, ">/dev/full")
    assert done.returncode == 74
    assert done.stderr == (
        f"journal: {tmp_path / 'run.journal'}\nerror: the output cannot be written: No space left on device; "
        "a journal, if one is kept, holds the answer\n"
    )
    assert (tmp_path / "run.journal").exists()


def test_what_a_command_writes_can_be_read_by_its_owner_only(tmp_path: Path) -> None:
    out = tmp_path / "pictures"
    journal = tmp_path / "run.journal"
    events = tmp_path / "run.events"
    before = os.umask(0o022)
    try:
        for words in (("--journal", journal, "--plot", "--out", out), ("--no-journal", "--events", events)):
            assert ran(*SEARCH, *words).returncode == 0
    finally:
        os.umask(before)
    written = [journal, events, out / "search.png", out / "search.html"]
    assert {each.name: stat.S_IMODE(each.stat().st_mode) for each in written} == dict.fromkeys(
        (each.name for each in written), 0o600
    )


def test_colons_in_a_path_are_printed_as_they_are(tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "a:x:b:smile:.journal"
    _, out, err = shell("journal", "verify", path)
    assert "a:x:b:smile:.journal" in (out + err).replace("\n", "")
    _, out, err = shell(*SEARCH, "--journal", path)
    assert f"journal: {path}\n" in out + err
    assert "a:x:b:smile:.journal" in shell("journal", "list", tmp_path)[1]
