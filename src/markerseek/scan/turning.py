"""One turn of the probe while it follows a target: without light, from rest to rest, and braked at any time.

The stage turns as in a sweep: it keeps its speed, reports its angle on the way, and stops by itself at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import cast

from markerseek.core import Clock, ConfigError, MoveError, Stage, StageReading, SweepingStage
from markerseek.guard import Guard
from markerseek.scan.sweeping import AT_REST_DEG, BEGIN_S, READ_S, Way, await_reading

ARRIVED_DEG = 0.05
"""Most by which a turn that was not braked may end beside its target, in degrees."""


def turning_stage(stage: Stage) -> SweepingStage:
    """Return the stage of a rig that can follow; `ConfigError` if it does not report where it is while it turns."""
    # The class is checked, because isinstance would read the properties, and so ask the device for its angle.
    if not hasattr(type(stage), "begin_sweep"):
        name = getattr(stage, "driver", type(stage).__name__)
        raise ConfigError(
            f"this rig cannot follow: its stage ({name}) does not report where it is while it turns, and keeps no "
            "speed; use one that can sweep"
        )
    return cast("SweepingStage", stage)


class TurnInProgress:
    """One turn that the guard has permitted; the guard is TURNING until the probe is at rest again.

    ``start``: readback at which the turn was permitted. ``to_deg``: angle of the stage at its end.
    """

    def __init__(
        self,
        stage: SweepingStage,
        *,
        guard: Guard,
        clock: Clock,
        start: StageReading,
        to_deg: float,
        speed_deg_s: float,
    ) -> None:
        self._stage = stage
        self._guard = guard
        self._clock = clock
        self._to_deg = to_deg
        # From the command to brake until it rests.
        self._longest_s = BEGIN_S + speed_deg_s / stage.acceleration_deg_s2
        self._readings = [start]
        self._way = Way(
            start=start,
            target_deg=to_deg,
            speed_deg_s=speed_deg_s,
            acceleration_deg_s2=stage.acceleration_deg_s2,
        )

    def readings(self, goes_on: Callable[[], bool]) -> Generator[float, None, float]:
        """Turn to the end, or brake once `goes_on` returns False; yield each readback, and return that at rest.

        Raises `MoveError` if the stage does not begin, stops on its way or does not brake.
        """
        stage = self._stage
        stage.begin_sweep(self._to_deg)
        moved_s = self._clock.now_s()
        braked_s = None
        while not (self._rests and (self._arrived or braked_s is not None)):
            before_deg = self._readings[-1].angle_deg
            self._read()
            here_deg = self._readings[-1].angle_deg
            now_s = self._clock.now_s()
            if abs(here_deg - before_deg) > AT_REST_DEG:
                moved_s = now_s
            yield here_deg
            if braked_s is None and not goes_on():
                stage.brake()
                braked_s = self._clock.now_s()
            self._require_motion(moved_s, braked_s, now_s=now_s)
        self._clock.wait(READ_S)
        last = self._next_reading()
        self._guard.end_turn(last.angle_deg, now_s=self._way.moment_s(last))
        stage.end_sweep()
        return last.angle_deg

    def _require_motion(self, moved_s: float, braked_s: float | None, *, now_s: float) -> None:
        """Refuse a stage that stands on its way, or does not brake; the times: when it moved last, and was braked."""
        at_deg = self._readings[-1].angle_deg
        if braked_s is None and not (self._arrived or now_s - moved_s < BEGIN_S):
            raise MoveError(
                f"the stage stands at {at_deg:.3f} deg on its way to {self._to_deg:.3f} deg; look for an obstacle"
            )
        if braked_s is not None and not now_s - braked_s < self._longest_s:
            raise MoveError(
                f"the stage does not stop, it is at {at_deg:.3f} deg {now_s - braked_s:.2f} s after it was told to; "
                "look at the stage"
            )

    def _read(self) -> None:
        await_reading(self._clock, self._readings[-1])
        reading = self._next_reading()
        self._guard.read_turn(reading.angle_deg, now_s=self._way.moment_s(reading))

    def _next_reading(self) -> StageReading:
        reading = self._stage.read_sweep()
        self._readings.append(reading)
        return reading

    @property
    def _arrived(self) -> bool:
        return abs(self._readings[-1].angle_deg - self._to_deg) <= ARRIVED_DEG

    @property
    def _rests(self) -> bool:
        """Whether the last two readings are those of a stage at rest."""
        if len(self._readings) < 3:
            return False
        return abs(self._readings[-1].angle_deg - self._readings[-2].angle_deg) <= AT_REST_DEG
