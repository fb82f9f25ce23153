"""A bench that a client starts: armed by what is typed after the question, and stopped while it turns and fires."""

from __future__ import annotations

import json
import os
import time

import pytest

from markerseek.drivers import LaserBox, LaserBoxSettings, SerialPort, SystemClock
from markerseek.drivers.kdc101 import AptLine
from markerseek.wire import apt, igtl
from tests.emulated import WORLD, emulation
from tests.igtl.igtl_bridge import OnTerminal
from tests.igtl.igtl_client import IgtlClient

pytestmark = pytest.mark.real_time


def angle_deg(line: AptLine) -> float:
    return apt.degrees_of(line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status).position)


def said_by(message: igtl.Message) -> dict[str, object]:
    """What the bridge says of the search; nothing in other messages."""
    is_said = isinstance(message.content, igtl.Text) and message.content.text.startswith("{")
    return json.loads(message.content.text) if is_said else {}


def test_keys_typed_before_a_client_asks_arm_nothing_and_the_question_names_it(tmp_path) -> None:
    with emulation(tmp_path) as devices:
        with (
            OnTerminal(devices.rig, typed=b"y\nrig.toml\n") as running,
            IgtlClient(running.port) as client,
        ):
            address = client.socket.getsockname()
            assert "SUCCESS" in client.ask('<Command Name="StartSearch" />')
            running.until("name of the rig: ")
            assert f"asked by: an OpenIGTLink client, {address[0]}:{address[1]}\n" in running.said
            os.write(running.far, b"y\n")
            client.until(lambda message: isinstance(message.content, igtl.Text) and "not armed" in message.content.text)
        assert devices.end() == (0.0, 0.0, 0)


@pytest.mark.long
def test_a_sweep_is_stopped_by_a_command(tmp_path) -> None:
    with emulation(tmp_path, seed=3, text=WORLD + "[receiver]\nsingle_pulses = true\n") as devices:
        with OnTerminal(devices.rig) as running, IgtlClient(running.port) as client:
            assert "SUCCESS" in client.ask('<Command Name="StartSearch" Sweep="true" />')
            running.until("name of the rig: ")
            os.write(running.far, b"rig.toml\n")
            # It turns to the nearer end in 3.5 s, and sweeps from there for 6 s.
            client.until(lambda message: said_by(message).get("role") == "search")
            time.sleep(5.5)
            assert "SUCCESS" in client.ask('<Command Name="StopSearch" />', name="2")
            messages = client.until(lambda message: "exit_code" in said_by(message))
            assert said_by(messages[-1])["exit_code"] == 130
            with SerialPort(str(devices.folder / "stage")) as port:
                # Without the driver, which would write its parameters.
                line = AptLine(port=port, clock=SystemClock(), answer_s=0.2, age_s=2.0)
                rest_deg = angle_deg(line)
                with SerialPort(str(devices.folder / "laser")) as laser:
                    # Since power-up; it sends no more triggers.
                    settings = LaserBoxSettings(port="", answer_s=5.0)
                    fired = LaserBox(port=laser, clock=SystemClock(), settings=settings)._seen
                # It does not creep on.
                time.sleep(0.5)
                assert angle_deg(line) == rest_deg
            assert -35 < rest_deg < 20
            # Of the 140 that the permit allowed, and none after the stop.
            assert 0 < fired <= 100
        assert devices.end()[2] == fired
