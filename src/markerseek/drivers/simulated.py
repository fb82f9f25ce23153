"""Simulated devices in a rig of devices: to try a stage without a laser, or a laser and a receiver without a stage.

They share one simulated world, and take their time by the clock on the wall. The probe of that world is where the
rig's stage says that it is.
"""

from __future__ import annotations

from typing import Annotated

from markerseek.core import Laser, Receiver, Stage, Within
from markerseek.drivers.entry import Entry, LaserKeys, ReceiverKeys, StageKeys


class SimulatedStageSettings(StageKeys, frozen=True, kw_only=True, tag="simulated"):
    """Keys of a simulated stage in a rig of devices: none, since the world says how it moves."""


class SimulatedLaserSettings(LaserKeys, frozen=True, kw_only=True, tag="simulated"):
    """Keys of a simulated laser in a rig of devices; the receiver must be simulated too."""


class SimulatedReceiverSettings(ReceiverKeys, frozen=True, kw_only=True, tag="simulated"):
    """Keys of a simulated receiver in a rig of devices, which describes the world too."""

    seed: Annotated[int, Within(0, 2**63 - 1)] = 1
    """Seed of the world's marker and noise."""
    world: str | None = None
    """Rig file (kind simulated) that describes the world; None: the usual one."""
    readout_s: Annotated[float, Within(0, 600, "s")] = 0.1
    """Time to read one acquisition."""


STAGE_ENTRY: Entry[SimulatedStageSettings, Stage] = Entry(
    settings=SimulatedStageSettings,
    open=lambda settings, opening: opening.simulated(settings),
    describe=lambda _settings, _stage: "SIMULATED stage",
)
LASER_ENTRY: Entry[SimulatedLaserSettings, Laser] = Entry(
    settings=SimulatedLaserSettings,
    open=lambda settings, opening: opening.simulated(settings),
    describe=lambda _settings, _laser: "",
    paired=True,
)
RECEIVER_ENTRY: Entry[SimulatedReceiverSettings, Receiver] = Entry(
    settings=SimulatedReceiverSettings,
    open=lambda settings, opening: opening.simulated(settings),
    describe=lambda settings, _receiver: f"SIMULATED laser and receiver, seed {settings.seed}",
    paths=("world",),
    same=("seed", "world"),
    paired=True,
)
