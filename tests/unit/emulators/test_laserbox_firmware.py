"""The reference firmware's protocol core agrees with the emulator byte for byte and pulse for pulse."""

from __future__ import annotations

import importlib.util
import itertools
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.emulators import laserbox as emulator
from markerseek.emulators._kdc101_triggers import Edge
from markerseek.sim import LaserSettings
from markerseek.wire import laserbox as wire
from tests.unit.drivers.laserbox_bench import Lit

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
        self.edges_ms: list[int] = []
        """Times of the edges at the trigger input."""
        self.taken = 0
        self.emulated = emulator.EmulatedLaserBox(
            world=Lit(),
            on_triggers=self.trains.append,
            turn_us=1000 * turn_ms,
            laser=LaserSettings(energy_meter_noise=0.0 if metered else None),
            edges=self.edges,
        )
        self.firmware = FIRMWARE.Box(
            lambda laser: self.pulls.append((self.firmware.now_us // 1000, laser)),
            self.seen,
            lambda: self.interlock,
            (lambda: emulator.LIGHT_COUNTS * self.seen()) if metered else None,
            lambda: (len(self.edges_ms), 1000 * max(self.edges_ms, default=0), 1000 * self.now_ms),
        )

    def edges(self, _now_s: float) -> list[Edge]:
        """Edges that the emulator has not taken yet."""
        new, self.taken = self.edges_ms[self.taken :], len(self.edges_ms)
        return [Edge(at_s=at_ms / 1e3, angle_deg=0.0) for at_ms in new]

    def step(self, every_ms: int) -> tuple[bytes, bytes]:
        """Turn the stage by five edges, one in so many milliseconds."""
        theirs = ours = b""
        for _ in range(5):
            answers = self.pass_ms(every_ms - 1)
            self.edges_ms.append(self.now_ms + 1)
            last = self.pass_ms(1)
            theirs, ours = theirs + answers[0] + last[0], ours + answers[1] + last[1]
        return theirs, ours

    def seen(self) -> int:
        return self.stray_pulses + sum(laser for _, laser in self.pulls)

    def pass_ms(self, duration_ms: int) -> tuple[bytes, bytes]:
        theirs = ours = b""
        for _ in range(duration_ms):
            self.now_ms += 1
            answers = self.turn()
            theirs, ours = theirs + answers[0], ours + answers[1]
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


def sweep_line(numbers: tuple[int, int, int, int], kind: type[wire.PermitSweep] = wire.PermitSweep) -> bytes:
    token, pulses, period_ms, expiry_ms = numbers
    sweep = kind(token=token, pulses=pulses, period_us=1000 * period_ms, expiry_ms=expiry_ms)
    return wire.encode(sweep)


LINES = st.one_of(
    st.integers(0, 3).map(lambda number: wire.encode(wire.AskTime(number=number))),
    st.tuples(st.integers(1, 8), st.integers(1, 9), st.integers(2, 40), st.integers(1, 300)).map(
        lambda numbers: sweep_line(numbers) + wire.encode(wire.Fire(token=numbers[0]))
    ),
    st.tuples(st.integers(1, 8), st.integers(1, 9), st.integers(2, 40), st.integers(50, 300)).map(
        lambda numbers: sweep_line(numbers, wire.PermitEdges) + wire.encode(wire.Fire(token=numbers[0]))
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
        st.one_of(LINES, LINES, st.integers(1, 120), st.none(), st.sampled_from(["flick", "light", "step3", "step25"])),
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
            case "step3" | "step25":
                theirs, ours = pair.step(int(step.removeprefix("step")))
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
    assert said == wire.encode(wire.Done(token=1, sent=3, photodiode=3))


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
def test_no_two_pulses_of_a_sweep_are_nearer_than_permitted_however_late_the_loop_is(late_ms: int) -> None:
    pair = Pair()
    pair.firmware.feed(sweep_line((1, 8, 10, 2000)) + wire.encode(wire.Fire(token=1)))
    for now_ms in range(0, 90, late_ms):
        pair.now_ms = now_ms
        pair.firmware.advance(1000 * now_ms)
    times = [at_ms for at_ms, _ in pair.pulls]
    assert len(times) >= 3
    assert min(after - before for before, after in itertools.pairwise(times)) >= 10


@pytest.mark.parametrize("metered", [False, True])
def test_an_edge_gives_a_pulse_and_one_that_comes_too_early_is_counted_in_the_dark(metered: bool) -> None:
    pair = Pair(metered=metered)
    pair.step(9)
    pair.send(sweep_line((1, 6, 20, 2000), wire.PermitEdges) + wire.encode(wire.Fire(token=1)))
    beats = iter(range(1, 100))
    edges_ms = [100, 130, 135, 149, 160, 190]
    said: list[wire.Reply] = []
    for _ in range(200):
        if pair.now_ms % 40 == 0:
            pair.send(wire.encode(wire.Beat(step=next(beats))))
        if pair.now_ms + 1 in edges_ms:
            pair.edges_ms.append(pair.now_ms + 1)
        theirs, ours = pair.pass_ms(1)
        assert ours == theirs
        said += map(wire.decode_reply, ours.splitlines())
    # Nothing at FIRE, at 130 + 5 and 130 + 19 ms; the triggers of the acquisition are those of the light.
    assert pair.pulls == [(100, True), (130, True), (160, True), (190, True)]
    stamped = [reply for reply in said if isinstance(reply, wire.Stamped)]
    assert [(pulse.stamp_us, pulse.edge) for pulse in stamped] == [
        (100_000, 1),
        (130_000, 2),
        (160_000, 5),
        (190_000, 6),
    ]
    assert [getattr(pulse, "light", None) for pulse in stamped] == [emulator.LIGHT_COUNTS if metered else None] * 4
    # Once the light has ended the train is completed, without edges.
    pair.send(wire.encode(wire.Disarm()))
    pair.pass_ms(100)
    assert [laser for _, laser in pair.pulls] == [True] * 4 + [False] * 2


def test_a_turn_that_is_held_up_itself_gives_no_late_light() -> None:
    """What counts is when the edge is looked at, and not when the turn began."""
    pulls: list[bool] = []
    edge = [(0, 0, 0)]
    box = FIRMWARE.Box(pulls.append, lambda: len(pulls), lambda: True, None, lambda: edge[0])
    box.feed(sweep_line((1, 50, 20, 2000), wire.PermitEdges) + wire.encode(wire.Fire(token=1)))
    edge[0] = (1, 29_500, 31_000)
    box.advance(30_000)
    assert pulls == []
    edge[0] = (2, 49_500, 50_500)
    box.advance(50_000)
    assert pulls == [True]
    # Less than a period after that light, though not after the beginning of its turn.
    edge[0] = (3, 70_100, 70_200)
    box.advance(70_150)
    assert pulls == [True]


@given(st.binary(max_size=80))
def test_the_firmware_s_crc_is_the_codec_s(data: bytes) -> None:
    assert FIRMWARE.crc16(data) == wire.crc16(data)


def test_limits_and_lease_are_those_of_the_codec() -> None:
    assert (FIRMWARE.VERSION, FIRMWARE.METERED_VERSION) == (wire.VERSION, wire.METERED_VERSION)
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


@pytest.mark.parametrize("late_ms", [1, 7, 30])
def test_a_loop_that_is_late_puts_pulses_off_and_never_bunches_them(late_ms: int) -> None:
    pair = Pair()
    pair.firmware.feed(permit_line((1, 8, 0, 100, 2000)) + wire.encode(wire.Fire(token=1)))
    times = []
    for now_ms in range(0, 90, late_ms):
        pair.now_ms = now_ms
        pair.firmware.advance(1000 * now_ms)
    times = [at_ms for at_ms, _ in pair.pulls]
    assert len(times) >= 3
    assert min(after - before for before, after in itertools.pairwise(times)) >= 5
