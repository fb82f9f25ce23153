"""Driver of a PicoLAS laser diode driver. NEVER TESTED ON HARDWARE, and written without a data sheet.

It speaks ASCII, 115200 baud, 8E1: a command ends with CR; an answer ends with LF LF, and its last line is ``0`` if
the command succeeded. It has no lease and no counter: the pulses reported are those commanded, and only the supervisor
switches it off when the search dies. Prefer the laser box.
"""

from __future__ import annotations

from markerseek.core import Clock, ConfigError, DeviceTimeoutError, LaserError, NotConnectedError
from markerseek.drivers.clock import polls
from markerseek.drivers.entry import Entry, LaserKeys, Opening
from markerseek.drivers.serial_port import Unread
from markerseek.drivers.standard_laser import StandardLaser
from markerseek.files import Line
from markerseek.wire import Port

SAFE_COMMAND = b"laseroff\r"
"""Command that switches it off; the supervisor sends it."""

_ANSWER_S = 1.0
_POLL_S = 0.005
_SPARE_S = 0.1
_LONGEST = 256


class PicolasSettings(LaserKeys, frozen=True, kw_only=True, tag="picolas"):
    """Keys of a PicoLAS driver in a rig file."""

    port: str
    """Serial port of the driver."""


class PicolasLogic:
    """The verbs of the driver. The pulses that it reports are those commanded.

    A permit of 0 pulses does nothing: it cannot trigger the acquisition alone, which must then run freely.
    """

    def __init__(self, *, port: Port, clock: Clock, rate_hz: float) -> None:
        if not 1 <= rate_hz <= 1000 or rate_hz != round(rate_hz):
            raise ConfigError(f"picolas: rate_hz is {rate_hz} Hz, it must be a whole number from 1 to 1000")
        self._port = port
        self._clock = clock
        self._rate_hz = round(rate_hz)
        self._pulses = 0
        self._ends_s = 0.0
        try:
            self.off()
            self._send(f"sreprate {self._rate_hz}")
        except DeviceTimeoutError as error:
            raise NotConnectedError(str(error)) from error

    def fire(self, pulses: int) -> None:
        """Switch on for this number of shots."""
        self._pulses = pulses
        self._ends_s = self._clock.now_s()
        # Not sent: whether this device takes 0 shots as none or as without end is not known.
        if pulses:
            self._send(f"sshots {pulses}")
            self._send("laseron")
            self._ends_s = self._clock.now_s() + pulses / self._rate_hz + _SPARE_S

    def fired(self) -> int | None:
        """As many as were commanded, once their time is over."""
        return self._pulses if self._clock.now_s() >= self._ends_s else None

    def off(self) -> None:
        """Switch off; `DeviceTimeoutError` if the driver does not confirm it, `LaserError` if it refuses."""
        self._send("laseroff")

    def _send(self, command: str) -> None:
        """Send a command and check that the last line of its answer is 0."""
        self._port.read(_LONGEST, timeout_s=0.0)  # drop an answer to an earlier command
        self._port.write(command.encode("ascii") + b"\r")
        answer = b""
        for _ in polls(self._clock, within_s=_ANSWER_S, every_s=_POLL_S):
            answer += self._port.read(_LONGEST, timeout_s=0.0)
            if len(answer) > _LONGEST:
                raise LaserError(f"picolas: {answer[:40]!r}... is no answer; check the port")
            if answer.endswith(b"\n\n"):
                break
        else:
            unread = Unread()
            unread.add(answer)
            raise DeviceTimeoutError(
                f"picolas: no answer to {command!r} in time: "
                + unread.said(cure="check its cable and power, and that laser.port is its port")
            )
        if answer.split()[-1:] != [b"0"]:
            raise LaserError(f"picolas: {command!r} was answered by {answer!r}, expected a last line 0; see its manual")


class PicolasLaser(StandardLaser[PicolasLogic]):
    """A laser on a PicoLAS driver.

    ``rate_hz``: pulses per second, a whole number. Raises `NotConnectedError` if nothing answers.
    """

    def __init__(self, *, port: Port, clock: Clock, rate_hz: float = 100.0) -> None:
        logic = PicolasLogic(port=port, clock=clock, rate_hz=rate_hz)
        super().__init__(logic, clock=clock, rate_hz=rate_hz, name="picolas")


def _open(settings: PicolasSettings, opening: Opening) -> PicolasLaser:
    return PicolasLaser(port=opening.line, clock=opening.clock, rate_hz=settings.rate_hz)


ENTRY: Entry[PicolasSettings, PicolasLaser] = Entry(
    settings=PicolasSettings,
    open=_open,
    describe=lambda settings, _laser: f"picolas at {settings.port}",
    line=lambda settings: Line(name="laser", path=settings.port, safe_command=SAFE_COMMAND, parity="E"),
    # Nothing else would switch that laser off when the search is killed.
    without_supervisor="a PicoLAS driver has no lease of its own",
)
