"""Emulated receivers: a SonixDAQ, a PLUS server, and a Vantage with `markerseek_send.m`.

Each records the sound of a simulated world, which must simulate frames, for each trigger. A SonixDAQ writes channel
files into a folder, some time after each trigger. They hold each pulse of an acquisition; their average equals the
simulated world's averaged frame, count for count. Like the device it runs independently: when the host dies, triggered
acquisitions are still written, one after the other. The others send a message for each trigger. Each names itself an
emulator to each client and with each message, serves one client at a time, and on this computer only.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import socket
import time
from abc import ABC, abstractmethod
from collections import deque
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, DeviceError, FrameHeader, Int16
from markerseek.emulators.faults import Faults
from markerseek.files import overwrite
from markerseek.sim import Flash, SimulatedWorld
from markerseek.wire import igtl, sonixdaq, vantage

_TAKEN_S = 5.0
"""Longest time in which a client must take a message, in seconds; it is dropped if it does not."""

_PULSE_S = 1e-3
"""Time from one message's stamp to the next, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Train:
    """A train of triggers, which is one acquisition: a copy of the world, and the light that came with the first."""

    world: SimulatedWorld
    flashes: tuple[Flash, ...]
    """One for all pulses, or one for each pulse of a sweep, with its angle."""
    triggers: int
    at_s: float = 0.0
    """Time of day, in seconds since 1970."""

    @property
    def swept(self) -> bool:
        """Whether the triggers are those of a sweep."""
        return bool(self.flashes) and self.flashes[0].angle_deg is not None

    def pulses(self) -> Int16[np.ndarray, "pulses channels samples"]:
        """Return the channel data of each trigger: single pulses of a sweep, else the average each time."""
        return self._singles() if self.swept else np.stack([self._average()] * self.triggers)

    def _singles(self) -> Int16[np.ndarray, "pulses channels samples"]:
        """Return the channel data of each trigger of a sweep, with the probe where it was."""
        dark = Flash(at_s=self.flashes[-1].at_s, pulses=1, energy=0.0, angle_deg=self.world.angle_deg)
        pulses = []
        for flash in self.flashes + (dark,) * (self.triggers - len(self.flashes)):
            self.world.angle_deg = self.world.angle_deg if flash.angle_deg is None else flash.angle_deg
            pulses.append(self._samples(flash, pulses=1))
        return np.stack(pulses)

    def _average(self) -> Int16[np.ndarray, "channels samples"]:
        """Return the average frame; where the train was cut short, the light came with the first triggers."""
        flash = self.flashes[-1] if self.flashes else None
        if flash is not None and flash.pulses < self.triggers:
            flash = replace(flash, energy=flash.energy * flash.pulses / self.triggers)
        return self._samples(flash, pulses=self.triggers)

    def _samples(self, flash: Flash | None, *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
        # Only the samples are used; the driver makes the header that the guard checks.
        header = FrameHeader(sequence=0, token="", pulses=pulses, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
        frame = self.world.frame(flash, header=header)
        if not isinstance(frame, ChannelFrame):
            raise ConfigError("receiver: this world gives intensities only; emulate a world of frames")
        return frame.samples


class EmulatedReceiver(ABC):
    """Records the sound of a simulated world for each trigger; close it at the end.

    ``world``: world whose sound is recorded.
    """

    driver: ClassVar[str]
    """Name of the driver that it is for."""

    _unix_s = staticmethod(time.time)  # noqa: TID251  the time of day is part of the messages

    @classmethod
    def on_bench(cls, *, world: SimulatedWorld, folder: Path, readout_s: float) -> Self:  # noqa: ARG003
        """Return that of an emulated bench; ``folder`` and ``readout_s`` are for one that writes files."""
        return cls(world=world)

    def __init__(self, *, world: SimulatedWorld) -> None:
        self._world = world
        self._flashes = len(world.flashes)
        self._triggered: deque[Train] = deque()

    @property
    @abstractmethod
    def said(self) -> str:
        """Where it is, for people."""

    @property
    @abstractmethod
    def keys(self) -> str:
        """Its driver and where it is, as keys of a rig file."""

    @abstractmethod
    def advance(self, now_s: float) -> None:
        """Deliver what was triggered and is due at that time in seconds; from another thread than `trigger`."""

    def warm_up(self) -> None:
        """Compute one acquisition and discard it: the first real one is not delayed by imports and compilation."""
        light = Flash(at_s=0.0, pulses=1, energy=1.0)
        # In a copy of the world, whose random numbers do not change.
        self._pulses(Train(world=deepcopy(self._world), flashes=(light,), triggers=1))

    def trigger(self, count: int) -> None:
        """Receive a train of triggers at the present angle of the probe, or at those of the flashes of a sweep.

        `advance` does the work.
        """
        new = self._world.flashes[self._flashes :]
        self._flashes = len(self._world.flashes)
        # A shallow copy keeps its angle while the world's probe is turned further.
        self._triggered.append(Train(world=copy(self._world), flashes=tuple(new), triggers=count, at_s=self._unix_s()))

    @abstractmethod
    def close(self) -> None:
        """End its connection, and free its port; allowed twice."""

    def _pulses(self, train: Train) -> Int16[np.ndarray, "pulses channels samples"]:
        return train.pulses()


@dataclass(slots=True, kw_only=True)
class _Writing:
    """Files of an acquisition, the time at which the first is due in seconds, and how many are written."""

    files: list[bytes]
    begins_s: float
    written: int = 0


class EmulatedSonixDaq(EmulatedReceiver):
    """Records into channel files.

    - ``folder``: folder of the channel files; created if missing.
    - ``readout_s``: time from the trigger to the last file: about 10 s (paper, section 4).
    """

    driver = "sonixdaq"

    @classmethod
    def on_bench(cls, *, world: SimulatedWorld, folder: Path, readout_s: float) -> Self:
        """As of `EmulatedReceiver`."""
        return cls(world=world, folder=folder, readout_s=readout_s)

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        folder: Path,
        readout_s: float = 10.0,
    ) -> None:
        if not 0 <= readout_s < math.inf:
            raise ConfigError(f"sonixdaq: readout_s is {readout_s} s, it must be finite and not negative")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"sonixdaq: the folder {folder} cannot be created ({error.strerror})") from error
        super().__init__(world=world)
        self.faults = Faults("receiver")
        self._folder = folder
        self._readout_s = readout_s
        self._now_s = 0.0
        self._queue: deque[_Writing] = deque()
        self._unfilled: deque[tuple[float, Path, bytes]] = deque()

    @property
    def said(self) -> str:
        """As of `EmulatedReceiver`."""
        return f"channel files: {self._folder}"

    @property
    def keys(self) -> str:
        """As of `EmulatedReceiver`."""
        return f'folder = {json.dumps(str(self._folder.resolve()))}\nframes = "triggered"\n'

    def close(self) -> None:
        """Nothing to release."""

    def advance(self, now_s: float) -> None:
        """Write the files that are due at that time in seconds; the next one is written half."""
        # Never backwards: the files run in a thread of their own, at a time that they read themselves.
        self._now_s = max(self._now_s, now_s)
        while self._unfilled and self._unfilled[0][0] <= self._now_s:
            _, place, data = self._unfilled.popleft()
            _fill(place, data)
        while self._triggered:
            files = self._acquisition(self._triggered.popleft())
            if not self.faults("off"):
                self._queue.append(_Writing(files=files, begins_s=self._now_s + self.faults.amount("late files")))
        while self._queue and self._has_written(self._queue[0]):
            ended_s = self._queue.popleft().begins_s + self._readout_s
            if self._queue:
                self._queue[0].begins_s = max(self._queue[0].begins_s, ended_s)

    def _has_written(self, writing: _Writing) -> bool:
        """Write the files of an acquisition that are due; return whether it is complete."""
        gone_s = self._now_s - writing.begins_s
        if gone_s < 0:
            return False
        share = 1.0 if gone_s >= self._readout_s else gone_s / self._readout_s
        most = round(self.faults.amount("part of the files", otherwise=sonixdaq.CHANNEL_COUNT))
        due = min(math.floor(share * sonixdaq.CHANNEL_COUNT), most)
        for number in range(writing.written, due):
            self._write(number, writing.files[number])
        if due > writing.written and due < sonixdaq.CHANNEL_COUNT:
            self._write(due, writing.files[due][: len(writing.files[due]) // 2])
        writing.written = max(due, writing.written)
        return share == 1.0

    def _acquisition(self, train: Train) -> list[bytes]:
        """Return the channel files of the triggers of a train."""
        pulses = self._pulses(train)
        if train.swept:
            lost, doubled = (round(self.faults.amount(f"{each} trigger")) for each in ("lost", "double"))
            pulses = np.delete(pulses, [lost - 1] if lost else [], axis=0)
            pulses = np.repeat(pulses, [1 + (number == doubled) for number in range(1, len(pulses) + 1)], axis=0)
        files = []
        for number in range(sonixdaq.CHANNEL_COUNT):
            other = {5: 6, 6: 5}.get(number, number) if self.faults("swapped channels") else number
            data = sonixdaq.encode_file(pulses[:, sonixdaq.element_of_file(other)], number=other)
            files.append(b"\xff" * 12 + data[12:] if self.faults("garbled headers") else data)
        return files

    def _write(self, number: int, data: bytes) -> None:
        """Replace a file atomically; the driver recognises the new inode."""
        place = self._folder / sonixdaq.file_name(number)
        if late_s := self.faults.amount("size first"):
            self._unfilled.append((self._now_s + late_s, place, data))
            kept = len(data) * 3 // 5
            data = data[:kept] + bytes(len(data) - kept)
        draft = place.with_suffix(".part")
        overwrite(draft, data)
        draft.replace(place)


def _fill(place: Path, data: bytes) -> None:
    """Give a file its contents; neither its size nor its time shows it."""
    status = place.stat()
    place.write_bytes(data)
    os.utime(place, ns=(status.st_atime_ns, status.st_mtime_ns))


class EmulatedSender(EmulatedReceiver):
    """Sends a message for each trigger.

    ``port``: a free port of this computer.
    """

    called: ClassVar[str]

    def __init__(self, *, world: SimulatedWorld) -> None:
        super().__init__(world=world)
        self._client: socket.socket | None = None
        self.port = self._open()

    @abstractmethod
    def _open(self) -> int:
        """Prepare its connection, and return its port."""

    @property
    def said(self) -> str:
        """As of `EmulatedReceiver`."""
        return f"{self.called} 127.0.0.1, port {self.port}"

    @abstractmethod
    def _meet(self) -> None:
        """Greet a client that has come, and note a client that has gone."""

    @abstractmethod
    def _message(self, counts: Int16[np.ndarray, "channels samples"], stamp_s: float) -> bytes:
        """Return the bytes of a message."""

    def advance(self, _now_s: float) -> None:
        """Meet a client, and send what was triggered."""
        self._meet()
        while self._triggered:
            train = self._triggered.popleft()
            for number, counts in enumerate(self._pulses(train)):
                self._send(self._message(counts, train.at_s + _PULSE_S * number))

    def _said(self) -> bytes | None:
        """Return what the client says; empty if it has gone, None if it is silent."""
        if self._client is None or not select.select([self._client], [], [], 0)[0]:
            return None
        try:
            return self._client.recv(1 << 16)
        except OSError:
            return b""

    def _send(self, data: bytes) -> None:
        try:
            if self._client is not None:
                self._client.sendall(data)
        except OSError:
            # It goes on without a client, and waits for the next.
            self._drop()

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None

    def close(self) -> None:
        """As of `EmulatedReceiver`."""
        self._drop()


class EmulatedPlus(EmulatedSender):
    """A PLUS server of int16 images of channels x samples, over OpenIGTLink.

    As a real one it sends header version 1, without metadata, until its client has sent version 2.
    """

    driver = "plus"
    called = "PLUS server:"
    device = "RfVideo_Reference"

    def _open(self) -> int:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._framer = igtl.Framer(most_bytes=1 << 16)
        self._version: Literal[1, 2] = 1
        return int(self._server.getsockname()[1])

    @property
    def keys(self) -> str:
        """As of `EmulatedReceiver`."""
        return f'driver = "plus"\ndevice = "{self.device}"\nport = {self.port}\nquiet_s = 0.5\n'

    def _meet(self) -> None:
        with contextlib.suppress(BlockingIOError):
            newest, _ = self._server.accept()
            self._drop()
            newest.settimeout(_TAKEN_S)
            self._client = newest
            self._version = 1
            self._framer = igtl.Framer(most_bytes=1 << 16)
            status = igtl.Status(code=igtl.OK, name="EMULATOR", message=igtl.EMULATOR)
            self._send(self._encoded(igtl.Message(device="PlusServer", content=status, time_s=self._unix_s())))
        said = self._said()
        try:
            # Which version the client speaks; a client that ends, or sends something else, is dropped.
            if any(header.version == 2 for header, _ in self._framer.feed(said or b"")):
                self._version = 2
        except DeviceError:
            said = b""
        if said == b"":
            self._drop()

    def _message(self, counts: Int16[np.ndarray, "channels samples"], stamp_s: float) -> bytes:
        image = igtl.Image(pixels=counts[np.newaxis], matrix=np.eye(4))
        known = {"emulator": igtl.EMULATOR}
        return self._encoded(igtl.Message(device=self.device, content=image, time_s=stamp_s, metadata=known))

    def _encoded(self, message: igtl.Message) -> bytes:
        return igtl.encode(replace(message, version=self._version))

    def close(self) -> None:
        """As of `EmulatedReceiver`."""
        super().close()
        self._server.close()


class EmulatedVantage(EmulatedSender):
    """A Vantage with `matlab/markerseek_send.m`: it connects when a receiver listens, and again when that has ended."""

    driver = "vantage"
    called = "Vantage: sends to"
    probe = "emulated"

    def _open(self) -> int:
        self._counter = 0
        with socket.create_server(("127.0.0.1", 0)) as taken:
            return int(taken.getsockname()[1])

    @property
    def keys(self) -> str:
        """As of `EmulatedReceiver`."""
        return f'driver = "vantage"\nprobe = "{self.probe}"\nport = {self.port}\nquiet_s = 0.5\n'

    def _meet(self) -> None:
        if self._said() is not None:
            # The receiver never sends anything: it has closed the connection.
            self._drop()
        if self._client is None:
            with contextlib.suppress(OSError):
                self._client = socket.create_connection(("127.0.0.1", self.port), timeout=_TAKEN_S)
            self._counter = -1
            self._send(self._message(np.empty((0, 0), np.int16), self._unix_s()))

    def _message(self, counts: Int16[np.ndarray, "channels samples"], _stamp_s: float) -> bytes:
        self._counter += 1
        return vantage.encode(
            vantage.VantageFrame(
                counter=self._counter, time_s=self._unix_s(), probe=self.probe, samples=counts, emulated=True
            )
        )


RECEIVERS: dict[str, type[EmulatedReceiver]] = {
    each.driver: each for each in (EmulatedSonixDaq, EmulatedPlus, EmulatedVantage)
}
"""Emulated receivers by the names of their drivers."""
