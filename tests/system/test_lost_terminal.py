"""Commands whose terminal or disk has gone."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.records.journal import Interrupted
from tests.emulated import exit_code_of, last_event, markerseek

Shell = Callable[..., tuple[int, str, str]]


QUICK = ("search", "--seed", "1", "--method", "weighted-average", "--acquisitions", "4", "--as-published")


SLOW = ("search", "--seed", "1", "--method", "weighted-average", "--pace", "0.2")


HUNG_UP = """
import contextlib, os, signal
signal.signal(signal.SIGHUP, signal.SIG_IGN)
os.write(2, b"ready")
with contextlib.suppress(OSError):
    os.read(0, 1)
"""
"""Ignores the end of its terminal, as nohup has it, and waits for it."""


def on_a_terminal(*words: object, before: str = "", answer: Path | None = None) -> tuple[subprocess.Popen[bytes], int]:
    """A command with a terminal of its own, and the other end of that; standard output is a file if one is named."""
    ours, theirs = os.openpty()
    command = markerseek(*words, before=before)
    out = theirs if answer is None else os.open(answer, os.O_WRONLY | os.O_CREAT)
    # A session of its own, whose terminal this is: its end is SIGHUP.
    taking = (
        "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(2, termios.TIOCSCTTY, 0); "
        "os.execv(sys.argv[1], sys.argv[1:])"
    )
    process = subprocess.Popen([sys.executable, "-c", taking, *command], stdin=theirs, stdout=out, stderr=theirs)
    os.close(theirs)
    if answer is not None:
        os.close(out)
    return process, ours


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "command", [(*QUICK, "--json"), ("bank", "scan"), ("doctor", "--json")], ids=lambda words: words[0]
)
def test_messages_on_a_full_disk_cost_no_answer(command: tuple[str, ...], tmp_path: Path) -> None:
    if command[0] == "bank":
        command = (*command, str(tmp_path / "scan.hdf5"), "--json")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(markerseek(*command), stdout=subprocess.PIPE, stderr=full, text=True, check=False)
    assert done.returncode == 0
    assert json.loads(done.stdout)


def test_an_error_whose_message_nobody_sees_keeps_its_exit_code(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        words = ("search", "--rig", tmp_path / "none.toml", "--json")
        done = subprocess.run(markerseek(*words), stdout=subprocess.PIPE, stderr=full, text=True, check=False)
    assert done.returncode == 2
    assert "none.toml" in json.loads(done.stdout)["error"]


def test_a_search_outlives_its_terminal_where_sighup_is_ignored(tmp_path: Path) -> None:
    answer = tmp_path / "answer.json"
    journal = tmp_path / "run.journal"
    process, terminal = on_a_terminal(*QUICK, "--json", "--journal", journal, before=HUNG_UP, answer=answer)
    os.read(terminal, 5)
    os.close(terminal)
    assert exit_code_of(process) == 0
    assert json.loads(answer.read_text())["answer"] == "found"


def test_an_answer_that_went_to_the_terminal_is_in_the_journal_and_the_exit_code_says_so(
    tmp_path: Path, shell: Shell
) -> None:
    journal = tmp_path / "run.journal"
    process, terminal = on_a_terminal(*QUICK, "--journal", journal, before=HUNG_UP)
    os.read(terminal, 5)
    os.close(terminal)
    assert exit_code_of(process) == 74
    code, out, _ = shell("resume", journal, "--json")
    assert (code, json.loads(out)["answer"]) == (0, "found")


@pytest.mark.real_time
@pytest.mark.parametrize("words", [(), ("--json",)], ids=["text", "json"])
def test_the_end_of_the_terminal_is_129_and_interrupted_in_the_record(words: tuple[str, ...], tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    process, terminal = on_a_terminal(*SLOW, "--journal", journal, *words)
    while not (journal.exists() and journal.stat().st_size > 100_000):
        assert process.poll() is None
        # What it prints is read, as a terminal does.
        if select.select([terminal], [], [], 0.02)[0]:
            os.read(terminal, 4096)
    os.close(terminal)
    assert exit_code_of(process) == 128 + signal.SIGHUP
    assert last_event(journal) == Interrupted(reason="the end of its terminal (SIGHUP)")


@pytest.mark.real_time
def test_a_bridge_that_ignores_sighup_outlives_its_terminal() -> None:
    process, terminal = on_a_terminal("igtl", "--port", "0", before=HUNG_UP)
    os.read(terminal, 5)
    os.write(terminal, b"\n")
    said = b""
    while b"Ctrl-C ends the bridge" not in said:
        said += os.read(terminal, 4096)
    os.close(terminal)
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=1)
    process.send_signal(signal.SIGTERM)
    assert exit_code_of(process) == 128 + signal.SIGTERM
