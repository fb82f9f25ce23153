"""Messages and units of the APT protocol: captured frames, frames of another program, and invalid bytes."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import ConfigError, DeviceError
from markerseek.wire import apt
from markerseek.wire.apt import CONTROLLER, TO_CONTROLLER, TO_HOST, AptFramer, AptMessage

# Captured from a TDC001 with a PRM1-Z8.
VELOCITY = bytes.fromhex("13 04 0E 00 D0 01 01 00 00 00 00 00 93 00 00 00 5F 8D 06 00")
BACKLASH = bytes.fromhex("3A 04 06 00 D0 01 01 00 80 07 00 00")
HOME = bytes.fromhex("40 04 0E 00 D0 01 01 00 02 00 01 00 5F 8D 06 00 FF 1D 00 00")
CAPTURED = (VELOCITY, BACKLASH, HOME)


def answer(ident: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", ident, len(data), 0x81, 0x50) + data


def status(position: int, bits: int, *, channel: int = 1) -> bytes:
    return answer(0x0491, struct.pack("<HihHI", channel, position, 0, 0, bits))


def only(data: bytes) -> AptMessage:
    (message,) = AptFramer().feed(data)
    return message


def test_captured_frames_are_what_is_sent() -> None:
    assert apt.set_velocity(apt.Velocity(acceleration=0x93, speed=0x068D5F)) == VELOCITY
    assert apt.set_backlash(apt.counts_of(1.0)) == BACKLASH


# As thorlabs-apt-protocol 29.0.0 packs them, a program that shares nothing with this one.
PACKED = {
    "12 00 00 00 50 01": apt.stop_updates(),
    "05 00 00 00 50 01": apt.ask(apt.INFO),
    "90 04 01 00 50 01": apt.ask(apt.STATUS),
    "10 02 01 01 50 01": apt.enable_channel(),
    "13 04 0e 00 d0 01 01 00 00 00 00 00 93 00 00 00 69 8d 06 00": apt.set_velocity(
        apt.Velocity(acceleration=147, speed=429417)
    ),
    "14 04 01 00 50 01": apt.ask(apt.VELOCITY),
    "3a 04 06 00 d0 01 01 00 00 00 00 00": apt.set_backlash(0),
    "3b 04 01 00 50 01": apt.ask(apt.BACKLASH),
    "23 04 10 00 d0 01 01 00 04 00 04 00 b2 11 01 00 4e ee fe ff 02 00": apt.set_limits(
        apt.SoftLimits(low=-70066, high=70066)
    ),
    "24 04 01 00 50 01": apt.ask(apt.LIMITS),
    "50 04 06 00 d0 01 01 00 8d f9 fe ff": apt.set_target(-67187),
    "51 04 01 00 50 01": apt.ask(apt.TARGET),
    "23 05 0c 00 d0 01 01 00 0d 00 01 00 00 00 01 00 00 00": apt.set_trigger_ports(apt.TriggerPorts(first=0x0D)),
    "24 05 01 00 50 01": apt.ask(apt.TRIGGER_PORTS),
    "53 04 01 00 50 01": apt.move(),
    "65 04 01 01 50 01": apt.stop(),
    "65 04 01 02 50 01": apt.stop(profiled=True),
}


@pytest.mark.parametrize("frame", PACKED)
def test_each_message_has_the_bytes_that_another_program_packs(frame: str) -> None:
    assert PACKED[frame] == bytes.fromhex(frame)


def test_captured_numbers_are_the_units_of_the_stage() -> None:
    assert apt.acceleration_word(10.03) == 0x93
    assert apt.counts_of(1.0) == 1920
    assert abs(0x068D5F / apt.SPEED_WORD - 10.0) < 5e-3
    assert apt.degrees_of(0x1DFF) == pytest.approx(4.0, abs=1 / apt.COUNTS_PER_DEG)
    # Position, speed and acceleration share one clock and one encoder: the words follow from each other.
    tick_s = 2048 / 6e6
    assert apt.COUNTS_PER_DEG * tick_s * 65536 == pytest.approx(apt.SPEED_WORD, rel=1e-6)
    assert apt.COUNTS_PER_DEG * tick_s**2 * 65536 == pytest.approx(apt.ACCELERATION_WORD, rel=1e-5)


@pytest.mark.parametrize("frame", CAPTURED, ids=["velocity", "backlash", "home"])
def test_captured_frames_are_cut_out_of_a_stream(frame: bytes) -> None:
    framer = AptFramer(TO_CONTROLLER, to=CONTROLLER)
    messages = [message.raw for byte in frame + frame for message in framer.feed(bytes([byte]))]
    assert messages == [frame, frame]


def test_units_are_rounded_and_never_cut_off() -> None:
    assert apt.counts_of(0.0013) == 2  # 2.4955
    assert apt.counts_of(-0.0013) == -2
    assert apt.counts_of(0.0014) == 3  # 2.6875
    assert apt.speed_word(10.0) == 429417  # 429416.6
    for angle_deg in (-36.5, -0.1, 0.0, 35.0):
        assert apt.degrees_of(apt.counts_of(angle_deg)) == pytest.approx(angle_deg, abs=0.5 / apt.COUNTS_PER_DEG)


@pytest.mark.parametrize("angle_deg", [math.nan, math.inf, -math.inf, 1.2e6, -1.2e6])
def test_what_has_no_count_is_refused(angle_deg: float) -> None:
    with pytest.raises(ConfigError, match="32 bits"):
        apt.counts_of(angle_deg)


@given(
    position=st.integers(-(2**31), 2**31 - 1),
    bits=st.integers(0, 2**32 - 1),
)
def test_a_status_is_decoded_from_its_bits(position: int, bits: int) -> None:
    said = apt.decode(only(status(position, bits)))
    assert isinstance(said, apt.Status)
    assert said.position == position
    assert said.moving == bool(bits & 0xF0)
    assert (said.homing, said.homed) == (bool(bits & 0x200), bool(bits & 0x400))
    assert bool(said.faults) == bool(bits & 0x4F0EC000)


def test_an_emulator_is_known_by_the_notes_in_its_identity() -> None:
    for notes, emulated in ((b"", False), (b"Thorlabs", False), (b"simulated by markerseek", True)):
        data = struct.pack("<i8sH4B60s3H", 27000001, b"KDC101\0\0", 44, 2, 1, 3, 0, notes, 1, 0, 1)
        info = apt.decode(only(answer(apt.INFO, data)))
        assert isinstance(info, apt.Info)
        assert (info.notes, info.emulated) == (notes.decode(), emulated)


def test_another_channel_is_refused() -> None:
    with pytest.raises(DeviceError, match="channel 2"):
        apt.decode(only(status(0, 0, channel=2)))


def test_a_lost_byte_costs_one_message() -> None:
    framer = AptFramer()
    good = status(123, 0x400)
    stream = good[:9] + good[10:] + good + good
    positions = [apt.decode(message).position for message in framer.feed(stream)]  # type: ignore[union-attr]
    assert positions[-1] == 123
    assert len(positions) == 2 or positions[0] != 123


@given(noise=st.binary(max_size=400), cut=st.integers(1, 7))
def test_any_bytes_are_survived_and_then_a_message_is_received(noise: bytes, cut: int) -> None:
    framer = AptFramer()
    messages = []
    for at in range(0, len(noise), cut):
        messages += framer.feed(noise[at : at + cut])
    # However it begins, no message is longer than this: a row of good ones is received again.
    good = status(-7, 0x400)
    for _ in range(8):
        messages += framer.feed(good)
    assert messages[-1].raw == good
    assert sum(len(message.raw) for message in messages) <= len(noise) + 8 * len(good)
    for message in messages:
        try:
            apt.decode(message)
        except DeviceError:
            continue


@given(ident=st.sampled_from(sorted(TO_HOST)), data=st.data())
def test_whatever_has_the_form_of_an_answer_is_decoded_or_refused(ident: int, data: st.DataObject) -> None:
    size = data.draw(st.sampled_from(sorted(TO_HOST[ident])))
    body = data.draw(st.binary(min_size=size, max_size=size))
    raw = answer(ident, body) if size else struct.pack("<HBBBB", ident, 1, 0, 0x01, 0x50)
    message = only(raw)
    try:
        apt.decode(message)
    except DeviceError:
        return


def test_the_beginning_of_a_message_can_be_forgotten() -> None:
    framer = AptFramer()
    good = status(1, 0)
    assert framer.feed(good[:12]) == []
    framer.forget()
    assert [message.raw for message in framer.feed(good)] == [good]
