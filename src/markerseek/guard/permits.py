"""Permits to fire: a number of pulses, for a short time, once, within a budget per second and one per session."""

from __future__ import annotations

from collections import deque

import msgspec
from msgspec.structs import replace

from markerseek.core import ConfigError, LaserError, LimitError, Permit, SweepPermit, is_finite, is_whole, require_range


class FiringLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What may be fired."""

    pulses_per_permit: int = 128
    """Most pulses in one acquisition."""
    pulses_per_sweep: int = 10_000
    """Most pulses in one sweep."""
    pulses_per_second: int = 1000
    """Most pulses under permits that are used within any one second."""
    pulses_per_session: int = 100_000
    """Most pulses until a person starts a new session."""
    lifetime_s: float = 30.0
    """Time after which a permit is void."""

    def __post_init__(self) -> None:
        for name in ("pulses_per_permit", "pulses_per_sweep", "pulses_per_second", "pulses_per_session"):
            value = getattr(self, name)
            if not (is_whole(value) and value >= 1):
                raise ConfigError(f"firing limits: {name} is {value}, it must be a whole number of at least 1")
        require_range("firing limits: lifetime_s", self.lifetime_s, low=0, high=600, unit="s", open_low=True)


class Permits:
    """Issues permits, redeems each once, and counts the pulses that they allow.

    Pulses are counted when they are permitted: a laser that does not report what it fired cannot exceed the session's
    budget. One permit is open at a time: a new one voids the one before.
    """

    def __init__(self, limits: FiringLimits) -> None:
        self._limits = limits
        self._issued = 0
        self._pulses = 0
        self._open: set[Permit] = set()
        self._used: deque[tuple[float, int]] = deque()

    @property
    def pulses_permitted(self) -> int:
        """Pulses permitted in this session so far."""
        return self._pulses

    def charge(self, pulses: int) -> None:
        """Count pulses that another guard permitted in this session; `ConfigError` if no whole number of at least 0."""
        if not (is_whole(pulses) and pulses >= 0):
            raise ConfigError(f"permits: {pulses} pulses cannot have been permitted before; count them again")
        self._pulses += pulses

    def issue(self, *, angle_deg: float, pulses: int, now_s: float) -> Permit:
        """Return the permit for one acquisition at one angle, now on the rig's clock; 0 pulses take a dark frame.

        `LimitError` if its pulses exceed a limit, or a value is no number; nothing was permitted then.
        """
        token, expires_s = self._charge(pulses, angle_deg, now_s, most=self._limits.pulses_per_permit)
        permit = Permit(token=token, angle_deg=float(angle_deg), pulses=int(pulses), expires_s=expires_s)
        self._open = {permit}
        return permit

    def issue_sweep(self, wanted: SweepPermit, *, now_s: float) -> SweepPermit:
        """Return the permit that is wanted for one sweep, with token and expiry; refused as by `issue`."""
        token, expires_s = self._charge(wanted.pulses, wanted.angle_deg, now_s, most=self._limits.pulses_per_sweep)
        permit = replace(wanted, token=token, expires_s=expires_s)
        self._open = {permit}
        return permit

    def _charge(self, pulses: int, angle_deg: float, now_s: float, *, most: int) -> tuple[str, float]:
        if not (is_whole(pulses) and is_finite(angle_deg) and is_finite(now_s)):
            raise LimitError(f"{pulses!r} pulses at {angle_deg!r} deg, {now_s!r} s: no number; nothing was permitted")
        if not 0 <= pulses <= most:
            raise LimitError(f"{pulses} pulses under one permit; the limit is {most}: ask for fewer")
        if not self._pulses + pulses <= self._limits.pulses_per_session:
            why = f"{self._pulses} pulses were permitted in this session and {pulses} more are asked for; the limit is"
            raise LimitError(f"{why} {self._limits.pulses_per_session}: a person must start a new session")
        self._issued = self._issued + 1
        self._pulses = self._pulses + pulses
        return f"permit-{self._issued}", float(now_s + self._limits.lifetime_s)

    def redeem(self, permit: Permit, *, now_s: float, most_in_1_s: int | None = None) -> None:
        """Use up a permit, at the moment at which the laser is to fire.

        ``most_in_1_s``: a lower limit of pulses within a second than that of the rig; None: the rig's.

        `LaserError` if it is not the open one (used, voided, altered or foreign) or has expired, `LimitError` if too
        many pulses would be fired within a second; nothing may be fired then.
        """
        if not isinstance(permit, Permit) or permit not in self._open:
            name = permit.token if isinstance(permit, Permit) else permit
            raise LaserError(f"the permit {name!r} is not open: used, voided or never issued; nothing was fired")
        self._open.clear()
        if not (is_finite(now_s) and now_s <= permit.expires_s):
            raise LaserError(f"the permit {permit.token!r} has expired; nothing was fired; what took so long?")
        while self._used and not now_s - self._used[0][0] < 1:
            self._used.popleft()
        recent = sum(pulses for _, pulses in self._used)
        more = permit.pulses_in_1_s
        usual = self._limits.pulses_per_second
        most = usual if most_in_1_s is None else min(usual, most_in_1_s)
        if not recent + more <= most:
            why = f"{recent} pulses within a second and {more} more are asked for; the limit is"
            raise LimitError(f"{why} {most}: fire more slowly; nothing was fired")
        self.count(permit, now_s=now_s)

    def count(self, permit: Permit, *, now_s: float) -> None:
        """Count what a permit allows within a second as fired just now."""
        self._used.append((now_s, permit.pulses_in_1_s))

    def void(self) -> None:
        """Void the open permit, if there is one."""
        self._open.clear()
