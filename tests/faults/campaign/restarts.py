"""Restarts: a search dies in mid-acquisition, and the next begins while the data acquisition holds its triggers.

Real drivers on emulated devices, in virtual time. The data acquisition is a computer of its own, which lives on. It
writes the files late, or it counts triggers and completes a cut train with those of the next search. Judged by truth:
which triggers each accepted frame holds, and where the marker is.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import numpy as np

from markerseek.core import (
    ChannelFrame,
    Event,
    Finished,
    Found,
    Int16,
    MarkerseekError,
    Measured,
    Permit,
    Refused,
    RunPlan,
    Sample,
    SearchPlan,
)
from markerseek.drivers import Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings, sonixdaq
from markerseek.emulators import DirectPort, EmulatedBench
from markerseek.emulators.bench import BenchClock
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs import image_reader
from markerseek.rigs.bench_devices import DARK_ALARM
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings

PULSES = 16
DARK_FRAMES = 3
READOUT_S = 10.0
"""Longest time from a trigger to the last file, in seconds."""

POLL_S = 0.4
"""Time between two looks at the folder: eight times the driver's, which would spend the campaign on them."""

DeathName = Literal["Ctrl-C", "kill"]
AtRest = Literal["late files", "counting triggers", "counting triggers, box loses power"]
DEATHS: tuple[DeathName, ...] = ("Ctrl-C", "kill")
AT_REST: tuple[AtRest, ...] = ("late files", "counting triggers", "counting triggers, box loses power")


class Killed(BaseException):
    """Death of the process, without any cleanup."""


class HostClock:
    """The clock of one process, which dies at a moment."""

    def __init__(self, clock: BenchClock, death: DeathName | None) -> None:
        self._clock = clock
        self._death = death
        self.dies_s = math.inf
        self.dead = False

    def now_s(self) -> float:
        return self._clock.now_s()

    def wait(self, duration_s: float) -> None:
        if self.dead:
            raise Killed
        if self.now_s() + duration_s >= self.dies_s:
            self._clock.wait(max(0.0, self.dies_s - self.now_s()))
            self.dies_s = math.inf
            if self._death == "kill":
                self.dead = True
                raise Killed
            raise KeyboardInterrupt
        self._clock.wait(duration_s)


class HostPort(DirectPort):
    """A line that the system closes with its process."""

    def __init__(self, *, device: Any, clock: HostClock) -> None:
        super().__init__(device=device, clock=clock)
        self._host = clock

    def write(self, data: bytes) -> None:
        if not self._host.dead:
            super().write(data)


class DyingLaser(LaserBox):
    """A laser box in whose n-th train, or in the readout after it, the process dies."""

    def __init__(self, *, port: HostPort, clock: HostClock, dies_at: int, within_s: float, share: float) -> None:
        super().__init__(port=port, clock=clock, dark_triggers=PULSES)
        self._host, self._left, self._after_s = clock, dies_at, share * within_s

    def fire(self, permit: Permit) -> int:
        self._left -= 1
        if self._left == 0:
            self._host.dies_s = self._host.now_s() + self._after_s
        return super().fire(permit)


@dataclass(frozen=True, kw_only=True)
class Written:
    """An acquisition that was written: its average, and the numbers of the trains whose triggers are in it."""

    samples: Int16[np.ndarray, "channels samples"]
    trains: frozenset[int]


@dataclass(kw_only=True)
class Outcome:
    """Outcome of the search after the restart."""

    died: bool = False
    answer: str = ""
    said: list[str] = field(default_factory=list)
    foreign: int = 0
    off_deg: float | None = None

    def of_first(self, search: Iterator[Event]) -> None:
        """Let the first search run until it dies."""
        try:
            for _ in search:
                pass
        except (Killed, KeyboardInterrupt):
            self.died = True
        except MarkerseekError as error:
            self.said.append(f"the first search: {error}")

    def of_second(
        self, search: Iterator[Event], *, marker_deg: float, is_own: Callable[[Sample, ChannelFrame], bool]
    ) -> None:
        """Judge the second search by the truth; ``is_own``: whether a frame holds triggers of this search only."""
        try:
            for event in search:
                match event:
                    case Refused(reason=reason):
                        self.said.append(reason)
                    case Measured(sample=sample):
                        assert isinstance(sample.frame, ChannelFrame)
                        self.foreign += not is_own(sample, sample.frame)
                    case Finished(estimate=estimate):
                        self.answer = type(estimate).__name__
                        self.off_deg = abs(estimate.mean_deg - marker_deg) if isinstance(estimate, Found) else None
        except MarkerseekError as error:
            self.answer = "fault"
            self.said.append(str(error))


class Restart:
    """A search that dies, and the one after it, on one bench."""

    def __init__(self, folder: Path, *, seed: int, number: int, daq: AtRest, death: DeathName, bare: bool) -> None:
        rng = np.random.default_rng([seed, number, AT_REST.index(daq), DEATHS.index(death)])
        self._rng, self._death, self._bare = rng, death, bare
        self.marker_deg = float(rng.uniform(-30, 30))
        self._counting = daq != "late files"
        readout_s = READOUT_S if self._counting else float(rng.uniform(0.2, 2.0))
        self._settings = SimulatedSettings(
            marker=MarkerSettings(angle_deg=self.marker_deg),
            receiver=ReceiverSettings(readout_s=readout_s),
            laser=LaserSettings(pulses=PULSES),
            noise=NoiseSettings(peak_snr_db=float(rng.uniform(34, 46))),
            start_deg=float(rng.uniform(-34, 34)),
        )
        self._bench = EmulatedBench(settings=self._settings, rng=rng, folder=folder)
        self._daq: Any = self._bench.daq
        self._daq.counts = PULSES if self._counting else None
        if not self._counting:
            # nothing is seen of the acquisition for seconds; then it is there all at once
            self._daq.faults.inject("late files", float(rng.uniform(5.0, READOUT_S - readout_s)))
        self._folder = folder
        self._method, self._acquisitions = (("posterior", 12), ("weighted-average", 29))[int(rng.integers(2))]
        self._dies_at = int(rng.integers(1, 11))
        self._within_s = 0.01 * PULSES if self._counting else 0.01 * PULSES + self._daq.faults.delay_s + readout_s
        self._completes = daq == "counting triggers"
        self.clock = BenchClock(tick_s=0.05)
        self.clock.lead(self._bench.stage.advance, self._daq.advance)
        self._trains = 0
        self._written: list[Written] = []
        self._watch()

    def _watch(self) -> None:
        """Number the trains of triggers, and keep which of them are in each acquisition."""
        trains = self._daq._trains
        trigger, receive, acquisition = self._daq.trigger, trains.average, self._daq._acquisition
        parts_received: list[tuple[Int16[np.ndarray, "channels samples"], int]] = []

        def numbered(count: int) -> None:
            self._trains += 1
            if self._completes and count:
                count = PULSES
            elif self._death == "kill" and self._bench.world.flashes[-1:] and not self._completes:
                count = min(count, self._bench.world.flashes[-1].pulses) if self._lit() else count
            trigger(count)
            self._daq._triggered[-1].world.train = self._trains

        def receiving(part: Any) -> Any:
            samples = receive(part)
            parts_received.append((samples, part.triggers))
            return samples

        def taking(parts: Any) -> Any:
            parts_received.clear()
            files = acquisition(parts)
            whole = sum(samples.astype(np.float64) * count for samples, count in parts_received)
            average = np.rint(whole / sum(count for _, count in parts_received)).astype(np.int16)
            self._written.append(Written(samples=average, trains=frozenset(part.world.train for part in parts)))
            return files

        self._bench.laser_box._on_triggers = numbered
        trains.average, self._daq._acquisition = receiving, taking

    def _lit(self) -> bool:
        """Whether light came with the train that has just ended."""
        return len(self._bench.world.flashes) > self._daq._trains._flashes

    def perform(self) -> Outcome:
        """Let the first search die, wait until a person has begun again, and judge the second."""
        with mock.patch.object(sonixdaq, "_POLL_S", POLL_S), contextlib.ExitStack() as bare:
            if self._bare:
                bare.enter_context(mock.patch("markerseek.scan.loop.apply_confirmation", lambda estimate, *_: estimate))
            return self._perform()

    def _perform(self) -> Outcome:
        outcome = Outcome()
        first = HostClock(self.clock, self._death)
        outcome.of_first(self._search(first, share=float(self._rng.uniform())))
        if not outcome.died:
            return outcome
        self.clock.wait(0.15)  # by then the lease has ended
        self._bench.laser_box.advance(self.clock.now_s())
        while self._bench.stage.moving:
            self.clock.wait(0.05)
        self.clock.wait(float(self._rng.uniform(0.0, 3.0)))
        outcome.of_second(
            self._search(HostClock(self.clock, None), share=None), marker_deg=self.marker_deg, is_own=self._is_own
        )
        return outcome

    def _is_own(self, _: Sample, frame: ChannelFrame) -> bool:
        """Whether a frame is an acquisition of the last train alone."""
        own = [each.samples for each in self._written if each.trains == {self._trains}]
        return any(np.array_equal(frame.samples, samples) for samples in own)

    def _search(self, clock: HostClock, *, share: float | None) -> Iterator[Event]:
        """A search by a process of its own, with the drivers and limits of a bench."""
        stage = Kdc101Stage(port=HostPort(device=self._bench.stage, clock=clock), clock=clock)
        laser = DyingLaser(
            port=HostPort(device=self._bench.laser_box, clock=clock),
            clock=clock,
            dies_at=0 if share is None else self._dies_at,
            within_s=self._within_s,
            share=share or 0.0,
        )
        receiver = SonixDaqReceiver(
            settings=SonixDaqSettings(folder=str(self._folder), readout_s=1.2 * READOUT_S),
            clock=clock,
            dark_triggers=PULSES,
        )
        if self._bare:
            receiver.settle = lambda: None  # type: ignore[method-assign]
        guard = Guard(
            limits=self._settings.limits,
            firing=FiringLimits(),
            admission=Admission(dark_alarm=None if self._bare else DARK_ALARM),
        )
        guard.arm(by="the campaign")
        scanner = Scanner(
            stage=stage,
            laser=laser,
            receiver=receiver,
            reader=image_reader(self._settings.probe.array, sampling_hz=self._settings.receiver.sampling_hz),
            clock=clock,
            guard=guard,
            pulses=PULSES if self._bare or self._counting else (PULSES + 1, PULSES - 1, PULSES),
        )
        limits = self._settings.limits.search
        policy = build(
            SearchPlan(method=self._method, acquisitions=self._acquisitions, start_deg=stage.angle_deg), limits=limits
        )
        return run(policy, scanner, RunPlan(dark_frames=DARK_FRAMES, closing_dark=not self._bare))
