"""`Scanner`: one acquisition at one angle, with the guard asked at each step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Protocol

from markerseek.core import AcquisitionError, Clock, ConfigError, Frame, Laser, Reader, Receiver, Sample, Stage
from markerseek.guard import Guard, Limits, State


class DeadMan(Protocol):
    """Lets go of the laser and the stage when the control loop falls silent between `hold` and `release`."""

    def hold(self) -> None:
        """Begin to need the steps of the control loop."""

    def release(self) -> None:
        """Need no more steps; allowed at any time, also twice."""


class Scanner:
    """Measures at one angle: guard, stage, permit, laser and receiver, admission, reader.

    Parameters
    ----------
    stage, laser, receiver, reader, clock
        The parts of the rig.
    guard
        Says what may be done, and believed. It must be armed before anything moves.
    pulses
        Laser pulses averaged in one acquisition; several numbers are used in turn, so that a frame that holds as many
        pulses as were triggered shows which acquisition it belongs to.
    arms_itself
        Whether the guard is armed by the first measurement: only where no hardware is involved.
    dead_man
        Watches over each move and each firing; None where no hardware is involved.
    """

    def __init__(
        self,
        *,
        stage: Stage,
        laser: Laser,
        receiver: Receiver,
        reader: Reader,
        clock: Clock,
        guard: Guard,
        pulses: int | Sequence[int] = 16,
        arms_itself: bool = False,
        dead_man: DeadMan | None = None,
    ) -> None:
        in_turn = (pulses,) if isinstance(pulses, int) else tuple(pulses)
        if not in_turn or min(in_turn) < 1:
            raise ConfigError(f"scanner: pulses is {pulses}, at least 1 is needed to hear anything")
        self.guard = guard
        self.clock = clock
        self._stage = stage
        self._laser = laser
        self._receiver = receiver
        self._reader = reader
        self._pulses = in_turn
        self._acquired = 0
        self._arms_itself = arms_itself
        self._held = _Held(dead_man)
        self._trusted = _Trusted(guard)
        self._willing = _Trusted(guard, AcquisitionError, ConfigError)
        self._refused_frame: Frame | None = None
        self._settled = False

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""
        return self.guard.limits

    @property
    def pulses(self) -> int:
        """Most laser pulses averaged in one acquisition."""
        return max(self._pulses)

    @property
    def angle_deg(self) -> float:
        """Readback of the stage in degrees, inside the travel range."""
        with self._trusted:
            angle_deg = self._stage.angle_deg
        return self.guard.readback(angle_deg)

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused; None if it was not, or nothing came."""
        return self._refused_frame

    def measure(self, angle_deg: float) -> Sample:
        """Turn the probe to an angle, fire, listen, and say what was heard.

        Parameters
        ----------
        angle_deg
            Where to measure, in degrees.

        Raises
        ------
        LimitError
            If the angle is outside the search range or the guard is not armed; nothing was moved.
        AcquisitionError
            If the frame was refused; it may be taken again.
        DeviceError
            If a device did not do its part; the guard is in FAULT then.
        """
        self._arm_itself()
        self.guard.begin_move(angle_deg)
        with self._trusted, self._held:
            reached_deg = self._stage.move_to(angle_deg)
        self.guard.end_move(reached_deg)
        self._acquired += 1
        return self._acquire(angle_deg, pulses=self._pulses[(self._acquired - 1) % len(self._pulses)])

    def measure_dark(self) -> Sample:
        """Listen where the probe stands with the laser kept off: what noise alone looks like.

        Raises
        ------
        DeviceError
            As `measure`.
        """
        self._arm_itself()
        return self._acquire(self.angle_deg, pulses=0)

    def stop(self) -> None:
        """Disarm the guard, take the laser's permit away, then stop the stage; a fault stays one."""
        self.guard.disarm()
        try:
            with self._trusted:
                self._laser.disarm()
        finally:
            with self._trusted:
                self._stage.stop()

    def _acquire(self, commanded_deg: float, *, pulses: int) -> Sample:
        self._refused_frame = None
        if not self._settled:
            # Fired at once after an acquisition that did not end well, a late frame would be taken for the next one.
            with self._willing:
                self._receiver.settle()
        self._settled = False
        permit = self.guard.issue(angle_deg=commanded_deg, pulses=pulses, now_s=self.clock.now_s())
        with self._willing:
            self._receiver.arm(permit)
        before_deg = self.angle_deg
        self.guard.redeem(permit, angle_deg=before_deg, now_s=self.clock.now_s())
        with self._trusted, self._held:
            fired = self._laser.fire(permit)
        self.guard.end_fire(fired)
        with self._willing:
            frame = self._receiver.acquire(permit)
        after_deg = self.angle_deg
        frame = replace(frame, header=replace(frame.header, angle_before_deg=before_deg, angle_after_deg=after_deg))
        self._refused_frame = frame
        self.guard.admit_frame(frame, permit=permit, now_s=self.clock.now_s())
        with self._willing:
            reading = self._reader.read(frame)
        self.guard.admit_reading(reading, frame=frame)
        self._refused_frame = None
        self._settled = True
        return Sample(angle_deg=(before_deg + after_deg) / 2, reading=reading, dark=pulses == 0, frame=frame)

    def _arm_itself(self) -> None:
        if self._arms_itself and self.guard.state is State.DISARMED:
            self.guard.arm(by="a rig without hardware")


class _Trusted:
    """Whatever a device raises is its fault, but for what it may refuse."""

    def __init__(self, guard: Guard, *harmless: type[Exception]) -> None:
        self._guard = guard
        self._harmless = harmless

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if isinstance(error, Exception) and not isinstance(error, self._harmless):
            self._guard.fail(f"{type(error).__name__}: {error}")


class _Held:
    """The dead man's lease, for as long as a step takes."""

    def __init__(self, dead_man: DeadMan | None) -> None:
        self._dead_man = dead_man

    def __enter__(self) -> None:
        if self._dead_man is not None:
            self._dead_man.hold()

    def __exit__(self, *_: object) -> None:
        if self._dead_man is not None:
            self._dead_man.release()
