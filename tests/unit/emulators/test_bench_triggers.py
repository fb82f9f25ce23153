"""Position-triggered sweeps of the real drivers over the emulated bench, whose stage triggers its laser box."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import (
    DeviceError,
    Found,
    LaserError,
    Measured,
    Sample,
    Sweep,
    Swept,
)
from markerseek.emulators.faults import Faults
from markerseek.guard import State
from markerseek.scan import run
from markerseek.sim import SimulatedSettings
from markerseek.wire import CONTROLLER, TO_CONTROLLER, AptFramer
from tests.emulated_lines import DirectPort
from tests.sweep_on_a_bench import SETTINGS, sweeping
from tests.sweep_on_a_bench import Bench as SweepBench
from tests.unit.scan.stamp_offsets import stamp_offsets_deg

SWEEP = Sweep(to_deg=-20.0, speed_deg_s=12.0, from_deg=-35.0)


class Swallowing(DirectPort):
    """A line to the stage on which one kind of message is lost."""

    ident: int | None = None

    def write(self, data: bytes) -> None:
        for message in AptFramer(TO_CONTROLLER, to=CONTROLLER).feed(data):
            if message.ident != self.ident:
                super().write(message.raw)


class Bench(SweepBench):
    """With a cable from the stage's trigger port to the box's trigger input."""

    stage_line = Swallowing

    def __init__(
        self, folder: Path, *, settings: SimulatedSettings = SETTINGS, position_triggered: bool = True
    ) -> None:
        super().__init__(folder, settings=settings, position_triggered=position_triggered)

    def swept(self) -> list[Sample]:
        """Samples of one sweep."""
        outcomes = list(self.scanner.take(SWEEP, number=1, goes_on=lambda: True))
        assert isinstance(outcomes[-1], Swept)
        return [outcome for outcome in outcomes if isinstance(outcome, Sample)]

    @property
    def faults(self) -> Faults:
        return self.emulated.laser_box.faults

    def truth_deg(self) -> list[float]:
        return [flash.angle_deg for flash in self.emulated.world.flashes if flash.angle_deg is not None]


def test_each_pulse_is_where_the_encoder_triggered_it_and_its_stamp_agrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path)
    offsets_deg = stamp_offsets_deg(monkeypatch)
    events = list(run(sweeping(bench.scanner.sweeping.stage.fastest_sweep_deg_s), bench.scanner))
    answer = events[-1].estimate  # type: ignore[union-attr]
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(-24.0, abs=0.1)
    samples = [event.sample for event in events if isinstance(event, Measured) and event.sample.sweep is not None]
    truth_deg = bench.truth_deg()
    assert len(samples) == len(truth_deg) > 60
    # Upwards, in the direction of the approach: no play is between encoder and probe. Half a count, and the rounding.
    off_deg = [sample.angle_deg - true for sample, true in zip(samples, truth_deg, strict=True)]
    assert max(map(abs, off_deg)) < 1e-3
    assert len(offsets_deg) == len(samples)
    assert max(map(abs, offsets_deg)) <= 0.02
    assert all(sample.sweep is not None and sample.sweep.delay_sigma_s < 1.2e-3 for sample in samples)
    # The ports are as before, and the moves of the confirmation gave no edge.
    assert bench.emulated.stage.edges(bench.clock.now_s()) == []


def lost(bench: Bench) -> None:
    bench.faults.inject("lost edge", 8)


def doubled(bench: Bench) -> None:
    bench.faults.inject("double edge", 8)


def test_a_cable_that_is_off_gives_no_light_and_is_named(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.faults.inject("no edges")
    with pytest.raises(LaserError, match="no pulse came in"):
        bench.swept()
    assert bench.truth_deg() == []
    assert bench.guard.state is State.FAULT


@pytest.mark.parametrize(("ident", "what"), [(0x0526, "trigger positions"), (0x0523, "trigger ports")])
def test_what_is_read_back_otherwise_than_written_ends_before_anything_moves(
    tmp_path: Path, ident: int, what: str
) -> None:
    bench = Bench(tmp_path)
    bench.stage_port.ident = ident
    with pytest.raises(DeviceError, match=f"does not keep its {what}"):
        bench.swept()
    assert (bench.emulated.stage.moves, bench.truth_deg()) == (0, [])


@pytest.mark.parametrize("position_triggered", [True, False])
def test_the_light_meter_measures_each_pulse_of_a_sweep(tmp_path: Path, position_triggered: bool) -> None:
    light = replace(SETTINGS.laser, energy_meter_noise=0.01, energy_spread=0.1)
    bench = Bench(tmp_path, settings=replace(SETTINGS, laser=light), position_triggered=position_triggered)
    samples = bench.swept()
    measured = [sample.frame.header.energy for sample in samples if sample.frame is not None]
    truth = [flash.energy for flash in bench.emulated.world.flashes]
    assert np.std(truth) > 0.05
    assert len(measured) == len(truth) > 15
    assert measured == pytest.approx(truth, rel=0.05)
