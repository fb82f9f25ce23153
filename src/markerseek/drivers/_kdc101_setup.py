"""Setup of a stage's controller: check its identity and state, write its parameters, read them back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

from markerseek.core import Interval, LimitError, MoveError, NotConnectedError
from markerseek.drivers._apt_line import AptLine
from markerseek.wire import apt

_ValueT = TypeVar(
    "_ValueT", apt.Velocity, apt.Counts, apt.SoftLimits, apt.TriggerPorts, apt.TriggerPositions, apt.Channel
)

_MODELS = ("KDC101", "TDC001")
TRIGGERING_MODELS = ("KDC101",)
"""Those with trigger ports."""

_TRIES = 3

_MAX_COUNTS = 2**30
"""Farthest from home that a stage can be: from there, targets still have 32 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Connected:
    """A controller whose identity and state were checked."""

    info: apt.Info
    """Model, serial number and firmware."""
    zero: int
    """Reading at which the probe points at 0, in counts, within the turn in which the stage is."""
    limits: apt.SoftLimits
    """Travel range as it was written, in counts."""
    position: int
    """Present position, in counts."""
    enabled: bool
    """Whether its motor gets current."""


def set_up(
    line: AptLine, *, travel: Interval, zero_deg: float, sense: int, velocity: apt.Velocity, serial_number: int | None
) -> Connected:
    """Check and configure a controller; nothing moves.

    - ``travel``: angles at which the probe may be.
    - ``zero_deg``: the stage's own reading at which the probe points at 0.
    - ``sense``: 1 if the probe's angle grows with the stage's own reading, -1 if it falls.
    - ``serial_number``: serial number that the controller must have; None accepts any.

    Raises `NotConnectedError` if it is another device. Raises `MoveError` if it moves, reports an error, is not homed,
    or does not keep what is written. Raises `LimitError` if the probe is outside the travel range.
    """
    # Another program may have left the controller sending its status unasked, which would pass for answers.
    line.send(apt.stop_updates())
    info = line.ask(apt.ask(apt.INFO), apt.INFO, apt.Info)
    if info.model not in _MODELS:
        raise NotConnectedError(f"a {info.model} is at the stage's port, expected one of: {', '.join(_MODELS)}")
    if serial_number is not None and info.serial_number != serial_number:
        raise NotConnectedError(
            f"the stage's controller has the serial number {info.serial_number}, expected {serial_number}; "
            "correct serial_number or the port"
        )
    status = line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status)
    _require_ready(status)
    if not abs(status.position) <= _MAX_COUNTS:
        raise MoveError(
            f"the stage reads {status.position} counts, more than a thousand turns from home; switch "
            "it off and on, and home it with the probe outside the patient"
        )
    # A rotary stage may have been turned any number of times: the probe's zero is the one in this turn.
    turns = round((apt.degrees_of(status.position) - zero_deg - sense * travel.centre_deg) / 360)
    zero = apt.counts_of(zero_deg + 360 * turns)
    # With a reversed probe, the lowest reading of the stage belongs to the highest angle of the probe.
    low_deg, high_deg = sorted((sense * travel.low_deg, sense * travel.high_deg))
    # Rounded inwards: half a count too far would be outside the travel range.
    low, high = math.ceil(low_deg * apt.COUNTS_PER_DEG), math.floor(high_deg * apt.COUNTS_PER_DEG)
    limits = apt.SoftLimits(low=zero + low, high=zero + high)
    if not limits.low <= status.position <= limits.high:
        angle_deg = sense * apt.degrees_of(status.position - zero)
        raise LimitError(
            f"the stage is at {angle_deg:.2f} deg, outside its travel {travel}; with the probe outside the "
            "patient, turn it back by the controller's wheel, or correct zero_deg or direction"
        )
    # The driver approaches from one side itself: the controller's own overshoot could leave the travel range.
    no_backlash = apt.Counts(counts=0)
    if info.model in TRIGGERING_MODELS:
        # First: a program that was killed may have left its triggers, or another one a port that begins moves.
        write_trigger_ports(line, mode=apt.TRIGGER_OFF)
    write_velocity(line, velocity)
    _write(line, "backlash", no_backlash, apt.set_backlash(no_backlash.counts) + apt.ask(apt.BACKLASH), apt.BACKLASH)
    _write(line, "limits", limits, apt.set_limits(limits) + apt.ask(apt.LIMITS), apt.LIMITS)
    return Connected(info=info, zero=zero, limits=limits, position=status.position, enabled=status.enabled)


def enable(line: AptLine) -> None:
    """Give the motor current; nothing moves. `MoveError` if the controller does not keep it."""
    enabled = apt.Channel(enabled=True)
    _write(line, "channel enabled", enabled, apt.enable_channel() + apt.ask(apt.CHANNEL_STATE), apt.CHANNEL_STATE)


def write_velocity(line: AptLine, velocity: apt.Velocity) -> None:
    """Write speed and acceleration of the moves that follow; `MoveError` if the controller does not keep them."""
    _write(line, "speed and acceleration", velocity, apt.set_velocity(velocity) + apt.ask(apt.VELOCITY), apt.VELOCITY)


def write_trigger_row(line: AptLine, row: apt.TriggerRow, *, mode: int) -> None:
    """Make trigger port 1 give a pulse at each position of a row; `MoveError` if the controller does not keep it."""
    # Off first: no port that is set still has a row while another is written.
    write_trigger_ports(line, mode=apt.TRIGGER_OFF)
    positions = apt.TriggerPositions(up=row, down=row)
    messages = apt.set_trigger_positions(positions) + apt.ask(apt.TRIGGER_POSITIONS)
    _write(line, "trigger positions", positions, messages, apt.TRIGGER_POSITIONS)
    # Only now: a port takes over the positions when it is set.
    write_trigger_ports(line, mode=mode)


def write_trigger_ports(line: AptLine, *, mode: int) -> None:
    """Set what trigger port 1 does, and port 2 to nothing; `MoveError` if the controller does not keep it."""
    ports = apt.TriggerPorts(first=mode)
    _write(line, "trigger ports", ports, apt.set_trigger_ports(ports) + apt.ask(apt.TRIGGER_PORTS), apt.TRIGGER_PORTS)


def _require_ready(status: apt.Status) -> None:
    if status.faults:
        raise MoveError(f"the stage reports: {', '.join(status.faults)}; switch it off and on, and home it")
    if status.moving or status.homing:
        raise MoveError("the stage is moving; wait until it is at rest, and end other programs that use it")
    # Never homed from here: homing ignores the soft limits.
    if not status.homed:
        raise MoveError(
            "the stage has not been homed since it was switched on and does not know its angle; homing turns it up to "
            "a whole turn whatever its limits: take the probe out of the patient, home it by the controller's menu, "
            "and start again"
        )


def _write(line: AptLine, name: str, value: _ValueT, messages: bytes, ident: int) -> None:
    """Write a parameter and read it back, more than once if bytes get lost."""
    for _ in range(_TRIES):
        # Written and requested together: whichever is lost, both are sent again.
        read = line.ask(messages, ident, type(value))
        if read == value:
            return
    raise MoveError(f"the stage does not keep its {name}: {value} was written, {read} read back; check its type")
