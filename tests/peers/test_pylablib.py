"""The emulated stage driven by pylablib, an independent driver, over a pseudo-terminal.

pylablib is under the GPL, so it lives in an environment of its own, without markerseek's dependencies: the emulator
runs in the interpreter that MARKERSEEK_PYTHON names (``.venv/bin/python`` if it does not), the tests in that one::

    python -m venv .venv-pylablib
    .venv-pylablib/bin/pip install pylablib-lightweight==1.4.3 numba==0.68.1 pyserial==3.5 pytest==9.2.0
    .venv-pylablib/bin/pytest --confcutdir=tests/peers tests/peers/test_pylablib.py
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

kinesis = pytest.importorskip("pylablib.devices.Thorlabs", reason="pylablib lives in an environment of its own")

ROOT = Path(__file__).resolve().parents[2]
COUNTS_PER_DEG = 1919.6418578623391

SERVE = """
from types import SimpleNamespace
from markerseek.drivers.clock import SystemClock
from markerseek.emulators import PtyLine
from markerseek.emulators.kdc101 import EmulatedKdc101, Kdc101Emulator
probe = SimpleNamespace(angle_deg=5.0)
emulator = Kdc101Emulator(probe=probe, settings=EmulatedKdc101(homed=False, play_deg=0.0))
with PtyLine(device=emulator, clock=SystemClock()) as line:
    print(line.path, flush=True)
    while True:
        line.serve_once(wait_s=2e-3)
"""


@pytest.fixture
def motor(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    import serial

    # The one thing that a pseudo-terminal lacks: the line RTS, which pylablib toggles once.
    monkeypatch.setattr(serial.Serial, "_update_rts_state", lambda _line: None)
    python = os.environ.get("MARKERSEEK_PYTHON", str(ROOT / ".venv/bin/python"))
    with subprocess.Popen([python, "-c", SERVE], stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            path = emulator.stdout.readline().strip()
            assert path, f"the emulator did not start with {python}"
            stage = kinesis.KinesisMotor(("serial", path), scale="PRM1-Z8")
            yield stage
            stage.close()
        finally:
            emulator.terminate()


def _rest(motor: Any) -> None:
    """Wait for motion to begin and to end: the moving bits are clear for a moment before it begins."""
    ends = time.monotonic() + 30
    while not motor.is_moving() and time.monotonic() < ends:
        pass
    motor.wait_move(timeout=30)


def test_it_knows_the_device(motor: Any) -> None:
    info = motor.get_device_info()
    assert (info.serial_no, info.model_no, info.nchannels) == (27000001, "KDC101", 1)
    assert "simulated" in info.notes
    assert motor.get_scale()[0] == pytest.approx(COUNTS_PER_DEG, rel=1e-9)


def test_parameters_come_back_as_they_were_set(motor: Any) -> None:
    motor.setup_velocity(acceleration=10, max_velocity=12.5)
    velocity = motor.get_velocity_parameters()
    assert velocity.max_velocity == pytest.approx(12.5, abs=1 / 42941)
    assert velocity.acceleration == pytest.approx(10, abs=1 / 14.6)
    motor.setup_gen_move(backlash_distance=0)
    assert motor.get_gen_move_parameters().backlash_distance == 0


def test_it_homes_and_moves_to_the_count(motor: Any) -> None:
    assert not motor.is_homed()
    motor.setup_gen_move(backlash_distance=0)
    motor.setup_velocity(acceleration=20, max_velocity=20)
    motor.home(sync=True, timeout=30)
    assert motor.is_homed()
    assert motor.get_position(scale=False) == 0
    for target_deg in (7.5, -3.25, 0.1):
        motor.move_to(target_deg)
        _rest(motor)
        assert abs(motor.get_position(scale=False) - target_deg * COUNTS_PER_DEG) <= 1


def test_it_stops_on_its_way(motor: Any) -> None:
    motor.setup_gen_move(backlash_distance=0)
    motor.move_to(60)
    while motor.get_position() <= 0:
        pass
    motor.stop(immediate=True)
    stopped = motor.get_position()
    assert 0 < stopped < 20
    assert not motor.is_moving()
    # It does not creep on.
    time.sleep(0.1)
    assert motor.get_position() == stopped
