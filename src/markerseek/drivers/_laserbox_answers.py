"""What the driver of the laser box says of answers that it cannot use."""

from __future__ import annotations

from markerseek.core import LaserError, NotConnectedError
from markerseek.wire import laserbox as wire

_MIN_LEASE_MS = 50
"""Shortest lease in milliseconds that survives one lost beat."""

_MAX_TOKENS = wire.MAX_COUNT - 1_000_000
"""Highest token that a box may have used before: enough are left for a session."""

_CURES = {
    "CRC": "a line was damaged on its way: check cable and earthing",
    "FORM": "it does not know the command: check its firmware's version",
    "TOKEN": "the permit is gone, by a lapsed lease or a restart of the box: arm and start again",
    "STEP": "a beat came twice: does another program use it?",
    "INTERLOCK": "the interlock is open: close it, then arm again",
    "BUSY": "it still sends the triggers of another firing: does another program use it?",
    "BUDGET": f"it sends at most {wire.MAX_PULSES_PER_MINUTE} pulses a minute: wait a minute, or average fewer",
}


def require_known(greeting: wire.Greeting) -> None:
    """Refuse a box whose version, lease or token this program cannot use."""
    if greeting.version not in (wire.VERSION, wire.METERED_VERSION):
        raise NotConnectedError(
            f"laser box: it has version {greeting.version} of the protocol, {wire.VERSION} and "
            f"{wire.METERED_VERSION} are known; load the firmware that came with this program"
        )
    if not _MIN_LEASE_MS <= greeting.lease_ms <= wire.LEASE_MS:
        raise NotConnectedError(
            f"laser box: its lease is {greeting.lease_ms} ms, it must lie between {_MIN_LEASE_MS} and "
            f"{wire.LEASE_MS} ms; set it in its firmware"
        )
    if greeting.last_token > _MAX_TOKENS:
        raise NotConnectedError(
            f"laser box: it has used the token {greeting.last_token}, and {wire.MAX_COUNT} is the last; switch it "
            "off and on, or check its firmware"
        )


def stray_light(seen: int, expected: int) -> LaserError:
    """The error of a photodiode that has seen another number of pulses than were fired."""
    return LaserError(
        f"laser box: its photodiode counts {seen} pulses of light since power-up, {expected} up to the last firing: "
        "there was light without a permit, or the box was switched off and on; nothing was fired; check the laser and "
        "its trigger line"
    )


def cure(reply: wire.Reply) -> str:
    """What a person can do where this is no answer."""
    return _CURES[reply.reason] if isinstance(reply, wire.Refusal) else "check its firmware"
