"""The driver of a PLUS server against an emulated one: which images count as an acquisition.

What it shares with the Vantage's (`StandardReceiver`) is tested there.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import closing
from types import MappingProxyType

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
from markerseek.drivers import LaserBoxSettings, PlusReceiver, PlusSettings, connect_plus, metered
from markerseek.sim import VirtualClock
from markerseek.wire import igtl
from tests.emulated_lines import permit

DEVICE = "RfVideo_Reference"
SETTINGS = PlusSettings(device=DEVICE, timeout_s=1.0, quiet_s=0.1)
DARK_TRIGGERS = 3
NO_FIELDS: Mapping[str, str] = MappingProxyType({})


class EmulatedPlus:
    """An emulated PLUS server on one end of a connection, triggered as by a laser; its receiver on the other."""

    def __init__(self) -> None:
        self.server, connection = socket.socketpair()
        self.clock = VirtualClock()
        self.settings = SETTINGS
        self.receiver = PlusReceiver(
            connection=connection,
            clock=self.clock,
            settings=SETTINGS,
            dark_triggers=DARK_TRIGGERS,
            unix_s=lambda: 1.75e9 + self.clock.now_s(),
        )
        self.sent = 0

    def send(
        self,
        count: int = 1,
        *,
        age_s: float = 0.0,
        device: str = DEVICE,
        pixels: object = None,
        fields: Mapping[str, str] = NO_FIELDS,
    ) -> None:
        for _ in range(count):
            self.sent += 1
            counts = np.full((1, 4, 8), self.sent, np.int16) if pixels is None else pixels
            # Milliseconds between two pulses.
            stamp_s = 1.75e9 + self.clock.now_s() - age_s + 1e-3 * self.sent
            content = igtl.Image(pixels=counts, matrix=np.eye(4))
            self.server.sendall(
                igtl.encode(igtl.Message(device=device, content=content, time_s=stamp_s, metadata=fields))
            )

    def fire(self, permit: Permit) -> int:
        """As a laser."""
        self.send(permit.pulses or DARK_TRIGGERS)
        return permit.pulses

    def disarm(self) -> None:
        """As a laser."""

    def close(self) -> None:
        self.server.close()
        self.receiver.close()


@pytest.fixture
def plus() -> object:
    emulated = EmulatedPlus()
    yield emulated
    emulated.close()


class TestPlus(ReceiverContract):
    @pytest.fixture(autouse=True)
    def _emulated(self, plus: EmulatedPlus) -> None:
        self.plus = plus

    def make(self) -> tuple[Receiver, Laser]:
        return self.plus.receiver, self.plus


def test_a_frame_is_the_mean_of_as_many_images_as_pulses(plus: EmulatedPlus) -> None:
    plus.receiver.arm(permit())
    plus.send(device="Bmode_Reference")
    plus.fire(permit())
    frame = plus.receiver.acquire(permit())
    # Images 2 to 5: the first was of another device.
    assert frame.samples.tolist() == np.full((4, 8), np.rint(3.5)).tolist()
    assert frame.samples.dtype == np.int16
    assert frame.sampling_hz == SETTINGS.sampling_hz


@pytest.mark.parametrize("said", [["2.0", "3.0"], ["2.0", "much"], ["2.0", None]])
def test_the_energy_is_the_mean_of_the_named_field_of_the_images(plus: EmulatedPlus, said: list[str | None]) -> None:
    keys = LaserBoxSettings(port="", energy_from="metadata", energy_field="PulseEnergy", usual_energy=2.0)
    receiver = metered(keys, plus, plus.receiver, full_scale=2047)
    receiver.arm(permit(pulses=2))
    for value in said:
        plus.send(fields=NO_FIELDS if value is None else {"PulseEnergy": value})
    if said[1] == "3.0":
        assert receiver.acquire(permit(pulses=2)).header.energy == 1.25
        return
    with pytest.raises(AcquisitionError, match=r"no number in its field 'PulseEnergy'.*correct laser\.energy_field"):
        receiver.acquire(permit(pulses=2))


def test_an_image_that_was_sent_before_the_trigger_is_refused(plus: EmulatedPlus) -> None:
    plus.receiver.arm(permit())
    plus.send(4, age_s=1.0)
    with pytest.raises(AcquisitionError, match=r"sent 0\.99\d s before the receiver was armed"):
        plus.receiver.acquire(permit())


def test_a_server_that_repeats_an_image_is_refused(plus: EmulatedPlus) -> None:
    plus.receiver.arm(permit(pulses=2))
    plus.send()
    plus.sent -= 1
    plus.send()
    with pytest.raises(AcquisitionError, match="the server repeats itself"):
        plus.receiver.acquire(permit(pulses=2))


@pytest.mark.parametrize(
    "pixels", [np.zeros((1, 4, 8), np.uint8), np.zeros((2, 4, 8), np.int16), np.zeros((1, 4, 9), np.float32)]
)
def test_images_that_are_no_channel_data_are_refused(plus: EmulatedPlus, pixels: np.ndarray) -> None:
    plus.receiver.arm(permit(pulses=1))
    plus.send(pixels=pixels)
    with pytest.raises(AcquisitionError, match="channel data are int16 of 1 x channels x samples"):
        plus.receiver.acquire(permit(pulses=1))


def test_a_server_that_says_so_is_an_emulator_and_one_that_says_it_too_late_is_refused() -> None:
    """What an emulator gives must not go into a result as a measurement."""
    for greeted in (True, False):
        server, connection = socket.socketpair()
        status = igtl.Status(code=igtl.OK, name="EMULATOR", message=igtl.EMULATOR)
        if greeted:
            server.sendall(igtl.encode(igtl.Message(device="PlusServer", content=status)))
        receiver = PlusReceiver(
            connection=connection, clock=VirtualClock(), settings=SETTINGS, dark_triggers=3, unix_s=lambda: 0.0
        )
        assert receiver.emulated is greeted
        receiver.arm(permit(pulses=1))
        content = igtl.Image(pixels=np.zeros((1, 4, 8), np.int16), matrix=np.eye(4))
        known = {"emulator": igtl.EMULATOR}
        server.sendall(igtl.encode(igtl.Message(device=DEVICE, content=content, metadata=known)))
        if greeted:
            assert receiver.acquire(permit(pulses=1)).header.pulses == 1
        else:
            with pytest.raises(NotConnectedError, match="is an emulator, which it did not say in time"):
                receiver.acquire(permit(pulses=1))
        server.close()
        receiver.close()


def test_no_server_is_a_sentence() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(NotConnectedError, match=f"no server on 127.0.0.1, port {port}: .*; start PlusServer"):
        connect_plus("127.0.0.1", port, within_s=5.0)


def test_a_device_has_a_name() -> None:
    with pytest.raises(ConfigError, match="device is ''"):
        PlusSettings(device="")


def test_images_of_other_devices_are_named(plus: EmulatedPlus) -> None:
    allowed = permit(pulses=2)
    plus.receiver.arm(allowed)
    plus.send(2, device="Video_Tracked")
    with pytest.raises(DeviceTimeoutError, match=f"IMAGE came of 'Video_Tracked', none of '{DEVICE}'"):
        plus.receiver.acquire(allowed)


def test_of_a_long_name_the_part_counts_that_the_protocol_has() -> None:
    server, connection = socket.socketpair()
    clock = VirtualClock()
    settings = PlusSettings(device="RfVideo_ProbeToReferenceTracked", timeout_s=1.0, quiet_s=0.1)
    with closing(server), closing(PlusReceiver(
        connection=connection, clock=clock, settings=settings, dark_triggers=1, unix_s=clock.now_s,
    )) as receiver:  # fmt: skip
        allowed = permit(pulses=1)
        receiver.arm(allowed)
        content = igtl.Image(pixels=np.full((1, 2, 3), 7, np.int16), matrix=np.eye(4))
        cut = igtl.Message(device="RfVideo_ProbeToRefer", content=content, time_s=clock.now_s())
        server.sendall(igtl.encode(cut))
        assert np.array_equal(receiver.acquire(allowed).samples, np.full((2, 3), 7))
