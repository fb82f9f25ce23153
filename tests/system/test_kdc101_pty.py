"""The stage's driver over a real serial port of the system, in real time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

from markerseek.drivers import Kdc101Settings, Kdc101Stage, SerialPort, SystemClock

pytestmark = pytest.mark.real_time

SERVE = """
from types import SimpleNamespace
from markerseek.drivers.clock import SystemClock
from markerseek.emulators import PtyLine
from markerseek.emulators.kdc101 import EmulatedKdc101, Kdc101Emulator
emulator = Kdc101Emulator(probe=SimpleNamespace(angle_deg=1.0), settings=EmulatedKdc101(talking=True))
with PtyLine(device=emulator, clock=SystemClock()) as line:
    print(line.path, flush=True)
    while True:
        line.serve_once(wait_s=2e-3)
"""

# A busy machine answers late: what is late is tested in virtual time.
PATIENT = Kdc101Settings(port="", zero_deg=0.0, speed_deg_s=25.0, acceleration_deg_s2=25.0, age_s=1.0)
ANSWER_S = 0.5


@pytest.fixture
def path() -> Iterator[str]:
    with subprocess.Popen([sys.executable, "-c", SERVE], stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            yield emulator.stdout.readline().strip()
        finally:
            emulator.terminate()


def test_it_moves_over_a_pseudo_terminal_from_another_process(path: str) -> None:
    with SerialPort(path, handshake=True) as port:
        stage = Kdc101Stage(port=port, clock=SystemClock(), settings=PATIENT, answer_s=ANSWER_S)
        assert stage.angle_deg == pytest.approx(1.0, abs=1e-3)
        for target_deg in (4.0, -2.5):
            assert stage.move_to(target_deg) == pytest.approx(target_deg, abs=1e-3)
        stage.stop()
    # Another program finds it where the first left it.
    with SerialPort(path, handshake=True) as port:
        assert Kdc101Stage(
            port=port, clock=SystemClock(), settings=PATIENT, answer_s=ANSWER_S
        ).angle_deg == pytest.approx(-2.5, abs=1e-3)
