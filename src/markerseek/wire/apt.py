"""What is said to a KDC101 or TDC001 that turns a PRM1Z8, and what it answers: units, and messages as bytes.

The messages are packed and parsed by thorlabs-apt-protocol. The units are of this stage with this controller, whose
clock ticks every 2048/6e6 s: counts per degree, and words for speed and acceleration. They are rounded, never cut off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from markerseek.core import ConfigError, DeviceError, MissingExtraError
from markerseek.wire.apt_frames import CONTROLLER, HOST, AptMessage

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

CHANNEL = 1

COUNTS_PER_DEG = 1919.6418578623391
SPEED_WORD = 42941.66
"""Word for one degree per second."""
ACCELERATION_WORD = 14.6574
"""Word for one degree per second squared."""

INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS = 0x0006, 0x0415, 0x043C, 0x0425, 0x0452, 0x0491
"""Identities of the answers that `decode` knows."""

_WORD = 2**31

_FAULTS = {
    "motion_error": "motion error",
    "instrument_error": "instrument error",
    "overtemp": "too hot",
    "voltage_fault": "supply voltage",
    "commutation_error": "commutation error",
    "motor_current_limit_reached": "motor current at its limit",
    "encoder_fault": "encoder fault",
    "overcurrent": "too much current",
    "current_fault": "current fault",
    "error": "error",
}
"""Bits that end a move, and what they mean. The limit switches are not among them: a PRM1Z8 touches one at home."""


def counts_of(angle_deg: float) -> int:
    """Encoder counts of an angle in degrees, to the nearest.

    Raises
    ------
    ConfigError
        If the angle is not finite, or has no 32-bit count.
    """
    return _word(angle_deg * COUNTS_PER_DEG, f"{angle_deg} deg")


def degrees_of(counts: int) -> float:
    """Angle in degrees of so many encoder counts."""
    return counts / COUNTS_PER_DEG


def speed_word(speed_deg_s: float) -> int:
    """Word for a speed in degrees per second, to the nearest."""
    return _word(speed_deg_s * SPEED_WORD, f"{speed_deg_s} deg/s")


def acceleration_word(acceleration_deg_s2: float) -> int:
    """Word for an acceleration in degrees per second squared, to the nearest."""
    return _word(acceleration_deg_s2 * ACCELERATION_WORD, f"{acceleration_deg_s2} deg/s^2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """Who a controller is: model, serial number, firmware."""

    model: str
    serial_number: int
    firmware: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Velocity:
    """How fast it may turn, in words."""

    acceleration: int
    speed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftLimits:
    """How far it may turn, in counts, what it does there, and what it does at its limit switches.

    Attributes
    ----------
    low, high
        Ends of the range, in counts.
    mode
        1 goes on, 2 stops at once, 3 brakes.
    switches
        What both switches do: 4 is made at home and means nothing elsewhere.
    """

    low: int
    high: int
    mode: int = 2
    switches: int = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Where it is and what it does.

    Attributes
    ----------
    position
        Position counter, signed.
    moving, homing, homed
        Its own word on that. The first is false for a moment after a move was asked for.
    faults
        Errors that it reports, in words.
    """

    position: int
    moving: bool
    homing: bool
    homed: bool
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """A number of counts that was stored: a target, or a backlash."""

    counts: int


Answer = Info | Velocity | SoftLimits | Status | Counts


def stop_updates() -> bytes:
    """Speak only when asked."""
    return _packed("hw_stop_updatemsgs")


def ask_info() -> bytes:
    """Ask who it is."""
    return _packed("hw_req_info")


def ask_status() -> bytes:
    """Ask where it is and what it does."""
    return _packed("mot_req_dcstatusupdate", chan_ident=CHANNEL)


def set_velocity(velocity: Velocity) -> bytes:
    """Speed and acceleration of the moves to come."""
    return _packed(
        "mot_set_velparams",
        chan_ident=CHANNEL,
        min_velocity=0,
        acceleration=velocity.acceleration,
        max_velocity=velocity.speed,
    )


def ask_velocity() -> bytes:
    """Ask for speed and acceleration."""
    return _packed("mot_req_velparams", chan_ident=CHANNEL)


def set_backlash(counts: int) -> bytes:
    """How far to overshoot and come back, in counts."""
    return _packed("mot_set_genmoveparams", chan_ident=CHANNEL, backlash_distance=counts)


def ask_backlash() -> bytes:
    """Ask how far it overshoots."""
    return _packed("mot_req_genmoveparams", chan_ident=CHANNEL)


def set_limits(limits: SoftLimits) -> bytes:
    """How far it may turn."""
    return _packed(
        "mot_set_limswitchparams",
        chan_ident=CHANNEL,
        cw_hardlimit=limits.switches,
        ccw_hardlimit=limits.switches,
        cw_softlimit=limits.high % (2 * _WORD),
        ccw_softlimit=limits.low % (2 * _WORD),
        soft_limit_mode=limits.mode,
    )


def ask_limits() -> bytes:
    """Ask how far it may turn."""
    return _packed("mot_req_limswitchparams", chan_ident=CHANNEL)


def set_target(counts: int) -> bytes:
    """Store a target; nothing moves yet."""
    return _packed("mot_set_moveabsparams", chan_ident=CHANNEL, absolute_position=counts)


def ask_target() -> bytes:
    """Ask which target is stored."""
    return _packed("mot_req_moveabsparams", chan_ident=CHANNEL)


def move() -> bytes:
    """Go to the target that is stored, also in the middle of another move."""
    return _packed("mot_move_absolute", chan_ident=CHANNEL)


def stop() -> bytes:
    """Stop at once, without braking gently."""
    return _packed("mot_move_stop", chan_ident=CHANNEL, stop_mode=1)


def decode(message: AptMessage) -> Answer | None:
    """What an answer says; None if it is of a kind that no question of ours asks for.

    Raises
    ------
    DeviceError
        If it is of another channel, or not a message that a controller can have sent.
    """
    if message.ident not in (INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS):
        return None
    fields = _parsers()[message.ident](message.raw)
    if message.ident == INFO:
        return _info(fields)
    if fields["chan_ident"] != CHANNEL:
        raise DeviceError(f"a stage's answer is of channel {fields['chan_ident']}, there is only channel {CHANNEL}")
    return _DECODERS[message.ident](fields)


def _info(fields: dict[str, Any]) -> Info:
    model = fields["model_number"].rstrip(b"\x00 ")
    if not model.isalnum():
        raise DeviceError(f"the stage's controller calls itself {model!r}, which is no name of a model")
    firmware = ".".join(str(part) for part in fields["firmware_version"])
    return Info(model=model.decode("ascii"), serial_number=fields["serial_number"], firmware=firmware)


def _velocity(fields: dict[str, Any]) -> Velocity:
    return Velocity(acceleration=fields["acceleration"], speed=fields["max_velocity"])


def _limits(fields: dict[str, Any]) -> SoftLimits:
    if fields["cw_hardlimit"] != fields["ccw_hardlimit"]:
        raise DeviceError("the stage's two limit switches are set differently")
    return SoftLimits(
        low=_signed(fields["ccw_softlimit"]),
        high=_signed(fields["cw_softlimit"]),
        mode=fields["soft_limit_mode"],
        switches=fields["cw_hardlimit"],
    )


def _status(fields: dict[str, Any]) -> Status:
    directions = ("moving_forward", "moving_reverse", "jogging_forward", "jogging_reverse")
    return Status(
        position=fields["position"],
        moving=any(fields[name] for name in directions),
        homing=fields["homing"],
        homed=fields["homed"],
        faults=tuple(words for name, words in _FAULTS.items() if fields[name]),
    )


_DECODERS: dict[int, Callable[[dict[str, Any]], Answer]] = {
    VELOCITY: _velocity,
    LIMITS: _limits,
    STATUS: _status,
    BACKLASH: lambda fields: Counts(counts=fields["backlash_distance"]),
    TARGET: lambda fields: Counts(counts=fields["absolute_position"]),
}


def _signed(word: int) -> int:
    return word - 2 * _WORD if word >= _WORD else word


def _word(value: float, meaning: str) -> int:
    if not (math.isfinite(value) and -_WORD <= round(value) < _WORD):
        raise ConfigError(f"{meaning} cannot be said to the stage's controller, whose words have 32 bits")
    return round(value)


def _packed(name: str, **fields: int) -> bytes:
    return bytes(getattr(_library("functions"), name)(CONTROLLER, HOST, **fields))


def _parsers() -> dict[int, Callable[[bytes], dict[str, Any]]]:
    parsers: dict[int, Callable[[bytes], dict[str, Any]]] = _library("parsing").id_to_func
    return parsers


@cache
def _library(part: str) -> ModuleType:
    try:
        from thorlabs_apt_protocol import functions, parsing  # type: ignore[import-untyped, unused-ignore]
    except ModuleNotFoundError as missing:
        raise MissingExtraError(
            package="thorlabs-apt-protocol", extra="devices", purpose="a Thorlabs stage"
        ) from missing
    modules: dict[str, ModuleType] = {"functions": functions, "parsing": parsing}
    return modules[part]
