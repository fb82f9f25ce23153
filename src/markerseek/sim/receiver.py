"""A simulated receiver: it acquires the frame of the flash since it was armed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.core import (
    AcquisitionError,
    Clock,
    ConfigError,
    Frame,
    FrameHeader,
    Permit,
    SweepPermit,
)
from markerseek.sim.world import Flash, SimulatedWorld


class SimulatedReceiver:
    """Receiver of a simulated world.

    ``readout_s``: time to read one acquisition from the device: about 10 s for SonixDAQ files (paper, section 4).
    ``meter_noise``: relative standard deviation of an energy meter, whose value stands in the header.
    ``frame_period_s``: least time between two triggers of a sweep. One that needs longer than that to be read is read
    at the end of a sweep, once.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        clock: Clock,
        readout_s: float,
        meter_noise: float | None = None,
        frame_period_s: float = 0.05,
        rng: np.random.Generator | None = None,
    ) -> None:
        if meter_noise is not None and rng is None:
            raise ConfigError(f"receiver: meter_noise is {meter_noise}, and there is no rng to draw it from")
        self._world = world
        self._clock = clock
        self._readout_s = readout_s
        self._meter_noise = meter_noise
        self._rng = rng
        self.frame_period_s = frame_period_s
        self.sequence = 0
        self._sweep: SweepPermit | None = None
        self._heard = 0
        self._armed: tuple[Permit, int, float] | None = None

    def settle(self) -> None:
        """Nothing to wait for: a simulated frame is never late."""

    def arm(self, permit: Permit) -> None:
        """Get ready for the flash that the laser will give under this permit."""
        self._armed = (permit, len(self._world.flashes), self._clock.now_s())

    def acquire(self, permit: Permit) -> Frame:
        """Return the averaged frame of the flash since `arm`; noise alone where there was none."""
        if self._armed is None or self._armed[0] != permit:
            raise AcquisitionError(f"receiver: it was not armed for the permit {permit.token!r}; arm it before firing")
        _, flashes_before, started_s = self._armed
        # Disarmed before the readout: one arming serves one acquisition, also one that fails.
        self._armed = None
        new = self._world.flashes[flashes_before:]
        self._clock.wait(self._readout_s)
        self.sequence += 1
        header = FrameHeader(
            sequence=self.sequence,
            token=permit.token,
            # The pulses that were fired, not those of the permit: the guard compares the two.
            pulses=sum(flash.pulses for flash in new),
            commanded_deg=permit.angle_deg,
            started_s=started_s,
            ended_s=self._clock.now_s(),
            energy=self._energy(new[-1]) if new else None,
        )
        return self._world.frame(new[-1] if new else None, header=header)

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Get ready for one flash after the other."""
        self._sweep = permit
        self._heard = len(self._world.flashes)

    @property
    def sweep_readout_s(self) -> float:
        """Time to read all frames of a sweep, in seconds; 0 where each is read before the next."""
        return 0.0 if self._readout_s <= self.frame_period_s else self._readout_s

    def frames(self) -> Sequence[Frame]:
        """Return the frames of the flashes that have been read by now; none where they are read at the end."""
        return () if self.sweep_readout_s > 0 else self._swept(self._clock.now_s())

    def end_sweep(self, *, pulses: int) -> Sequence[Frame]:  # noqa: ARG002  flashes alone trigger it
        """Return the frames that are left, after the read-out."""
        # All of them are read from the last flash on, each by itself from when it is asked for.
        flashes = self._world.flashes[self._heard :]
        now_s = self._clock.now_s()
        begun_s = flashes[-1].at_s if flashes and self.sweep_readout_s > 0 else now_s
        self._clock.wait(max(0.0, begun_s + self._readout_s - now_s))
        frames = self._swept(self._clock.now_s())
        self._sweep = None
        return frames

    def _swept(self, now_s: float) -> list[Frame]:
        """Return the frames of the flashes that were read until then, with the probe where it was at each."""
        frames: list[Frame] = []
        stands_deg = self._world.angle_deg
        for flash in self._world.flashes[self._heard :]:
            if self._sweep is None or not flash.at_s + min(self._readout_s, self.frame_period_s) <= now_s:
                break
            self._heard += 1
            self.sequence += 1
            header = FrameHeader(
                sequence=self.sequence,
                token=self._sweep.token,
                pulses=flash.pulses,
                commanded_deg=self._sweep.to_deg,
                started_s=flash.at_s,
                ended_s=now_s,
                energy=self._energy(flash),
            )
            self._world.angle_deg = stands_deg if flash.angle_deg is None else flash.angle_deg
            frames.append(self._world.frame(flash, header=header))
        self._world.angle_deg = stands_deg
        return frames

    def _energy(self, flash: Flash) -> float | None:
        """Return what the meter says of a flash."""
        if self._meter_noise is None or self._rng is None:
            return None
        return flash.energy * (1 + self._meter_noise * float(self._rng.standard_normal()))
