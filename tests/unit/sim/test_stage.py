"""The simulated stage and laser against closed forms and against the world's truth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from markerseek.acoustics import Absorber, AcousticModel, Noise
from markerseek.core import Interval, Permit
from markerseek.sim import (
    LaserSettings,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedStage,
    StageMotion,
    VirtualClock,
    World,
)

TRAVEL = Interval(low_deg=-36.5, high_deg=36.5)


def world(*, start_deg: float = 0.0, energy_jitter: float = 0.0, white_sigma: float = 0.0) -> World:
    return World(
        model=AcousticModel(),
        absorbers=(Absorber(radius_m=0.06, angle_deg=0.0, strength=500.0),),
        noise=Noise(white_sigma=white_sigma),
        energy_jitter=energy_jitter,
        start_deg=start_deg,
        rng=np.random.default_rng(5),
    )


def permit(token: str = "a", *, pulses: int = 16, expires_s: float = 60.0) -> Permit:
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=expires_s)


@pytest.mark.parametrize("distance_deg", [0.3, 5.0, 10.0, 10.1, 70.0])
def test_the_duration_of_a_move_is_that_of_an_integrated_speed_profile(distance_deg: float) -> None:
    motion = StageMotion(speed_deg_s=10.0, acceleration_deg_s2=8.0)

    def speed(_time: float, place: np.ndarray) -> list[float]:
        """Fastest speed allowed from the way already gone, the way to go, and the limit: v² = 2 a s."""
        gone = max(place[0], 1e-9)
        left = max(distance_deg - place[0], 0.0)
        return [min(np.sqrt(2 * 8.0 * min(gone, left)), 10.0)]

    def arrived(_time: float, place: np.ndarray) -> float:
        return float(place[0] - (distance_deg - 1e-7))

    arrived.terminal = True  # type: ignore[attr-defined]
    solved = solve_ivp(speed, (0, 60), [0.0], events=arrived, max_step=1e-2, rtol=1e-8)
    assert motion.duration_s(distance_deg) == pytest.approx(solved.t_events[0][0], rel=2e-3)
    assert motion.duration_s(-distance_deg) == motion.duration_s(distance_deg)


@given(targets=st.lists(st.floats(-35, 35), min_size=1, max_size=8))
def test_every_target_is_reached_from_below_so_that_play_never_shows(targets: list[float]) -> None:
    truth = world()
    stage = SimulatedStage(world=truth, clock=VirtualClock(), motion=StageMotion(backlash_deg=0.3), travel=TRAVEL)
    for target in targets:
        reached = stage.move_to(target)
        assert abs(reached - target) <= 0.5 / 1919.6418
        assert truth.angle_deg == pytest.approx(reached, abs=1e-12)


def test_without_the_approach_from_below_the_play_shows_in_truth_and_not_in_the_readback() -> None:
    truth = world()
    motion = StageMotion(backlash_deg=0.3, approach_deg=0.0)
    stage = SimulatedStage(world=truth, clock=VirtualClock(), motion=motion, travel=TRAVEL)
    stage.move_to(10.0)
    reached = stage.move_to(5.0)
    assert reached == pytest.approx(5.0, abs=3e-4)
    assert truth.angle_deg - reached == pytest.approx(0.3)


def test_a_move_takes_its_time_and_the_approach_too() -> None:
    clock = VirtualClock()
    motion = StageMotion(settle_s=0.1)
    stage = SimulatedStage(world=world(), clock=clock, motion=motion, travel=TRAVEL)
    stage.move_to(20.0)
    assert clock.now_s() == pytest.approx(3.0 + 0.1, abs=1e-3)
    stage.move_to(10.0)
    assert clock.now_s() == pytest.approx(3.1 + motion.duration_s(11) + motion.duration_s(1) + 0.1, abs=1e-3)


def test_the_receiver_records_the_flash_and_without_one_only_noise() -> None:
    clock = VirtualClock()
    truth = world(white_sigma=2.0)
    laser = SimulatedLaser(world=truth, clock=clock)
    receiver = SimulatedReceiver(world=truth, clock=clock, readout_s=10.0)
    receiver.arm(permit("a"))
    laser.fire(permit("a"))
    lit = receiver.acquire(permit("a"))
    receiver.arm(permit("b", pulses=0))
    laser.fire(permit("b", pulses=0))
    dark = receiver.acquire(permit("b", pulses=0))
    assert (lit.header.pulses, dark.header.pulses) == (16, 0)
    assert (lit.header.sequence, dark.header.sequence) == (1, 2)
    assert np.abs(lit.samples).max() > 100
    assert np.std(dark.samples) == pytest.approx(2.0, rel=0.03)
    assert clock.now_s() == pytest.approx(20.16)


def test_the_energy_of_an_acquisition_varies_and_drifts_and_a_meter_reports_it_with_its_own_noise() -> None:
    """ln energy scatters by the spread about the drift; what the header says is the true energy but for the meter."""
    clock = VirtualClock()
    truth = world()
    rng = np.random.default_rng(8)
    light = LaserSettings(energy_spread=0.05, energy_drift_per_min=0.1)
    laser = SimulatedLaser(world=truth, clock=clock, light=light, rng=rng)
    receiver = SimulatedReceiver(world=truth, clock=clock, readout_s=0.59, meter_noise=0.01, rng=rng)
    reported = []
    fired_s = []
    for number in range(400):
        asked = permit(str(number), pulses=1, expires_s=1e9)
        receiver.arm(asked)
        fired_s.append(clock.now_s())
        laser.fire(asked)
        reported.append(receiver.acquire(asked).header.energy)
    dark = permit("dark", pulses=0, expires_s=1e9)
    receiver.arm(dark)
    laser.fire(dark)
    assert receiver.acquire(dark).header.energy is None
    true = np.array([flash.energy for flash in truth.flashes])
    away = np.log(true) - 0.1 * np.array(fired_s) / 60
    assert (away.mean(), away.std()) == pytest.approx((0.0, 0.05), abs=0.008)
    differ = np.array(reported) / true - 1
    assert (differ.mean(), differ.std()) == pytest.approx((0.0, 0.01), abs=0.0015)
