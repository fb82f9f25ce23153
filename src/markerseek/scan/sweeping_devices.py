"""The devices of a rig that can sweep: their limits, the duration of a sweep, and the permit that it needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import (
    ConfigError,
    Laser,
    Receiver,
    Stage,
    Sweep,
    SweepingLaser,
    SweepingReceiver,
    SweepingStage,
    SweepPermit,
)

SLOWEST, FASTEST = 0.08, 1.25
"""Lowest and highest speed at which the laser fires, over the speed of the sweep: it fires on the ramps, but not if the
probe stalls."""

TURN_DEG = 0.1
"""Distance from the turning angle at which the probe counts as having reached it, the same as for the guard."""

TURN_S = 0.5
"""Time that a stage needs to turn back: it comes to rest, and gets its next target."""

LEAST_WAY_DEG = 0.5
"""Shortest way from rest to rest on which the laser must fire."""

SLOWER = 1.1
"""Longest duration of a sweep over the computed one: a stage may be slower than its settings say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepingDevices:
    """Stage, laser and receiver of a rig that can sweep."""

    stage: SweepingStage
    laser: SweepingLaser
    receiver: SweepingReceiver

    @classmethod
    def of(cls, stage: Stage, laser: Laser, receiver: Receiver) -> SweepingDevices:
        """The devices, if all three can sweep; `ConfigError` names a device that cannot."""
        for part, device in (("stage", stage), ("laser", laser), ("receiver", receiver)):
            # The class is checked, because isinstance would read the properties, and so ask the device for its angle.
            if not hasattr(type(device), "begin_sweep"):
                # A user's own class is called by its name in the rig file, not by the name of its wrapper.
                name = getattr(device, "driver", type(device).__name__)
                raise ConfigError(
                    f"this rig cannot sweep: its {part} ({name}) only works with the probe at rest; leave --sweep out"
                )
        devices = cls(stage=stage, laser=laser, receiver=receiver)  # type: ignore[arg-type]
        # Read here, because it raises `ConfigError` if a device can sweep but is not set up for it.
        _ = devices.least_period_s
        return devices

    @property
    def least_period_s(self) -> float:
        """Least time between two pulses, in seconds."""
        return max(self.laser.sweep_period_s, self.receiver.frame_period_s)

    @property
    def in_bursts(self) -> bool:
        """Whether the frames of a sweep are read at its end, all as one acquisition."""
        return self.receiver.sweep_readout_s > 0

    def wait_deg(self, sweep: Sweep) -> float | None:
        """Angle at which the probe waits for the frames of a sweep; None: where it ends, because they come first."""
        if sweep.wait_deg is None:
            return None
        way_s = self._way_s(sweep.wait_deg - sweep.end_deg, speed_deg_s=sweep.speed_deg_s)
        return sweep.wait_deg if self.receiver.sweep_readout_s > way_s else None

    def permit(self, sweep: Sweep, *, from_deg: float, dark: int = 0, mark: int = 0) -> SweepPermit:
        """The permit that a sweep needs, without token and expiry; `ConfigError` if it is too fast for the stage.

        ``dark``: least number of triggers without light at the end. ``mark``: additional triggers.
        """
        speed, fastest = sweep.speed_deg_s, self.stage.fastest_sweep_deg_s
        if not speed <= fastest:
            raise ConfigError(
                f"sweep: {speed:g} deg/s is too fast for this stage: at most {math.floor(100 * fastest) / 100:g} deg/s"
            )
        # On a short way the probe brakes before it reaches the speed of the sweep.
        way_deg = abs(sweep.to_deg - from_deg)
        reached = math.sqrt(max(way_deg, LEAST_WAY_DEG) * self.stage.acceleration_deg_s2)
        # At the turning angle the probe is as slow as a stage that is `TURN_DEG` away from rest.
        turning = math.inf if sweep.back_deg is None else 0.8 * math.sqrt(2 * self.stage.acceleration_deg_s2 * TURN_DEG)
        period_s = self.least_period_s
        lasts = self.duration_s(sweep, from_deg=from_deg) / period_s
        pulses = max(math.ceil(SLOWER * lasts) + 1, math.ceil(lasts) + dark)
        return SweepPermit(
            token="",
            angle_deg=from_deg,
            pulses=pulses + mark,
            expires_s=0.0,
            to_deg=sweep.to_deg,
            back_deg=sweep.back_deg,
            slowest_deg_s=min(SLOWEST * min(speed, reached), turning),
            fastest_deg_s=FASTEST * speed,
            period_s=period_s,
        )

    def require_in_time(self, sweep: Sweep, permit: SweepPermit, *, now_s: float) -> None:
        """Raise `ConfigError`, before anything moves, if the permit may expire during the sweep."""
        duration_s, left_s = self.duration_s(sweep, from_deg=permit.angle_deg), permit.expires_s - now_s
        if not SLOWER * duration_s <= left_s:
            raise ConfigError(
                f"sweep: it takes {duration_s:.1f} s at {sweep.speed_deg_s:g} deg/s, and its permit holds for "
                f"{left_s:.1f} s; sweep faster"
            )

    def duration_s(self, sweep: Sweep, *, from_deg: float) -> float:
        """Time of a sweep in seconds, run-up and braking included."""
        there_s = self._way_s(sweep.to_deg - from_deg, speed_deg_s=sweep.speed_deg_s)
        if sweep.back_deg is None:
            return there_s
        return there_s + TURN_S + self._way_s(sweep.back_deg - sweep.to_deg, speed_deg_s=sweep.speed_deg_s)

    def _way_s(self, way_deg: float, *, speed_deg_s: float) -> float:
        """Time from rest to rest, in seconds."""
        way_deg, acceleration = abs(way_deg), self.stage.acceleration_deg_s2
        if way_deg <= speed_deg_s**2 / acceleration:
            return 2 * math.sqrt(way_deg / acceleration)
        return way_deg / speed_deg_s + speed_deg_s / acceleration
