"""A command ends with the program that runs it, whatever it does just then: P17, five seconds in every state."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from markerseek.cli.heartbeat import ORDERLY_S, SILENT_S, watch_heartbeat

pytestmark = pytest.mark.real_time

PROMISED_S = 5.0
"""Time from the last beat to the end of the command."""

BUSY_S = 4.0
"""What a busy computer may need in addition."""

RIG = 'kind = "bench"\n' + "".join(f'[{each}]\ndriver = "simulated"\n' for each in ("stage", "laser", "receiver"))

SLOW_IMPORT = """
import builtins, time
imported = builtins.__import__
def slow(name, *rest):
    if name.startswith("numpy"):
        print("reached", flush=True)
        time.sleep(60)
    return imported(name, *rest)
builtins.__import__ = slow
"""

OPENS = """
import time
from markerseek import registration, rigs
def hang(*_, **__):
    print("reached", flush=True)
    time.sleep(60)
rigs.bench = registration.SimulatedRoom = hang
"""
"""A driver that does not come back while it opens its device."""

DRAWS = """
import time
from markerseek.cli.report import Output
def hang(*_):
    print("reached", flush=True)
    time.sleep(60)
Output.show = hang
"""

START = "from markerseek.cli import main; main()"


def started(*words, before="", terminal=None):
    """A command with a heartbeat, and the pipe of its beats."""
    beats, beating = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", f"{before}\n{START}", *map(str, words), "--heartbeat", f"/dev/fd/{beats}"],
        pass_fds=(beats,),
        stdin=subprocess.DEVNULL if terminal is None else terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE if terminal is None else terminal,
    )
    os.close(beats)
    return process, beating


def reach(process, beating, has_come):
    """Wait for a state, and beat meanwhile."""
    until_s = time.monotonic() + 120
    while not has_come():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until_s
        os.write(beating, b".")
        time.sleep(0.1)


def ends_in_s(process, beating, *, killed):
    """Seconds until the command has ended after its bridge was killed, or has hung; and what it said."""
    os.write(beating, b".")
    if killed:
        os.close(beating)
    began_s = time.monotonic()
    try:
        process.wait(60)
    finally:
        process.kill()
        if not killed:
            os.close(beating)
    taken_s = time.monotonic() - began_s
    return taken_s, process.communicate()[1]


def readable(stream):
    return lambda: bool(select.select([stream], [], [], 0)[0])


@pytest.mark.parametrize("killed", [True, False], ids=["bridge killed", "bridge hangs"])
@pytest.mark.parametrize(
    ("before", "words"),
    [
        (SLOW_IMPORT, ("search", "--seed", "4", "--no-journal")),
        (SLOW_IMPORT, ("register", "--simulate")),
        (OPENS, ("search", "--rig", "RIG", "--no-journal")),
        (OPENS, ("register", "--simulate", "--record", "FOLDER")),
        (DRAWS, ("search", "--seed", "4", "--no-journal")),
    ],
    ids=["importing", "importing for a session", "opening devices", "opening a session", "drawing"],
)
def test_a_command_ends_with_its_bridge_before_and_after_it_searches(before, words, killed, tmp_path):
    rig = tmp_path / "a.toml"
    rig.write_text(RIG)
    named = {"RIG": rig, "FOLDER": tmp_path / "session"}
    process, beating = started(*(named.get(word, word) for word in words), before=before)
    reach(process, beating, readable(process.stdout))
    taken_s, said = ends_in_s(process, beating, killed=killed)
    assert taken_s < PROMISED_S + BUSY_S
    assert process.returncode == -signal.SIGTERM
    assert b"the program that started this command has ended, or hangs" in said


@pytest.mark.parametrize("killed", [True, False], ids=["bridge killed", "bridge hangs"])
@pytest.mark.parametrize("command", ["search", "resume"])
def test_a_command_ends_with_its_bridge_while_it_asks_on_the_terminal(command, killed, tmp_path, shell):
    rig = tmp_path / "a.toml"
    rig.write_text(RIG)
    words = ("search", "--rig", rig, "--no-journal")
    if command == "resume":
        journal = tmp_path / "run.journal"
        other, pipe = started("search", "--seed", "4", "--pace", "1", "--journal", journal)
        reach(other, pipe, lambda: journal.exists() and journal.stat().st_size > 1000)
        ends_in_s(other, pipe, killed=True)
        words = ("resume", journal)
    ours, theirs = os.openpty()
    process, beating = started(*words, terminal=theirs)
    os.close(theirs)
    os.set_blocking(ours, False)
    said = bytearray()

    def asked():
        with contextlib.suppress(BlockingIOError):
            said.extend(os.read(ours, 65536))
        return b"name of the rig:" in said

    reach(process, beating, asked)
    assert ends_in_s(process, beating, killed=killed)[0] < PROMISED_S + BUSY_S
    assert process.returncode == -signal.SIGTERM
    os.close(ours)


def test_a_command_whose_bridge_was_dead_before_it_started_ends_at_once(tmp_path):
    process, beating = started("search", "--seed", "4", "--journal", tmp_path / "run.journal")
    assert ends_in_s(process, beating, killed=True)[0] < PROMISED_S
    assert not (tmp_path / "run.journal").exists()


def test_the_figures_keep_the_promise():
    assert SILENT_S + ORDERLY_S <= PROMISED_S


@pytest.mark.parametrize("words", [("--heartbeat",), ("--heartbeat", "/dev/null"), ("--heartbeat=/nowhere",), ()])
def test_a_heartbeat_that_is_no_pipe_is_left_to_the_option(words):
    watch_heartbeat(["search", *words])


def test_a_heartbeat_that_is_no_pipe_is_refused(shell):
    code, _, errors = shell("register", "--simulate", "--heartbeat", Path("/dev/null"))
    assert code == 2
    assert "it is no pipe" in errors
