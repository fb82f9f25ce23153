"""Each ROS 2 test has a domain of its own, and the transport that this program chooses."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


def pytest_configure(config: pytest.Config) -> None:
    # A program started with signals ignored (in the background) would hand that on to those that tests stop.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # rclpy's wheels bring an old lark.
    config.addinivalue_line("filterwarnings", "ignore:module 'sre_:DeprecationWarning")


# Nodes of another run of these tests, at the same time, must not answer; make runs two, which have slots 0 and 1.
_SLOT = int(os.environ.get("ROS_TESTS_SLOT", "0"))
_DOMAINS = (2 * ((37 * os.getpid() + number) % 115) + _SLOT for number in itertools.count())


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(next(_DOMAINS)))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    for name in ("FASTDDS_BUILTIN_TRANSPORTS", "FASTDDS_DEFAULT_PROFILES_FILE", "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def start() -> Iterator[object]:
    """Starts a program and waits for a line with "ready" or "served"; all are ended with the test."""
    with contextlib.ExitStack() as ends:

        def begin(*words: object, wait: bool = True) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [*map(str, words)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                text=True,
            )
            ends.callback(_end, process)
            said = ""
            while wait and "ready" not in said and "served" not in said:
                said = process.stdout.readline()
                assert said, f"{words} ended with {process.wait()}"
            return process

        yield begin


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
    process.stdout.close()


@pytest.fixture
def node() -> Iterator[object]:
    """A client of the nodes of a test."""
    from markerseek.ros import RosNode

    with RosNode("client") as made:
        yield made


@pytest.fixture
def bench() -> Iterator[object]:
    """A stage node with a slow stage, and its client."""
    from tests.ros2.stage_bench import Bench

    made = Bench()
    yield made
    made.close()
