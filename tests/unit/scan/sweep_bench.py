"""A simulated rig that sweeps, its devices to be broken, and the truth about what it did."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from msgspec import structs

from markerseek import rigs
from markerseek.core import (
    Estimate,
    Event,
    Frame,
    NotFound,
    Pulse,
    Sample,
    StageReading,
    Sweep,
    SweepPermit,
)
from markerseek.scan import Scanner, run
from markerseek.sim import (
    CurveWorld,
    GaussianCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    StageMotion,
)
from markerseek.sim.world import Flash

TO_END = Sweep(to_deg=35.0, speed_deg_s=10.0)


class Sweeps:
    """A policy that asks for sweeps, and ends one once a sample lies beyond an angle."""

    def __init__(self, *sweeps: Sweep, until_deg: float = math.inf) -> None:
        self.left = list(sweeps)
        self.until_deg = until_deg
        self.samples: list[Sample] = []
        self.ended = False

    def ask(self) -> Sweep | None:
        """The next sweep, until it was over."""
        return self.left[0] if self.left else None

    def tell(self, sample: Sample) -> None:
        """Take a sample."""
        self.samples.append(sample)
        if self.left and sample.angle_deg > self.until_deg:
            self.ended = True
            self.left = self.left[1:]

    def end_sweep(self) -> None:
        """Go on to the next sweep, unless this one was ended here."""
        self.left = self.left if self.ended else self.left[1:]
        self.ended = False

    def estimate(self) -> Estimate:
        """Nothing."""
        return NotFound(mean_deg=0.0, reason="a test")


@dataclass
class SweepBench:
    """A simulated rig of intensities; its scanner is made of its devices when it runs."""

    motion: StageMotion = field(default_factory=lambda: StageMotion(speed_deg_s=12.5, acceleration_deg_s2=25.0))
    rate_hz: float = 20.0
    readout_s: float = 0.0
    start_deg: float = -35.0
    delay_s: float = 0.0
    jitter: float = 0.1
    light: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settings = SimulatedSettings(start_deg=self.start_deg, stage=self.motion)
        light = structs.replace(
            settings.laser, rate_hz=self.rate_hz, energy_jitter=self.jitter, stamp_delay_s=self.delay_s
        )
        light = structs.replace(light, **self.light)
        receiver = structs.replace(
            settings.receiver, readout_s=self.readout_s, frame_period_s=max(self.readout_s, 1e-3)
        )
        if self.readout_s > 0.1:
            receiver = structs.replace(receiver, frame_period_s=0.05)
        self.rig = rigs.of_intensities(
            seed=1,
            curve=GaussianCurve(fwhm_deg=6.0),
            marker_deg=5.0,
            settings=structs.replace(settings, laser=light, receiver=receiver),
        )
        self.permits: list[SweepPermit] = []
        issue = self.rig.scanner.guard.issue_sweep

        def noted(wanted: SweepPermit, *, now_s: float) -> SweepPermit:
            permit = issue(wanted, now_s=now_s)
            self.permits.append(permit)
            return permit

        self.rig.scanner.guard.issue_sweep = noted  # type: ignore[method-assign]

    @property
    def scanner(self) -> Scanner:
        return self.rig.scanner

    @property
    def stage(self) -> SimulatedStage:
        stage = self.rig.stage
        assert isinstance(stage, SimulatedStage)
        return stage

    @property
    def laser(self) -> SimulatedLaser:
        laser = self.rig.laser
        assert isinstance(laser, SimulatedLaser)
        return laser

    @property
    def receiver(self) -> SimulatedReceiver:
        receiver = self.rig.receiver
        assert isinstance(receiver, SimulatedReceiver)
        return receiver

    @property
    def world(self) -> CurveWorld:
        world = self.laser._world
        assert isinstance(world, CurveWorld)
        return world

    def run(self, policy: Sweeps, **options: object) -> Generator[Event, None, None]:
        return run(policy, self.scanner, **options)  # type: ignore[arg-type]

    def flashes(self) -> Sequence[Flash]:
        return self.world.flashes

    def require_permitted(self) -> None:
        """P3, by the truth: every pulse of a sweep under one permit, inside its angles, no faster than its rate."""
        flashes = [flash for flash in self.flashes() if flash.angle_deg is not None]
        # Each permit's pulses begin after those of the one before; the rig numbers no permit in a flash.
        left = list(flashes)
        for permit in self.permits:
            mine = [flash for flash in left if flash.at_s <= permit.expires_s][: permit.pulses]
            later = [each for each in self.permits if each.expires_s > permit.expires_s]
            if later:
                began_s = later[0].expires_s - (permit.expires_s - self.issued_s(permit))
                mine = [flash for flash in mine if flash.at_s < began_s]
            left = left[len(mine) :]
            assert all(flash.pulses == 1 for flash in mine)
            low_deg, *_, high_deg = sorted((permit.angle_deg, permit.to_deg, permit.end_deg))
            for flash in mine:
                assert flash.angle_deg is not None
                # 0.1 deg: what readback and target may differ by, and the play that no encoder sees.
                assert low_deg - 0.1 <= flash.angle_deg <= high_deg + 0.1 + self.motion.backlash_deg
            for before, after in pairwise(mine):
                apart_s = after.at_s - before.at_s
                assert apart_s >= 0.999 * permit.period_s
                assert before.angle_deg is not None
                assert after.angle_deg is not None
                turned_deg = permit.forward * (after.angle_deg - before.angle_deg)
                assert abs(turned_deg) <= permit.fastest_deg_s * apart_s + 0.1
                assert turned_deg >= 0 or permit.back_deg is not None
        assert not left

    def issued_s(self, permit: SweepPermit) -> float:
        """When a permit was issued; all live for as long."""
        return permit.expires_s - 30.0


class Fast(SimulatedStage):
    """Turns twice as fast as it was told."""

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        super().prepare_sweep(speed_deg_s=2 * speed_deg_s)


class Staying(SimulatedStage):
    """Does not turn back."""

    begun = 0

    def begin_sweep(self, to_deg: float) -> None:
        self.begun += 1
        if self.begun == 1:
            super().begin_sweep(to_deg)


class Short(SimulatedStage):
    """Comes to rest nearer to an upper end than the guard sees, and not quite there."""

    def begin_sweep(self, to_deg: float) -> None:
        super().begin_sweep(to_deg - 0.05)


class Running(SimulatedStage):
    """Does not brake at its end."""

    def read_sweep(self) -> StageReading:
        reading = super().read_sweep()
        return structs.replace(reading, angle_deg=reading.angle_deg + max(0.0, reading.angle_deg - 30.0))


class Ahead(SimulatedLaser):
    """Its clock jumps by less than the probe needs to come to rest: all stamps lie between two readings."""

    def pulses(self) -> Sequence[Pulse]:
        jump_s = 0.2 if self._fired > 30 else 0.0
        return [structs.replace(pulse, at_s=pulse.at_s + jump_s) for pulse in super().pulses()]


class Hasty(SimulatedLaser):
    """Fires 1.5 times as fast as permitted."""

    def begin_sweep(self, permit: SweepPermit) -> None:
        super().begin_sweep(structs.replace(permit, period_s=permit.period_s / 1.5))


class Pausing(SimulatedLaser):
    """Pauses for half a second, and makes up for it in 0.1 s."""

    def _fire_until(self, now_s: float) -> None:
        if not 1.0 < now_s - self._began_s < 1.6:
            super()._fire_until(now_s)

    def _fire_one(self, at_s: float) -> None:
        since_s = at_s - self._began_s - 1.0
        super()._fire_one(at_s + 0.5 - since_s * 5 / 6 if 0 < since_s < 0.6 else at_s)


class Losing(SimulatedReceiver):
    """Misses the thirtieth trigger of each sweep, and counts those that it got."""

    def _swept(self, now_s: float) -> list[Frame]:
        kept: list[Frame] = []
        for frame in super()._swept(now_s):
            self.triggers += 1
            if self.triggers == 30:
                self.sequence -= 1
                continue
            late = self.triggers > 30
            kept.append(
                structs.replace(frame, header=structs.replace(frame.header, sequence=frame.header.sequence - late))
            )
        return kept

    def begin_sweep(self, permit: SweepPermit) -> None:
        super().begin_sweep(permit)
        self.triggers = 0
