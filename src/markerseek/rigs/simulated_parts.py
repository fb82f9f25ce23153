"""Simulated devices in a rig of devices, in one world, on the clock of the rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import Clock, ConfigError, Permit, Stage
from markerseek.drivers import (
    BenchSettings,
    DeviceSettings,
    GuidedStageSettings,
    SimulatedLaserKeys,
    SimulatedReceiverKeys,
    SimulatedStageKeys,
)
from markerseek.rigs.scene import draw_scene
from markerseek.sim import SimulatedHand, SimulatedLaser, SimulatedReceiver, SimulatedSettings, SimulatedStage, World


class SimulatedParts:
    """The simulated devices of a rig, and the world that they share."""

    def __init__(self, bench: BenchSettings) -> None:
        keys = bench.receiver if isinstance(bench.receiver, SimulatedReceiverKeys) else SimulatedReceiverKeys()
        settings = _world_of(keys)
        rng = np.random.default_rng(keys.seed)
        scene = draw_scene(settings, rng)
        self._settings, self._bench, self._readout_s, self._rng = settings, bench, keys.readout_s, rng
        self._world = World(
            model=scene.model,
            absorbers=scene.absorbers,
            noise=scene.noise,
            energy_jitter=settings.laser.energy_jitter,
            start_deg=settings.start_deg,
            rng=rng,
        )

    def opened(self, settings: DeviceSettings, *, clock: Clock, stage: Stage | None) -> Any:
        """The device that has these settings; ``stage``: of the rig, whatever drives it."""
        if isinstance(settings, SimulatedStageKeys):
            return _Stage(world=self._world, clock=clock, motion=self._settings.stage, travel=self._bench.limits.travel)
        if isinstance(settings, GuidedStageSettings):
            return SimulatedHand(
                world=self._world, clock=clock, limits=self._bench.limits.search, rng=self._rng.spawn(1)[0]
            )
        if stage is None:
            raise ConfigError(
                "simulated laser and receiver need the stage of their rig; serve them by markerseek ros2 sim"
            )
        if isinstance(settings, SimulatedLaserKeys):
            return _Laser(world=self._world, clock=clock, stage=stage, rate_hz=settings.rate_hz)
        return _Receiver(world=self._world, clock=clock, readout_s=self._readout_s)


def _world_of(keys: SimulatedReceiverKeys) -> SimulatedSettings:
    """Settings of the world, with the sampling frequency of the rig; `ConfigError` if they are of another kind."""
    # Here, because rig_file reads rigs of devices too.
    from markerseek.rigs.rig_file import read_simulated

    settings = read_simulated(None if keys.world is None else Path(keys.world), cure="name one of kind simulated")
    if settings.receiver.data != "channels":
        raise ConfigError(
            f"receiver: the world of a simulated receiver gives {settings.receiver.data}, channel data are needed; "
            'name one with data = "channels"'
        )
    return replace(settings, receiver=replace(settings.receiver, sampling_hz=keys.sampling_hz))


class _Stage(SimulatedStage):
    emulated = True


class _Receiver(SimulatedReceiver):
    emulated = True


class _Laser(SimulatedLaser):
    """Lights the world with its probe where the rig's stage is."""

    emulated = True

    def __init__(self, *, world: World, clock: Clock, stage: Stage, rate_hz: float) -> None:
        super().__init__(world=world, clock=clock, rate_hz=rate_hz)
        self._probe, self._stage = world, stage

    def fire(self, permit: Permit) -> int:
        # A simulated stage turns the probe itself, and knows of its play.
        if not isinstance(self._stage, _Stage):
            self._probe.angle_deg = self._stage.angle_deg
        return super().fire(permit)
