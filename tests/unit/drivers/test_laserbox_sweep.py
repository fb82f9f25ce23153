"""Sweeps by the laser box's driver against its emulator: every pulse has its time, and the light ends when it must."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import (
    DeviceError,
    DeviceTimeoutError,
    LaserError,
    Permit,
    Pulse,
    SweepPermit,
    is_finite,
)
from markerseek.drivers import LaserBox
from markerseek.drivers._laserbox_line import BoxSweep
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.sim import LaserSettings
from markerseek.wire import laserbox as wire
from tests.emulated_lines import BenchClock, DirectPort, FaultyLine
from tests.unit.drivers.laserbox_bench import Lit

Late = float | tuple[float, float]


class Bench:
    """A box that sweeps, and its driver, whose beat is in each wait."""

    def __init__(self, *, metered: bool = False, late_s: Late = 1e-3) -> None:
        self.world = Lit()
        self.triggers: list[int] = []
        light = LaserSettings(energy_meter_noise=0.0 if metered else None)
        self.box = EmulatedLaserBox(world=self.world, on_triggers=self.triggers.append, laser=light)
        self.box.faults.inject("clock drift", 50e-6)
        self.clock = BenchClock(tick_s=1e-3)
        self.port = DirectPort(device=self.box, clock=self.clock, line=FaultyLine(late_s=late_s))
        self.driver = LaserBox(port=self.port, clock=self.clock)
        self.clock.lead(lambda _: self.driver.beat(), lambda _: self.port.read(0, timeout_s=0.0))

    def turn(self, duration_s: float) -> list[Pulse]:
        """Ask for the pulses every 50 ms, as a sweep does."""
        pulses: list[Pulse] = []
        ends_s = self.clock.now_s() + duration_s
        while self.clock.now_s() < ends_s:
            self.clock.wait(0.05)
            pulses += self.driver.pulses()
        return pulses


def permit(token: str = "s", *, pulses: int = 100, expires_s: float = 1e4) -> SweepPermit:
    return SweepPermit(
        token=token,
        angle_deg=-35.0,
        pulses=pulses,
        expires_s=expires_s,
        to_deg=35.0,
        slowest_deg_s=2.0,
        fastest_deg_s=12.0,
        period_s=0.05,
    )


@pytest.mark.parametrize("ahead_us", [0, 2**31 - 1_000_000, 2**30])
def test_each_pulse_of_a_sweep_has_its_time_on_the_rig_s_clock(ahead_us: int) -> None:
    bench = Bench()
    # Also where the box's count of microseconds wraps round in mid-sweep.
    bench.box.faults.inject("clock step", ahead_us)
    bench.driver.begin_sweep(permit())
    pulses = bench.turn(3.0)
    fired = bench.driver.end_sweep()
    pulses += bench.driver.pulses()
    truth_s = [pulse.at_s for pulse in bench.box.pulses]
    assert fired == len(pulses) == len(truth_s) >= 55
    off_s = [pulse.at_s - true for pulse, true in zip(pulses, truth_s, strict=True)]
    assert max(map(abs, off_s)) <= 1e-3
    assert max(pulse.sigma_s for pulse in pulses) <= 1e-3
    # and what it is said to be off by is no smaller than what it is off by
    assert sum((off / pulse.sigma_s) ** 2 for off, pulse in zip(off_s, pulses, strict=True)) <= 3 * len(pulses)
    assert min(after - before for before, after in pairwise(truth_s)) >= 0.05 - 1e-9
    assert len(bench.world.flashes) == fired


def test_light_ends_at_once_on_request_and_the_triggers_that_are_left_are_dark() -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit(pulses=40))
    bench.turn(1.0)
    asked_s = bench.clock.now_s()
    fired = bench.driver.end_sweep()
    assert bench.clock.now_s() - asked_s < 0.02
    assert bench.driver.end_sweep() == fired
    # The next acquisition waits for them.
    assert bench.driver.fire(Permit(token="next", angle_deg=0.0, pulses=3, expires_s=math.inf)) == 3
    assert bench.triggers == [40, 3]
    times_s = [pulse.at_s for pulse in bench.box.pulses]
    assert times_s[fired - 1] <= asked_s + 0.01
    assert times_s[fired] > 1.95


def test_all_permitted_pulses_end_a_sweep_too() -> None:
    bench = Bench(metered=True)
    bench.driver.begin_sweep(permit(pulses=10))
    assert len(bench.turn(1.0)) == 10
    assert bench.driver.end_sweep() == 10
    bench.driver.begin_sweep(permit("t", pulses=10))
    assert len(bench.turn(1.0)) == 10


def test_a_sweep_that_follows_too_soon_is_refused_without_light() -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit(pulses=100))
    bench.turn(0.5)
    bench.driver.end_sweep()
    fired = len(bench.box.pulses)
    with pytest.raises(DeviceError, match="still sends the triggers of an earlier firing"):
        bench.driver.begin_sweep(permit("t"))
    bench.clock.wait(6.0)
    assert len(bench.box.pulses) == fired


@pytest.mark.parametrize("still_beats", [True, False])
def test_a_loop_that_does_not_come_by_any_more_has_no_light(still_beats: bool) -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit())
    bench.turn(0.5)
    if not still_beats:
        bench.driver.beat = lambda: None  # type: ignore[method-assign]
    hung_s = bench.clock.now_s()
    bench.clock.wait(3.0)
    assert bench.box.pulses[-1].at_s <= hung_s + (0.25 if still_beats else 0.1)
    with pytest.raises(LaserError, match=r"it ended the light after \d+ of at most 100 pulses"):
        bench.driver.pulses()


def silent(bench: Bench) -> None:
    bench.box.faults.inject("silent")


def doubled(bench: Bench) -> None:
    bench.box.faults.inject("double pulse", 15)


def without_light(bench: Bench) -> None:
    bench.box.faults.inject("dead lamp")


def unseen(bench: Bench) -> None:
    bench.box.faults.inject("blind photodiode")


def stepped(bench: Bench) -> None:
    bench.box.faults.inject("clock step", 5000)


def interlocked(bench: Bench) -> None:
    bench.box.open_interlock()


@pytest.mark.parametrize(
    ("fault", "error", "said"),
    [
        (silent, DeviceTimeoutError, "no answer during the sweep"),
        (doubled, LaserError, r"photodiode=2.* came after 14 pulses"),
        (without_light, LaserError, "photodiode=0"),
        (unseen, LaserError, "photodiode=0"),
        (stepped, LaserError, r"its clock jumped by [34]"),
        (interlocked, LaserError, "it ended the light after"),
    ],
)
def test_each_fault_of_the_box_ends_the_sweep_in_time(
    fault: Callable[[Bench], None], error: type[DeviceError], said: str
) -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit())
    bench.turn(0.5)
    fault(bench)
    broken_s = bench.clock.now_s()
    with pytest.raises(error, match=said):
        bench.turn(5.0)
    assert bench.clock.now_s() - broken_s < 0.5
    bench.clock.wait(1.0)
    assert not bench.box.permitted
    assert all(pulse.at_s < broken_s + 0.6 for pulse in bench.box.pulses)


def test_a_line_too_slow_for_the_time_of_a_pulse_is_refused() -> None:
    bench = Bench(late_s=0.01)
    bench.driver.begin_sweep(permit())
    with pytest.raises(LaserError, match=r"the time of a pulse is known to \d\.\d ms only, the limit is 1 ms"):
        bench.turn(2.5)


@pytest.mark.parametrize("rate", [-0.009, -300e-6, 1e-3, 0.008])
@pytest.mark.parametrize("late_s", [0.0, (0.0, 0.006)])
def test_a_clock_that_is_fast_or_slow_gives_each_pulse_its_time(
    rate: float, late_s: float | tuple[float, float]
) -> None:
    bench = Bench(late_s=late_s)  # type: ignore[arg-type]
    bench.box.faults.inject("clock drift", rate)
    bench.driver.begin_sweep(permit())
    pulses = bench.turn(4.0)
    fired = bench.driver.end_sweep()
    pulses += bench.driver.pulses()
    truth_s = [pulse.at_s for pulse in bench.box.pulses]
    assert fired == len(pulses) == len(truth_s) >= 60
    assert max(abs(pulse.at_s - true) for pulse, true in zip(pulses, truth_s, strict=True)) <= 1e-3


@pytest.mark.parametrize(("rate", "said"), [(0.017, "1.7% fast"), (-0.04, "4.[0-2]% slow")])
def test_a_clock_that_is_too_fast_or_too_slow_is_named_with_its_rate(rate: float, said: str) -> None:
    bench = Bench()
    bench.box.faults.inject("clock drift", rate)
    bench.driver.begin_sweep(permit())
    with pytest.raises(LaserError, match=rf"its clock is {said} against this computer's, the limit is 1%;"):
        bench.turn(3.0)


def test_an_answer_that_comes_between_two_looks_was_not_there_at_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the computer is held up between them: no clock has jumped."""
    bench = Bench()
    bench.driver.begin_sweep(permit())
    read = bench.port.read
    looks = itertools.count()

    def held_up(size: int, *, timeout_s: float) -> bytes:
        if size > 1 and next(looks) % 4 == 0:
            bench.clock.wait(0.01)
        return read(size, timeout_s=timeout_s)

    monkeypatch.setattr(bench.port, "read", held_up)
    assert len(bench.turn(1.0)) > 10


@pytest.mark.parametrize(
    ("permits", "said"), [((permit(), permit()), "used before"), ((permit(expires_s=0.0),), "exp")]
)
def test_a_permit_of_a_sweep_is_used_once_and_in_time(permits: tuple[SweepPermit, ...], said: str) -> None:
    bench = Bench()
    *before, last = permits
    for each in before:
        bench.driver.begin_sweep(each)
        bench.driver.end_sweep()
    fired = len(bench.box.pulses)
    with pytest.raises(LaserError, match=said):
        bench.driver.begin_sweep(last)
    bench.clock.wait(1.0)
    assert len(bench.box.pulses) == fired


def test_disarm_ends_the_light_of_a_sweep() -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit())
    bench.turn(0.5)
    bench.driver.disarm()
    fired = len(bench.box.pulses)
    bench.clock.wait(6.0)
    assert (len(bench.box.pulses), list(bench.driver.pulses())) == (fired, [])
    assert bench.driver.fire(Permit(token="a", angle_deg=0.0, pulses=2, expires_s=math.inf)) == 2


def test_light_in_the_dark_part_of_a_sweep_is_found() -> None:
    bench = Bench()
    bench.driver.begin_sweep(permit(pulses=20))
    bench.turn(0.5)
    bench.driver.end_sweep()
    bench.box.stray_light()
    with pytest.raises(LaserError, match="there was light without a permit"):
        bench.driver.fire(Permit(token="a", angle_deg=0.0, pulses=2, expires_s=math.inf))


COUNTS = st.one_of(st.integers(0, 3), st.integers(0, wire.MAX_COUNT))
REPLIES = st.one_of(
    st.builds(wire.Time, number=st.integers(1, 5), clock_us=COUNTS),
    st.builds(
        wire.Stamped,
        token=st.just(1),
        number=st.integers(1, 4),
        stamp_us=COUNTS,
        photodiode=st.just(1),
        light=COUNTS,
    ),
    st.builds(wire.Stamped, token=COUNTS, number=COUNTS, stamp_us=COUNTS, photodiode=COUNTS, light=COUNTS),
    st.builds(wire.Dark, token=COUNTS, sent=COUNTS, photodiode=COUNTS),
    st.builds(wire.Done, token=COUNTS, sent=COUNTS, photodiode=COUNTS, light=COUNTS),
    st.just(wire.Disarmed()),
    st.just(wire.Refusal(reason="STEP")),
)


@given(st.lists(st.tuples(REPLIES, st.floats(0.0, 0.1)), max_size=30))
def test_whatever_a_box_says_a_pulse_has_a_time_or_there_is_none(said: list[tuple[wire.Reply, float]]) -> None:
    now_s = 10.0
    sweep = BoxSweep(token=1, pulses=4, heard_s=now_s, stepped_s=now_s, asked_s=dict.fromkeys(range(1, 6), now_s))
    pulses: list[Pulse] = []
    try:
        for reply, later_s in said:
            now_s += later_s
            sweep.hear(reply, now_s=now_s)
            pulses += sweep.new_pulses(now_s=now_s)
    except LaserError:
        pass
    assert len(pulses) <= 4
    assert all(is_finite(pulse.at_s) and 0 <= pulse.sigma_s <= 1e-3 for pulse in pulses)


def test_what_was_stamped_twice_or_not_at_all_is_refused() -> None:
    bench = Bench()
    feed = bench.box.advance
    dropped = []

    def without_third(now_s: float) -> bytes:
        lines = feed(now_s).splitlines(keepends=True)
        kept = [line for line in lines if not line.startswith(b"PULSE 1 3 ")]
        dropped.extend(set(lines) - set(kept))
        return b"".join(kept)

    bench.box.advance = without_third  # type: ignore[method-assign]
    bench.driver.begin_sweep(permit())
    with pytest.raises(LaserError, match=r"number=4.* came after 2 pulses"):
        bench.turn(1.0)
    assert wire.decode_reply(dropped[0].rstrip())
