"""The driver of a live Vantage: which frames of its sender count as an acquisition; the sender's bytes from Octave."""

from __future__ import annotations

import math
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.contract import ReceiverContract
from markerseek.core import (
    AcquisitionError,
    ConfigError,
    DeviceTimeoutError,
    Laser,
    NotConnectedError,
    Permit,
    Receiver,
)
from markerseek.drivers import SystemClock, VantageReceiver, VantageSettings, await_sender
from markerseek.sim import VirtualClock
from markerseek.wire.vantage import VantageFrame, VantageFramer, encode
from tests.emulated_lines import permit
from tests.octave import NO_OCTAVE, has_octave_sockets

SENDER = Path(__file__).parents[3] / "matlab"
SETTINGS = VantageSettings(probe="L11-5v", timeout_s=1.0, quiet_s=0.1)
DARK_TRIGGERS = 3
GREETING = VantageFrame(counter=0, time_s=0.0, probe="L11-5v", samples=np.empty((0, 0), np.int16))


class Sender:
    """The sender on one end of a connection, triggered as by a laser; the receiver on the other."""

    def __init__(self) -> None:
        self.end, connection = socket.socketpair()
        self.clock = VirtualClock()
        self.counter = 0
        self.end.sendall(encode(GREETING))
        self.receiver = VantageReceiver(
            connection=connection,
            clock=self.clock,
            settings=SETTINGS,
            dark_triggers=DARK_TRIGGERS,
            unix_s=lambda: 1.75e9 + self.clock.now_s(),
        )

    def frame(self, **other: object) -> VantageFrame:
        self.counter += 1
        samples = np.full((4, 8), self.counter, np.int16)
        usual = VantageFrame(counter=self.counter, time_s=1.75e9 + self.clock.now_s(), probe="L11-5v", samples=samples)
        return replace(usual, **other)

    def send(self, count: int = 1, **other: object) -> None:
        for _ in range(count):
            self.end.sendall(encode(self.frame(**other)))

    def fire(self, permit: Permit) -> int:
        """As a laser."""
        self.send(permit.pulses or DARK_TRIGGERS)
        return permit.pulses

    def disarm(self) -> None:
        """As a laser."""

    def close(self) -> None:
        self.end.close()
        self.receiver.close()


@pytest.fixture
def sender() -> Iterator[Sender]:
    made = Sender()
    yield made
    made.close()


class TestVantage(ReceiverContract):
    @pytest.fixture(autouse=True)
    def _sender(self, sender: Sender) -> None:
        self.sender = sender

    def make(self) -> tuple[Receiver, Laser]:
        return self.sender.receiver, self.sender


def lost(sender: Sender) -> None:
    sender.send(2)
    sender.counter += 1
    sender.send(2)


def doubled(sender: Sender) -> None:
    sender.send(3)
    sender.counter -= 1
    sender.send()


def wrong_size(sender: Sender) -> None:
    sender.send(3)
    sender.send(samples=np.zeros((4, 9), np.int16))


REFUSED = {
    "lost": (lost, r"1 frames are lost: 4 came after 2"),
    "doubled": (doubled, r"counter 3 came after 3: it is doubled"),
    "too many": (lambda sender: sender.send(5), r"5 frames came for 4 pulses"),
    "of before": (lambda sender: sender.send(4, time_s=1.75e9 - 1), r"sent 1\.\d+ s before the receiver was armed"),
    "of tomorrow": (lambda sender: sender.send(4, time_s=1.76e9), r"s after it came, clock_s allows 0\.05 s"),
    "wrong size": (wrong_size, r"frame 4 has \(4, 9\) channels and samples, those before had \(4, 8\)"),
    "another probe": (
        lambda sender: sender.send(4, probe="C5-2v"),
        r"of the probe 'C5-2v', receiver\.probe is 'L11-5v'",
    ),
    "an emulator": (lambda sender: sender.send(4, emulated=True), "differ in whether an emulator sends"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_frames_that_are_not_of_the_trigger_are_refused_and_the_next_are_taken(sender: Sender, fault: str) -> None:
    act, said = REFUSED[fault]
    sender.receiver.arm(permit())
    act(sender)
    with pytest.raises(AcquisitionError, match=said):
        sender.receiver.acquire(permit())
    with pytest.raises(AcquisitionError, match="was not armed"):
        sender.receiver.acquire(permit())
    sender.receiver.arm(permit())
    sender.fire(permit())
    assert sender.receiver.acquire(permit()).header.pulses == 4


def test_a_receiver_that_nobody_triggers_in_the_dark_names_who_should(sender: Sender) -> None:
    """A laser of one's own whose fire(0) does nothing."""
    dark = permit("d", pulses=0)
    sender.receiver.arm(dark)
    said = r"0 of (\d+) frames came within 1 s in the dark: the laser's fire\(0\) must trigger the receiver \1 times"
    with pytest.raises(DeviceTimeoutError, match=said):
        sender.receiver.acquire(dark)


def test_too_few_frames_are_a_timeout_and_the_next_acquisition_misses_none(sender: Sender) -> None:
    sender.receiver.arm(permit())
    sender.send(3)
    # A sender that hangs in the middle of a frame.
    half = encode(sender.frame())
    sender.end.sendall(half[:60])
    with pytest.raises(DeviceTimeoutError, match="3 of 4 frames came within 1 s; check the trigger"):
        sender.receiver.acquire(permit())
    sender.end.sendall(half[60:])
    sender.receiver.arm(permit())
    sender.fire(permit())
    assert sender.receiver.acquire(permit()).header.pulses == 4


def test_a_sender_that_sends_without_triggers_is_refused_when_armed(sender: Sender) -> None:
    waited = sender.clock.wait

    def wait(seconds: float) -> None:
        waited(seconds)
        sender.send()

    sender.clock.wait = wait
    with pytest.raises(AcquisitionError, match="although nothing is triggered; the sequence must wait"):
        sender.receiver.arm(permit())


def test_frames_that_nobody_asked_for_are_said_when_it_settles(sender: Sender) -> None:
    sender.send(2)
    with pytest.raises(AcquisitionError, match="2 frames came although nothing was triggered; they are not used"):
        sender.receiver.settle()


def header(*numbers: int, mark: bytes = b"MSV1", time_s: float = 0.0, probe: bytes = b"L11-5v") -> bytes:
    return struct.pack("<4sIIIId20s", mark, *numbers, time_s, probe)


LIES = {
    "mark": (header(0, 1, 4, 8, mark=b"HTTP"), "begins with b'HTTP'"),
    "size": (header(0, 1, 0xFFFFFFFF, 0xFFFFFFFF), "4294967295 channels x 4294967295 samples"),
    "none": (header(0, 1, 0, 8), "0 channels x 8 samples"),
    "greeting": (header(0, 0, 4, 8), "a greeting has 4 channels"),
    "flags": (header(6, 1, 4, 8), "flags 0x6"),
    "time": (header(0, 1, 4, 8, time_s=math.nan), "the time nan s"),
    "probe": (header(0, 1, 4, 8, probe=b"\xff"), "it must be 1 to 20 ASCII characters"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_header_that_lies_ends_the_connection(sender: Sender, lie: str) -> None:
    sent, said = LIES[lie]
    sender.receiver.arm(permit())
    sender.end.sendall(sent)
    with pytest.raises(NotConnectedError, match=f"{said}.*the connection is closed"):
        sender.receiver.acquire(permit())
    with pytest.raises(NotConnectedError, match="the connection has ended"):
        sender.receiver.arm(permit())


@pytest.mark.parametrize(
    ("first", "said"),
    [
        (b"", "says nothing for 5 s"),
        (encode(replace(GREETING, probe="C5-2v")), "the sender has the probe 'C5-2v', receiver.probe is 'L11-5v'"),
        (encode(replace(GREETING, counter=7, samples=np.ones((1, 1), np.int16))), "counter 7, no greeting came"),
    ],
)
def test_a_peer_that_does_not_greet_as_the_sender_is_not_connected(first: bytes, said: str) -> None:
    end, connection = socket.socketpair()
    end.sendall(first)
    with end, connection, pytest.raises(NotConnectedError, match=said):
        VantageReceiver(connection=connection, clock=VirtualClock(), settings=SETTINGS, dark_triggers=3)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


def test_no_sender_or_one_from_elsewhere_is_a_sentence() -> None:
    keys = {"probe": "L11-5v", "port": free_port(), "connect_s": 0.2}
    with pytest.raises(NotConnectedError, match=r"no sender came to 127.0.0.1, port .* within 0.2 s; call marker"):
        await_sender(VantageSettings(**keys), VirtualClock())
    clock = VirtualClock()
    waited = clock.wait
    strangers: list[socket.socket] = []

    def wait(seconds: float) -> None:
        if not strangers:
            strangers.append(socket.create_connection(("127.0.0.1", keys["port"]), timeout=1))
        waited(seconds)

    clock.wait = wait
    with pytest.raises(NotConnectedError, match=r"127.0.0.1 was turned away: receiver.peer is 10.0.0.9"):
        await_sender(VantageSettings(**keys, peer="10.0.0.9"), clock)
    with strangers[0] as stranger:
        assert stranger.recv(1) == b""


def test_a_probe_has_a_name() -> None:
    with pytest.raises(ConfigError, match="probe is ''"):
        VantageSettings(probe="")


@pytest.mark.skipif(not has_octave_sockets(), reason=NO_OCTAVE)
def test_the_sender_in_octave_sends_rows_and_columns_of_the_buffer_channel_by_channel() -> None:
    buffer = "int16 (reshape (1:60, 12, 5) * 100 - 3000)"
    port = free_port()
    program = (
        f"addpath ('{SENDER}'); markerseek_send ('open', '127.0.0.1', {port}, 'L11-5v', [3 1 2], 2:9); "
        f"markerseek_send ({buffer}); markerseek_send ({buffer} + int16 (1)); "
        "try; markerseek_send (int16 (ones (5, 5))); catch problem; disp (problem.message); end; "
        "try; markerseek_send (1.5); catch problem; disp (problem.message); end; markerseek_send ('close');"
    )
    ended: list[subprocess.CompletedProcess[str]] = []
    octave = ["octave-cli", "--quiet", "--no-init-file", "--eval", program]
    run = threading.Thread(
        target=lambda: ended.append(subprocess.run(octave, capture_output=True, text=True, check=False, timeout=60))
    )
    came = b""
    # Listening before Octave begins, as a search that waits.
    clock = SystemClock()
    started = clock.wait
    clock.wait = lambda seconds: (run.start() if not run.ident else None, started(seconds))  # type: ignore[method-assign]
    with await_sender(VantageSettings(probe="L11-5v", port=port), clock) as connection:
        connection.settimeout(30)
        while data := connection.recv(4096):
            came += data
    run.join()
    assert ended[0].returncode == 0, ended[0].stderr
    assert "the frame has 5 samples x 5 channels; rows go to 9, columns to 3" in ended[0].stdout
    assert "give 'open' with host, port, probe, columns and rows" in ended[0].stdout
    greeting, first, second = VantageFramer().feed(came)
    expected = (np.arange(1, 61).reshape(5, 12) * 100 - 3000)[[2, 0, 1], 1:9]
    assert [frame.counter for frame in (greeting, first, second)] == [0, 1, 2]
    assert first.samples.tolist() == expected.tolist()
    assert second.samples.tolist() == (expected + 1).tolist()
    assert 1.7e9 < first.time_s <= second.time_s < first.time_s + 10
    assert not first.emulated
