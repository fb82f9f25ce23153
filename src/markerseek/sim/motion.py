"""A marker that moves: to and fro about the axis of rotation, with the tissue that it lies on."""

from __future__ import annotations

from markerseek.core import Frame, FrameHeader, require_range
from markerseek.sim.world import Flash, SimulatedWorld

SWING_DEG = 20.0
"""The marker goes to and fro over this range at an even speed, in degrees; it turns beyond it."""

TURN_S = 1.0
"""Time in which it turns round at the ends, in seconds, at an even acceleration of twice its speed a second."""

MAX_DEG_S = 20.0
"""Fastest motion, in degrees per second."""


def swing_deg(time_s: float, speed_deg_s: float) -> float:
    """Angle of a marker that goes to and fro about 0, in degrees; at time 0 it leaves the lower end.

    ``speed_deg_s``: speed between the turns.
    """
    straight_s = SWING_DEG / speed_deg_s
    ways, within_s = divmod(time_s, straight_s + TURN_S)
    if within_s < straight_s:
        angle_deg = speed_deg_s * within_s - SWING_DEG / 2
    else:
        turning_s = within_s - straight_s
        angle_deg = SWING_DEG / 2 + speed_deg_s * turning_s * (1 - turning_s / TURN_S)
    return angle_deg if ways % 2 == 0 else -angle_deg


class OscillatingMotion:
    """Motion of a marker to and fro about its angle at rest, in degrees.

    ``speed_deg_s``: speed between the turns.
    """

    def __init__(self, *, speed_deg_s: float) -> None:
        require_range("moving marker: speed_deg_s", speed_deg_s, low=0, high=MAX_DEG_S, unit="deg/s", open_low=True)
        self.speed_deg_s = speed_deg_s
        self._began_s: float | None = None

    @property
    def reach_deg(self) -> float:
        """Farthest that it moves to either side, in degrees: half the swing, and the way of the turn."""
        return SWING_DEG / 2 + self.speed_deg_s * TURN_S / 4

    def begin(self, at_s: float) -> None:
        """Let the marker move from this time on; it rests until then."""
        self._began_s = at_s

    def moved_deg(self, at_s: float) -> float:
        """Angle by which it has moved at a time, in degrees."""
        if self._began_s is None or at_s < self._began_s:
            return 0.0
        # From the middle of the swing, where it was at rest.
        return swing_deg(at_s - self._began_s + SWING_DEG / 2 / self.speed_deg_s, self.speed_deg_s)


class MovingWorld:
    """A simulated world whose marker and tissue turn together about the axis.

    All pulses of a frame see the marker where it is at the first: motion within a train of pulses is not simulated.
    """

    def __init__(self, world: SimulatedWorld, swing: OscillatingMotion) -> None:
        self._world = world
        self._swing = swing
        self.angle_deg = world.angle_deg
        # The same list: flashes are added by the world behind.
        self.flashes: list[Flash] = world.flashes

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue, as the world behind."""
        self._world.flash(pulses=pulses, at_s=at_s)

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> Frame:
        """Frame after a flash, or without one, with the marker where it was then."""
        at_s = header.started_s if flash is None else flash.at_s
        self._world.angle_deg = self.angle_deg - self._swing.moved_deg(at_s)
        return self._world.frame(flash, header=header)
