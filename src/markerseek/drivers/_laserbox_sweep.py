"""A sweep of the laser box: the times of its pulses, and what the box has said of them.

The box stamps each pulse by a clock of its own. A question for that clock bounds, by the times of question and answer,
what it showed then; many of them bound it more closely than any one does.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

from markerseek.core import LaserError, Pulse
from markerseek.wire import laserbox as wire

DRIFT = 100e-6
"""Most by which the box's clock is fast or slow against the computer's: of two crystals, each 50 ppm off."""

STAMP_S = 1e-3
"""Most that the time of a pulse may be off, in seconds: 0.01 deg at the fastest speed of a sweep."""

_TURN_US = wire.MAX_COUNT + 1
_ROUND_S = 1e-6
_KEPT = 256


class BoxClock:
    """The box's clock on the rig's, by round trips: a time at which it was asked, one at which the answer was there."""

    def __init__(self) -> None:
        self._first_us: int | None = None
        self._trips: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def add(self, clock_us: int, *, asked_s: float, answered_s: float) -> None:
        """Add a round trip; only the last of many are kept."""
        if self._first_us is None:
            self._first_us = clock_us
        self._trips.append((self._since_first_s(clock_us), asked_s, answered_s))

    def pulse(self, stamp_us: int) -> Pulse:
        """The pulse of that stamp, at a time that every round trip allows.

        Raises `LaserError` if no time is allowed, because the clock jumped, or if they differ by too much.
        """
        at_s = self._since_first_s(stamp_us)
        earliest_s, latest_s = -math.inf, math.inf
        for clock_s, asked_s, answered_s in self._trips:
            since_s, drift_s = at_s - clock_s, DRIFT * abs(at_s - clock_s) + _ROUND_S
            earliest_s = max(earliest_s, asked_s + since_s - drift_s)
            latest_s = min(latest_s, answered_s + since_s + drift_s)
        width_s = latest_s - earliest_s
        if width_s < 0:
            raise LaserError(
                f"laser box: its clock jumped by {-1e3 * width_s:.1f} ms or more in mid-sweep; look for a restart of "
                "the box, or a loose cable"
            )
        if not width_s / 2 <= STAMP_S:
            raise LaserError(
                f"laser box: the time of a pulse is known to {1e3 * width_s / 2:.1f} ms only, the limit is "
                f"{1e3 * STAMP_S:g} ms; close other programs, or give the box a port of its own"
            )
        return Pulse(at_s=(earliest_s + latest_s) / 2, sigma_s=width_s / math.sqrt(12))

    def _since_first_s(self, clock_us: int) -> float:
        """Seconds from the first round trip to what the clock shows; that starts at 0 again every 36 minutes."""
        first_us = self._first_us or 0
        return ((clock_us - first_us + _TURN_US // 2) % _TURN_US - _TURN_US // 2) / 1e6


@dataclass(slots=True, kw_only=True)
class BoxSweep:
    """The permitted sweep, and the answers of the box so far."""

    token: int
    pulses: int
    heard_s: float
    """Time of the last answer of the box."""
    stepped_s: float
    """Time of the control loop's last step."""
    clock: BoxClock = field(default_factory=BoxClock)
    asked_s: dict[int, float] = field(default_factory=dict)
    """Time of each question about the box's clock that has no answer yet, by its number."""
    usual_light: float | None = None
    """Reading of the light meter for a usual pulse; None: the light meter is not used."""
    stamped: list[wire.Stamped] = field(default_factory=list)
    """Pulses, in order."""
    returned: int = 0
    """Number of pulses that `new_pulses` has returned."""
    ending: bool = False
    """Whether the command to end the light was sent."""
    disarmed: bool = False
    dark: wire.Dark | None = None
    """Answer of the box after the end of the light, with the number of pulses; None until then."""

    def hear(self, reply: wire.Reply, *, now_s: float) -> None:
        """Take an answer of the box; `LaserError` if the box refuses, or if a pulse is missing or gave no light."""
        self.heard_s = now_s
        match reply:
            case wire.Time(number=number, clock_us=clock_us):
                asked_s = self.asked_s.pop(number, None)
                if asked_s is not None:
                    self.clock.add(clock_us, asked_s=asked_s, answered_s=now_s)
            case wire.Stamped(token=self.token, number=number, photodiode=1) if number == len(self.stamped) + 1:
                self.stamped.append(reply)
            case wire.Dark(token=self.token):
                self.dark = reply
            case wire.Disarmed():
                self.disarmed = True
            case wire.Done(token=self.token):
                pass
            case _:
                raise LaserError(
                    f"laser box: {reply} came after {len(self.stamped)} pulses of the sweep {self.token}, each of "
                    "which the photodiode must see once; check laser, photodiode and trigger"
                )

    def require_light(self) -> None:
        """Refuse a sweep whose light has ended without a command, and before all its pulses."""
        if self.dark is not None and not self.ending and self.dark.sent < self.pulses:
            raise LaserError(
                f"laser box: it ended the light after {self.dark.sent} of at most {self.pulses} pulses; check the "
                "interlock, and what held up this computer for longer than the box's lease"
            )

    def fired(self) -> int:
        """Pulses that were fired, once the light has ended; `LaserError` if box, photodiode and stamps differ."""
        dark = self.dark
        if dark is None or not dark.sent == dark.photodiode == len(self.stamped):
            raise LaserError(
                f"laser box: {dark} ended a sweep of {len(self.stamped)} stamped pulses; check laser, photodiode and "
                "trigger"
            )
        return dark.sent

    def new_pulses(self) -> list[Pulse]:
        """Pulses since the last call, with their times on the rig's clock."""
        new = [self._pulse(stamped) for stamped in self.stamped[self.returned :]]
        self.returned = len(self.stamped)
        return new

    def _pulse(self, stamped: wire.Stamped) -> Pulse:
        energy = None if self.usual_light is None else stamped.light / self.usual_light
        return replace(self.clock.pulse(stamped.stamp_us), energy=energy)
