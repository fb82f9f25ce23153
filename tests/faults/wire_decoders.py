"""Decoders of device bytes as functions of bytes: protocol decoders, and drivers on a scripted line.

A script holds what a driver reads, one reading after another: a length, and that number of bytes. After its end the
device is silent, or, if the first byte of the script is odd, repeats the script without end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from pyigtl.messages import CRC64

from markerseek.bridges.igtl.commands import is_command, read_request, search_request
from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
    Permit,
    Pulse,
    SweepPermit,
    is_finite,
)
from markerseek.drivers import Kdc101Stage, LaserBox
from markerseek.drivers.picolas import PicolasLaser
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.sim import Flash, VirtualClock
from markerseek.wire import Port, igtl, laserbox
from markerseek.wire.apt import CONTROLLER, TO_CONTROLLER, AptFramer
from tests.emulated_lines import DirectPort
from tests.faults.decoders import read_or_refused

PULSES = 4
MAX_READS = 100_000
LONGEST_S = 60.0
"""Readings and virtual seconds after which a driver is taken to hang."""


class ScriptedPort:
    """A port that plays back a script; where nothing comes, a read takes its time."""

    def __init__(
        self,
        script: bytes,
        *,
        dress: Callable[[bytes], bytes] = bytes,
        wait: Callable[[float], None] = lambda _duration_s: None,
    ) -> None:
        self._wait = wait
        self.said = b""
        self._dress = dress
        self._again = bool(script[:1] and script[0] & 1)
        self._script = script[1:]
        self._at = 0
        self._reads = 0

    def write(self, data: bytes) -> None:
        self.said += data

    def read(self, size: int, *, timeout_s: float) -> bytes:
        self._reads += 1
        assert self._reads <= MAX_READS, "it reads for ever"
        if self._at >= len(self._script):
            if not self._again:
                self._wait(timeout_s)
                return b""
            self._at = 0
        if not self._script:
            return b""
        length = min(self._script[self._at], size)
        received = self._script[self._at + 1 : self._at + 1 + length]
        self._at += 1 + length
        return self._dress(received)

    def close(self) -> None:
        pass


class RecordingPort:
    """Records what is read from another port as a script."""

    def __init__(self, port: Port) -> None:
        self.script = bytearray(b"\0")
        self._port = port

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        received = self._port.read(size, timeout_s=timeout_s)
        assert len(received) < 256
        self.script += bytes([len(received)]) + received
        return received

    def close(self) -> None:
        self._port.close()


class AllIsWell:
    """A PicoLAS driver that confirms every command."""

    def __init__(self) -> None:
        self._said = b""

    def write(self, data: bytes) -> None:
        self._said += b"0\r\n\n\n" * data.count(b"\r")

    def read(self, size: int, *, timeout_s: float) -> bytes:
        data = self._said[:size]
        self._said = self._said[size:]
        return data

    def close(self) -> None:
        pass


def _permit(clock: Clock) -> Permit:
    return Permit(token="a", angle_deg=0.0, pulses=PULSES, expires_s=clock.now_s() + 50.0)


def _use_stage(port: Port, clock: Clock) -> None:
    stage = Kdc101Stage(port=port, clock=clock)
    stage.move_to(1.5)
    assert stage.angle_deg in stage.limits
    stage.stop()


def _use_laser_box(port: Port, clock: Clock) -> None:
    laser = LaserBox(port=port, clock=clock)
    assert laser.fire(_permit(clock)) == PULSES
    laser.disarm()


def _use_laser_sweep(port: Port, clock: Clock) -> None:
    laser = LaserBox(port=port, clock=clock)
    permit = SweepPermit(
        token="a",
        angle_deg=0.0,
        pulses=PULSES,
        expires_s=clock.now_s() + 50.0,
        to_deg=1.0,
        slowest_deg_s=1.0,
        fastest_deg_s=2.0,
        period_s=0.05,
    )
    laser.begin_sweep(permit)
    pulses: list[Pulse] = []
    for _ in range(10):
        clock.wait(0.025)
        laser.beat()
        pulses += laser.pulses()
    fired = laser.end_sweep()
    pulses += laser.pulses()
    assert fired == len(pulses) <= PULSES
    assert all(is_finite(pulse.at_s) and 0 <= pulse.sigma_s <= 1e-3 for pulse in pulses)


def _use_picolas(port: Port, clock: Clock) -> None:
    laser = PicolasLaser(port=port, clock=clock)
    assert laser.fire(_permit(clock)) == PULSES
    laser.disarm()


def _whole_of(use: Callable[[Port, Clock], None], device: Callable[[Clock], Port]) -> Callable[[], bytes]:
    def whole() -> bytes:
        clock = VirtualClock()
        port = RecordingPort(device(clock))
        use(port, clock)
        return bytes(port.script)

    return whole


def _scripted(
    use: Callable[[Port, Clock], None],
    require: Callable[[bytes], None],
    *,
    dress: Callable[[bytes], bytes] = bytes,
) -> Callable[[bytes], None]:
    def decode(data: bytes) -> None:
        clock = VirtualClock()
        port = ScriptedPort(data, dress=dress, wait=clock.wait)
        try:
            use(port, clock)
        finally:
            require(port.said)
            assert clock.now_s() <= LONGEST_S, f"it took {clock.now_s()} s"

    return decode


def _require_targets_inside(said: bytes) -> None:
    """Whatever it received, the driver asked only for targets inside the limits that it wrote."""
    limits: tuple[int, int] | None = None
    for message in AptFramer(TO_CONTROLLER, to=CONTROLLER).feed(said):
        assert message.ident not in (0x0443, 0x0448, 0x046A, 0x0457), f"{message.ident:#x} was said"
        if message.ident == 0x0423:
            high, low = np.frombuffer(message.data[6:14], "<i4").tolist()
            limits = low, high
        elif message.ident == 0x0450:
            assert limits is not None
            target = int.from_bytes(message.data[2:6], "little", signed=True)
            assert limits[0] <= target <= limits[1]


def _require_permits_as_permitted(said: bytes) -> None:
    for line in said.split(b"\n"):
        command = laserbox.decode_command(line)
        if isinstance(command, laserbox.PermitPulses | laserbox.PermitSweep):
            assert command.pulses <= PULSES


def _require_off_at_last(said: bytes) -> None:
    assert not said or said.endswith((b"laseroff\r", b"sreprate 100\r"))


def _stage(clock: Clock) -> Port:
    return DirectPort(device=Kdc101Emulator(probe=SimpleNamespace(angle_deg=0.0)), clock=clock)


def _box(clock: Clock) -> Port:
    flash = Flash(at_s=0.0, pulses=1, energy=1.0)
    world: Any = SimpleNamespace(flash=lambda **_: None, flashes=[flash], angle_deg=0.0)
    return DirectPort(device=EmulatedLaserBox(world=world, on_triggers=lambda _: None), clock=clock)


def _signed(text: bytes) -> bytes:
    """A line with the checksum that fits, which chance would not find."""
    return text and text + b"*%04X\n" % laserbox.crc16(text)


def _whole_unsigned() -> bytes:
    """The script of a sound laser box, the last line of each reading without its checksum."""
    script = _whole_of(_use_laser_box, _box)()
    bare = bytearray(b"\0")
    at = 1
    while at < len(script):
        text = script[at + 1 : at + 1 + script[at]].rstrip(b"\n").rpartition(b"\n")[2].rpartition(b"*")[0]
        bare += bytes([len(text)]) + text
        at += 1 + script[at]
    return bytes(bare)


def _read_igtl(data: bytes) -> None:
    """A message, with the checksum that fits, which chance would not find; a command in it is read too."""
    header = igtl.decode_header(data[: igtl.HEADER_BYTES], most_bytes=1 << 16)
    body = data[igtl.HEADER_BYTES :]
    message = igtl.decode(replace(header, body_bytes=len(body), crc=CRC64(body)), body)
    if is_command(message):
        try:
            search_request(read_request(message, client="127.0.0.1:1").values)
        except ConfigError as refusal:
            raise DeviceError(str(refusal)) from refusal
    elif not isinstance(message.content, igtl.Other):
        # What was accepted can be sent on.
        igtl.encode(message)


def _whole_igtl() -> bytes:
    content = igtl.Command(number=1, name="StartSearch", text='<Command Name="StartSearch" Seed="1" />')
    return igtl.encode(igtl.Message(device="CMD_1", content=content, metadata={"sequence": "1"}))


WIRES: dict[str, tuple[Callable[[], bytes], Callable[[bytes], None]]] = {
    "igtl": (_whole_igtl, _read_igtl),
    "kdc101": (_whole_of(_use_stage, _stage), _scripted(_use_stage, _require_targets_inside)),
    "laserbox": (_whole_of(_use_laser_box, _box), _scripted(_use_laser_box, _require_permits_as_permitted)),
    "laserbox-signed": (_whole_unsigned, _scripted(_use_laser_box, _require_permits_as_permitted, dress=_signed)),
    "laserbox-sweep": (
        _whole_of(_use_laser_sweep, _box),
        _scripted(_use_laser_sweep, _require_permits_as_permitted),
    ),
    "picolas": (_whole_of(_use_picolas, lambda _: AllIsWell()), _scripted(_use_picolas, _require_off_at_last)),
}
"""What a sound device would say, and the function that decodes it, by its name; bare codecs: `unit/wire`."""


def wire_outcome(decode: Callable[[bytes], None], data: bytes) -> str:
    """``read`` or ``refused``; any other error comes through."""
    return read_or_refused(lambda: decode(data), DeviceError)
