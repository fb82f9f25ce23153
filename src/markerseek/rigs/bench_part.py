"""Connects one part of a bench, its stage or its laser and receiver, for a node that serves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from markerseek.core import Clock, ConfigError, Laser, Receiver, Stage
from markerseek.drivers import (
    BenchSettings,
    RosReceiver,
    RosStage,
    SystemClock,
)
from markerseek.guard import Guard
from markerseek.rigs.bench_devices import OpenDevices, acquisition_of, guard_of, stage_of


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchPart:
    """The stage of a bench, or its laser and receiver, with a guard of their own: for a node that serves them.

    Attributes
    ----------
    stage, laser, receiver
        The devices; None where they are not of this part.
    guard
        Permits each step; it begins disarmed.
    clock
        Real time.
    description
        What it is.
    devices
        The lines, to be armed and closed.
    """

    stage: Stage | None
    laser: Laser | None
    receiver: Receiver | None
    guard: Guard
    clock: Clock
    description: str
    devices: OpenDevices

    def arm(self, *, by: str) -> None:
        """As `Rig.arm`."""
        self.guard.arm(by=by)
        self.devices.arm()


def bench_part(
    settings: BenchSettings, part: Literal["stage", "acquisition"], *, beat: Callable[[], None]
) -> BenchPart:
    """Connect the stage of a bench, or its laser and receiver, and nothing else; close its devices at the end.

    Parameters
    ----------
    settings
        Of the whole bench.
    part
        Which part.
    beat
        Called while a device works, at least every 20 ms; it may raise an exception, which ends the step.

    Raises
    ------
    DeviceError
        As `bench`.
    ConfigError
        If that part is itself behind ROS 2.
    """
    over_ros = isinstance(settings.stage if part == "stage" else settings.receiver, RosStage | RosReceiver)
    if over_ros:
        raise ConfigError(f"the {part} of this rig file is itself a ROS 2 node; name the rig file of its devices")
    devices = OpenDevices(settings, names=("stage",) if part == "stage" else ("laser",))
    try:
        supervisor = devices.supervisor

        def step() -> None:
            if supervisor is not None:
                supervisor.beat()
            beat()

        clock = SystemClock(beat=step)
        stage, laser, receiver = None, None, None
        if part == "stage":
            stage, description = stage_of(settings, devices, clock)
        else:
            laser, receiver, description = acquisition_of(settings, devices, clock)
        return BenchPart(
            stage=stage,
            laser=laser,
            receiver=receiver,
            guard=guard_of(settings),
            clock=clock,
            description=description,
            devices=devices,
        )
    except BaseException:
        devices.close()
        raise
