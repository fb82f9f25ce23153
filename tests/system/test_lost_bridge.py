"""A search whose bridge has gone, whatever signals it has inherited."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from markerseek.records.journal import Interrupted
from tests.emulated import exit_code_of, last_event, markerseek

QUICK = ("search", "--seed", "1", "--method", "weighted-average", "--acquisitions", "4", "--as-published")


SLOW = ("search", "--seed", "1", "--method", "weighted-average", "--pace", "0.2")


INHERITED = {
    "ignored": "signal.signal(signal.SIGTERM, signal.SIG_IGN)",
    "blocked": "signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))",
}


@pytest.mark.real_time
@pytest.mark.parametrize("how", INHERITED)
def test_a_search_ends_with_its_bridge_whatever_it_has_inherited(how: str, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    beats, beating = os.pipe()
    inheriting = f"import os, signal, sys; {INHERITED[how]}; os.execv(sys.argv[1], sys.argv[1:])"
    command = markerseek(*SLOW, "--journal", journal, "--heartbeat", f"/dev/fd/{beats}", "--json")
    process = subprocess.Popen(
        [sys.executable, "-c", inheriting, *command],
        pass_fds=(beats,),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(beats)
    while not (journal.exists() and journal.stat().st_size > 100_000):
        assert process.poll() is None
        os.write(beating, b".")
        time.sleep(0.02)
    os.close(beating)
    began_s = time.monotonic()
    assert exit_code_of(process) == 128 + signal.SIGTERM
    # At once, and 1 s where the end hangs; the rest is for a busy computer.
    assert time.monotonic() - began_s < 3
    assert last_event(journal) == Interrupted(reason="another program (SIGTERM)")


HUNG = """
import signal, time
import markerseek.runs.run as module
def hang(*_):
    print("hangs", flush=True)
    # As a library of a vendor that returns to Python only once its device answers.
    signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
    time.sleep(60)
module.Run.events = hang
"""


@pytest.mark.real_time
def test_an_end_that_hangs_is_ended_after_a_second() -> None:
    beats, beating = os.pipe()
    words = (*QUICK, "--no-journal", "--heartbeat", f"/dev/fd/{beats}")
    process = subprocess.Popen(
        markerseek(*words, before=HUNG), pass_fds=(beats,), stderr=subprocess.PIPE, stdout=subprocess.PIPE
    )
    os.close(beats)
    while not select.select([process.stdout], [], [], 0.1)[0]:
        assert process.poll() is None
        os.write(beating, b".")
    os.close(beating)
    began_s = time.monotonic()
    process.communicate(timeout=55)
    assert process.returncode == 128 + signal.SIGTERM
    assert time.monotonic() - began_s < 30
