"""Which frames may reach a policy. A fault is data: it is refused by name, never passed on as an intensity."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import AcquisitionError, ChannelFrame, ConfigError, Frame, Permit, Reading, SaturationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Admission:
    """The rules under which a frame and its reading are believed.

    Attributes
    ----------
    settled_deg
        Most that the readback may change during an acquisition, in degrees.
    saturated_limit
        Most channels at full scale in the marker's window, as a share of all; 1 admits any.
    dead_limit
        Most channels without a signal, as a share of all; 1 admits any.
    """

    settled_deg: float = 0.05
    saturated_limit: float = 0.05
    dead_limit: float = 0.05

    def __post_init__(self) -> None:
        if not 0 < self.settled_deg < 1:
            raise ConfigError(f"admission: settled_deg is {self.settled_deg} deg, it must lie between 0 and 1 deg")
        for name in ("saturated_limit", "dead_limit"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"admission: {name} is {getattr(self, name)}, it is a share between 0 and 1")

    def admit_frame(self, frame: Frame, *, permit: Permit, previous_sequence: int | None) -> None:
        """Refuse a frame that is not the answer to this permit.

        Parameters
        ----------
        frame
            The frame, its header completed with the readback before and after.
        permit
            The permit under which it was asked for.
        previous_sequence
            Sequence number of the frame before, None for the first.

        Raises
        ------
        AcquisitionError
            If it carries another token, comes out of order, was not fired as permitted, or was taken while moving.
        """
        header = frame.header
        if header.token != permit.token:
            raise AcquisitionError(
                f"stale frame: it carries the token {header.token!r}, {permit.token!r} was asked for; take it again"
            )
        if previous_sequence is not None and header.sequence <= previous_sequence:
            raise AcquisitionError(
                f"frame out of order: sequence number {header.sequence} after {previous_sequence}; take it again"
            )
        if header.pulses != permit.pulses:
            raise AcquisitionError(f"{header.pulses} pulses were seen, {permit.pulses} were permitted; check the laser")
        if header.commanded_deg != permit.angle_deg:
            raise AcquisitionError(
                f"the frame is of {header.commanded_deg} deg, {permit.angle_deg} deg was asked for; take it again"
            )
        if header.angle_before_deg is None or header.angle_after_deg is None:
            raise AcquisitionError("the frame carries no readback of the angle; the scanner must add it")
        moved_deg = abs(header.angle_after_deg - header.angle_before_deg)
        if not moved_deg <= self.settled_deg:
            raise AcquisitionError(
                f"the probe moved by {moved_deg:.3f} deg during the acquisition, the limit is {self.settled_deg} deg; "
                "let it settle"
            )

    def admit_reading(self, reading: Reading, *, frame: Frame) -> None:
        """Refuse a reading that cannot be a measurement.

        Raises
        ------
        AcquisitionError
            If the intensity is not a finite number of at least 0, another feature is not finite, or too many channels
            are dead.
        SaturationError
            If too many channels are saturated.
        """
        if not (math.isfinite(reading.intensity) and reading.intensity >= 0):
            raise AcquisitionError(f"intensity is {reading.intensity}: it must be finite and at least 0; take it again")
        for name in ("lateral_m", "depth_m", "arrival_s", "noise_sigma", "coherence"):
            value = getattr(reading, name)
            if value is not None and not math.isfinite(value):
                raise AcquisitionError(f"{name} is {value}, it must be finite; take it again")
        saturated = reading.saturated_fraction
        if saturated is not None and not saturated <= self.saturated_limit:
            raise SaturationError(
                f"saturated: {saturated:.0%} of the channels are at full scale in the marker's window, the limit is "
                f"{self.saturated_limit:.0%}; reduce the gain or the laser's energy"
            )
        if isinstance(frame, ChannelFrame):
            dead = len(reading.dead_channels) / frame.samples.shape[0]
            if not dead <= self.dead_limit:
                raise AcquisitionError(
                    f"{len(reading.dead_channels)} of {frame.samples.shape[0]} channels are dead, the limit is "
                    f"{self.dead_limit:.0%}; check the probe's connector"
                )
