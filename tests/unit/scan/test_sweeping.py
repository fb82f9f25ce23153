"""Sweeps on the simulated rig, judged by its truth: where each pulse was fired, and what ends a sweep."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    Asked,
    ConfigError,
    Failed,
    Finished,
    LaserError,
    LimitError,
    Measured,
    MoveError,
    NotConnectedError,
    Refused,
    Sample,
    StageReading,
    Sweep,
    SweepPermit,
    Swept,
)
from markerseek.guard import State
from markerseek.scan import RunLimits
from markerseek.scan.scanner import _WatchdogHeld
from markerseek.scan.sweeping import Way
from markerseek.sim import SimulatedLaser, SimulatedReceiver, SimulatedStage, StageMotion
from markerseek.sim.stage import Leg
from tests.unit.scan.scan_bench import drain
from tests.unit.scan.sweep_bench import (
    TO_END,
    Ahead,
    Fast,
    Hasty,
    Losing,
    Pausing,
    Running,
    Short,
    Staying,
    SweepBench,
    Sweeps,
)


@given(
    st.integers(0, 2**32 - 1), st.floats(2.0, 25.0), st.floats(2.0, 25.0), st.floats(0.0, 0.1), st.floats(-0.02, 0.02)
)
def test_the_moment_of_a_reading_leaves_a_sound_stage_time_for_the_next(
    seed: int, speed_deg_s: float, acceleration_deg_s2: float, late_s: float, off_deg: float
) -> None:
    """Never after the true one, nor out of question and answer; and a prompt reading is of its question."""
    rng = np.random.Generator(np.random.PCG64(seed))
    start_deg, target_deg = rng.uniform(-35.0, 35.0, 2).tolist()
    leg = Leg(
        began_s=float(rng.uniform(0.0, 0.1)),
        start_deg=start_deg,
        speed_deg_s=0.0,
        target_deg=target_deg,
        top_deg_s=speed_deg_s,
        acceleration_deg_s2=acceleration_deg_s2,
    )
    way = Way(
        start=StageReading(angle_deg=start_deg, asked_s=0.0, answered_s=0.0),
        target_deg=target_deg,
        speed_deg_s=speed_deg_s,
        acceleration_deg_s2=acceleration_deg_s2,
    )
    asked_s = 0.01
    for _ in range(80):
        answered_s = asked_s + float(rng.choice([1e-3, late_s]))
        true_s = float(rng.uniform(asked_s, answered_s))
        angle_deg = leg.at(true_s)[0] + off_deg * float(rng.uniform(-1, 1))
        moment_s = way.moment_s(StageReading(angle_deg=angle_deg, asked_s=asked_s, answered_s=answered_s))
        assert asked_s <= moment_s <= answered_s
        assert moment_s <= true_s + 1e-6
        asked_s = answered_s + 0.05


FAST = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)


def samples_of(bench: SweepBench, sweep: Sweep) -> list[Sample]:
    outcomes = list(bench.scanner.take(sweep, number=1, goes_on=lambda: True))
    assert isinstance(outcomes[-1], Swept)
    return [outcome for outcome in outcomes if isinstance(outcome, Sample)]


@pytest.mark.parametrize(
    ("bench", "sweep"),
    [
        (SweepBench(), TO_END),
        (SweepBench(readout_s=10.0), TO_END),
        (SweepBench(rate_hz=100.0), Sweep(to_deg=-10.0, speed_deg_s=12.5)),
        (SweepBench(start_deg=30.0), Sweep(to_deg=-35.0, speed_deg_s=4.0)),
        (SweepBench(motion=StageMotion()), Sweep(to_deg=35.0, speed_deg_s=8.6)),
    ],
)
def test_each_pulse_gives_a_sample_at_the_angle_where_it_was_fired(bench: SweepBench, sweep: Sweep) -> None:
    samples = samples_of(bench, sweep)
    flashes = bench.flashes()
    assert len(samples) == len(flashes) > 20
    # Downwards the probe lags by the backlash, which is taken out, until it is taken up.
    play_deg = bench.motion.backlash_deg if sweep.to_deg < samples[0].angle_deg else 0.0
    off = [sample.angle_deg - (flash.angle_deg or math.nan) for sample, flash in zip(samples, flashes, strict=True)]
    # A reading is of any moment between question and answer: 1 ms off in the simulation.
    most_deg = sweep.speed_deg_s * 2e-3
    assert all(-most_deg <= each <= play_deg + most_deg for each in off)
    after_play = off[len(off) // 3 :]
    assert max(map(abs, after_play)) <= most_deg
    # What it is said to be off by is what it is off by.
    sigmas = [sample.angle_sigma_deg for sample in samples]
    spread = math.sqrt(
        sum((each / sigma) ** 2 for each, sigma in zip(after_play, sigmas[-len(after_play) :], strict=True))
        / len(after_play)
    )
    assert 0.3 < spread < 2.0
    assert {sample.sweep.number for sample in samples if sample.sweep} == {1}
    speeds = sorted(sample.sweep.speed_deg_s for sample in samples if sample.sweep)
    direction = math.copysign(1, sweep.to_deg - samples[0].angle_deg)
    assert speeds[len(speeds) // 2] == pytest.approx(direction * sweep.speed_deg_s, rel=0.01)
    bench.require_permitted()


@pytest.mark.parametrize("delay_s", [5e-3, -30e-3, 30e-3])
def test_a_delay_that_nobody_knows_shifts_all_angles_by_the_way_of_the_probe_and_loses_no_pulse(delay_s: float) -> None:
    bench = SweepBench(delay_s=delay_s)
    samples = samples_of(bench, TO_END)
    flashes = bench.flashes()
    off = [sample.angle_deg - (flash.angle_deg or 0.0) for sample, flash in zip(samples, flashes, strict=True)][9:-9]
    assert sum(off) / len(off) == pytest.approx(-delay_s * TO_END.speed_deg_s, abs=0.015)
    # The unmeasured 10 ms, and what the age of the stage's answers leaves open.
    assert samples[0].sweep is not None
    assert samples[0].sweep.delay_sigma_s == pytest.approx(math.hypot(10e-3, 4e-3 / math.sqrt(12)), rel=1e-3)


def test_a_stamp_that_lies_further_ahead_than_any_delay_of_the_rig_is_a_fault() -> None:
    bench = SweepBench(delay_s=-30e-3, light={"stamp_delay_sigma_s": 1e-4})
    bench.laser.stamp_delay_s = 0.0
    events = drain(bench.run(Sweeps(TO_END)), LaserError)
    assert "its clock is wrong" in str(events[-1].error)


def test_a_delay_that_was_measured_is_taken_out() -> None:
    bench = SweepBench(delay_s=20e-3, light={"stamp_delay_sigma_s": 1e-3})
    samples = samples_of(bench, TO_END)
    flashes = bench.flashes()
    assert 17e-3 < bench.laser.stamp_delay_s < 23e-3
    off = [sample.angle_deg - (flash.angle_deg or 0.0) for sample, flash in zip(samples, flashes, strict=True)][9:-9]
    left_s = bench.laser.stamp_delay_s - 20e-3
    assert sum(off) / len(off) == pytest.approx(left_s * TO_END.speed_deg_s, abs=0.015)
    assert samples[0].sweep is not None
    assert samples[0].sweep.delay_sigma_s < 2e-3


@pytest.mark.parametrize("jitter_s", [1e-3, 3e-3])
def test_a_fast_laser_whose_stamps_jitter_is_no_fault_and_says_how_far_it_is_off(jitter_s: float) -> None:
    bench = SweepBench(rate_hz=100.0, light={"stamp_jitter_s": jitter_s}, motion=FAST)
    samples = samples_of(bench, structs.replace(TO_END, speed_deg_s=25.0))
    flashes = bench.flashes()
    assert len(samples) == len(flashes) > 300
    # At full speed, where the chords between two readings are straight.
    off = [
        (sample.angle_deg - (flash.angle_deg or 0.0)) / sample.angle_sigma_deg
        for sample, flash in zip(samples, flashes, strict=True)
        if abs(sample.angle_deg) < 20.0
    ]
    assert np.std(off) == pytest.approx(jitter_s / 1.5e-3, rel=0.3)


def test_some_pulses_give_no_light_and_a_backlash_that_is_not_what_the_rig_states_stays_in_the_angles() -> None:
    motion = structs.replace(FAST, backlash_deg=0.2, stated_backlash_deg=0.05)
    bench = SweepBench(start_deg=35.0, rate_hz=100.0, motion=motion, light={"without_light": 0.1})
    samples = samples_of(bench, Sweep(to_deg=-35.0, speed_deg_s=10.0))
    flashes = bench.flashes()
    # Four standard deviations of a binomial count.
    dark = sum(flash.energy == 0 for flash in flashes)
    assert abs(dark - 0.1 * len(flashes)) < 4 * math.sqrt(0.09 * len(flashes))
    off = [sample.angle_deg - (flash.angle_deg or 0.0) for sample, flash in zip(samples, flashes, strict=True)]
    assert np.median(off) == pytest.approx(0.05 - 0.2, abs=0.02)


@pytest.mark.parametrize("kind", [Hasty, Pausing])
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_a_laser_that_fires_faster_than_permitted_is_a_fault(rate_hz: float, kind: type[SimulatedLaser]) -> None:
    bench = SweepBench(rate_hz=rate_hz)
    bench.laser.__class__ = kind
    events = drain(bench.run(Sweeps(TO_END)), LaserError)
    assert "is the least that was permitted; check the laser's trigger" in str(events[-1].error)
    assert bench.scanner.guard.state is State.FAULT
    # Noticed within a few readings.
    assert bench.scanner.clock.now_s() < 3.0


@pytest.mark.parametrize("readout_s", [0.0, 10.0])
@pytest.mark.parametrize("start_deg", [-35.0, 35.0])
def test_a_sweep_turns_back_in_light_and_each_pulse_has_its_angle(start_deg: float, readout_s: float) -> None:
    bench = SweepBench(start_deg=start_deg, readout_s=readout_s, motion=FAST, rate_hz=100.0)
    sweep = Sweep(to_deg=-start_deg, speed_deg_s=25.0, back_deg=start_deg)
    began_s = bench.scanner.clock.now_s()
    samples = samples_of(bench, sweep)
    flashes = bench.flashes()
    assert bench.scanner.clock.now_s() - began_s < bench.scanner.sweeping.duration_s(sweep, from_deg=start_deg) + 11
    assert bench.stage.angle_deg == pytest.approx(start_deg, abs=0.01)
    speeds = np.array([sample.sweep.speed_deg_s for sample in samples if sample.sweep])
    off = np.array([sample.angle_deg - (flash.angle_deg or 0) for sample, flash in zip(samples, flashes, strict=True)])
    # One permit; both ways in light at the full speed, and at its ends and its turn no gap in it.
    assert len(bench.permits) == 1
    assert {round(speed) for speed in speeds if abs(speed) > 24.5} == {-25, 25}
    apart_s = [after.at_s - before.at_s for before, after in pairwise(flashes)]
    assert max(apart_s) < 1.01 * bench.permits[0].period_s
    assert len(samples) > 2 * 70 / 25 / bench.permits[0].period_s
    # Where the backlash is taken up, and where a chord bends, it may be off by more than the stage's answers are old.
    plays = np.array([sample.sweep.play_sigma_deg for sample in samples if sample.sweep])
    assert set(plays[speeds < -1]) == {bench.motion.backlash_deg / 2}
    assert set(plays[speeds > 1]) == {0.0}
    assert np.abs(off).max() <= bench.motion.backlash_deg + 25.0 * 0.054**2 / 8 + 25.0 * 2e-3
    assert np.abs(off[np.abs(speeds) > 24.9]).max() <= 25.0 * 2e-3
    bench.require_permitted()


@pytest.mark.parametrize("to_deg", np.arange(9.0, 10.0, 0.25))
@pytest.mark.parametrize("kind", [SimulatedStage, Short])
def test_it_turns_back_whenever_the_stage_is_read_and_however_near_it_comes(
    to_deg: float, kind: type[SimulatedStage]
) -> None:
    bench = SweepBench(motion=FAST, readout_s=0.2, start_deg=-10.0)
    bench.stage.__class__ = kind
    samples = samples_of(bench, Sweep(to_deg=float(to_deg), speed_deg_s=25.0, back_deg=-10.0))
    assert samples[-1].angle_deg < -8.0
    assert len(samples) == len(bench.flashes())


@pytest.mark.parametrize("until_deg", [5.0, 9.97])
def test_a_policy_that_ends_a_sweep_before_or_where_it_turns_is_no_fault(until_deg: float) -> None:
    bench = SweepBench(motion=FAST, start_deg=-10.0)
    policy = Sweeps(Sweep(to_deg=10.0, speed_deg_s=10.0, back_deg=-10.0), until_deg=until_deg)
    (ended,) = (event for event in bench.run(policy) if isinstance(event, Swept))
    assert until_deg < ended.angle_deg < 10.01


def test_a_stage_that_does_not_turn_back_ends_the_light_within_seconds() -> None:
    bench = SweepBench(motion=FAST)
    bench.stage.__class__ = Staying
    sweep = Sweep(to_deg=35.0, speed_deg_s=25.0, back_deg=0.0)
    events = drain(bench.run(Sweeps(sweep)), MoveError)
    assert "turned back" in str(events[-1].error)
    assert bench.scanner.guard.state is State.FAULT
    rests_s = 70 / 25 + 1
    assert max(flash.at_s for flash in bench.flashes()) < rests_s + 2.0


def test_a_run_asks_once_and_hands_out_a_sample_for_each_pulse() -> None:
    bench = SweepBench()
    policy = Sweeps(TO_END)
    events = list(bench.run(policy))
    asked = [event for event in events if isinstance(event, Asked)]
    assert [(each.index, each.angle_deg) for each in asked] == [(1, 35.0)]
    assert asked[0].sweep == structs.replace(TO_END, from_deg=asked[0].sweep and asked[0].sweep.from_deg)
    measured = [event for event in events if isinstance(event, Measured)]
    assert [event.index for event in measured] == list(range(1, len(bench.flashes()) + 1))
    assert [event.sample for event in measured] == policy.samples
    finished = events[-1]
    assert isinstance(finished, Finished)
    assert finished.acquisitions == len(measured)
    assert finished.travel_deg == pytest.approx(70.0, abs=0.02)
    assert finished.elapsed_s == pytest.approx(70 / 10 + 10 / 25, abs=0.8)
    assert bench.scanner.guard.state is State.DISARMED


@pytest.mark.parametrize("readout_s", [0.0, 10.0])
def test_a_policy_that_knows_enough_ends_a_sweep_and_no_pulse_is_lost(readout_s: float) -> None:
    bench = SweepBench(readout_s=readout_s)
    policy = Sweeps(TO_END, until_deg=0.0)
    events = list(bench.run(policy))
    swept = next(event for event in events if isinstance(event, Swept))
    assert swept.pulses == len(policy.samples) == len(bench.flashes())
    if readout_s == 0:
        # One reading and one pulse later the light is off; v²/2a is two degrees.
        assert 1.5 < swept.angle_deg < 4.0
        assert policy.samples[-1].angle_deg < 2.0
    else:
        # All frames of a burst come at its end.
        assert swept.angle_deg == pytest.approx(35.0, abs=0.01)


@pytest.mark.parametrize(
    ("way_deg", "rate_hz", "speed_deg_s", "acceleration_deg_s2"),
    [(1.6, 20.0, 8.6, 10.0), (3.46, 1000.0, 8.6, 10.0), (6.0, 100.0, 12.5, 25.0), (12.0, 20.0, 12.5, 25.0)],
)
def test_most_of_a_way_is_lit_on_which_the_probe_does_not_reach_its_speed(
    way_deg: float,
    speed_deg_s: float,
    acceleration_deg_s2: float,
    rate_hz: float,
) -> None:
    motion = StageMotion(speed_deg_s=speed_deg_s, acceleration_deg_s2=acceleration_deg_s2)
    bench = SweepBench(motion=motion, rate_hz=rate_hz)
    samples = samples_of(bench, Sweep(to_deg=-35.0 + way_deg, speed_deg_s=speed_deg_s))
    angles_deg = [sample.angle_deg for sample in samples]
    apart_deg = float(np.diff(angles_deg).max())
    # Three quarters of the way, but for what is left before the first pulse and after the last.
    assert max(angles_deg) - min(angles_deg) >= 0.75 * way_deg - 2 * apart_deg
    assert apart_deg < 0.7
    bench.require_permitted()


@pytest.mark.parametrize(
    ("readout_s", "there_deg", "lasts_s"), [(10.0, -5.0, 10.0), (2.0, 35.0, 2.0), (0.0, 35.0, 0.15)]
)
def test_the_probe_turns_without_light_while_its_frames_are_read_if_there_is_time(
    readout_s: float, there_deg: float, lasts_s: float
) -> None:
    bench = SweepBench(readout_s=readout_s)
    events = list(bench.run(Sweeps(structs.replace(TO_END, wait_deg=-5.0))))
    (swept,) = (event for event in events if isinstance(event, Swept))
    assert swept.angle_deg == pytest.approx(there_deg, abs=0.02)
    assert bench.scanner.guard.state is State.DISARMED
    assert bench.scanner.angle_deg == pytest.approx(swept.angle_deg, abs=1e-3)
    # It turned while they were read and no longer, and each frame has the angle of its pulse.
    last_s = bench.flashes()[-1].at_s
    assert bench.scanner.clock.now_s() - last_s == pytest.approx(lasts_s, abs=0.1)
    bench.require_permitted()
    samples = [event.sample for event in events if isinstance(event, Measured)]
    assert len(samples) == swept.pulses > 100
    for sample, flash in zip(samples, bench.flashes(), strict=True):
        assert sample.angle_deg == pytest.approx(flash.angle_deg, abs=0.05)
    assert isinstance(events[-1], Finished)
    assert events[-1].travel_deg == pytest.approx(70.0 + abs(35.0 - there_deg), abs=0.5)


def test_an_obstacle_on_the_way_to_where_it_waits_is_a_fault() -> None:
    bench = SweepBench(readout_s=10.0)
    bench.stage.move_to = lambda _: 30.0  # type: ignore[method-assign]
    with pytest.raises(MoveError, match="sent to -5"):
        list(bench.run(Sweeps(structs.replace(TO_END, wait_deg=-5.0))))
    assert bench.scanner.guard.state is State.FAULT


@pytest.mark.parametrize(
    ("sweep", "error", "said"),
    [
        (Sweep(to_deg=35.0, speed_deg_s=12.6), ConfigError, "at most 12.5 deg/s"),
        (Sweep(to_deg=35.0, speed_deg_s=1.0), ConfigError, "sweep faster"),
        (Sweep(to_deg=35.5, speed_deg_s=10.0), LimitError, "outside the search range"),
        (Sweep(to_deg=35.0, speed_deg_s=10.0, wait_deg=-35.5), LimitError, "outside the search range"),
        (Sweep(to_deg=35.0, speed_deg_s=10.0, back_deg=-35.5), LimitError, "outside the search range"),
        (Sweep(to_deg=34.0, speed_deg_s=10.0, back_deg=34.5), ConfigError, "it must turn back there"),
    ],
)
def test_a_sweep_that_cannot_be_made_moves_nothing(sweep: Sweep, error: type[Exception], said: str) -> None:
    bench = SweepBench()
    with pytest.raises(error, match=said):
        list(bench.run(Sweeps(sweep)))
    assert not bench.flashes()
    assert bench.stage.angle_deg == pytest.approx(-35.0, abs=1e-3)
    assert bench.scanner.guard.state is not State.FAULT


@pytest.mark.parametrize("kind", [Fast, Running])
def test_a_stage_that_does_not_do_its_part_ends_light_and_motion(kind: type[SimulatedStage]) -> None:
    bench = SweepBench()
    bench.stage.__class__ = kind
    policy = Sweeps(TO_END)
    events = drain(bench.run(policy), MoveError)
    assert isinstance(events[-1], Failed)
    assert bench.scanner.guard.state is State.FAULT
    fired = len(bench.flashes())
    at_s = bench.rig.scanner.clock.now_s()
    stood_deg = bench.world.angle_deg
    bench.scanner.clock.wait(10.0)
    bench.laser.pulses()
    assert len(bench.flashes()) == fired
    assert all(flash.at_s <= at_s for flash in bench.flashes())
    _ = bench.stage.angle_deg
    # It brakes, and is inside its permit.
    assert abs(bench.world.angle_deg - stood_deg) <= bench.stage._sweep_deg_s**2 / (2 * 25.0) + 0.1
    assert -35.1 <= bench.world.angle_deg <= 35.1


def test_stamps_that_are_wrong_though_each_lies_between_two_readings_give_no_answer() -> None:
    bench = SweepBench()
    bench.laser.__class__ = Ahead
    drain(bench.run(Sweeps(TO_END)), LaserError)
    assert bench.scanner.guard.state is State.FAULT


def test_a_sweep_that_is_left_ends_the_light_and_the_motion_by_itself() -> None:
    bench = SweepBench()
    bench.scanner.guard.arm(by="a test")
    outcomes = bench.scanner.take(TO_END, number=1, goes_on=lambda: True)
    for _ in range(30):
        next(outcomes)
    outcomes.close()
    at_deg = bench.stage.probe_deg(bench.scanner.clock.now_s())
    fired = len(bench.flashes())
    bench.scanner.clock.wait(5.0)
    bench.laser.pulses()
    assert len(bench.flashes()) == fired
    # It brakes at once, in v²/2a, and does not go on to its next target.
    assert abs(bench.stage.angle_deg - at_deg) == pytest.approx(2.0, abs=0.1)


def test_a_burst_that_loses_a_frame_is_refused_whole_and_swept_again_from_its_beginning() -> None:
    bench = SweepBench(readout_s=10.0)
    bench.receiver.__class__ = Losing
    policy = Sweeps(TO_END)
    events = drain(bench.run(policy, limits=RunLimits(attempts=2)), AcquisitionError)
    assert [type(event) for event in events[1:]] == [Asked, Refused, Asked, Failed]
    assert policy.samples == []
    # Each try begins where the sweep began.
    first, second = (event for event in events if isinstance(event, Asked))
    assert first == second
    assert bench.permits[1].angle_deg == pytest.approx(-35.0, abs=0.1)
    bench.require_permitted()


def test_a_burst_that_was_refused_once_is_swept_anew_from_its_beginning() -> None:
    bench = SweepBench(readout_s=10.0)
    policy = Sweeps(TO_END)
    bench.receiver.__class__ = Losing
    events = []
    for event in bench.run(policy):
        events.append(event)
        if isinstance(event, Refused):
            bench.receiver.__class__ = SimulatedReceiver
    assert [type(event) for event in events if not isinstance(event, Measured)] == [
        *(type(event) for event in events[:1]),
        Asked,
        Refused,
        Asked,
        Swept,
        Finished,
    ]
    assert policy.samples[0].angle_deg < -34
    assert {sample.sweep.number for sample in policy.samples if sample.sweep} == {2}
    bench.require_permitted()


def test_a_supervisor_that_is_gone_in_mid_sweep_is_an_error_once_the_light_has_ended() -> None:
    bench = SweepBench()
    dark: list[bool] = []

    class Gone:
        def hold(self) -> None:
            pass

        def release(self) -> None:
            dark.append(bench.laser._sweep is None)
            raise NotConnectedError("the supervisor is gone")

    bench.scanner._watchdog_held = _WatchdogHeld(Gone())
    outcomes = bench.scanner.take(TO_END, number=1, goes_on=lambda: True)
    assert isinstance(next(outcomes), Sample)
    with pytest.raises(NotConnectedError, match="the supervisor is gone"):
        outcomes.close()
    assert dark == [True]


def test_a_permit_has_room_for_a_stage_that_is_slower_than_it_says() -> None:
    bench = SweepBench()
    permit: SweepPermit = bench.scanner.sweeping.permit(TO_END, from_deg=-35.0)
    assert permit.pulses >= 1.09 * 20 * bench.scanner.sweeping.duration_s(TO_END, from_deg=-35.0)
    assert permit.fastest_deg_s < 2 * TO_END.speed_deg_s
