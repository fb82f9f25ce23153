"""The laser box's driver against its emulator in virtual time: what is permitted is fired, and nothing else ever is."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import (
    ConfigError,
    DeviceTimeoutError,
    FrameHeader,
    LaserError,
    NotConnectedError,
    Permit,
    ReadingFrame,
)
from markerseek.drivers.laserbox import LaserBox
from markerseek.emulators import DirectPort
from markerseek.emulators.laserbox import EmulatedLaserBox, LaserBoxFaults
from markerseek.sim import Flash, VirtualClock
from markerseek.wire import laserbox as wire


@dataclass
class Lit:
    """A world that remembers what light fell on it."""

    angle_deg: float = 3.0
    flashes: list[Flash] = field(default_factory=list)

    def flash(self, *, pulses: int, at_s: float) -> None:
        self.flashes.append(Flash(at_s=at_s, pulses=pulses, energy=1.0))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ReadingFrame:
        return ReadingFrame(header=header, intensity=0.0)


class Bench:
    """A box, its world, and a driver on it."""

    def __init__(self, *, lease_ms: int = 100) -> None:
        self.world = Lit()
        self.triggers: list[int] = []
        self.faults = LaserBoxFaults()
        self.box = EmulatedLaserBox(
            world=self.world, on_triggers=self.triggers.append, lease_ms=lease_ms, faults=self.faults
        )
        self.clock = VirtualClock()
        self.port = DirectPort(device=self.box, clock=self.clock)

    def driver(self, *, rate_hz: float = 100.0) -> LaserBox:
        return LaserBox(port=self.port, clock=self.clock, rate_hz=rate_hz, dark_triggers=16)

    def say(self, *messages: wire.Command, at_s: float | None = None) -> list[wire.Reply]:
        """Talk to the box without a driver."""
        told = self.box.advance(self.clock.now_s() if at_s is None else at_s)
        for message in messages:
            told += self.box.feed(wire.encode(message))
        return [wire.decode_reply(line) for line in told.split(b"\n")[:-1]]


def permit(token: str = "a", *, pulses: int = 16, expires_s: float = math.inf) -> Permit:
    return Permit(token=token, angle_deg=3.0, pulses=pulses, expires_s=expires_s)


def pulses_of(token: int, *, pulses: int = 50, rate_hz: int = 100, expiry_ms: int = 2000) -> wire.PermitPulses:
    return wire.PermitPulses(token=token, pulses=pulses, rate_hz=rate_hz, expiry_ms=expiry_ms, triggers=max(pulses, 1))


def test_the_pulses_come_at_their_rate_and_are_counted() -> None:
    bench = Bench()
    assert bench.driver(rate_hz=50).fire(permit(pulses=16)) == 16
    times = [pulse.at_s for pulse in bench.box.pulses]
    assert [later - sooner for sooner, later in itertools.pairwise(times)] == pytest.approx([0.02] * 15)
    assert {pulse.angle_deg for pulse in bench.box.pulses} == {3.0}
    assert [flash.pulses for flash in bench.world.flashes] == [16]
    assert bench.triggers == [16]


def test_a_train_longer_than_many_leases_is_kept_alive_by_beats() -> None:
    bench = Bench(lease_ms=50)
    assert bench.driver(rate_hz=20).fire(permit(pulses=128)) == 128


def test_a_dark_frame_triggers_the_acquisition_as_often_as_a_lit_one_and_no_light_falls() -> None:
    bench = Bench()
    assert bench.driver().fire(permit(pulses=0)) == 0
    assert (bench.triggers, bench.box.pulses, bench.world.flashes) == ([16], [], [])


def test_permits_are_used_once_also_by_a_second_program() -> None:
    bench = Bench()
    driver = bench.driver()
    driver.fire(permit("a"))
    with pytest.raises(LaserError, match="used before"):
        driver.fire(permit("a"))
    assert bench.driver().fire(permit("a")) == 16  # a later program goes on with the box's own counter
    assert len(bench.box.pulses) == 32


@pytest.mark.parametrize("expires_s", [-math.inf, 0.0, 0.1, math.nan])
def test_a_permit_that_ends_before_its_pulses_fires_none(expires_s: float) -> None:
    bench = Bench()
    with pytest.raises(LaserError, match="nothing was fired"):
        bench.driver().fire(permit(expires_s=expires_s))
    assert bench.box.pulses == []


@pytest.mark.parametrize("change", [{"laser_dead": True}, {"photodiode_dead": True}, {"extra_pulses": 1}])
def test_pulses_that_do_not_agree_end_in_an_error_with_the_three_numbers(change: dict[str, bool | int]) -> None:
    bench = Bench()
    driver = bench.driver()
    for name, value in change.items():
        setattr(bench.faults, name, value)
    with pytest.raises(LaserError, match=r"16 pulses were permitted, 1[67] sent and (0|17) seen"):
        driver.fire(permit())
    assert not bench.box.permitted


def test_a_silent_box_is_told_to_disarm_and_given_up_in_time() -> None:
    bench = Bench()
    driver = bench.driver()
    bench.faults.silent = True
    began_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="no answer to PERMIT in time"):
        driver.fire(permit())
    with pytest.raises(DeviceTimeoutError, match="no answer to DISARM"):
        driver.disarm()
    assert bench.clock.now_s() - began_s < 2
    assert not bench.box.permitted
    assert bench.box.pulses == []


def test_no_box_at_all_is_not_connected() -> None:
    bench = Bench()
    bench.faults.silent = True
    with pytest.raises(NotConnectedError, match="nothing answers HELLO"):
        bench.driver()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "speaks version 2 of its protocol, 1 is needed"),
        ({"lease_ms": 40}, "its lease is 40 ms, it must lie between 50 and 100 ms"),
        ({"lease_ms": 5000}, "its lease is 5000 ms"),
    ],
)
def test_a_box_of_another_kind_is_not_connected(change: dict[str, int], message: str) -> None:
    greeting = wire.Greeting(identity="other", version=1, lease_ms=100, last_token=0)
    told = wire.encode(replace(greeting, **change))

    class Other:
        def advance(self, now_s: float) -> bytes:
            return b""

        def feed(self, data: bytes) -> bytes:
            return b"half a line\n" + told if b"HELLO" in data else b""

    clock = VirtualClock()
    with pytest.raises(NotConnectedError, match=message):
        LaserBox(port=DirectPort(device=Other(), clock=clock), clock=clock)


@pytest.mark.parametrize("answer", [wire.Permitted(token=2), wire.Done(token=9, sent=16, photodiode=16)])
def test_an_answer_to_something_else_is_no_answer(answer: wire.Reply) -> None:
    bench = Bench()
    driver = bench.driver()
    feed = bench.box.feed

    def confused(data: bytes) -> bytes:
        wanted = b"PERMIT" if isinstance(answer, wire.Permitted) else b"FIRE"
        return wire.encode(answer) if data.startswith(wanted) else feed(data)

    bench.box.feed = confused  # type: ignore[method-assign]
    with pytest.raises(LaserError, match=r"answers the (permit|firing of) 1"):
        driver.fire(permit())
    assert bench.box.pulses == []


def test_a_second_program_that_asks_for_a_permit_while_it_fires_stops_it() -> None:
    bench = Bench()
    bench.say(pulses_of(1), wire.Fire(token=1), at_s=0.0)
    assert bench.say(pulses_of(2), at_s=0.025) == [
        wire.Done(token=1, sent=3, photodiode=3),
        wire.Refusal(reason="BUSY"),
    ]


def test_a_lease_longer_than_the_protocol_s_and_a_dark_frame_without_triggers_are_refused() -> None:
    with pytest.raises(ConfigError, match="lease_ms is 101 ms"):
        Bench(lease_ms=101)
    bench = Bench()
    with pytest.raises(ConfigError, match="dark_triggers is 0"):
        LaserBox(port=bench.port, clock=bench.clock, dark_triggers=0)
    for answer_s in (0.09, 5.1, math.nan):
        with pytest.raises(ConfigError, match=f"answer_s is {answer_s} s"):
            LaserBox(port=bench.port, clock=bench.clock, answer_s=answer_s)


def test_an_open_interlock_fires_nothing_and_closing_it_gives_no_permit_back() -> None:
    bench = Bench()
    driver = bench.driver()
    bench.box.open_interlock()
    with pytest.raises(LaserError, match="the interlock is open: close it"):
        driver.fire(permit())
    bench.box.close_interlock()
    assert not bench.box.permitted
    assert bench.box.pulses == []


def test_the_interlock_ends_a_train_at_once() -> None:
    bench = Bench()
    bench.say(pulses_of(1), wire.Fire(token=1), at_s=0.0)
    bench.say(wire.Beat(step=1), at_s=0.055)
    bench.box.open_interlock()
    bench.box.close_interlock()
    assert bench.say(at_s=1.0) == [wire.Done(token=1, sent=6, photodiode=6)]
    assert bench.triggers == [6]


def test_the_output_is_low_at_the_lease_s_end_and_no_beat_brings_it_back() -> None:
    bench = Bench()
    assert bench.say(pulses_of(1), wire.Fire(token=1), at_s=0.0) == [wire.Permitted(token=1)]
    assert bench.say(wire.Beat(step=1), at_s=0.05) == []
    assert bench.say(at_s=0.151) == [wire.Done(token=1, sent=15, photodiode=15)]  # 0, 10, ... 140 ms: none at 150 ms
    assert bench.say(wire.Beat(step=2), wire.Fire(token=1), at_s=0.2) == [wire.Refusal(reason="TOKEN")]
    assert max(pulse.at_s for pulse in bench.box.pulses) < 0.15


def test_a_beat_that_does_not_count_up_takes_the_permit_away() -> None:
    for step in (4, 5):
        bench = Bench()
        bench.say(wire.Beat(step=5), pulses_of(1), wire.Fire(token=1), at_s=0.0)
        assert bench.say(wire.Beat(step=step), at_s=0.035) == [
            wire.Done(token=1, sent=4, photodiode=4),
            wire.Refusal(reason="STEP"),
        ]


def test_a_permit_is_void_after_its_expiry_however_long_the_lease_lasts() -> None:
    bench = Bench()
    bench.say(pulses_of(1, expiry_ms=55), wire.Fire(token=1), at_s=0.0)
    bench.say(wire.Beat(step=1), at_s=0.04)
    assert bench.say(at_s=0.3) == [wire.Done(token=1, sent=6, photodiode=6)]


def test_power_up_forgets_the_permit_and_a_damaged_line_takes_it_away() -> None:
    bench = Bench()
    bench.say(pulses_of(1), at_s=0.0)
    bench.box.power_up()
    assert bench.say(wire.Fire(token=1)) == [wire.Refusal(reason="TOKEN")]
    bench.say(pulses_of(2), wire.Fire(token=2), at_s=0.05)
    damaged = bytearray(wire.encode(wire.Beat(step=1)))
    damaged[5] ^= 1
    assert wire.encode(wire.Refusal(reason="CRC")) in bench.box.feed(bytes(damaged))
    assert not bench.box.permitted


def test_tokens_only_count_up() -> None:
    bench = Bench()
    bench.say(pulses_of(7), wire.Disarm())
    for token in (1, 6, 7):
        assert bench.say(pulses_of(token)) == [wire.Refusal(reason="TOKEN")]
    assert bench.say(wire.Hello())[0].last_token == 7  # type: ignore[union-attr]
    assert bench.say(pulses_of(8)) == [wire.Permitted(token=8)]


@given(
    st.lists(
        st.tuples(
            st.one_of(
                st.just(wire.encode(wire.Hello())),
                st.integers(1, 9).map(lambda step: wire.encode(wire.Beat(step=step))),
                st.integers(1, 5).map(lambda token: wire.encode(wire.Fire(token=token))),
                st.integers(1, 5).map(lambda token: wire.encode(pulses_of(token, pulses=token, expiry_ms=150))),
                st.just(wire.encode(wire.Disarm())),
                st.binary(max_size=12),
            ),
            st.floats(0, 0.12),
        ),
        max_size=30,
    )
)
def test_whatever_it_is_told_every_pulse_has_a_permit_a_lease_and_its_turn(told: list[tuple[bytes, float]]) -> None:
    """Checked on the truth: by hearing the answers alone, an observer can bound every pulse."""
    bench = Bench()
    now_s, permitted, counted = 0.0, 0, 0
    renewed_s = -math.inf
    for data, pause_s in told:
        now_s += pause_s
        before = len(bench.box.pulses)
        answer = bench.box.advance(now_s)
        # between two messages: only within one lease of the last renewal
        assert all(pulse.at_s < renewed_s + 0.1 for pulse in bench.box.pulses[before:])
        answer += bench.box.feed(data)
        if data.startswith((b"PERMIT", b"BEAT")) and b"ERR" not in answer:
            renewed_s = now_s
        if data.startswith(b"PERMIT") and b"OK PERMIT" in answer:
            permitted += int(data.split(b" ")[2])
        assert len(bench.box.pulses) >= counted
        counted = len(bench.box.pulses)
    assert counted <= permitted


@pytest.mark.parametrize("rate_hz", [0.0, 0.5, 99.5, 1001.0, math.nan, math.inf])
def test_a_rate_that_the_box_cannot_keep_is_refused(rate_hz: float) -> None:
    with pytest.raises(ConfigError, match="rate_hz is"):
        Bench().driver(rate_hz=rate_hz)
