"""Restarts of a sweep: it dies in its burst, and the next begins while the data acquisition still writes that one.

Real drivers on emulated devices, in virtual time; the first burst of a program waits for no settled folder (decision
75). Judged by truth: whether each frame that is believed is of a pulse of the program that believed it.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from markerseek.core import ChannelFrame, Event, Int16, Sample
from markerseek.drivers import LaserBox, sonixdaq
from markerseek.guard import State
from markerseek.scan import Scanner
from markerseek.scan import scanner as scanner_module
from markerseek.sim import MarkerSettings
from tests.sweep_on_a_bench import SETTINGS, Bench

from .restarts import DEATHS, DeathName, Killed, Outcome

SWEEP_S = 9.0
"""A sweep over the range and the dark triggers after it, in seconds."""

LATEST_S = 12.0
"""Longest time from the last trigger to the last file, in seconds: that of decision 75."""

POLL_S = 0.1
"""Time between two looks at the folder: twice the driver's."""


class BurstRestart:
    """A sweep that dies, and the search after it, on one bench.

    ``bare`` leaves out what decision 75 brought: a number of triggers that is the burst's own.
    """

    def __init__(self, folder: Path, *, seed: int, number: int, death: DeathName, bare: bool = False) -> None:
        rng = np.random.default_rng([seed, number, DEATHS.index(death)])
        self._rng, self._death, self._bare = rng, death, bare
        self.marker_deg = float(rng.uniform(-30, 30))
        readout_s = float(rng.uniform(0.3, 8.0))
        late_s = float(rng.uniform(0.0, LATEST_S - 0.2 - readout_s))
        noise = replace(SETTINGS.noise, peak_snr_db=float(rng.uniform(34, 46)))
        self._bench = Bench(
            folder,
            settings=replace(
                SETTINGS,
                marker=MarkerSettings(angle_deg=self.marker_deg),
                noise=noise,
                start_deg=float(rng.uniform(-34, 34)),
            ),
            readout_s=readout_s,
            late_s=late_s,
            seed=int(rng.integers(2**31)),
        )
        self._daq: Any = self._bench.emulated.daq
        self._daq.faults.inject("late files", late_s)
        self._dies_after_s = float(rng.uniform(0.0, SWEEP_S + late_s + readout_s))
        self._dies_s: float | None = None
        self._died_s = math.inf
        self._made: list[tuple[float, Int16[np.ndarray, "pulses channels samples"]]] = []
        self._watch()
        self._bench.clock.lead(self._live)

    def _watch(self) -> None:
        """Keep the pulses of each acquisition, and when the first of them was fired."""
        pulses = self._daq._trains.pulses

        def noted(train: Any) -> Any:
            made = pulses(train)
            flash = train.flashes[0] if hasattr(train, "flashes") else train.flash
            self._made.append((-math.inf if flash is None else flash.at_s, made))
            return made

        self._daq._trains.pulses = noted

    def _live(self, now_s: float) -> None:
        """Die once, so long after the burst began."""
        if self._dies_s is None and self._bench.guard.state is State.SWEEPING:
            self._dies_s = now_s + self._dies_after_s
        if self._dies_s is not None and self._dies_s <= now_s < self._died_s:
            self._died_s = now_s
            if self._death == "kill":
                raise Killed
            raise KeyboardInterrupt

    def perform(self) -> Outcome:
        """Let the first search die, begin again a little later, and judge the second."""
        outcome, bench = Outcome(), self._bench
        with mock.patch.object(sonixdaq, "_POLL_S", POLL_S), contextlib.ExitStack() as patches:
            if self._bare:
                patches.enter_context(mock.patch.object(scanner_module, "_MARKS", 1))
            outcome.of_first(self._first())
            if not outcome.died:
                return outcome
            # Without beats the light ends; the box completes the triggers.
            bench.alive = False
            while bench.emulated.stage.moving:
                bench.clock.wait(0.05)
                bench.emulated.stage.advance(bench.clock.now_s())
            bench.clock.wait(float(self._rng.uniform(0.2, 6.0)))
            outcome.of_second(self._second(), marker_deg=self.marker_deg, is_own=self._is_own)
        return outcome

    def _first(self) -> Iterator[Event]:
        """The search that dies; one that is killed says no word to any device."""
        with contextlib.ExitStack() as patches:
            if self._death == "kill":
                patches.enter_context(mock.patch.object(Scanner, "_end_light_and_motion", return_value=None))
            yield from self._bench.search()

    def _second(self) -> Iterator[Event]:
        """The search of the next program, which connects anew."""
        bench = self._bench
        bench.stage = bench.connect()
        bench.laser = LaserBox(port=bench.port, clock=bench.clock)
        bench.alive = True
        bench.begin()
        yield from bench.search()

    def _is_own(self, sample: Sample, frame: ChannelFrame) -> bool:
        """Whether a frame is of pulses that were fired after the first search died."""
        own = [pulses for fired_s, pulses in self._made if fired_s > self._died_s]
        return any(_holds(pulses, frame, swept=sample.sweep is not None) for pulses in own)


def _holds(pulses: Int16[np.ndarray, "pulses channels samples"], frame: ChannelFrame, *, swept: bool) -> bool:
    """Whether a frame is one of these pulses, or their mean."""
    if swept:
        return any(np.array_equal(frame.samples, pulse) for pulse in pulses)
    return np.array_equal(frame.samples, np.rint(pulses.mean(axis=0, dtype=np.float64)).astype(np.int16))
