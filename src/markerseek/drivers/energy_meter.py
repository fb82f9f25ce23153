"""The energy of a rig's pulses: by the laser box's photodiode, by their pick-up, or from a field of a PLUS server.

Whatever measures it, its value for a usual pulse (`LaserKeys.usual_energy`) makes the energy of a frame's header;
the scanner divides readings by it. Without that value the rig's answers are as without a meter, and
`EnergyMeter.usual` says which it should be.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from typing import cast

from msgspec import structs

from markerseek.core import (
    ChannelFrame,
    ConfigError,
    Frame,
    Laser,
    NotConnectedError,
    Permit,
    Receiver,
    SweepingReceiver,
    SweepPermit,
)
from markerseek.drivers.entry import LaserKeys
from markerseek.drivers.laserbox import LaserBox
from markerseek.drivers.plus import PlusReceiver
from markerseek.signals import pickup_amplitude


class EnergyMeter:
    """A receiver whose frames say the energy of their pulses.

    ``receiver``: the receiver itself. ``measured``: what the meter says of a frame that has come, in a unit of its own.
    ``usual_energy``: what it says of a usual pulse; None leaves the header as it is. ``singles``: whether it measures
    the single pulses of a sweep, too, by their frames; the laser box states their energy with their stamps.
    """

    def __init__(
        self,
        receiver: Receiver,
        *,
        measured: Callable[[Frame], float | None],
        usual_energy: float | None,
        singles: bool = True,
    ) -> None:
        self._receiver = receiver
        self._measured = measured
        self._usual_energy = usual_energy
        self._singles = singles
        self._values: list[float] = []

    @property
    def usual(self) -> float | None:
        """Mean of what the meter has said so far, in its own unit; None before the first pulse."""
        return statistics.fmean(self._values) if self._values else None

    def settle(self) -> None:
        """As of the receiver."""
        self._receiver.settle()

    def arm(self, permit: Permit) -> None:
        """As of the receiver."""
        self._receiver.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        """Return the frame of the receiver, with the energy of its pulses in the header."""
        return self._with_energy(self._receiver.acquire(permit))

    @property
    def frame_period_s(self) -> float:
        """As of the receiver; `ConfigError` if that cannot sweep."""
        return self._sweeping.frame_period_s

    @property
    def sweep_readout_s(self) -> float:
        """As of the receiver."""
        return self._sweeping.sweep_readout_s

    def begin_sweep(self, permit: SweepPermit) -> None:
        """As of the receiver."""
        self._sweeping.begin_sweep(permit)

    def frames(self) -> Sequence[Frame]:
        """Return the frames of the receiver, each with the energy of its pulse in the header."""
        return self._each_with_energy(self._sweeping.frames())

    def end_sweep(self, *, pulses: int) -> Sequence[Frame]:
        """As `frames`, those that are left."""
        return self._each_with_energy(self._sweeping.end_sweep(pulses=pulses))

    @property
    def _sweeping(self) -> SweepingReceiver:
        # Of the class: an instance that is not set up for it says why by itself.
        if not hasattr(type(self._receiver), "begin_sweep"):
            raise ConfigError(
                f"this rig cannot sweep: its receiver ({type(self._receiver).__name__}) only works with the probe at "
                "rest; leave `sweep` out"
            )
        return cast("SweepingReceiver", self._receiver)

    def _each_with_energy(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        return [self._with_energy(frame) for frame in frames] if self._singles else frames

    def _with_energy(self, frame: Frame) -> Frame:
        # A dark frame has no pulse, whatever a meter says of it.
        value = self._measured(frame) if frame.header.pulses else None
        if value is None:
            return frame
        self._values.append(value)
        if self._usual_energy is None:
            return frame
        return structs.replace(frame, header=structs.replace(frame.header, energy=value / self._usual_energy))


def metered(keys: LaserKeys, laser: Laser, receiver: Receiver, *, full_scale: int) -> Receiver:
    """Return the receiver, as `EnergyMeter` where the rig file names what measures the energy.

    ``full_scale``: counts at which the channels clip. Raises `ConfigError` if the rig has no such part,
    `NotConnectedError` if the laser box has no light meter.
    """
    measured = _measured_by(keys, laser, receiver, full_scale)
    if measured is None:
        return receiver
    return EnergyMeter(
        receiver, measured=measured, usual_energy=keys.usual_energy, singles=keys.energy_from != "photodiode"
    )


def _measured_by(
    keys: LaserKeys, laser: Laser, receiver: Receiver, full_scale: int
) -> Callable[[Frame], float | None] | None:
    if keys.energy_from == "photodiode":
        if not isinstance(laser, LaserBox):
            raise ConfigError(_unfit("photodiode", "laser.driver laserbox, of this rig file"))
        if not laser.metered:
            raise NotConnectedError(
                "laser box: its photodiode only counts pulses, and energy_from is photodiode; build a light meter "
                '(firmware/laserbox), or set energy_from = "none"'
            )
        return lambda _frame: laser.light_per_pulse
    if keys.energy_from == "metadata":
        if not isinstance(receiver, PlusReceiver):
            raise ConfigError(_unfit("metadata", "receiver.driver plus"))
        field = keys.energy_field or ""
        return lambda _frame: receiver.messages.energy_of(field)
    if keys.pickup_us is None:
        return None
    window_us = keys.pickup_us
    return lambda frame: (
        pickup_amplitude(frame, window_us=window_us, full_scale=full_scale) if isinstance(frame, ChannelFrame) else None
    )


def _unfit(source: str, needed: str) -> str:
    return f"laser: energy_from is {source}, which needs {needed}; name another, or none"
