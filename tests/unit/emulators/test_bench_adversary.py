"""A bench that is against the search: frames in a wrong order, late answers and old readings, judged by the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import AcquisitionError, DeviceError, Found, ReadingFrame, SearchPlan, StageReading
from markerseek.emulators import EmulatedSonixDaq
from markerseek.guard import State
from markerseek.scan import run
from markerseek.search import build_sweeping
from markerseek.sim import SimulatedReceiver, StageMotion
from tests.sweep_on_a_bench import SETTINGS, Bench
from tests.unit.scan.sweep_bench import SweepBench

TRUTH_DEG = SETTINGS.marker.angle_deg or 0.0

Pulses = np.ndarray


def ordered(bench: Bench, change: Callable[[Pulses], Pulses]) -> None:
    """Have the frames of each burst come in another order."""
    daq = bench.emulated.daq
    assert isinstance(daq, EmulatedSonixDaq)
    pulses = daq._pulses
    # 16 of them are the dark frame of an acquisition at rest.
    daq._pulses = lambda part: change(made) if len(made := pulses(part)) > 60 else made  # type: ignore[method-assign]


def again(frame: Pulses, times: int) -> Pulses:
    """The same sound some times, each with a noise of its own."""
    return np.repeat(frame, times, axis=0) + np.random.default_rng(1).integers(
        -1, 2, size=(times, *frame.shape[1:]), dtype=frame.dtype
    )


def late(bench: Bench, by: int) -> None:
    """Old frames come first, and as many are lost at the end."""
    ordered(bench, lambda pulses: np.concatenate([again(pulses[-1:], by), pulses[:-by]]))


def early(bench: Bench, by: int) -> None:
    """The first frames are lost, and as many dark ones follow at the end."""
    ordered(bench, lambda pulses: np.concatenate([pulses[by:], again(pulses[-1:], by)]))


def lost_and_doubled(bench: Bench, lost: int, doubled: int) -> None:
    """One trigger is lost, and another comes twice: the number is right; in bursts that are long enough."""

    def change(pulses: Pulses) -> Pulses:
        if len(pulses) <= doubled:
            return pulses
        more = np.insert(pulses, doubled, again(pulses[doubled - 1 : doubled], 1), axis=0)
        return np.delete(more, lost - 1, axis=0)

    ordered(bench, change)


def answering_late(bench: Bench, late_s: float) -> None:
    bench.stage_port.line.late_s = late_s


def old_readings(bench: Bench, age_s: float) -> None:
    """The stage's readings are as old, and their times do not show it."""
    times_s, angles_deg, read = [0.0], [bench.probe_deg], bench.stage.read_sweep
    bench.clock.lead(lambda now_s: (times_s.append(now_s), angles_deg.append(bench.probe_deg)))

    def aged() -> StageReading:
        reading = read()
        return replace(reading, angle_deg=float(np.interp(reading.at_s - age_s, times_s, angles_deg)))

    bench.stage.read_sweep = aged  # type: ignore[method-assign]


def jumping(bench: Bench, by_deg: float, at_deg: float) -> None:
    """The position jumps in mid-sweep."""
    left = [1]

    def look(_: float) -> None:
        if left and bench.guard.state is State.SWEEPING and bench.probe_deg > at_deg:
            left.clear()
            bench.emulated.stage.faults.inject("readback jump", by_deg)

    bench.clock.lead(look)


@pytest.mark.parametrize("by", [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize("shifted", [late, pytest.param(early, marks=pytest.mark.long)])
def test_a_burst_whose_frames_are_all_late_or_early_is_refused(
    tmp_path: Path, shifted: Callable[[Bench, int], None], by: int
) -> None:
    bench = Bench(tmp_path)
    shifted(bench, by)
    with pytest.raises(AcquisitionError, match=r"the sweeps there and back differ as if the light came -?\d+ ± \d ms"):
        list(bench.search())


def covered_or_refused(bench: Bench) -> None:
    """Found where the marker is, or a fault; no other answer."""
    try:
        *_, over = bench.search()
    except DeviceError:
        return
    answer = over.estimate  # type: ignore[union-attr]
    # Four standard deviations: not by chance in so few searches.
    assert not isinstance(answer, Found) or abs(answer.mean_deg - TRUTH_DEG) <= 4 * answer.sigma_deg


@pytest.mark.long
@pytest.mark.parametrize(
    ("lost", "doubled"),
    [(2, 60), (2, 125), (40, 150), (70, 90)],
)
def test_a_trigger_lost_and_another_doubled_do_not_shift_the_answer(tmp_path: Path, lost: int, doubled: int) -> None:
    bench = Bench(tmp_path)
    lost_and_doubled(bench, lost, doubled)
    covered_or_refused(bench)


@pytest.mark.parametrize(
    ("break_it", "amounts"),
    [
        (answering_late, (16e-3,)),
        (answering_late, (50e-3,)),
        (answering_late, (100e-3,)),
        pytest.param(old_readings, (10e-3,), marks=pytest.mark.long),
        pytest.param(jumping, (0.15, -20.0), marks=pytest.mark.long),
        pytest.param(jumping, (-0.15, 10.0), marks=pytest.mark.long),
    ],
)
def test_a_stage_that_is_read_late_or_jumps_shifts_no_answer_beyond_its_interval(
    tmp_path: Path, break_it: Callable[..., None], amounts: tuple[float, ...]
) -> None:
    bench = Bench(tmp_path)
    break_it(bench, *amounts)
    covered_or_refused(bench)


class Behind(SimulatedReceiver):
    """A stream whose data are those of the frame before, under true headers."""

    before: float | None = None

    def _swept(self, now_s: float) -> list[ReadingFrame]:
        behind = []
        for frame in super()._swept(now_s):
            assert isinstance(frame, ReadingFrame)
            behind.append(replace(frame, intensity=1.01 * frame.intensity if self.before is None else self.before))
            self.before = frame.intensity
        return behind


ONE_WAY = "where the delay is known, one way is swept, and a stream that is one frame behind is believed"


@pytest.mark.parametrize("sigma_s", [None, pytest.param(1e-3, marks=pytest.mark.xfail(reason=ONE_WAY, strict=True))])
def test_a_stream_that_is_one_frame_behind_is_refused(sigma_s: float | None) -> None:
    motion = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)
    bench = SweepBench(motion=motion, light={"stamp_delay_sigma_s": sigma_s})
    bench.receiver.__class__ = Behind
    plan = SearchPlan(method="posterior", start_deg=-35.0, sweep_speed_deg_s=25.0)
    with pytest.raises(AcquisitionError, match=r"the sweeps there and back differ as if the light came -5\d ± \d ms"):
        list(run(build_sweeping(plan, limits=bench.rig.limits.search), bench.scanner))
