"""Messages to and from a KDC101 or TDC001 with a PRM1Z8, as bytes.

The messages are packed and parsed by thorlabs-apt-protocol.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from markerseek.core import DeviceError, MissingExtraError
from markerseek.wire.apt_frames import CONTROLLER, HOST, AptMessage
from markerseek.wire.apt_values import (
    ACCELERATION_WORD,
    COUNTS_PER_DEG,
    EMULATOR,
    SPEED_WORD,
    Answer,
    Counts,
    Info,
    SoftLimits,
    Status,
    Velocity,
    acceleration_word,
    counts_of,
    degrees_of,
    speed_word,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

__all__ = [
    "ACCELERATION_WORD",
    "BACKLASH",
    "CHANNEL",
    "COUNTS_PER_DEG",
    "EMULATOR",
    "INFO",
    "LIMITS",
    "SPEED_WORD",
    "STATUS",
    "TARGET",
    "VELOCITY",
    "Answer",
    "Counts",
    "Info",
    "SoftLimits",
    "Status",
    "Velocity",
    "acceleration_word",
    "ask_backlash",
    "ask_info",
    "ask_limits",
    "ask_status",
    "ask_target",
    "ask_velocity",
    "counts_of",
    "decode",
    "degrees_of",
    "move",
    "set_backlash",
    "set_limits",
    "set_target",
    "set_velocity",
    "speed_word",
    "stop",
    "stop_updates",
]

CHANNEL = 1

INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS = 0x0006, 0x0415, 0x043C, 0x0425, 0x0452, 0x0491
"""Identities of the answers that `decode` knows."""

_UNSIGNED = 2**32

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
"""Status bits that end a move, and their names. The limit switches are missing: a PRM1Z8 touches one at home."""


def stop_updates() -> bytes:
    """Send nothing unasked."""
    return _packed("hw_stop_updatemsgs")


def ask_info() -> bytes:
    """Ask for model, serial number and firmware."""
    return _packed("hw_req_info")


def ask_status() -> bytes:
    """Ask for the status: position, motion, faults."""
    return _packed("mot_req_dcstatusupdate", chan_ident=CHANNEL)


def set_velocity(velocity: Velocity) -> bytes:
    """Set speed and acceleration of later moves."""
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
    """Set by how many counts downward moves overshoot and come back."""
    return _packed("mot_set_genmoveparams", chan_ident=CHANNEL, backlash_distance=counts)


def ask_backlash() -> bytes:
    """Ask for that overshoot."""
    return _packed("mot_req_genmoveparams", chan_ident=CHANNEL)


def set_limits(limits: SoftLimits) -> bytes:
    """Set the soft limits."""
    return _packed(
        "mot_set_limswitchparams",
        chan_ident=CHANNEL,
        cw_hardlimit=limits.switches,
        ccw_hardlimit=limits.switches,
        cw_softlimit=limits.high % _UNSIGNED,
        ccw_softlimit=limits.low % _UNSIGNED,
        soft_limit_mode=limits.mode,
    )


def ask_limits() -> bytes:
    """Ask for the soft limits."""
    return _packed("mot_req_limswitchparams", chan_ident=CHANNEL)


def set_target(counts: int) -> bytes:
    """Store a target; nothing moves yet."""
    return _packed("mot_set_moveabsparams", chan_ident=CHANNEL, absolute_position=counts)


def ask_target() -> bytes:
    """Ask for the stored target."""
    return _packed("mot_req_moveabsparams", chan_ident=CHANNEL)


def move() -> bytes:
    """Move to the stored target, also during another move."""
    return _packed("mot_move_absolute", chan_ident=CHANNEL)


def stop() -> bytes:
    """Stop at once, without deceleration."""
    return _packed("mot_move_stop", chan_ident=CHANNEL, stop_mode=1)


def decode(message: AptMessage) -> Answer | None:
    """Content of an answer; None if no request of this module asks for it.

    Raises
    ------
    DeviceError
        If it is of another channel, or no controller can have sent it.
    """
    if message.ident not in (INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS):
        return None
    fields = _parsers()[message.ident](message.raw)
    if message.ident == INFO:
        # The library skips the notes of the manufacturer, 60 bytes from byte 24 on.
        return _info(fields, notes=message.raw[24:84])
    if fields["chan_ident"] != CHANNEL:
        raise DeviceError(f"a stage's answer is of channel {fields['chan_ident']}, there is only channel {CHANNEL}")
    return _DECODERS[message.ident](fields)


def _info(fields: dict[str, Any], *, notes: bytes) -> Info:
    # The field is padded by zeros or blanks. Anything but letters and digits shows that the message is damaged.
    model = fields["model_number"].rstrip(b"\x00 ")
    if not model.isalnum():
        raise DeviceError(f"the stage's controller reports the model {model!r}, which is no model name")
    firmware = ".".join(str(part) for part in fields["firmware_version"])
    return Info(
        model=model.decode("ascii"),
        serial_number=fields["serial_number"],
        firmware=firmware,
        notes=notes.rstrip(b"\x00 ").decode("ascii", "replace"),
    )


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


# The library packs soft limits unsigned, and a reading may lie below home: two's complement by hand.
def _signed(word: int) -> int:
    return word - _UNSIGNED if word >= _UNSIGNED // 2 else word


def _packed(name: str, **fields: int) -> bytes:
    return bytes(getattr(_library("functions"), name)(CONTROLLER, HOST, **fields))


def _parsers() -> dict[int, Callable[[bytes], dict[str, Any]]]:
    parsers: dict[int, Callable[[bytes], dict[str, Any]]] = _library("parsing").id_to_func
    return parsers


@cache
def _library(part: str) -> ModuleType:
    # Imported on first use: it is an optional package, and rigs without a Thorlabs stage run without it.
    try:
        from thorlabs_apt_protocol import functions, parsing  # type: ignore[import-untyped, unused-ignore]
    except ModuleNotFoundError as missing:
        raise MissingExtraError(
            package="thorlabs-apt-protocol", extra="devices", purpose="a Thorlabs stage"
        ) from missing
    modules: dict[str, ModuleType] = {"functions": functions, "parsing": parsing}
    return modules[part]
