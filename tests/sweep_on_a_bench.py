"""Sweeps of the real drivers over the emulated bench, byte by byte in virtual time; a SonixDAQ reads them as bursts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from markerseek.core import Event, Receiver, SearchPlan
from markerseek.drivers import (
    Kdc101Settings,
    Kdc101Stage,
    LaserBox,
    LaserBoxSettings,
    SonixDaqReceiver,
    SonixDaqSettings,
)
from markerseek.emulators import LIGHT_COUNTS, EmulatedBench
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build_sweeping
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings, StageMotion
from markerseek.wire import apt
from tests.emulated_lines import BenchClock, DirectPort

SETTINGS = SimulatedSettings(
    marker=MarkerSettings(angle_deg=-24.0),
    start_deg=-35.0,
    stage=StageMotion(speed_deg_s=20.0, acceleration_deg_s2=25.0),
    receiver=ReceiverSettings(readout_s=0.3, single_pulses=True),
)


DARK_ALARM = 1e-6


class Bench:
    """Real drivers on emulated devices; the laser box's lease is renewed in each wait, as on a bench.

    ``late_s``: further time that the files may take.
    """

    def __init__(
        self,
        folder: Path,
        *,
        settings: SimulatedSettings = SETTINGS,
        frames: str = "triggered",
        readout_s: float = 0.3,
        late_s: float = 0.0,
        seed: int = 3,
    ) -> None:
        self.settings = settings = replace(settings, receiver=replace(settings.receiver, readout_s=readout_s))
        self.emulated = EmulatedBench(settings=settings, rng=np.random.default_rng(seed), folder=folder)
        self.clock = clock = BenchClock(tick_s=2e-3)
        self.stage_port = DirectPort(device=self.emulated.stage, clock=clock)
        port = DirectPort(device=self.emulated.laser_box, clock=clock)
        self.stage = self.connect()
        metered = LaserBoxSettings(port="", energy_from="photodiode", usual_energy=LIGHT_COUNTS)
        self.laser = LaserBox(port=port, clock=clock, settings=metered)
        self.port = port
        self.alive = True
        clock.lead(self._beat, lambda _: port.read(0, timeout_s=0.0), self.emulated.daq.advance)
        self.daq = SonixDaqSettings(
            folder=str(folder),
            timeout_s=10.0 + late_s,
            readout_s=0.2 + readout_s + late_s,
            frames=frames,  # type: ignore[arg-type]
        )
        self.begin()

    def begin(self) -> None:
        """A program begins: it watches the folder from now on, and is armed."""
        self.guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission(dark_alarm=DARK_ALARM))
        self.scanner = Scanner(
            stage=self.stage,
            laser=self.laser,
            receiver=self.receiver(),
            reader=image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz),
            clock=self.clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")

    def receiver(self) -> Receiver:
        return SonixDaqReceiver(settings=self.daq, clock=self.clock)

    def _beat(self, _: float) -> None:
        if self.alive:
            self.laser.beat()

    def connect(self) -> Kdc101Stage:
        settings = Kdc101Settings(port="", zero_deg=0.0, speed_deg_s=20.0, acceleration_deg_s2=25.0)
        return Kdc101Stage(port=self.stage_port, clock=self.clock, settings=settings)

    def search(self) -> Iterator[Event]:
        speed_deg_s = self.scanner.sweeping.stage.fastest_sweep_deg_s
        return run(sweeping(speed_deg_s, start_deg=self.scanner.angle_deg, from_end=True), self.scanner)

    @property
    def speed_deg_s(self) -> float:
        """The speed that the controller holds."""
        return int.from_bytes(self.emulated.stage.velocity[10:14], "little") / apt.SPEED_WORD

    @property
    def probe_deg(self) -> float:
        self.emulated.stage.turn(self.clock.now_s())
        return self.emulated.world.angle_deg


def sweeping(speed_deg_s: float, *, start_deg: float = -35.0, from_end: bool = False):  # type: ignore[no-untyped-def]
    plan = SearchPlan(
        method="posterior",
        start_deg=start_deg,
        sweep_speed_deg_s=speed_deg_s,
        sweep_from_end=from_end,
    )
    return build_sweeping(plan, limits=SETTINGS.limits.search)
