"""Simulated and replayed devices, and real drivers on emulated ones, keep the contracts of `markerseek.contract`."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from markerseek.acoustics import AcousticModel, Noise
from markerseek.contract import LaserContract, ReceiverContract, StageContract
from markerseek.core import DeviceTimeoutError, Interval, Laser, LaserError, NotConnectedError, Receiver, Stage
from markerseek.drivers import Kdc101Settings, Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.drivers.picolas import PicolasLaser
from markerseek.emulators import EmulatedBench, EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.records.banks import IntensityBank
from markerseek.rigs.replay_devices import ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.sim import (
    ReceiverSettings,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    StageMotion,
    VirtualClock,
    World,
)
from tests.emulated_lines import BenchClock, DirectPort, permit

BANK = IntensityBank(angles_deg=(-35.0, 0.0, 35.0), intensities=(0.0, 1.0, 0.0))


def dark_world() -> World:
    return World(
        model=AcousticModel(samples=64),
        absorbers=(),
        noise=Noise(white_sigma=1.0),
        energy_jitter=0.0,
        start_deg=0.0,
        rng=np.random.default_rng(1),
    )


class TestSimulatedStage(StageContract):
    resolution_deg = 0.5 / 1919.6418578623391

    def make(self) -> Stage:
        travel = Interval(low_deg=-36.5, high_deg=36.5)
        return SimulatedStage(world=dark_world(), clock=VirtualClock(), motion=StageMotion(), travel=travel)


class TestReplayStage(StageContract):
    resolution_deg = 0.0

    def make(self) -> Stage:
        return ReplayStage(BANK, between="interpolated")


class TestSimulatedLaser(LaserContract):
    def make(self) -> Laser:
        return SimulatedLaser(world=dark_world(), clock=VirtualClock())


class TestReplayLaser(LaserContract):
    def make(self) -> Laser:
        return ReplayLaser()


class TestSimulatedReceiver(ReceiverContract):
    def make(self) -> tuple[Receiver, Laser]:
        world = dark_world()
        clock = VirtualClock()
        receiver = SimulatedReceiver(world=world, clock=clock, readout_s=0.1)
        return receiver, SimulatedLaser(world=world, clock=clock)


class TestReplayReceiver(ReceiverContract):
    def make(self) -> tuple[Receiver, Laser]:
        return ReplayReceiver(stage=ReplayStage(BANK), bank=BANK), ReplayLaser()


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
        data = self._said[:size]
        self._said = self._said[size:]
        return data

    def close(self) -> None:
        """Nothing to release."""


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
