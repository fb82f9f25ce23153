"""Devices as field reports describe them: impolite servers, held files, floods."""

from __future__ import annotations

import errno
import math
import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import AcquisitionError, Clock, DeviceTimeoutError, NotConnectedError
from markerseek.drivers import (
    LaserBoxSettings,
    PlusReceiver,
    PlusSettings,
    SystemClock,
    VantageReceiver,
    VantageSettings,
    connect_plus,
    metered,
)
from markerseek.drivers.sonixdaq import DaqFolder
from markerseek.emulators import EmulatedBench, EmulatedPlus
from markerseek.rigs import read_rig_file
from markerseek.rigs.bench_rig import bench
from markerseek.sim import SimulatedSettings, VirtualClock
from markerseek.wire import igtl
from markerseek.wire.vantage import VantageFrame, encode
from tests.emulated_lines import permit
from tests.field.openigtlink_server import ImpoliteServer
from tests.unit.drivers.test_sonixdaq import Bench as SonixDaqBench

DEVICE = "RfVideo_Reference"


def hand_rig(folder: Path, port: int, *, more: str = "") -> Path:
    """Rig file of a probe that a person turns, whose angle comes from a server; laser and receiver are simulated."""
    path = folder / "hand.toml"
    path.write_text(
        f'kind = "bench"\n[stage]\ndriver = "guided"\nencoder = "openigtlink"\nport = {port}\nconnect_s = 1.0\n{more}\n'
        '[laser]\ndriver = "simulated"\n[receiver]\ndriver = "simulated"\n'
    )
    return path


@pytest.mark.real_time
def test_b2_a_server_is_asked_for_version_2_and_its_invalid_ends_the_angle(tmp_path: Path) -> None:
    with ImpoliteServer() as server, bench(read_rig_file(hand_rig(tmp_path, server.port))) as rig:
        assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)
        assert server.version == 2
        # The tracker sees nothing any more: the server repeats its last matrix, with times of now.
        server.status = "INVALID"
        server.sent.wait(1.0)
        with pytest.raises(DeviceTimeoutError, match="it says that its transform is 'INVALID'"):
            rig.stage.angle_deg  # noqa: B018  reading it asks the encoder
        server.status = "OK"
        assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("highest", "status", "said"),
    [
        (1, "OK", r"does not state by TransformStatus.*came in header version 1; version 2 was asked for: use a newer"),
        (
            2,
            None,
            r"does not state by TransformStatus in its metadata that it is valid; let the server send it, as PLUS does",
        ),
        (2, "OUT_OF_VIEW", r"it says that its transform is 'OUT_OF_VIEW'"),
    ],
)
def test_b2_a_transform_without_a_status_is_not_believed(
    tmp_path: Path, highest: int, status: str | None, said: str
) -> None:
    with ImpoliteServer(highest=highest, status=status) as server:
        path = hand_rig(tmp_path, server.port)
        with pytest.raises(NotConnectedError, match=said), bench(read_rig_file(path)):
            pass
        if status == "OUT_OF_VIEW":
            return
        # A person may take the word of a server that never states it.
        with bench(read_rig_file(hand_rig(tmp_path, server.port, more="require_status = false"))) as rig:
            assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)


@pytest.mark.real_time
@pytest.mark.parametrize("highest", [2, 1])
def test_b2_the_energy_in_the_fields_of_images_comes_with_version_2(highest: int) -> None:
    keys = LaserBoxSettings(port="", energy_from="metadata", energy_field="PulseEnergy", usual_energy=2.0)
    settings = PlusSettings(device=DEVICE, quiet_s=0.05, timeout_s=2.0)
    with ImpoliteServer(highest=highest, streams=False) as server:
        connection = connect_plus("127.0.0.1", server.port, within_s=5.0)
        plain = PlusReceiver(connection=connection, clock=SystemClock(), settings=settings, dark_triggers=3)
        # Nothing of this laser is used.
        receiver = metered(keys, None, plain, full_scale=2047)  # type: ignore[arg-type]
        receiver.arm(permit(pulses=3))
        for number in range(3):
            server.send_image(DEVICE, 1e-3 * number, PulseEnergy="2.5")
        if highest == 2:
            assert receiver.acquire(permit(pulses=3)).header.energy == 1.25
        else:
            with pytest.raises(AcquisitionError, match=r"header version 1, which has no fields; version 2 was asked"):
                receiver.acquire(permit(pulses=3))
        plain.close()


def test_b2_the_emulated_server_sends_version_1_until_its_client_sends_version_2(tmp_path: Path) -> None:
    emulated = EmulatedBench(
        settings=SimulatedSettings(), rng=np.random.default_rng(1), folder=tmp_path, receiver="plus"
    )
    plus = emulated.daq
    assert isinstance(plus, EmulatedPlus)
    versions: list[int] = []
    with socket.create_connection(("127.0.0.1", plus.port)) as client:
        framer = igtl.Framer(most_bytes=1 << 24)

        def hear() -> None:
            plus.advance(0.0)
            versions.extend(header.version for header, _ in framer.feed(client.recv(1 << 24)))

        hear()
        client.sendall(igtl.encode(igtl.Message(device="x", content=igtl.Status(code=igtl.OK), version=1)))
        plus.trigger(1)
        while len(versions) < 2:
            hear()
        client.sendall(igtl.asks_for_metadata())
        plus.trigger(1)
        while len(versions) < 3:
            hear()
    plus.close()
    assert versions == [1, 1, 2]


GREETING = VantageFrame(counter=0, time_s=0.0, probe="L11-5v", samples=np.empty((0, 0), np.int16))
EMPTY = VantageFrame(counter=1, time_s=0.0, probe="L11-5v", samples=np.zeros((1, 1), np.int16))


class Flood:
    """Sends the same bytes as fast as they are taken, in a thread, until the other end closes."""

    def __init__(self, first: bytes, flood: bytes) -> None:
        self._end, self.connection = socket.socketpair()
        self._end.sendall(first)
        self._flood = flood * (1 + (1 << 18) // len(flood))
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()
        time.sleep(0.05)

    def _run(self) -> None:
        try:
            while True:
                self._end.sendall(self._flood)
        except OSError:
            return

    def close(self) -> None:
        self.connection.close()
        self._end.close()
        if self._thread.ident:
            self._thread.join(5)
            assert not self._thread.is_alive()


def vantage(flood: Flood) -> VantageReceiver:
    settings = VantageSettings(probe="L11-5v", timeout_s=2.0, quiet_s=0.05)
    return VantageReceiver(connection=flood.connection, clock=SystemClock(), settings=settings, dark_triggers=3)


def plus_receiver(flood: Flood) -> PlusReceiver:
    settings = PlusSettings(device=DEVICE, timeout_s=2.0, quiet_s=0.05)
    return PlusReceiver(connection=flood.connection, clock=SystemClock(), settings=settings, dark_triggers=3)


def message(content: igtl.Content, device: str = "other") -> bytes:
    return igtl.encode(igtl.Message(device=device, content=content))


FLOODS: dict[str, tuple[Callable[[Flood], VantageReceiver | PlusReceiver], bytes, bytes]] = {
    "greetings of a Vantage": (vantage, encode(GREETING), encode(GREETING)),
    "frames of a Vantage": (vantage, encode(GREETING), encode(EMPTY)),
    "a frame of a Vantage that never ends": (
        vantage,
        encode(GREETING),
        struct.pack("<4sIIIId20s", b"MSV1", 0, 1, 1024, 1 << 16, 0.0, b"L11-5v") + bytes(1 << 20),
    ),
    "states of a PLUS server": (plus_receiver, b"", message(igtl.Status(code=igtl.OK))),
    "transforms of a PLUS server": (plus_receiver, b"", message(igtl.Transform(matrix=np.eye(4)))),
    "images of a PLUS server": (
        plus_receiver,
        b"",
        message(igtl.Image(pixels=np.zeros((1, 1, 1), np.int16), matrix=np.eye(4)), DEVICE),
    ),
}


@pytest.mark.real_time
@pytest.mark.parametrize("flood", FLOODS)
def test_b9_a_flood_ends_an_acquisition_in_seconds_with_a_sentence(flood: str) -> None:
    make, first, again = FLOODS[flood]
    line = Flood(first, again)
    receiver = make(line)
    receiver.arm(permit(pulses=3))
    line.start()
    began_s, said = time.monotonic(), []
    for act in (receiver.acquire, receiver.arm, receiver.acquire):
        try:
            act(permit(pulses=3))
        except (AcquisitionError, NotConnectedError, DeviceTimeoutError) as problem:
            said.append(str(problem))
    # The time limit of the rig is 2 s.
    assert time.monotonic() - began_s < 5
    line.close()
    assert said
    told = " ".join(said)
    if "never ends" in flood:
        assert "a frame begins with" in told or "0 of 3 frames came within 2 s" in told
    else:
        assert "floods" in told or "came for 3 pulses" in told, told


def test_b9_what_a_server_streams_during_a_long_pause_is_no_flood() -> None:
    """A tracker of 1 kHz during a move of 20 s: 20,000 messages wait, and none is an image."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        end = socket.create_connection(listening.getsockname(), timeout=5)
        connection, _ = listening.accept()
    clock = VirtualClock()
    receiver = PlusReceiver(
        connection=connection,
        clock=clock,
        settings=PlusSettings(device=DEVICE, timeout_s=1.0, quiet_s=0.1),
        dark_triggers=3,
        unix_s=lambda: 0.0,
    )
    clock.wait(20.0)
    # The buffers of the system hold them.
    end.sendall(20_000 * message(igtl.Transform(matrix=np.eye(4))))
    receiver.arm(permit(pulses=3))
    for number in range(3):
        image = igtl.Image(pixels=np.ones((1, 2, 2), np.int16), matrix=np.eye(4))
        end.sendall(igtl.encode(igtl.Message(device=DEVICE, content=image, time_s=1.0 + number)))
    assert receiver.acquire(permit(pulses=3)).samples.tolist() == [[1, 1], [1, 1]]
    receiver.close()
    end.close()


class Held:
    """Files of a folder that cannot be opened, and a folder that cannot be listed, for a while of virtual time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, clock: Clock, folder: Path) -> None:
        self._clock, self._folder = clock, str(folder)
        self.number, self.until_s, self.files, self.times = errno.EACCES, -1.0, "CH", 0
        self._opened, self._listed = os.open, os.scandir
        monkeypatch.setattr(os, "open", self._open)
        monkeypatch.setattr(os, "scandir", self._scandir)

    def _refuse(self, path: object) -> None:
        if self._clock.now_s() < self.until_s:
            self.times += 1
            raise OSError(self.number, os.strerror(self.number), path)

    def _open(self, path: object, *arguments: object, **named: object) -> int:
        # What writes the files is another computer.
        reads = int(str(arguments[0])) & os.O_ACCMODE == os.O_RDONLY if arguments else True
        if reads and str(path).startswith(self._folder) and Path(str(path)).name.startswith(self.files):
            self._refuse(path)
        return self._opened(path, *arguments, **named)  # type: ignore[arg-type]

    def _scandir(self, path: object) -> object:
        if self.files == "." and str(path) == self._folder:
            self._refuse(path)
        return self._listed(path)  # type: ignore[call-overload]


HOLDS = [
    (errno.EACCES, "CH", 0.15),
    (errno.EBUSY, "CH12", 0.15),
    (errno.ESTALE, "CH127", 0.15),
    (errno.EPERM, "CH000", 1.0),
    (errno.ENOENT, "CH05", 0.3),
    (errno.ESTALE, ".", 0.15),
    (errno.ENOENT, ".", 0.5),
    (errno.EIO, ".", 0.3),
    (errno.ENOTCONN, ".", 3.5),
    (errno.EIO, "CH0", 3.5),
]


@pytest.mark.parametrize(("number", "files", "for_s"), HOLDS)
def test_b3_files_that_are_held_for_a_moment_are_not_complete_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, files: str, for_s: float
) -> None:
    daq = SonixDaqBench(tmp_path / "daq")
    held = Held(monkeypatch, daq.clock, tmp_path / "daq")
    held.number, held.files = number, files
    # Also where the folder is looked at before the trigger.
    for token, begins_s in (("a", 1.0), ("b", 0.0)):
        held.until_s = daq.clock.now_s() + 0.2 + begins_s + for_s
        frame = daq.take(token)
        assert held.times
        np.testing.assert_array_equal(frame.samples, daq.received[-1])


@pytest.mark.parametrize(("number", "files", "said"), [(errno.EBUSY, "CH017", "CH017.daq"), (errno.ESTALE, ".", "daq")])
def test_b3_files_that_stay_held_are_named_at_the_time_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, files: str, said: str
) -> None:
    daq = SonixDaqBench(tmp_path / "daq")
    held = Held(monkeypatch, daq.clock, tmp_path / "daq")
    daq.receiver.arm(permit(pulses=4))
    held.number, held.files, held.until_s = number, files, math.inf
    daq.daq.trigger(4)
    name = errno.errorcode[number]
    with pytest.raises(DeviceTimeoutError, match=rf"after 5 s .*{said} cannot be read \({name}: .*; check trigger"):
        daq.receiver.acquire(permit(pulses=4))


def test_b3_files_that_are_held_again_while_they_are_read_are_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scanner for viruses opens each file once its writer has closed it."""
    daq = SonixDaqBench(tmp_path / "daq")
    read = DaqFolder.read
    failures = iter([errno.EACCES, errno.EBUSY])

    def held_at_first(folder: DaqFolder, names: list[str], *, pulses: int) -> np.ndarray:
        with folder._refused():
            if (number := next(failures, None)) is not None:
                raise OSError(number, os.strerror(number), str(tmp_path / "daq" / "CH003.daq"))
        return read(folder, names, pulses=pulses)

    monkeypatch.setattr(DaqFolder, "read", held_at_first)
    np.testing.assert_array_equal(daq.take("a").samples, daq.received[-1])
