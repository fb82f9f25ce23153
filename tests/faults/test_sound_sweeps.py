"""Sweeps of a sound stage behind a busy computer: none is refused; and of one whose coupling slips: noticed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import DeviceError, Sample, Sweep, Swept
from markerseek.drivers import Kdc101Settings, Kdc101Stage, LaserBox, LaserBoxSettings
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.guard import Admission, FiringLimits, Guard, State
from markerseek.scan import Scanner
from markerseek.sim import CurveWorld, GaussianCurve, SimulatedReceiver, SimulatedSettings
from markerseek.wire import apt
from tests.faults.late_lines import DelayedBench, DelayedClock, Delays

HELD_UP = 0.05
"""Share of its steps at which a process is held up, for 20 ms at most: a load of 8, less the host's long pauses."""

BEAT_S = 0.02


class BeatingClock(DelayedClock):
    """Renews the laser box's lease in each wait, as the clock of a rig does."""

    laser: LaserBox | None = None

    def wait(self, duration_s: float) -> None:
        left_s = duration_s
        self._renew()
        while left_s > 0:
            step_s = min(left_s, BEAT_S)
            super().wait(step_s)
            left_s -= step_s
            self._renew()

    def _renew(self) -> None:
        if self.laser is not None:
            self.laser.beat()


class Bench:
    """The real drivers of stage and laser box on emulated devices that one process serves; intensities, no images."""

    def __init__(self, number: int, *, held_up: float, settle_deg: float) -> None:
        rng = np.random.Generator(np.random.PCG64(number))
        self.speed_deg_s = float(rng.choice((10.0, 20.0, 25.0)))
        acceleration_deg_s2 = float(rng.choice((10.0, 25.0)))
        settings = SimulatedSettings(start_deg=float(rng.choice((-35.0, 0.0, 20.0))))
        # Nothing is held up while the devices are connected.
        host = Delays(rng=rng, share=0.0, most_s=0.02)
        served = Delays(rng=rng, share=0.0, most_s=0.02)
        clock = BeatingClock(host)
        lines = DelayedBench(clock=clock, delays=served)

        class World(CurveWorld):
            """A world whose flashes have the time of the host's clock, and not that of the box's."""

            def flash(self, *, pulses: int, at_s: float) -> None:
                super().flash(pulses=pulses, at_s=lines.served_s)

        curve = GaussianCurve(fwhm_deg=6.0)
        world = World(settings, curve=curve, marker_deg=5.0, cells=10_000, rng=rng, noise_stated=True)
        self.emulator = Kdc101Emulator(probe=world, settings=EmulatedKdc101(settle_deg=settle_deg), rng=rng)

        def moment(_: float) -> float:
            self.emulator.turn(lines.served_s)
            return lines.served_s

        box = EmulatedLaserBox(world=world, on_triggers=lambda _: None, laser=settings.laser, rng=rng, moment=moment)
        stage = Kdc101Stage(
            port=lines.port(self.emulator),
            clock=clock,
            settings=Kdc101Settings(
                port="", zero_deg=0.0, speed_deg_s=self.speed_deg_s, acceleration_deg_s2=acceleration_deg_s2
            ),
        )
        laser = LaserBox(port=lines.port(box, without_pauses=True), clock=clock, settings=LaserBoxSettings(port=""))
        clock.laser = laser
        self.guard = Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission(dark_alarm=1e-6))
        reader = rigs.of_intensities(seed=1, curve=curve, marker_deg=5.0, settings=settings).scanner._reader
        self.scanner = Scanner(
            stage=stage,
            laser=laser,
            receiver=SimulatedReceiver(world=world, clock=clock, readout_s=1e-3),
            reader=reader,
            clock=clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")
        host.share = held_up / 10
        served.share = held_up
        self.sweep = (
            Sweep(to_deg=35.0, speed_deg_s=0.99 * self.speed_deg_s, from_deg=-35.0),
            Sweep(to_deg=35.0, back_deg=-35.0, speed_deg_s=0.99 * self.speed_deg_s),
            Sweep(to_deg=-35.0, speed_deg_s=0.5 * self.speed_deg_s, from_deg=20.0),
        )[number % 3]

    def outcomes(self) -> list[Any]:
        return list(self.scanner.take(self.sweep, number=1))


def bench(number: int, *, held_up: float = HELD_UP) -> Bench:
    return Bench(number, held_up=held_up, settle_deg=(0.0, 0.02, 0.05)[number % 7 % 3])


def require_sound(numbers: Iterable[int]) -> None:
    for number in numbers:
        outcomes = bench(number).outcomes()
        assert isinstance(outcomes[-1], Swept), number
        assert sum(isinstance(each, Sample) for each in outcomes) > 30, number


def test_no_sweep_of_a_sound_stage_is_refused_whatever_holds_it_up() -> None:
    # The light of the last began too early: a reading that came late had shown a probe that was still slow as fast.
    require_sound((*range(12), 36))


@pytest.mark.long
def test_nor_is_one_of_500() -> None:
    require_sound(range(500))


def slipped(number: int, slip_deg: float, *, held_up: float) -> bool | None:
    """Whether a slip at a random moment of even turning was noticed; None if there was no such moment."""
    it = bench(number, held_up=held_up)
    rng = np.random.Generator(np.random.PCG64(1000 + number))
    stage = it.emulator._stage
    advance = stage.advance
    top_deg_s = it.sweep.speed_deg_s
    turned_s = [0.0]
    # By then its readings are surely none of the run-up.
    slips_s = float(rng.uniform(0.55, 1.2))
    done: list[float] = []

    def slipping(duration_s: float) -> bool:
        stopped = advance(duration_s)
        speed_deg_s = stage.motor.speed_deg_s
        if it.guard.state is State.SWEEPING and abs(speed_deg_s) > 0.999 * top_deg_s:
            turned_s[0] += duration_s
            if not done and turned_s[0] > slips_s:
                done.append(stage.motor.angle_deg)
                stage.offset += round(math.copysign(1.0, speed_deg_s) * slip_deg * apt.COUNTS_PER_DEG)
        return stopped

    stage.advance = slipping  # type: ignore[method-assign]
    try:
        it.outcomes()
    except DeviceError:
        return True if done else None
    return False if done else None


@pytest.mark.parametrize("held_up", [0.0, pytest.param(HELD_UP, marks=pytest.mark.long)])
@pytest.mark.parametrize("slip_deg", [-0.2, 0.2])
def test_a_slip_of_a_fifth_of_a_degree_is_noticed_while_it_turns_evenly(slip_deg: float, held_up: float) -> None:
    noticed = [slipped(number, slip_deg, held_up=held_up) for number in range(24 if held_up else 12)]
    assert noticed.count(True) >= len(noticed) / 2
    assert False not in noticed
