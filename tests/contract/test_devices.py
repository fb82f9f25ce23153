"""The simulated and the replayed devices keep the contracts of `markerseek.testing`."""

from __future__ import annotations

import numpy as np

from markerseek.acoustics import AcousticModel, Noise
from markerseek.core import Interval, Laser, Receiver, Stage
from markerseek.records.banks import IntensityBank
from markerseek.records.replay import ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.sim import SimulatedLaser, SimulatedReceiver, SimulatedStage, StageMotion, VirtualClock, World
from markerseek.testing import LaserContract, ReceiverContract, StageContract

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
        world, clock = dark_world(), VirtualClock()
        receiver = SimulatedReceiver(world=world, clock=clock, readout_s=0.1)
        return receiver, SimulatedLaser(world=world, clock=clock)


class TestReplayReceiver(ReceiverContract):
    def make(self) -> tuple[Receiver, Laser]:
        return ReplayReceiver(stage=ReplayStage(BANK), bank=BANK), ReplayLaser()
