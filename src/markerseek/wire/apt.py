"""Messages to and from a KDC101 or TDC001 with a PRM1Z8, as bytes, and the units of their numbers.

The messages are packed and parsed by thorlabs-apt-protocol. The units are of this stage with this controller, whose
clock ticks every 2048/6e6 s: counts per degree, and words for speed and acceleration. They are rounded, never
truncated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from markerseek.core import ConfigError, DeviceError, needs_package
from markerseek.wire.apt_frames import CONTROLLER, HOST, AptMessage

# Thorlabs, "APT Communications Protocol", PRM1-Z8 with TDC001 or KDC101: 1919.64, 42941.66 and 14.66.
COUNTS_PER_DEG = 1919.6418578623391
SPEED_WORD = 42941.66
"""Word for 1 deg/s: counts per sampling interval of 2048/6e6 s, times 65536."""
ACCELERATION_WORD = 14.6574
"""Word for 1 deg/s²: counts per sampling interval squared, times 65536."""

CHANNEL = 1

EMULATOR = "simulated by markerseek"
"""Notes in the identity of an emulated controller."""

INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS = 0x0006, 0x0415, 0x043C, 0x0425, 0x0452, 0x0491
TRIGGER_PORTS, TRIGGER_POSITIONS, CHANNEL_STATE = 0x0525, 0x0528, 0x0212
"""Identities of the answers that `decode` knows."""

TRIGGER_OFF, TRIGGER_STEPS_UP, TRIGGER_STEPS_DOWN = 0x00, 0x0D, 0x0E
"""Modes of a trigger port: nothing, or a pulse at each position while the counts rise, or fall.

Thorlabs, "APT Communications Protocol", MGMSG_MOT_SET_KCUBETRIGIOCONFIG. 0x0B is high while it moves, and 0x0C while it
turns at its full speed: either would give one edge a sweep.
"""

TRIGGER_US = 50
"""Length of a trigger pulse, in microseconds: the box counts its rising edge by an interrupt."""

_ACTIVE_HIGH = 1

_KNOWN = (INFO, VELOCITY, BACKLASH, LIMITS, TARGET, STATUS, TRIGGER_PORTS, TRIGGER_POSITIONS, CHANNEL_STATE)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """Identity of a controller: model, serial number, firmware, and the maker's notes."""

    model: str
    serial_number: int
    firmware: str
    notes: str = ""

    @property
    def emulated(self) -> bool:
        """Whether it says of itself that it is the emulator, and no hardware."""
        return self.notes == EMULATOR


@dataclass(frozen=True, slots=True, kw_only=True)
class Velocity:
    """Speed and acceleration, in the controller's words."""

    acceleration: int
    speed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftLimits:
    """Soft limits in counts, and the behaviour there and at the limit switches."""

    low: int
    high: int
    """``low`` and ``high``: ends of the range, in counts."""
    mode: int = 2
    """At a soft limit: 1 ignores it, 2 stops at once, 3 decelerates."""
    switches: int = 4
    """Behaviour of both limit switches: 4 makes on contact, and serves for homing only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Status of the stage."""

    position: int
    """Position counter, signed."""
    moving: bool
    homing: bool
    homed: bool
    """``moving``, ``homing`` and ``homed``: ``moving`` is false for a moment after a move was commanded."""
    faults: tuple[str, ...]
    """Names of the errors that it reports."""
    enabled: bool = True
    """Whether the motor of its channel gets current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """A stored number of counts: a target, or a backlash."""

    counts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """Whether the channel is enabled: its motor gets current."""

    enabled: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerPorts:
    """Modes of the two trigger ports; an active output is high."""

    first: int
    second: int = TRIGGER_OFF
    polarities: tuple[int, int] = (_ACTIVE_HIGH, _ACTIVE_HIGH)


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerRow:
    """Positions at which a port gives pulses while the stage turns one way, in counts."""

    start: int
    interval: int
    """Distance from one to the next, positive in either direction."""
    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerPositions:
    """Where the ports give pulses: while the counts rise, and while they fall."""

    up: TriggerRow
    down: TriggerRow
    pulse_us: int = TRIGGER_US
    cycles: int = 1
    """How often both rows may be run through."""


Answer = Info | Velocity | SoftLimits | Status | Counts | TriggerPorts | TriggerPositions | Channel


def counts_of(angle_deg: float) -> int:
    """Encoder counts of an angle in degrees, rounded."""
    return _word(angle_deg * COUNTS_PER_DEG, f"{angle_deg} deg")


def degrees_of(counts: int) -> float:
    """Angle in degrees of a number of encoder counts."""
    return counts / COUNTS_PER_DEG


def speed_word(speed_deg_s: float) -> int:
    """Word for a speed in degrees per second, rounded."""
    return _word(speed_deg_s * SPEED_WORD, f"{speed_deg_s} deg/s")


def acceleration_word(acceleration_deg_s2: float) -> int:
    """Word for an acceleration in degrees per second squared, rounded."""
    return _word(acceleration_deg_s2 * ACCELERATION_WORD, f"{acceleration_deg_s2} deg/s^2")


def _word(value: float, meaning: str) -> int:
    if not (math.isfinite(value) and -_UNSIGNED // 2 <= round(value) < _UNSIGNED // 2):
        raise ConfigError(f"{meaning} cannot be sent to the stage's controller, whose words have 32 bits")
    return round(value)


def stop_updates() -> bytes:
    """Send nothing unasked."""
    return _packed("hw_stop_updatemsgs")


def ask_info() -> bytes:
    """Ask for model, serial number and firmware."""
    return _packed("hw_req_info")


def ask_status() -> bytes:
    """Ask for the status: position, motion, faults."""
    return _packed("mot_req_dcstatusupdate", chan_ident=CHANNEL)


def enable_channel() -> bytes:
    """Give the motor current; nothing moves."""
    return _packed("mod_set_chanenablestate", chan_ident=CHANNEL, enable_state=1)


def ask_channel() -> bytes:
    """Ask whether the channel is enabled."""
    return _packed("mod_req_chanenablestate", chan_ident=CHANNEL)


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


def set_trigger_positions(positions: TriggerPositions) -> bytes:
    """Set where a port gives pulses; it does so from the next `set_trigger_ports` on."""
    return _packed(
        "mot_set_kcubeposttrigparams",
        chan_ident=CHANNEL,
        start_pos_fwd=positions.up.start,
        interval_fwd=positions.up.interval,
        num_pulses_fwd=positions.up.number,
        start_pos_rev=positions.down.start,
        interval_rev=positions.down.interval,
        num_pulses_rev=positions.down.number,
        pulse_width=positions.pulse_us,
        num_cycles=positions.cycles,
    )


def ask_trigger_positions() -> bytes:
    """Ask where a port gives pulses."""
    return _packed("mot_req_kcubeposttrigparams", chan_ident=CHANNEL)


def set_trigger_ports(ports: TriggerPorts) -> bytes:
    """Set what the trigger ports do."""
    return _packed(
        "mot_set_kcubetrigioconfig",
        chan_ident=CHANNEL,
        trig1_mode=ports.first,
        trig1_polarity=ports.polarities[0],
        trig2_mode=ports.second,
        trig2_polarity=ports.polarities[1],
    )


def ask_trigger_ports() -> bytes:
    """Ask what the trigger ports do."""
    return _packed("mot_req_kcubetrigconfig", chan_ident=CHANNEL)


def move() -> bytes:
    """Move to the stored target, also during another move."""
    return _packed("mot_move_absolute", chan_ident=CHANNEL)


def stop(*, profiled: bool = False) -> bytes:
    """Stop at once, without deceleration, or with the one that was set."""
    return _packed("mot_move_stop", chan_ident=CHANNEL, stop_mode=2 if profiled else 1)


def decode(message: AptMessage) -> Answer | None:
    """Content of an answer; None if no request of this module asks for it.

    Raises `DeviceError` if it is of another channel, or no controller can have sent it.
    """
    if message.ident not in _KNOWN:
        return None
    fields = _library().parsing.id_to_func[message.ident](message.raw)
    if message.ident == INFO:
        # The library skips the notes of the manufacturer, 60 bytes from byte 24 on.
        return _info(fields, notes=message.raw[24:84])
    if fields["chan_ident"] != CHANNEL:
        raise DeviceError(f"a stage's answer is of channel {fields['chan_ident']}, there is only channel {CHANNEL}")
    if message.ident == STATUS:
        return _status(fields)
    if message.ident == LIMITS:
        return _limits(fields)
    if message.ident == VELOCITY:
        return Velocity(acceleration=fields["acceleration"], speed=fields["max_velocity"])
    if message.ident == TRIGGER_PORTS:
        return TriggerPorts(
            first=fields["trig1_mode"],
            second=fields["trig2_mode"],
            polarities=(fields["trig1_polarity"], fields["trig2_polarity"]),
        )
    if message.ident == TRIGGER_POSITIONS:
        return _trigger_positions(fields)
    if message.ident == CHANNEL_STATE:
        return Channel(enabled=fields["enabled"])
    return Counts(counts=fields["backlash_distance" if message.ident == BACKLASH else "absolute_position"])


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


def _limits(fields: dict[str, Any]) -> SoftLimits:
    if fields["cw_hardlimit"] != fields["ccw_hardlimit"]:
        raise DeviceError("the stage's two limit switches are set differently")
    return SoftLimits(
        low=_signed(fields["ccw_softlimit"]),
        high=_signed(fields["cw_softlimit"]),
        mode=fields["soft_limit_mode"],
        switches=fields["cw_hardlimit"],
    )


def _trigger_positions(fields: dict[str, Any]) -> TriggerPositions:
    up, down = (
        TriggerRow(
            start=fields[f"start_pos_{way}"], interval=fields[f"interval_{way}"], number=fields[f"num_pulses_{way}"]
        )
        for way in ("fwd", "rev")
    )
    return TriggerPositions(up=up, down=down, pulse_us=fields["pulse_width"], cycles=fields["num_cycles"])


def _status(fields: dict[str, Any]) -> Status:
    directions = ("moving_forward", "moving_reverse", "jogging_forward", "jogging_reverse")
    return Status(
        position=fields["position"],
        moving=any(fields[name] for name in directions),
        homing=fields["homing"],
        homed=fields["homed"],
        faults=tuple(words for name, words in _FAULTS.items() if fields[name]),
        enabled=fields["channel_enabled"],
    )


# The library packs soft limits unsigned, and a reading may lie below home: two's complement by hand.
def _signed(word: int) -> int:
    return word - _UNSIGNED if word >= _UNSIGNED // 2 else word


def _packed(name: str, **fields: int) -> bytes:
    return bytes(getattr(_library().functions, name)(CONTROLLER, HOST, **fields))


@cache
def _library() -> Any:
    # Imported on first use: it is an optional package, and rigs without a Thorlabs stage run without it.
    with needs_package("thorlabs-apt-protocol", extra="devices", purpose="a Thorlabs stage"):
        import thorlabs_apt_protocol.functions
        import thorlabs_apt_protocol.parsing
    return thorlabs_apt_protocol
