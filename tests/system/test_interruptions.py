"""Signals to a command in the background, and Ctrl-C while a command is still importing."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from markerseek.cli.signals import StoppedBySignal, stopped_by_signals
from tests.emulated import markerseek, ran


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_a_search_in_the_background_stops_and_says_how_to_continue(tmp_path: Path) -> None:
    """A shell without job control starts a command with & so that it ignores SIGINT."""
    journal = tmp_path / "run.journal"
    command = markerseek("search", "--seed", 1, "--pace", 0.2, "--journal", journal)
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # noqa: PLW1509  one thread
    )
    # a commit of a frame takes half a megabyte: the search has begun
    while process.poll() is None and not (journal.exists() and journal.stat().st_size > 100_000):
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert 0 <= said.find("stopped by the user") < said.find("continue with: markerseek resume")
    assert "Traceback" not in said


class Dropped:
    """Python drops every exception that is raised while one of these is deleted."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_whose_exception_python_drops_stops_the_run_all_the_same() -> None:
    def run() -> None:
        Dropped()
        # A second without the signal.
        for _ in range(50_000_000):
            pass

    with pytest.raises(StoppedBySignal, match="SIGTERM"), stopped_by_signals():
        run()


def test_after_a_stop_no_signal_interrupts_the_end() -> None:
    before = signal.getsignal(signal.SIGINT)
    with stopped_by_signals():
        pass
    # Nothing was stopped: the next Ctrl-C counts.
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(StoppedBySignal, match="the user"), stopped_by_signals():
        signal.raise_signal(signal.SIGINT)
    # While the devices are closed.
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGTERM)


INTERRUPTED = """
import os, signal, sys
class CtrlC:
    def find_spec(self, name, path=None, target=None):
        if name == "numba":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, CtrlC())
"""


def test_ctrl_c_during_an_import_gives_one_sentence() -> None:
    ended = ran("search", "--seed", 1, "--no-journal", before=INTERRUPTED)
    assert (ended.returncode, ended.stderr) == (130, "error: stopped by the user\n")


HUNG_STAGE = """
import time
from markerseek.drivers import StageStatus

class Stage:
    speed_deg_s, resolution_deg, emulated = 20.0, 0.01, True
    hangs = False

    def read(self):
        while self.hangs:
            try:
                time.sleep(1)
            except BaseException:
                pass
        return StageStatus(angle_deg=0.0, moving=False)

    def go(self, angle_deg):
        self.hangs = True
        print("it hangs", flush=True)

    def stop(self):
        pass
"""


@pytest.mark.real_time
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_driver_that_hangs_is_named_and_cannot_hold_up_the_end(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "my_stage.py").write_text(HUNG_STAGE)
    rig = tmp_path / "rig.toml"
    simulated = '[laser]\ndriver = "simulated"\n[receiver]\ndriver = "simulated"\n'
    rig.write_text(f'kind = "bench"\n[stage]\ndriver = "my_stage:Stage"\n{simulated}')
    command = markerseek("search", "--rig", rig, "--arm", "--no-journal")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "it hangs\n"
    # The second is ignored, as while a sound rig is stopped.
    process.send_signal(number)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    line = HUNG_STAGE.splitlines().index("                time.sleep(1)") + 1
    place = f"read() of {tmp_path}/my_stage.py, line {line}"
    assert said.count(place) == 2, said
    assert said.index("stopping takes long") < said.index("the process was ended")
