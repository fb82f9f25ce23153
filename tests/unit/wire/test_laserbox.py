"""Lines of the laser box's protocol: round trips, and refusal of everything else."""

from __future__ import annotations

import binascii

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import ConfigError, LaserError
from markerseek.wire import laserbox as box

COUNT = st.integers(0, box.MAX_COUNT)
TRIGGERS = st.integers(1, box.MAX_PULSES)
PERMITS = TRIGGERS.flatmap(
    lambda triggers: st.builds(
        box.PermitPulses,
        token=st.integers(1, box.MAX_COUNT),
        pulses=st.integers(0, triggers),
        rate_hz=st.integers(max(1, -(-1000 * triggers // box.MAX_EXPIRY_MS)), box.MAX_RATE_HZ),
        expiry_ms=st.integers(1, box.MAX_EXPIRY_MS),
        triggers=st.just(triggers),
    )
)
COMMANDS = st.one_of(
    st.just(box.Hello()),
    PERMITS,
    st.builds(box.Beat, step=COUNT),
    st.builds(box.Fire, token=COUNT),
    st.builds(box.AskTime, number=COUNT),
    st.builds(
        box.PermitSweep,
        token=st.integers(1, box.MAX_COUNT),
        pulses=st.integers(1, 6),
        period_us=st.integers(box.MIN_PERIOD_US, box.MAX_PERIOD_US),
        expiry_ms=st.integers(1, box.MAX_EXPIRY_MS),
    ),
    st.just(box.Disarm()),
)
REPLIES = st.one_of(
    st.builds(
        box.Greeting,
        identity=st.text("abcXYZ019", min_size=1, max_size=16),
        version=COUNT,
        lease_ms=COUNT,
        last_token=COUNT,
        seen=COUNT,
        meter=st.integers(0, 1),
    ),
    st.builds(box.Permitted, token=COUNT, seen=COUNT),
    st.builds(box.SweepPermitted, token=COUNT, seen=COUNT),
    st.builds(box.Stamped, token=COUNT, number=COUNT, stamp_us=COUNT, photodiode=COUNT, light=COUNT),
    st.builds(box.Dark, token=COUNT, sent=COUNT, photodiode=COUNT),
    st.builds(box.Time, number=COUNT, clock_us=COUNT),
    st.builds(box.Done, token=COUNT, sent=COUNT, photodiode=COUNT, light=COUNT),
    st.just(box.Disarmed()),
    st.sampled_from(["CRC", "FORM", "TOKEN", "STEP", "INTERLOCK", "BUSY", "BUDGET"]).map(
        lambda reason: box.Refusal(reason=reason)
    ),
)


def bitwise_crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE as its definition reads, one bit at a time."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


@given(st.binary(max_size=100))
def test_the_crc_is_that_of_its_definition_and_of_the_standard_library(data: bytes) -> None:
    assert box.crc16(data) == bitwise_crc(data) == binascii.crc_hqx(data, 0xFFFF)


def test_the_lines_of_the_specification() -> None:
    permit = box.PermitPulses(token=1, pulses=16, rate_hz=100, expiry_ms=2000, triggers=16)
    assert box.encode(permit) == b"PERMIT 1 16 100 2000 16*D0FB\n"
    assert box.encode(box.Beat(step=17)) == b"BEAT 17*97F5\n"


@given(COMMANDS)
def test_commands_survive_the_line(command: box.Command) -> None:
    line = box.encode(command)
    assert len(line) <= box.LINE_BYTES
    assert box.decode_command(line.removesuffix(b"\n")) == command


@given(REPLIES)
def test_replies_survive_the_line(reply: box.Reply) -> None:
    line = box.encode(reply)
    assert len(line) <= box.LINE_BYTES
    assert box.decode_reply(line.removesuffix(b"\n")) == reply


@pytest.mark.parametrize("line", [b"BEAT 17*97F5", b"PERMIT 1 16 100 2000 16*D0FB"])
def test_every_one_or_two_flipped_bits_of_a_line_are_seen(line: bytes) -> None:
    number = int.from_bytes(line)
    flips = [1 << bit for bit in range(8 * len(line))]
    for first in range(len(flips)):
        for second in range(first, len(flips)):
            flipped = number ^ (flips[first] | flips[second])
            assert isinstance(box.decode_command(flipped.to_bytes(len(line))), box.Refusal)


@given(st.one_of(st.binary(max_size=120), st.text("ABDEFHILMOPRSTKN 0123456789*-+._", max_size=60).map(str.encode)))
def test_any_bytes_are_a_message_or_refused(line: bytes) -> None:
    with_crc = line + b"*%04X" % box.crc16(line)
    for given_line in (line, with_crc):
        command = box.decode_command(given_line)
        if not isinstance(command, box.Refusal):
            assert box.encode(command) == given_line + b"\n"
        try:
            reply = box.decode_reply(given_line)
        except LaserError:
            continue
        assert box.encode(reply) == given_line + b"\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "HELLO ",
        " HELLO",
        "hello",
        "HELLO 1",
        "BEAT",
        "BEAT -1",
        "BEAT 01",
        "BEAT 1.0",
        "BEAT 2147483648",
        "BEAT 99999999999999999999",
        "FIRE  1",
        "DISARM now",
        "PERMIT 1 16 100 2000",
        "PERMIT 0 16 100 2000 16",
        "PERMIT 1 17 100 2000 16",
        "PERMIT 1 0 100 2000 0",
        "PERMIT 1 1025 100 2000 1025",
        "PERMIT 1 16 0 2000 16",
        "PERMIT 1 16 1001 2000 16",
        "PERMIT 1 16 100 0 16",
        "PERMIT 1 16 100 60001 16",
        "PERMIT 1 16 1 60000 61",
        "SWEEP 0 16 50000 2000",
        "SWEEP 1 0 50000 2000",
        "SWEEP 1 10001 2000 2000",
        "SWEEP 1 16 1999 2000",
        "SWEEP 1 2 10000001 2000",
        "SWEEP 1 16 50000 0",
        "SWEEP 1 16 50000 60001",
        "SWEEP 1 1201 50000 60000",
        "SWEEP 1 16 50000",
        "TIME",
        "ON",
    ],
)
def test_what_is_no_command_is_refused_by_form(text: str) -> None:
    line = text.encode()
    assert box.decode_command(line + b"*%04X" % box.crc16(line)) == box.Refusal(reason="FORM")


@pytest.mark.parametrize(
    "message",
    [
        box.Beat(step=-1),
        box.Fire(token=box.MAX_COUNT + 1),
        box.PermitPulses(token=1, pulses=2, rate_hz=100, expiry_ms=10, triggers=1),
        box.Greeting(identity="two words", version=1, lease_ms=100, last_token=0, seen=0, meter=0),
        box.Greeting(identity="", version=1, lease_ms=100, last_token=0, seen=0, meter=0),
    ],
)
def test_what_the_other_end_would_refuse_is_not_sent(message: box.Command | box.Reply) -> None:
    with pytest.raises(ConfigError, match="cannot be sent"):
        box.encode(message)


@given(st.lists(COMMANDS, max_size=6), st.data())
def test_lines_come_out_whole_however_the_bytes_are_cut(commands: list[box.Command], data: st.DataObject) -> None:
    stream = b"".join(map(box.encode, commands))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    lines = box.Lines()
    received = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        received += lines.feed(stream[start:end])
    assert [box.decode_command(line) for line in received] == commands


@given(st.integers(1, 200), st.integers(1, 30))
def test_a_line_too_long_comes_out_empty_and_the_next_one_whole(excess: int, step: int) -> None:
    lines = box.Lines()
    stream = b"x" * (box.LINE_BYTES - 1 + excess) + b"\n" + box.encode(box.Hello())
    received = [line for start in range(0, len(stream), step) for line in lines.feed(stream[start : start + step])]
    assert received == [b"", box.encode(box.Hello()).removesuffix(b"\n")]
