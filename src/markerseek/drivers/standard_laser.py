"""A laser from its verbs: a permit is good once and before its expiry, and after the pulses or any error it is off."""

from __future__ import annotations

from contextlib import suppress
from typing import Generic, Protocol, TypeVar

from markerseek.core import Clock, DeviceError, DeviceTimeoutError, LaserError, Permit, SweepPermit
from markerseek.drivers.clock import polls

_ANSWER_S = 1.0
_POLL_S = 0.005
"""Longest time from the last pulse to the count of the pulses, and between two looks for it, in seconds."""


class LaserLogic(Protocol):
    """The verbs of a laser. Each returns at once, or as soon as the device has confirmed it.

    A class may have the attributes ``emulated``, whether it is no real device, and ``description``.
    """

    def fire(self, pulses: int) -> None:
        """Begin to fire this number of pulses; 0: trigger the acquisition as often as for a lit one, without light."""

    def fired(self) -> int | None:
        """Return how many were fired since `fire`; None while they go on."""

    def off(self) -> None:
        """Take the light away; called at any time, also twice."""


LogicT = TypeVar("LogicT", bound=LaserLogic)


class LaserPermits:
    """The permits that a laser was given: each is used once, and only if it ends after its pulses.

    ``name``: begins each error.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._clock = clock
        self._used: set[str] = set()

    def require_unused(self, permit: Permit | SweepPermit) -> None:
        """Refuse a permit that was used; `LaserError`."""
        if permit.token in self._used:
            raise LaserError(f"{self._name}: the permit {permit.token!r} was used before; nothing was fired")

    def use(self, permit: Permit | SweepPermit, *, needed_s: float) -> float:
        """Use a permit up, and return how long it is good for, in seconds.

        Raises `LaserError` if it was used before, or is good for a shorter time than needed.
        """
        self.require_unused(permit)
        left_s = permit.expires_s - self._clock.now_s()
        if not left_s > 0:
            raise LaserError(f"{self._name}: the permit {permit.token!r} has expired; nothing was fired")
        # Refused here: a train cut at the expiry would be pulses on the skin that no frame uses.
        if not left_s >= needed_s:
            raise LaserError(
                f"{self._name}: the permit {permit.token!r} is good for {left_s:.2f} s more and its pulses take "
                f"{needed_s:.2f} s; nothing was fired"
            )
        # Used up before the first byte is sent: a permit whose firing failed half-way must never be tried again.
        self._used.add(permit.token)
        return left_s


class StandardLaser(Generic[LogicT]):
    """A `markerseek.core.Laser` that fires by the verbs of its logic.

    ``name``: begins each error. ``rate_hz``: pulses per second.
    """

    def __init__(self, logic: LogicT, *, clock: Clock, rate_hz: float, name: str) -> None:
        self.logic = logic
        self._clock = clock
        self._rate_hz = rate_hz
        self._name = name
        self._permits = LaserPermits(name, clock)

    @property
    def emulated(self) -> bool:
        """Whether the device says that it is an emulator."""
        return bool(getattr(self.logic, "emulated", False))

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses, switch off, and return how many were fired.

        Raises `LaserError` if the permit was used or is too short, if the device refuses, or if another number was
        fired. Raises `DeviceTimeoutError` if the device does not say in time. Whatever is raised, it was switched off.
        """
        needed_s = permit.pulses / self._rate_hz
        self._permits.use(permit, needed_s=needed_s)
        try:
            self.logic.fire(permit.pulses)
            fired = self._await(needed_s)
            self.logic.off()
        except BaseException:
            # If even this fails, the supervisor switches it off; the first error is the one to report.
            with suppress(DeviceError):
                self.logic.off()
            raise
        if fired != permit.pulses:
            raise LaserError(
                f"{self._name}: {permit.pulses} pulses were permitted and {fired} fired; check the laser and "
                "its trigger"
            )
        return fired

    def _await(self, needed_s: float) -> int:
        for _ in polls(self._clock, within_s=needed_s + _ANSWER_S, every_s=_POLL_S):
            if (fired := self.logic.fired()) is not None:
                return fired
        raise DeviceTimeoutError(
            f"{self._name}: the end of the pulses was not confirmed within {_ANSWER_S:g} s; it is switched off; "
            "check its cable and its power"
        )

    def disarm(self) -> None:
        """Switch off; raises what the device says if it does not confirm it."""
        self.logic.off()
