"""The laser box's driver against its emulator: permitted pulses are fired and counted, and no others."""

from __future__ import annotations

import itertools

import pytest
from msgspec.structs import replace

from markerseek.core import ConfigError, DeviceTimeoutError, LaserError, NotConnectedError
from markerseek.drivers import LaserBox, LaserBoxSettings
from markerseek.sim import VirtualClock
from markerseek.wire import laserbox as wire
from tests.emulated_lines import DirectPort
from tests.unit.drivers.laserbox_bench import Bench, permit, pulses_of


def test_the_pulses_come_at_their_rate_and_are_counted() -> None:
    bench = Bench()
    assert bench.driver(rate_hz=50).fire(permit(pulses=16)) == 16
    times = [pulse.at_s for pulse in bench.box.pulses]
    assert [later - sooner for sooner, later in itertools.pairwise(times)] == pytest.approx([0.02] * 15)
    assert {pulse.angle_deg for pulse in bench.box.pulses} == {3.0}
    assert [flash.pulses for flash in bench.world.flashes] == [16]
    assert bench.triggers == [16]


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
    assert bench.driver().fire(permit("a")) == 16  # a later program continues the box's own counter
    assert len(bench.box.pulses) == 32


@pytest.mark.parametrize(("fault", "amount"), [("dead lamp", 0), ("blind photodiode", 0), ("extra pulses", 1)])
def test_pulses_that_do_not_agree_end_in_an_error_with_the_three_numbers(fault: str, amount: int) -> None:
    bench = Bench()
    driver = bench.driver()
    bench.faults.inject(fault, amount)
    with pytest.raises(LaserError, match=r"16 pulses were permitted, 1[67] sent and (0|17) seen"):
        driver.fire(permit())
    assert not bench.box.permitted


def test_a_silent_box_gets_the_command_to_disarm_and_times_out() -> None:
    bench = Bench()
    driver = bench.driver()
    bench.faults.inject("silent")
    began_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="no answer to PERMIT in time"):
        driver.fire(permit())
    with pytest.raises(DeviceTimeoutError, match="no answer to DISARM"):
        driver.disarm()
    assert bench.clock.now_s() - began_s < 2
    assert not bench.box.permitted
    assert bench.box.pulses == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 9}, "has version 9 of the protocol, 7 is known"),
        ({"version": 6}, "has version 6 of the protocol"),
        ({"lease_ms": 40}, "its lease is 40 ms, it must lie between 50 and 100 ms"),
        ({"lease_ms": 5000}, "its lease is 5000 ms"),
    ],
)
def test_a_box_of_another_kind_is_not_connected(change: dict[str, int], message: str) -> None:
    greeting = wire.Greeting(identity="other", version=wire.VERSION, lease_ms=100, last_token=0, seen=0, meter=0)
    reply = wire.encode(replace(greeting, **change))

    class Other:
        def advance(self, now_s: float) -> bytes:
            return b""

        def feed(self, data: bytes) -> bytes:
            return b"half a line\n" + reply if b"HELLO" in data else b""

    clock = VirtualClock()
    with pytest.raises(NotConnectedError, match=message):
        LaserBox(port=DirectPort(device=Other(), clock=clock), clock=clock)


@pytest.mark.parametrize(
    "answer", [wire.Permitted(token=2, seen=0), wire.Done(token=9, sent=16, photodiode=16, light=0)]
)
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


def test_an_open_interlock_fires_nothing_and_closing_it_gives_no_permit_back() -> None:
    bench = Bench()
    driver = bench.driver()
    bench.box.open_interlock()
    with pytest.raises(LaserError, match="the interlock is open: close it"):
        driver.fire(permit())
    bench.box.close_interlock()
    assert not bench.box.permitted
    assert bench.box.pulses == []


def test_light_between_two_firings_is_reported_and_nothing_is_fired() -> None:
    bench = Bench()
    driver = bench.driver()
    driver.fire(permit("a"))
    bench.box.stray_light(2)
    with pytest.raises(
        LaserError, match="counts 18 pulses of light since power-up, 16 up to the last firing"
    ) as refusal:
        driver.fire(permit("b"))
    assert "nothing was fired" in str(refusal.value)
    assert not bench.box.permitted
    assert len(bench.box.pulses) == 18
    assert driver.fire(permit("c")) == 16  # after a person has looked, it is counted from there


def test_light_before_it_was_connected_is_not_of_this_session() -> None:
    bench = Bench()
    bench.box.stray_light(3)
    assert bench.driver().fire(permit()) == 16


def test_a_box_that_was_switched_off_and_on_between_two_firings_is_noticed() -> None:
    bench = Bench()
    driver = bench.driver()
    driver.fire(permit("a"))
    bench.box.power_up()
    with pytest.raises(LaserError, match="counts 0 pulses of light since power-up, 16 up to"):
        driver.fire(permit("b"))


def test_a_next_program_waits_until_the_triggers_of_a_cut_train_have_ended() -> None:
    bench = Bench()
    bench.say(pulses_of(1, pulses=128), wire.Fire(token=1))
    bench.clock.wait(0.05)
    bench.say(wire.Disarm())
    driver = bench.driver()
    assert 1.28 <= bench.clock.now_s() < 1.4
    assert bench.triggers == [128]
    assert driver.fire(permit()) == 16
    assert bench.triggers == [128, 16]
    assert len(bench.box.pulses) == 6 + 16


def test_after_a_cut_train_the_same_driver_waits_too() -> None:
    bench = Bench()
    driver = bench.driver()
    bench.faults.inject("blind photodiode")
    with pytest.raises(LaserError, match="0 seen"):
        driver.fire(permit("a"))
    bench.faults.heal("blind photodiode")
    bench.say(pulses_of(9), wire.Fire(token=9), wire.Disarm())
    assert driver.fire(permit("b")) == 16
    assert bench.triggers == [16, 50, 16]


def test_a_box_that_never_ends_its_triggers_is_given_up() -> None:
    bench = Bench()
    bench.box.feed = lambda _data: wire.encode(wire.Refusal(reason="BUSY"))  # type: ignore[method-assign]
    with pytest.raises(NotConnectedError, match="still sends the triggers of an earlier firing after 61 s"):
        bench.driver()
    assert 61 <= bench.clock.now_s() < 62


def test_a_budget_that_is_used_up_is_reported_with_the_remedy() -> None:
    bench = Bench()
    driver = bench.driver(rate_hz=1000)
    for number in range(46):
        driver.fire(permit(f"{number}", pulses=128))
    with pytest.raises(LaserError, match="at most 6000 pulses a minute: wait a minute"):
        driver.fire(permit("one more", pulses=128))
    assert len(bench.box.pulses) == 46 * 128
    bench.clock.wait(61)
    assert driver.fire(permit("later", pulses=128)) == 128


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"rate_hz": 99.5}, "rate_hz is 99.5 Hz, it must be a whole number from 1 to 1000"),
        ({"rate_hz": 1.0, "pulses": 61}, r"61 pulses at 1\.0 Hz take 61 s, the limit is 60 s"),
    ],
)
def test_keys_that_no_box_can_follow_are_refused(keys: dict[str, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        LaserBoxSettings(port="", **keys)  # type: ignore[arg-type]
