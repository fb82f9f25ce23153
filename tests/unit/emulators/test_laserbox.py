"""The laser box by itself, given messages without a driver: lease, expiry, tokens and interlock end its pulses."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from markerseek.wire import laserbox as wire
from tests.unit.drivers.laserbox_bench import Bench, pulses_of


def test_a_second_program_that_asks_for_a_permit_while_it_fires_stops_it() -> None:
    bench = Bench()
    bench.say(pulses_of(1), wire.Fire(token=1), at_s=0.0)
    assert bench.say(pulses_of(2), at_s=0.025) == [wire.Refusal(reason="BUSY")]
    assert not bench.box.permitted
    assert bench.say(wire.Hello(), at_s=0.490) == [wire.Refusal(reason="BUSY")]
    assert bench.say(at_s=0.5) == [wire.Done(token=1, sent=3, photodiode=3, light=0)]
    assert bench.say(pulses_of(2)) == [wire.Permitted(token=2, seen=3)]


def test_a_train_that_is_cut_is_completed_without_light_at_the_same_rate() -> None:
    for cut in (wire.Disarm(), wire.Beat(step=0), wire.Hello(), pulses_of(2)):
        bench = Bench()
        bench.say(pulses_of(1), wire.Fire(token=1), at_s=0.0)
        bench.say(cut, at_s=0.025)
        bench.say(at_s=0.490)
        assert bench.triggers == []
        assert bench.say(at_s=0.5) == [wire.Done(token=1, sent=3, photodiode=3, light=0)]
        assert bench.triggers == [50]
        assert [pulse.at_s for pulse in bench.box.pulses] == [0.0, 0.01, 0.02]
        assert [flash.pulses for flash in bench.world.flashes] == [3]


def test_light_that_comes_later_than_the_photodiode_is_read_is_not_of_the_firing() -> None:
    bench = Bench()
    bench.faults.inject("late light", 1500)
    bench.say(pulses_of(1, pulses=3), wire.Fire(token=1), at_s=0.0)
    assert bench.say(at_s=0.09) == [wire.Done(token=1, sent=3, photodiode=2, light=0)]
    assert bench.say(pulses_of(2)) == [wire.Permitted(token=2, seen=3)]


def test_a_beat_that_does_not_count_up_takes_the_permit_away() -> None:
    for step in (4, 5):
        bench = Bench()
        bench.say(wire.Beat(step=5), pulses_of(1), wire.Fire(token=1), at_s=0.0)
        assert bench.say(wire.Beat(step=step), at_s=0.035) == [wire.Refusal(reason="STEP")]
        assert bench.say(at_s=0.5) == [wire.Done(token=1, sent=4, photodiode=4, light=0)]


def test_a_permit_is_void_after_its_expiry_however_long_the_lease_lasts() -> None:
    bench = Bench()
    bench.say(pulses_of(1, expiry_ms=55), wire.Fire(token=1), at_s=0.0)
    bench.say(wire.Beat(step=1), at_s=0.04)
    assert bench.say(at_s=0.5) == [wire.Done(token=1, sent=6, photodiode=6, light=0)]


def test_power_up_clears_the_permit_and_a_damaged_line_revokes_it() -> None:
    bench = Bench()
    bench.say(pulses_of(1), at_s=0.0)
    bench.box.power_up()
    assert bench.say(wire.Fire(token=1)) == [wire.Refusal(reason="TOKEN")]
    bench.say(pulses_of(2), wire.Fire(token=2), at_s=0.05)
    damaged = bytearray(wire.encode(wire.Beat(step=1)))
    damaged[5] ^= 1
    assert wire.encode(wire.Refusal(reason="CRC")) in bench.box.feed(bytes(damaged))
    assert not bench.box.permitted


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
def test_under_any_commands_every_pulse_has_a_permit_a_lease_and_its_turn(commands: list[tuple[bytes, float]]) -> None:
    """Checked on the truth: from the answers alone, an observer can bound every pulse."""
    bench = Bench()
    now_s, permitted, counted = 0.0, 0, 0
    renewed_s = -math.inf
    for data, pause_s in commands:
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
