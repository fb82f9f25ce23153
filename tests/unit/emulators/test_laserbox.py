"""The laser box without a driver: what ends its pulses; the reference firmware's core agrees with it byte for byte."""

from __future__ import annotations

import importlib.util
import itertools
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.emulators import laserbox as emulator
from markerseek.sim import LaserSettings
from markerseek.wire import laserbox as wire
from tests.unit.drivers.laserbox_bench import Bench, Lit, pulses_of


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
    now_s = 0.0
    permitted = 0
    counted = 0
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


MAIN = Path(__file__).parents[3] / "firmware" / "laserbox" / "main.py"


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("laserbox_firmware", MAIN)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FIRMWARE: Any = load()
FIRMWARE.IDENTITY = wire.EMULATOR  # the one word in which they differ


class Pair:
    """Firmware and emulator, given the same commands at the same time; a turn of the loop takes so many ms."""

    def __init__(self, *, metered: bool = False, turn_ms: int = 1) -> None:
        self.turn_ms = turn_ms
        self.interlock = True
        self.trains: list[int] = []
        self.pulls: list[tuple[int, bool]] = []
        self.now_ms = 0
        self.stray_pulses = 0
        self.emulated = emulator.EmulatedLaserBox(
            world=Lit(),
            on_triggers=self.trains.append,
            turn_us=1000 * turn_ms,
            laser=LaserSettings(energy_meter_noise=0.0 if metered else None),
        )
        self.firmware = FIRMWARE.Box(
            lambda laser: self.pulls.append((self.firmware.now_us // 1000, laser)),
            self.seen,
            lambda: self.interlock,
            (lambda: emulator.LIGHT_COUNTS * self.seen()) if metered else None,
        )

    def seen(self) -> int:
        return self.stray_pulses + sum(laser for _, laser in self.pulls)

    def pass_ms(self, duration_ms: int) -> tuple[bytes, bytes]:
        theirs = b""
        ours = b""
        for _ in range(duration_ms):
            self.now_ms += 1
            answers = self.turn()
            theirs = theirs + answers[0]
            ours = ours + answers[1]
        return theirs, ours

    def turn(self) -> tuple[bytes, bytes]:
        """A turn of the loop, if it is time for one."""
        if self.now_ms % self.turn_ms:
            return b"", b""
        return self.emulated.advance(self.now_ms / 1e3), self.firmware.advance(1000 * self.now_ms)

    def switch_interlock(self) -> tuple[bytes, bytes]:
        self.interlock = not self.interlock
        (self.emulated.close_interlock if self.interlock else self.emulated.open_interlock)()
        self.firmware.interlock_opened |= not self.interlock
        return self.turn()

    def flick_interlock(self) -> tuple[bytes, bytes]:
        """Open it, and close it again where it was closed, before the next turn of the loop."""
        self.emulated.open_interlock()
        self.firmware.interlock_opened = True
        if self.interlock:
            self.emulated.close_interlock()
        return b"", b""

    def shine(self) -> tuple[bytes, bytes]:
        self.stray_pulses += 1
        self.emulated.stray_light()
        return b"", b""

    def send(self, data: bytes) -> tuple[bytes, bytes]:
        return self.emulated.feed(data), self.firmware.feed(data)


def permit_line(numbers: tuple[int, int, int, int, int]) -> bytes:
    token, pulses, more, rate_hz, expiry_ms = numbers
    return wire.encode(
        wire.PermitPulses(
            token=token, pulses=pulses, rate_hz=rate_hz, expiry_ms=expiry_ms, triggers=max(pulses + more, 1)
        )
    )


def sweep_line(numbers: tuple[int, int, int, int]) -> bytes:
    token, pulses, period_ms, expiry_ms = numbers
    sweep = wire.PermitSweep(token=token, pulses=pulses, period_us=1000 * period_ms, expiry_ms=expiry_ms)
    return wire.encode(sweep)


LINES = st.one_of(
    st.integers(0, 3).map(lambda number: wire.encode(wire.AskTime(number=number))),
    st.tuples(st.integers(1, 8), st.integers(1, 9), st.integers(2, 40), st.integers(1, 300)).map(
        lambda numbers: sweep_line(numbers) + wire.encode(wire.Fire(token=numbers[0]))
    ),
    st.just(wire.encode(wire.Hello())),
    st.just(wire.encode(wire.Disarm())),
    st.integers(1, 30).map(lambda step: wire.encode(wire.Beat(step=step))),
    st.integers(1, 8).map(lambda token: wire.encode(wire.Fire(token=token))),
    st.tuples(
        st.integers(1, 8),
        st.integers(0, 12),
        st.integers(0, 3),
        st.sampled_from([10, 20, 50, 100, 200, 500]),
        st.integers(1, 300),
    ).map(permit_line),
    st.tuples(st.integers(1, 8), st.integers(1, 9)).map(
        lambda pair: permit_line((pair[0], pair[1], 0, 100, 300)) + wire.encode(wire.Fire(token=pair[0]))
    ),
    st.binary(max_size=10),
    st.just(b"x" * 79 + b"\n"),
    st.just(b"x" * 80 + b"\n"),
    st.text("ABDEFHILMOPRSTKN 0123456789*-", max_size=20).map(
        lambda text: text.encode() + b"*%04X\n" % wire.crc16(text.encode())
    ),
)


@given(
    st.lists(
        st.one_of(LINES, LINES, st.integers(1, 120), st.none(), st.sampled_from(["flick", "light"])),
        max_size=25,
    ),
    st.booleans(),
    st.sampled_from([1, 1, 2, 20]),
)
def test_firmware_and_emulator_answer_alike_to_any_commands(
    steps: list[bytes | int | str | None], metered: bool, turn_ms: int
) -> None:
    pair = Pair(metered=metered, turn_ms=turn_ms)
    for step in steps:
        match step:
            case bytes():
                theirs, ours = pair.send(step)
            case int():
                theirs, ours = pair.pass_ms(step)
            case None:
                theirs, ours = pair.switch_interlock()
            case "flick":
                theirs, ours = pair.flick_interlock()
            case _:
                theirs, ours = pair.shine()
        assert ours == theirs
    theirs, ours = pair.pass_ms(2000)
    assert ours == theirs
    assert sum(laser for _, laser in pair.pulls) + pair.stray_pulses == len(pair.emulated.pulses)
    if not pair.stray_pulses:
        assert [at_ms / 1e3 for at_ms, laser in pair.pulls if laser] == [pulse.at_s for pulse in pair.emulated.pulses]
    # every train that began was completed, lit or not
    assert sum(pair.trains) == len(pair.pulls)


@pytest.mark.parametrize("late_us", [0, 500, 1000])
def test_done_waits_for_light_that_comes_late(late_us: int) -> None:
    times_us = []
    now_us = 0
    box = FIRMWARE.Box(
        lambda laser: times_us.append(now_us + late_us) if laser else None,
        lambda: sum(at_us <= now_us for at_us in times_us),
        lambda: True,
    )
    box.feed(permit_line((1, 3, 0, 1000, 2000)) + wire.encode(wire.Fire(token=1)))
    said = b""
    for now_us in range(0, 10_000, 100):
        said += box.advance(now_us)
    assert said == wire.encode(wire.Done(token=1, sent=3, photodiode=3, light=0))


def test_emulator_and_firmware_refuse_the_same_pulses_by_their_budget() -> None:
    pair = Pair()
    for token in range(1, 9):
        theirs, ours = pair.send(permit_line((token, 1000, 0, 1000, 2000)) + wire.encode(wire.Fire(token=token)))
        assert ours == theirs
        assert (b"ERR BUDGET" in ours) is (token > 6)
        for step in range(25):
            pair.send(wire.encode(wire.Beat(step=100 * token + step)))
            theirs, ours = pair.pass_ms(50)
            assert ours == theirs
    assert len(pair.pulls) == 6000


@pytest.mark.parametrize("late_ms", [1, 7, 30])
@pytest.mark.parametrize(
    ("line", "apart_ms"), [(sweep_line((1, 8, 10, 2000)), 10), (permit_line((1, 8, 0, 100, 2000)), 5)]
)
def test_a_loop_that_is_late_puts_pulses_off_and_never_bunches_them(line: bytes, apart_ms: int, late_ms: int) -> None:
    pair = Pair()
    pair.firmware.feed(line + wire.encode(wire.Fire(token=1)))
    for now_ms in range(0, 90, late_ms):
        pair.now_ms = now_ms
        pair.firmware.advance(1000 * now_ms)
    times = [at_ms for at_ms, _ in pair.pulls]
    assert len(times) >= 3
    assert min(after - before for before, after in itertools.pairwise(times)) >= apart_ms


@given(st.binary(max_size=80))
def test_the_firmware_s_crc_is_the_codec_s(data: bytes) -> None:
    assert FIRMWARE.crc16(data) == wire.crc16(data)


def test_limits_and_lease_are_those_of_the_codec() -> None:
    assert FIRMWARE.VERSION == wire.VERSION
    for name in (
        "LEASE_MS",
        "MAX_SWEEP_PULSES",
        "MIN_PERIOD_US",
        "MAX_PERIOD_US",
        "LINE_BYTES",
        "MAX_PULSES",
        "MAX_RATE_HZ",
        "MAX_EXPIRY_MS",
        "MAX_COUNT",
        "MAX_PULSES_PER_MINUTE",
        "LIGHT_LATE_US",
    ):
        assert getattr(FIRMWARE, name) == getattr(wire, name), name
