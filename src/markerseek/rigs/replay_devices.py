"""Devices that replay a recorded scan: a stage that moves to recorded angles, and a receiver that returns their data.

The stage moves to the nearest recorded angle and reports it as its readback, because nothing was measured in between.
The paper's offline analysis (section 2.5) interpolates instead, which can be chosen for a bank of intensities.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    Frame,
    FrameHeader,
    Interval,
    LaserError,
    LimitError,
    Permit,
    ReadingFrame,
)
from markerseek.records.banks import FrameBank, IntensityBank


class ReplayStage:
    """Stage that moves to recorded angles only, or to any angle where the bank is interpolated.

    ``bank``: the recorded scan; the stage starts at its lowest angle. ``between``: where to move between two recorded
    angles: to the nearest, or, for intensities, to the angle asked for.
    """

    def __init__(
        self, bank: IntensityBank | FrameBank, *, between: Literal["nearest", "interpolated"] = "nearest"
    ) -> None:
        self.limits: Interval = bank.range
        self._grid = None if between == "interpolated" and isinstance(bank, IntensityBank) else bank.angles_deg
        self._angle_deg = bank.angles_deg[0]

    @property
    def angle_deg(self) -> float:
        """Angle of the stage, in degrees."""
        return self._angle_deg

    def move_to(self, angle_deg: float) -> float:
        """Move to an angle or the nearest recorded one, and return the angle reached, in degrees."""
        if angle_deg not in self.limits:
            raise LimitError(f"replay: {angle_deg:g} deg is outside the recorded range {self.limits}")
        if self._grid is not None:
            angle_deg = min(self._grid, key=lambda recorded_deg: abs(recorded_deg - angle_deg))
        self._angle_deg = angle_deg
        return angle_deg

    def stop(self) -> None:
        """Nothing to do: moves are instantaneous."""


class ReplayLaser:
    """Laser that fires nothing; it accepts each permit once."""

    def __init__(self) -> None:
        self._used: set[str] = set()

    def fire(self, permit: Permit) -> int:
        """Return the number of pulses permitted; the recorded frames were fired when the scan was made."""
        # This laser has no clock; a permit that expires at minus infinity has expired on any.
        if permit.expires_s == -math.inf:
            raise LaserError(f"replay: the permit {permit.token!r} has expired")
        if permit.token in self._used:
            raise LaserError(f"replay: the permit {permit.token!r} was used before")
        self._used.add(permit.token)
        return permit.pulses

    def disarm(self) -> None:
        """Nothing to do: there is no laser."""


class ReplayReceiver:
    """Receiver that returns the recorded data of the stage's angle."""

    def __init__(self, *, stage: ReplayStage, bank: IntensityBank | FrameBank) -> None:
        self._stage = stage
        self._bank = bank
        self._sequence = 0
        self._dark = 0
        self._armed: Permit | None = None

    def settle(self) -> None:
        """Nothing to wait for: the data were recorded before."""

    def arm(self, permit: Permit) -> None:
        """Prepare one acquisition."""
        self._armed = permit
        # Dark frames are handed out once each: the detection threshold needs independent ones.
        if permit.pulses == 0 and self._dark >= self._bank.dark_frames:
            held = f"{self._bank.dark_frames or 'no'} dark frames"
            raise ConfigError(f"replay: the bank holds {held}; ask for no more of them")

    def acquire(self, permit: Permit) -> Frame:
        """Return the frame or intensity of the stage's angle."""
        if self._armed != permit:
            raise AcquisitionError(f"replay: it was not armed for the permit {permit.token!r}")
        self._armed = None
        self._sequence += 1
        angle_deg = self._stage.angle_deg
        header = FrameHeader(
            sequence=self._sequence,
            token=permit.token,
            pulses=permit.pulses,
            commanded_deg=permit.angle_deg,
            # Virtual time stands still in a replay; the recorded times stay in the bank.
            started_s=0.0,
            ended_s=0.0,
        )
        if isinstance(self._bank, FrameBank):
            if permit.pulses == 0:
                self._dark += 1
                return structs.replace(self._bank.dark_frame(self._dark - 1), header=header)
            # The header of the new acquisition, which the guard compares with the permit, and the recorded energy.
            frame = self._bank.frame(self._bank.angles_deg.index(angle_deg))
            return structs.replace(frame, header=structs.replace(header, energy=frame.header.energy))
        intensity = float(np.interp(angle_deg, self._bank.angles_deg, self._bank.intensities))
        return ReadingFrame(header=header, intensity=intensity)
