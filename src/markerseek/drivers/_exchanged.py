"""Which of our devices answers at the port of the other one: the two ports of a rig are easily exchanged."""

from __future__ import annotations

from markerseek.core import Clock, DeviceError, LaserError
from markerseek.drivers.clock import polls
from markerseek.wire import Port, apt, laserbox

_ANSWER_S = 0.3
_POLL_S = 0.01

_EXCHANGED = "the ports of stage and laser are exchanged: exchange stage.port and laser.port"


def box_at(port: Port, clock: Clock) -> str:
    """Return the end of an error of a stage that does not answer: that a laser box does; empty if none does."""
    port.write(b"\n" + laserbox.encode(laserbox.Hello()))
    lines = laserbox.Lines()
    for _ in polls(clock, within_s=_ANSWER_S, every_s=_POLL_S):
        for line in lines.feed(port.read(256, timeout_s=0.0)):
            try:
                laserbox.decode_reply(line)
            except LaserError:
                continue
            return f"; a laser box answers there: {_EXCHANGED}"
    return ""


def stage_at(port: Port, clock: Clock) -> str:
    """Return the end of an error of a laser box that does not answer: that a stage's controller does.

    Empty if none does.
    """
    port.write(apt.ask(apt.INFO))
    framer = apt.AptFramer()
    for _ in polls(clock, within_s=_ANSWER_S, every_s=_POLL_S):
        for message in framer.feed(port.read(256, timeout_s=0.0)):
            try:
                info = apt.decode(message)
            except DeviceError:
                continue
            if isinstance(info, apt.Info):
                return f"; the {info.model} of a stage answers there: {_EXCHANGED}"
    return ""
