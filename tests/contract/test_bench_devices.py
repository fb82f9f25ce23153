"""The real drivers keep the contracts of `markerseek.testing` on emulated devices, in virtual time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from markerseek.core import DeviceTimeoutError, Laser, LaserError, NotConnectedError, Receiver, Stage
from markerseek.drivers import Kdc101Settings, Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.drivers.picolas import PicolasLaser
from markerseek.emulators import EmulatedBench, EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import ReceiverSettings, SimulatedSettings, VirtualClock
from markerseek.testing import LaserContract, ReceiverContract, StageContract
from tests.emulated_lines import BenchClock, DirectPort, permit

SETTINGS = SimulatedSettings(receiver=ReceiverSettings(readout_s=0.5))


def receiver_and_laser(folder: Path) -> tuple[Receiver, LaserBox]:
    bench = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(1), folder=folder)
    clock = BenchClock()
    clock.lead(bench.daq.advance)
    laser = LaserBox(port=DirectPort(device=bench.laser_box, clock=clock), clock=clock)
    return SonixDaqReceiver(settings=SonixDaqSettings(folder=str(folder)), clock=clock), laser


class TestLaserBox(LaserContract):
    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path) -> None:
        self.folder = tmp_path

    def make(self) -> Laser:
        return receiver_and_laser(self.folder)[1]


class TestSonixDaq(ReceiverContract):
    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path) -> None:
        self.folder = tmp_path

    def make(self) -> tuple[Receiver, Laser]:
        return receiver_and_laser(self.folder)


class ScriptedPicolas:
    """Answers as the notes of `devices.md` say that a PicoLAS driver does; none was tested on a real device."""

    def __init__(self, answer: bytes = b"0\r\n\n") -> None:
        self.commands: list[bytes] = []
        self.answer = answer
        self._said = b""

    def write(self, data: bytes) -> None:
        assert data.endswith(b"\r")
        self.commands.append(data[:-1])
        self._said += self.answer

    def read(self, size: int, *, timeout_s: float) -> bytes:
        data, self._said = self._said[:size], self._said[size:]
        return data

    def close(self) -> None:
        """Nothing to release."""


class TestPicolas(LaserContract):
    def make(self) -> Laser:
        return PicolasLaser(port=ScriptedPicolas(), clock=VirtualClock())


def test_a_picolas_driver_is_switched_off_at_first_and_after_its_pulses() -> None:
    port = ScriptedPicolas()
    PicolasLaser(port=port, clock=VirtualClock(), rate_hz=50).fire(permit())
    assert port.commands == [b"laseroff", b"sreprate 50", b"sshots 4", b"laseron", b"laseroff"]


def test_a_picolas_driver_without_an_answer_is_not_connected_and_one_that_refuses_is_switched_off() -> None:
    with pytest.raises(NotConnectedError, match="no byte came"):
        PicolasLaser(port=ScriptedPicolas(answer=b""), clock=VirtualClock())
    port = ScriptedPicolas()
    laser = PicolasLaser(port=port, clock=VirtualClock())
    port.answer = b"interlock\r\n7\r\n\n"
    with pytest.raises(LaserError, match="expected a last line 0"):
        laser.fire(permit())
    assert port.commands[-1] == b"laseroff"
    port.answer = b"0\r\n"
    with pytest.raises(DeviceTimeoutError, match="no answer to 'laseroff'"):
        laser.disarm()
    port.answer = bytes(300)
    with pytest.raises(LaserError, match="is no answer; check the port"):
        laser.disarm()


@pytest.mark.parametrize("approach_from", ["below", "above"])
@pytest.mark.parametrize(
    "stands", [EmulatedKdc101(), EmulatedKdc101(zero_deg=123.4), EmulatedKdc101(zero_deg=-10.0, turns=1)], ids=str
)
class TestKdc101Stage(StageContract):
    @pytest.fixture(autouse=True)
    def _choose(self, stands: EmulatedKdc101, approach_from: str) -> None:
        self.stands = stands
        self.settings = Kdc101Settings(port="", zero_deg=stands.zero_deg, approach_from=approach_from)  # type: ignore[arg-type]

    def make(self) -> Stage:
        clock = VirtualClock()
        emulator = Kdc101Emulator(probe=SimpleNamespace(angle_deg=3.0), settings=self.stands)
        return Kdc101Stage(port=DirectPort(device=emulator, clock=clock), clock=clock, settings=self.settings)
