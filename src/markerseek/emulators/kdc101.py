"""A KDC101 with a PRM1Z8, emulated at the level of bytes. The notes in its identity say that it is simulated.

It answers the messages that drivers of a single-channel motor use, and turns the probe of a simulated world. It
starts as a real one does: with its default parameters and, by its settings, not homed, or still sending its status
unasked because another program enabled that.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from markerseek.core import Within, require_fields
from markerseek.emulators._kdc101_motion import (
    HOMED,
    POWER_UP,
    SET_BACKLASH,
    SET_HOME,
    SET_JOG,
    SET_LIMITS,
    SET_TARGET,
    SET_VELOCITY,
    MotionControl,
    Prm1z8,
    Turned,
)
from markerseek.emulators.faults import Faults
from markerseek.wire import apt
from markerseek.wire.apt import CONTROLLER, HOST, TO_CONTROLLER, AptFramer, AptMessage

_UPDATES_S = 0.1
_PROFILED = 2
"""Mode of MGMSG_MOT_MOVE_STOP in which the motor brakes with its deceleration."""
_FIRMWARE = (4, 0, 3, 0)

PORTS = 0x0523
"""Message that sets what the trigger ports do; they are kept, and do nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedKdc101:
    """State and mounting of an emulated stage before a driver connects."""

    homed: bool = True
    """Whether it was homed since it was switched on."""
    talking: bool = False
    """Whether it sends its status ten times a second, unasked."""
    zero_deg: Annotated[float, Within(-360, 360, "deg")] = 0.0
    """The stage's own angle at which the probe points at 0."""
    turns: Annotated[int, Within(-10, 10)] = 0
    """Whole turns that the position counter is ahead: with 1, a probe at -35 deg reads 325."""
    play_deg: Annotated[float, Within(0, 5, "deg")] = 0.1
    """Backlash between motor and probe."""
    mirrored: bool = False
    """Whether the probe is mounted the other way round: its angle falls while the stage's own reading grows."""
    enabled: bool = True
    """Whether its channel is enabled when it is switched on; a menu of the controller sets it."""
    settle_deg: Annotated[float, Within(0, 0.2, "deg")] = 0.0
    """How far the servo swings beyond the end of a move, before it settles in half a second."""
    model: str = "KDC101"
    serial_number: int = 27000001
    """``model`` and ``serial_number``: model and serial number that it reports."""

    def __post_init__(self) -> None:
        require_fields(self, "emulated stage")


class Kdc101Emulator:
    """The controller: bytes in, bytes out, and the time by `advance`.

    ``probe``: the probe that it turns, with its true angle; the controller knows only its encoder.
    """

    def __init__(
        self,
        *,
        probe: Turned,
        settings: EmulatedKdc101 | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        self._settings = settings or EmulatedKdc101()
        self.faults = Faults("stage", step=lambda: self._motion.moves)
        rng = rng or np.random.Generator(np.random.PCG64(0))
        self._stage = Prm1z8(
            probe=probe,
            zero_deg=self._settings.zero_deg + 360.0 * self._settings.turns,
            play_deg=self._settings.play_deg,
            sense=-1 if self._settings.mirrored else 1,
            fault=self.faults,
            rng=rng,
            settle_deg=self._settings.settle_deg,
        )
        self._motion = MotionControl(stage=self._stage, fault=self.faults)
        self._framer = AptFramer(TO_CONTROLLER, to=CONTROLLER)
        self._outbox = bytearray()
        self._now_s = 0.0
        self._next_update_s = 0.0
        self._handlers = self._message_handlers()
        self._power_up(homed=self._settings.homed)

    @property
    def truth_range_deg(self) -> tuple[float, float]:
        """Lowest and highest angle at which the probe has truly been, in degrees."""
        return self._stage.lowest_deg, self._stage.highest_deg

    @property
    def moves(self) -> int:
        """Moves that began at rest."""
        return self._motion.moves

    @property
    def largest_lead_deg(self) -> float:
        """Largest distance of a target from the motor when it was set, in degrees."""
        return self._motion.largest_lead_deg

    @property
    def moving(self) -> bool:
        """Whether the motor turns in truth."""
        return self._motion.speed_deg_s != 0

    def advance(self, now_s: float) -> bytes:
        """Advance to that time, and return what the controller sends by itself."""
        # Most calls come twice at one time (a poll before each write); without faults nothing can have changed.
        if now_s == self._now_s and not self.faults and not self._updates:
            return self._out()
        if self.faults("power cycle") is None:
            self._power_cycled = False
        elif not self._power_cycled:
            self._power_up(homed=False)
            self._power_cycled = True
        self._motion.advance(now_s)
        self._now_s = now_s
        if self._updates and self._next_update_s <= now_s:
            self._next_update_s = now_s + _UPDATES_S
            self._send_status(apt.STATUS)
        return self._out()

    def turn(self, now_s: float) -> None:
        """Turn the motor to where it is at that time; what the controller sends by itself waits for `advance`."""
        self._motion.advance(now_s)

    @property
    def velocity(self) -> bytes:
        """The parameters of speed and acceleration that it holds, as they were written."""
        return self._stored[SET_VELOCITY]

    def feed(self, data: bytes) -> bytes:
        """Receive bytes, and return the immediate answer."""
        for message in self._framer.feed(b"" if self._is_cut else data):
            # The device ignores messages that it does not know, without an answer.
            handler = self._handlers.get(message.ident)
            if handler is not None:
                handler(message)
        return self._out()

    def _message_handlers(self) -> dict[int, Callable[[AptMessage], None]]:
        parameters = [SET_VELOCITY, SET_JOG, SET_LIMITS, SET_BACKLASH, SET_HOME, SET_TARGET]
        if self._settings.model == "KDC101":
            parameters.append(PORTS)
        return {
            **dict.fromkeys(parameters, self._set),
            **dict.fromkeys([ident + 1 for ident in parameters], self._send_parameter),
            0x0005: self._send_info,
            0x0011: self._set_updates,
            0x0012: self._set_updates,
            0x0210: self._enable,
            0x0211: self._send_enabled,
            0x040A: self._send_counter,
            0x0411: self._send_counter,
            0x0429: self._send_bits,
            0x0443: lambda _message: self._motion.go_home(),
            0x0453: self._move,
            0x0465: lambda message: self._motion.stop(profiled=message.raw[3] == _PROFILED),
            0x0480: self._answer_status,
            0x0490: self._answer_status,
        }

    def _power_up(self, *, homed: bool) -> None:
        self._stored = {**POWER_UP, PORTS: struct.pack("<6H", 1, 0, 1, 0, 1, 0)}
        self._motion.wake_up(homed=homed)
        self._motion.enabled = self._settings.enabled
        self._updates = self._settings.talking
        self._next_update_s = self._now_s
        self._power_cycled = False

    def _out(self) -> bytes:
        for event in self._motion.events:
            if event == HOMED:
                self._send(event, first=apt.CHANNEL)
            else:
                self._send_status(event)
        self._motion.events.clear()
        out = bytes(self._outbox)
        self._outbox = bytearray()
        return b"" if self._is_cut else out

    @property
    def _is_cut(self) -> bool:
        return self.faults("silent") is not None or self.faults("power cut") is not None

    def _set(self, message: AptMessage) -> None:
        self._stored[message.ident] = message.data
        if message.ident not in (SET_TARGET, PORTS):
            self._motion.learn(self._stored)

    def _move(self, message: AptMessage) -> None:
        self._motion.go(struct.unpack("<Hi", message.data or self._stored[SET_TARGET])[1])

    def _set_updates(self, message: AptMessage) -> None:
        self._updates = message.ident == 0x0011

    def _send_parameter(self, message: AptMessage) -> None:
        self._send(message.ident + 1, data=self._stored[message.ident - 1])

    def _send_info(self, message: AptMessage) -> None:
        model = self._settings.model.encode("ascii")
        number = self._settings.serial_number
        notes = apt.EMULATOR.encode("ascii")
        self._send(message.ident + 1, data=struct.pack("<i8sH4B60s3H", number, model, 16, *_FIRMWARE, notes, 1, 0, 1))

    def _enable(self, message: AptMessage) -> None:
        self._motion.enabled = message.raw[3] == 1

    def _send_enabled(self, message: AptMessage) -> None:
        self._send(message.ident + 1, first=apt.CHANNEL, second=1 if self._motion.enabled else 2)

    def _send_counter(self, message: AptMessage) -> None:
        self._send(message.ident + 1, data=struct.pack("<Hi", apt.CHANNEL, self._motion.position))

    def _send_bits(self, message: AptMessage) -> None:
        self._send(message.ident + 1, data=struct.pack("<HI", apt.CHANNEL, self._motion.bits))

    def _answer_status(self, message: AptMessage) -> None:
        self._send_status(message.ident + 1)

    def _send_status(self, ident: int) -> None:
        position = self._motion.position
        bits = self._motion.bits
        if ident == 0x0481:
            data = struct.pack("<HiiI", apt.CHANNEL, position, position, bits)
        else:
            data = struct.pack("<HihHI", apt.CHANNEL, position, round(self._motion.speed_deg_s), 0, bits)
        self._send(ident, data=data)

    def _send(self, ident: int, *, first: int = 0, second: int = 0, data: bytes = b"") -> None:
        if data:
            self._outbox += struct.pack("<HHBB", ident, len(data), HOST | 0x80, CONTROLLER) + data
        else:
            self._outbox += struct.pack("<HBBBB", ident, first, second, HOST, CONTROLLER)
