"""An emulated rig at the level of bytes: stage, laser box and SonixDAQ folder in one simulated world.

Behind pseudo-terminals, `serve_bench` runs them in real time; only the writing of files can be paced, because leases
and the check of a stage's speed need real time.

The pseudo-terminals stand here too (`PtyLine`), for any emulated device.
"""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from markerseek._closing import Closing
from markerseek.core import Clock, ConfigError, Float64
from markerseek.emulators.endoscope import EmulatedEndoscope
from markerseek.emulators.kdc101 import EmulatedKdc101, Kdc101Emulator
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.emulators.receivers import RECEIVERS, EmulatedReceiver
from markerseek.rigs import draw_scene
from markerseek.sim import CLOCK_DRIFT, SimulatedSettings

_UNREAD_LIMIT = 65536
"""Most bytes kept for a driver that does not read; later ones are lost, as on a wire."""


class ByteDevice(Protocol):
    """An emulated device, without a line or a clock of its own."""

    def advance(self, now_s: float) -> bytes:
        """Advance the device to that time of the clock, and return the bytes that it sends by itself until then."""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes now, and return the immediate answer."""


class PtyLine(Closing):
    """A pseudo-terminal pair: drivers open `path`, the emulator answers at the other end.

    Use it as a context manager, and call `serve_once` again and again, in a thread or a process of its own.

    ``clock``: its clock: real time, where another program is at the other end. ``link``: path of a link to the
    pseudo-terminal, whose own name changes from start to start; None: no link.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock, link: Path | None = None) -> None:
        self._device = device
        self._clock = clock
        self._outbox = bytearray()
        self._link: Path | None = None
        self._ours, self._theirs = os.openpty()
        # Our copy of the driver's end stays open: without it, reading fails whenever no driver has the port open.
        # Raw: a terminal would echo the driver's bytes and change line ends.
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self._open = True
        self._name = os.ttyname(self._theirs)
        if link is not None:
            self._put_link(link)

    @property
    def path(self) -> str:
        """Name of the serial port for a driver."""
        return str(self._link or self._name)

    def serve_once(self, *, wait_s: float) -> None:
        """Wait for bytes at most that many seconds, then advance the device once."""
        arrived, _, _ = select.select([self._ours], [], [], wait_s)
        # Read first: bytes that arrive after the time is taken would be answered as of a time before they were sent.
        data = os.read(self._ours, 4096) if arrived else b""
        self._outbox += self._device.advance(self._clock.now_s())
        if data:
            self._outbox += self._device.feed(data)
        # A full pty would block the loop that serves the other devices too.
        del self._outbox[_UNREAD_LIMIT:]
        if self._outbox:
            try:
                del self._outbox[: os.write(self._ours, self._outbox)]
            except BlockingIOError:
                return

    def close(self) -> None:
        """Close the line; a driver that has it open is disconnected. Allowed twice."""
        if not self._open:
            return
        self._open = False
        os.close(self._ours)
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _put_link(self, link: Path) -> None:
        try:
            link.symlink_to(self._name)
        except OSError as error:
            self.close()
            raise ConfigError(
                f"link: {link} cannot be made a link to {self._name} ({error.strerror}); "
                "name another path, or delete what a killed emulator left there"
            ) from error
        self._link = link


_TICK_S = 2e-3

_HELD_UP_S = 0.02
"""Longest time between two ticks that counts, in seconds: the rest is a pause of the computer, not of the devices."""


class EmulatedBench:
    """Devices that act on one world, drawn from settings as `markerseek.rigs.simulated` draws it from the same seed.

    ``settings``: settings of the world and of its data acquisition. ``stage``: None: a stage with the backlash of the
    settings. ``receiver``: name of the driver whose receiver is emulated (`RECEIVERS`).
    """

    def __init__(
        self,
        *,
        settings: SimulatedSettings,
        rng: np.random.Generator,
        folder: Path,
        stage: EmulatedKdc101 | None = None,
        receiver: str = "sonixdaq",
    ) -> None:
        if receiver not in RECEIVERS:
            raise ConfigError(f"receiver is {receiver!r}, it must be one of: {', '.join(RECEIVERS)}")
        scene = draw_scene(settings, rng)
        self.truth_deg = scene.marker.angle_deg if settings.marker.present else None
        self.world = scene.world(settings, rng)
        # Child generators: draws per pulse must not shift the random numbers of the world, or seeds would not compare.
        _, noise, light = rng.spawn(3)
        self.stage = Kdc101Emulator(
            probe=self.world, settings=stage or EmulatedKdc101(play_deg=settings.stage.backlash_deg), rng=noise
        )
        self.daq = RECEIVERS[receiver].on_bench(world=self.world, folder=folder, readout_s=settings.receiver.readout_s)
        self.laser_box = EmulatedLaserBox(
            world=self.world,
            on_triggers=self.daq.trigger,
            laser=settings.laser,
            rng=light,
            moment=self._turned,
        )
        self.laser_box.faults.inject("clock drift", CLOCK_DRIFT)
        self._box_time: ServingClock | None = None

    def displacement_m(self, at_s: float) -> Float64[np.ndarray, " 3"]:
        """Return how far the tissue has moved in the TRUS frame, at a time of the clock that serves the lines.

        The world lives in the time of the laser box, in which its light comes.
        """
        box_s = at_s if self._box_time is None else self._box_time.at(at_s)
        return np.asarray(self.world.motion.displacement_m(np.array([box_s]))[0])

    def _turned(self, now_s: float) -> float:
        """Turn the probe to where it is at a time of the devices, and return that time."""
        self.stage.turn(now_s)
        return now_s

    def line(self, name: Literal["stage", "laser"], *, clock: Clock, link: Path) -> PtyLine:
        """Return a pseudo-terminal for one of the devices.

        The laser box lives in the time of the process that serves it: a delay of that process does not end a lease.
        The stage lives in real time: a motor turns on, whatever a computer does, and its driver checks that it does.

        ``link``: where to put a link to the pseudo-terminal.
        """
        if name == "stage":
            return PtyLine(device=self.stage, clock=clock, link=link)
        serving = ServingClock(clock)
        self._box_time = serving
        # The time of a pulse is the stage's: a box that was delayed fires the pulse later, where the probe is then.
        self.laser_box.moment = lambda _: self._turned(serving.real_s)
        return PtyLine(device=self.laser_box, clock=serving, link=link)


class ServingClock:
    """Real time without the pauses of the serving process, for leases only."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.real_s = clock.now_s()
        """Time of the clock at the last call of `now_s`."""
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return the seconds since the clock was made, pauses left out."""
        now_s = self._clock.now_s()
        # A pause of this process would look like a stage that jumps and a lease that lapses.
        self._now_s += min(now_s - self.real_s, _HELD_UP_S)
        self.real_s = now_s
        return self._now_s

    def at(self, real_s: float) -> float:
        """Return what this clock shows at a time of the real one, if it does not pause in between."""
        return self._now_s + (real_s - self.real_s)

    def wait(self, duration_s: float) -> None:
        """Wait on the real clock."""
        self._clock.wait(duration_s)


def serve_bench(
    *,
    lines: Sequence[PtyLine],
    clock: Clock,
    pace: float,
    daq: EmulatedReceiver,
    until: Callable[[], bool],
    images: EmulatedEndoscope | None = None,
) -> None:
    """Serve emulated devices until ``until`` is true.

    ``pace``: seconds of real time for one second of the acquisition. ``daq``: acquisition that writes files or sends
    images, in a thread of its own: neither a slow disk or client nor the forward model may delay the lines. ``until``:
    called at every tick. ``images``: endoscope that writes images, in another thread.
    """
    ended = threading.Event()

    def repeat(advance: Callable[[], object]) -> None:
        while not ended.is_set():
            advance()
            clock.wait(_TICK_S)

    works = [lambda: daq.advance(clock.now_s() / pace), *([] if images is None else [images.advance])]
    with ThreadPoolExecutor(max_workers=len(works)) as workers:
        writing = [workers.submit(repeat, work) for work in works]
        try:
            while not until() and not any(each.done() for each in writing):
                for line in lines:
                    line.serve_once(wait_s=_TICK_S / len(lines))
        finally:
            ended.set()
        for each in writing:
            each.result()
