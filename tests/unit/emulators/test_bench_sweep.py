"""Sweeps of the real drivers over the emulated bench, byte by byte in virtual time, judged by the truth.

A SonixDAQ reads them as bursts. At the end the bench is against the search: frames in a wrong order, late answers and
old readings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    DeviceError,
    Event,
    Found,
    Measured,
    ReadingFrame,
    Sample,
    SearchPlan,
    StageReading,
    Sweep,
    Swept,
    is_finite,
)
from markerseek.drivers import (
    Kdc101Settings,
    Kdc101Stage,
    LaserBox,
    LaserBoxSettings,
    SonixDaqReceiver,
    SonixDaqSettings,
)
from markerseek.emulators import LIGHT_COUNTS, EmulatedBench, EmulatedSonixDaq
from markerseek.guard import Admission, FiringLimits, Guard, State
from markerseek.rigs import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build_sweeping
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedReceiver, SimulatedSettings, StageMotion
from markerseek.wire import apt
from markerseek.wire import laserbox as wire
from tests.emulated_lines import BenchClock, DirectPort
from tests.unit.scan.sweep_bench import SweepBench

SETTINGS = SimulatedSettings(
    marker=MarkerSettings(angle_deg=-24.0),
    start_deg=-35.0,
    stage=StageMotion(speed_deg_s=20.0, acceleration_deg_s2=25.0),
    receiver=ReceiverSettings(readout_s=0.3, single_pulses=True),
)


class Bench:
    """Real drivers on emulated devices; the laser box's lease is renewed in each wait, as on a bench."""

    def __init__(
        self,
        folder: Path,
        *,
        settings: SimulatedSettings = SETTINGS,
        readout_s: float = 0.3,
    ) -> None:
        settings = structs.replace(settings, receiver=structs.replace(settings.receiver, readout_s=readout_s))
        self.settings = settings
        self.emulated = EmulatedBench(settings=settings, rng=np.random.default_rng(3), folder=folder)
        clock = BenchClock(tick_s=2e-3)
        self.clock = clock
        self.stage_port = DirectPort(device=self.emulated.stage, clock=clock)
        port = DirectPort(device=self.emulated.laser_box, clock=clock)
        self.stage = self.connect()
        metered = LaserBoxSettings(port="", energy_from="photodiode", usual_energy=LIGHT_COUNTS)
        self.laser = LaserBox(port=port, clock=clock, settings=metered)
        self.port = port
        self.alive = True
        clock.lead(self._beat, lambda _: port.read(0, timeout_s=0.0), self.emulated.daq.advance)
        self.daq = SonixDaqSettings(
            folder=str(folder),
            timeout_s=10.0,
            readout_s=0.2 + readout_s,
            frames="triggered",
        )
        self.begin()

    def begin(self) -> None:
        """A program begins: it watches the folder from now on, and is armed."""
        self.guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission(dark_alarm=1e-6))
        self.scanner = Scanner(
            stage=self.stage,
            laser=self.laser,
            receiver=SonixDaqReceiver(settings=self.daq, clock=self.clock),
            reader=image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz),
            clock=self.clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")

    def _beat(self, _: float) -> None:
        if self.alive:
            self.laser.beat()

    def connect(self) -> Kdc101Stage:
        settings = Kdc101Settings(port="", zero_deg=0.0, speed_deg_s=20.0, acceleration_deg_s2=25.0)
        return Kdc101Stage(port=self.stage_port, clock=self.clock, settings=settings)

    def search(self) -> Iterator[Event]:
        speed_deg_s = self.scanner.sweeping.stage.fastest_sweep_deg_s
        return run(sweeping(speed_deg_s, start_deg=self.scanner.angle_deg, from_end=True), self.scanner)

    @property
    def speed_deg_s(self) -> float:
        """The speed that the controller holds."""
        return int.from_bytes(self.emulated.stage.velocity[10:14], "little") / apt.SPEED_WORD

    @property
    def probe_deg(self) -> float:
        self.emulated.stage.turn(self.clock.now_s())
        return self.emulated.world.angle_deg


def sweeping(speed_deg_s: float, *, start_deg: float = -35.0, from_end: bool = False):  # type: ignore[no-untyped-def]
    plan = SearchPlan(
        method="posterior",
        start_deg=start_deg,
        sweep_speed_deg_s=speed_deg_s,
        sweep_from_end=from_end,
    )
    return build_sweeping(plan, limits=SETTINGS.limits.search)


@pytest.mark.long
@pytest.mark.parametrize(("readout_s", "waits_deg"), [(0.3, -35.0), (6.0, 0.0)])
def test_a_search_over_the_bytes_answers_as_the_simulated_rig_does(
    tmp_path: Path, readout_s: float, waits_deg: float
) -> None:
    bench = Bench(tmp_path, readout_s=readout_s)
    events = list(bench.search())
    simulated = rigs.simulated(seed=3, settings=SETTINGS)
    *_, direct = run(sweeping(simulated.scanner.sweeping.stage.fastest_sweep_deg_s), simulated.scanner)
    # type: ignore[union-attr]
    answer = events[-1].estimate
    expected = direct.estimate
    assert isinstance(answer, Found)
    assert isinstance(expected, Found)
    assert answer.mean_deg == pytest.approx(expected.mean_deg, abs=0.15)
    assert answer.mean_deg == pytest.approx(-24.0, abs=0.3)
    swept = next(event for event in events if isinstance(event, Swept))
    samples = [event.sample for event in events if isinstance(event, Measured) and event.sample.sweep is not None]
    truth_deg = [flash.angle_deg for flash in bench.emulated.world.flashes if flash.angle_deg is not None]
    assert len(samples) == swept.pulses == len(truth_deg) > 100
    # Each sample is at the angle where its pulse was fired: a millisecond at 20 deg/s, and the encoder's count. Where
    # it turns back, the backlash is not taken up yet.
    off_deg = [sample.angle_deg - (true or 0.0) for sample, true in zip(samples, truth_deg, strict=True)]
    assert max(map(abs, off_deg)) < 0.11
    settled_deg = [off for off, sample in zip(off_deg, samples, strict=True) if abs(sample.angle_deg) < 30.0]
    assert len(settled_deg) > 100
    assert max(map(abs, settled_deg)) < 0.03
    assert all(is_finite(sample.angle_sigma_deg) and sample.angle_sigma_deg < 0.05 for sample in samples)
    assert swept.angle_deg == pytest.approx(waits_deg, abs=0.02)
    assert bench.speed_deg_s == pytest.approx(20.0, rel=1e-4)


def test_the_light_meter_measures_each_pulse_of_a_sweep(tmp_path: Path) -> None:
    light = structs.replace(SETTINGS.laser, energy_meter_noise=0.01, energy_spread=0.1)
    bench = Bench(tmp_path, settings=structs.replace(SETTINGS, laser=light))
    outcomes = bench.scanner.take(Sweep(to_deg=-20.0, speed_deg_s=12.0), number=1, goes_on=lambda: True)
    frames = [outcome.frame for outcome in outcomes if isinstance(outcome, Sample)]
    measured = [frame.header.energy for frame in frames if frame is not None]
    truth = [flash.energy for flash in bench.emulated.world.flashes]
    assert np.std(truth) > 0.05
    assert len(measured) == len(truth) > 15
    assert measured == pytest.approx(truth, rel=0.05)


class Killed(BaseException):
    """The program ends here, without a word to any device."""


def killed(_: Bench) -> None:
    raise Killed


@pytest.mark.long
@pytest.mark.parametrize("late_s", [0.0, 4.0, 7.0, 10.0])
def test_the_burst_of_a_program_that_was_killed_is_not_taken_for_that_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late_s: float
) -> None:
    bench = Bench(tmp_path, readout_s=1.0)
    bench.emulated.daq.faults.inject("late files", late_s)  # type: ignore[union-attr]
    InMidSweep(bench, killed, at_deg=-15.0)
    with monkeypatch.context() as patch:
        patch.setattr(Scanner, "_end_light_and_motion", lambda _: None)
        with pytest.raises(Killed):
            list(bench.search())
    # Without beats the light ends; the box completes the triggers, and the device writes the burst when it likes.
    bench.alive = False
    bench.clock.wait(6.0)
    bench.emulated.daq.faults.heal("late files")  # type: ignore[union-attr]
    bench.stage = bench.connect()
    bench.laser = LaserBox(port=bench.port, clock=bench.clock)
    bench.alive = True
    bench.begin()
    # type: ignore[union-attr]
    daq = bench.emulated.daq
    pulses = bench.emulated.daq._pulses
    made: list[np.ndarray] = []
    monkeypatch.setattr(daq, "_pulses", lambda part: made.append(pulses(part)) or made[-1])
    events = list(bench.search())
    # Refused, or written over by its own in time: each frame that is believed is of a pulse of the last sweep.
    swept = [event.sample.frame for event in events if isinstance(event, Measured) and event.sample.sweep]
    *_, burst, _ = made
    assert len(swept) > 100
    for frame, pulse in zip(swept, burst, strict=False):
        assert isinstance(frame, ChannelFrame)
        np.testing.assert_array_equal(frame.samples, pulse)
    assert isinstance(answer := events[-1].estimate, Found)  # type: ignore[union-attr]
    assert answer.mean_deg == pytest.approx(-24.0, abs=0.3)


def test_light_in_the_dark_frame_of_a_burst_ends_in_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path)
    # type: ignore[union-attr]
    daq = bench.emulated.daq
    pulses = bench.emulated.daq._pulses
    # As if the laser answered the dark triggers as well, with the probe at the marker.
    monkeypatch.setattr(daq, "_pulses", lambda part: np.concatenate([(made := pulses(part))[:-16], made[10:26]]))
    with pytest.raises(AcquisitionError, match="taken without light, yet it holds a source"):
        list(bench.search())
    assert bench.guard.state is State.FAULT
    assert not bench.emulated.laser_box.permitted


def stalled(bench: Bench) -> None:
    bench.emulated.stage.faults.inject("stall")


def frozen(bench: Bench) -> None:
    bench.emulated.stage.faults.inject("frozen motor")


def without_stage(bench: Bench) -> None:
    bench.emulated.stage.faults.inject("silent")


def without_box(bench: Bench) -> None:
    bench.emulated.laser_box.faults.inject("silent")


def interlocked(bench: Bench) -> None:
    bench.emulated.laser_box.open_interlock()


def dark(bench: Bench) -> None:
    bench.emulated.laser_box.faults.inject("dead lamp")


def interrupted(_: Bench) -> None:
    raise KeyboardInterrupt


class InMidSweep:
    """Does something once, when the probe has come by an angle on its way up, or ``back``."""

    def __init__(
        self, bench: Bench, action: Callable[[Bench], None], *, at_deg: float = -10.0, back: bool = False
    ) -> None:
        self._bench = bench
        self._action = action
        self._at_deg = at_deg
        self._back = back
        self._before_deg = math.inf
        self.began_s: float | None = None
        self.at_deg = -math.inf
        bench.clock.lead(self._look)

    def _look(self, now_s: float) -> None:
        if self.began_s is None and self._bench.guard.state is State.SWEEPING:
            self._before_deg = self.at_deg
            self.at_deg = self._bench.probe_deg
            turned_back = self.at_deg < self._before_deg and self.at_deg < self._at_deg
            if turned_back if self._back else self.at_deg > self._at_deg:
                self.began_s = now_s
                self._action(self._bench)


@pytest.mark.parametrize(("at_deg", "back", "rests_deg"), [(-15.0, False, 35.0), (10.0, True, -35.0)])
def test_a_host_that_is_killed_leaves_no_light_beyond_the_lease_and_the_probe_in_its_permit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_deg: float, back: bool, rests_deg: float
) -> None:
    bench = Bench(tmp_path)
    fault = InMidSweep(bench, killed, at_deg=at_deg, back=back)
    monkeypatch.setattr(Scanner, "_end_light_and_motion", lambda _: None)
    with pytest.raises(Killed):
        list(bench.search())
    bench.alive = False
    angles_deg = []
    bench.clock.lead(lambda _: angles_deg.append(bench.probe_deg))
    bench.clock.wait(20.0)
    assert fault.began_s is not None
    lights_s = [flash.at_s for flash in bench.emulated.world.flashes]
    assert fault.began_s < max(lights_s) <= fault.began_s + wire.LEASE_MS / 1e3 + 1e-3
    # 0.1 deg: the backlash.
    assert -35.1 <= min(angles_deg) <= max(angles_deg) <= 35.1
    assert angles_deg[-1] == pytest.approx(rests_deg, abs=0.11)


@pytest.mark.parametrize("break_it", [stalled, frozen, without_stage, without_box, interlocked, dark, interrupted])
def test_whatever_fails_in_mid_sweep_ends_light_and_motion_and_the_speed_is_restored(
    tmp_path: Path, break_it: Callable[[Bench], None]
) -> None:
    bench = Bench(tmp_path)
    fault = InMidSweep(bench, break_it)
    expected = KeyboardInterrupt if break_it is interrupted else DeviceError
    measured = []
    with pytest.raises(expected):
        measured += [event for event in bench.search() if isinstance(event, Measured)]
    assert not measured
    assert fault.began_s is not None
    assert bench.guard.state is (State.DISARMED if break_it is interrupted else State.FAULT)
    bench.clock.wait(20.0)
    assert not bench.emulated.laser_box.permitted
    light = [pulse for pulse in bench.emulated.laser_box.pulses if pulse.at_s > fault.began_s]
    assert all(pulse.at_s <= fault.began_s + 0.5 for pulse in light)
    # It brakes within its permit; where the stage cannot be reached, it stops at the end of that by itself.
    assert bench.probe_deg - fault.at_deg >= -0.01
    assert bench.probe_deg <= (35.1 if break_it is without_stage else 20.0)
    # Restored at once where the stage can be reached, else by the next start.
    if break_it is without_stage:
        bench.emulated.stage.faults.heal()
        bench.connect()
    assert bench.speed_deg_s == pytest.approx(20.0, rel=1e-4)


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
    times_s = [0.0]
    angles_deg = [bench.probe_deg]
    read = bench.stage.read_sweep
    bench.clock.lead(lambda now_s: (times_s.append(now_s), angles_deg.append(bench.probe_deg)))

    def aged() -> StageReading:
        reading = read()
        return structs.replace(reading, angle_deg=float(np.interp(reading.at_s - age_s, times_s, angles_deg)))

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
            behind.append(
                structs.replace(frame, intensity=1.01 * frame.intensity if self.before is None else self.before)
            )
            self.before = frame.intensity
        return behind


@pytest.mark.parametrize("sigma_s", [None, 1e-3, 3e-3])
def test_a_stream_that_is_one_frame_behind_is_refused(sigma_s: float | None) -> None:
    motion = StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0)
    bench = SweepBench(motion=motion, light={"stamp_delay_sigma_s": sigma_s})
    bench.receiver.__class__ = Behind
    plan = SearchPlan(method="posterior", start_deg=-35.0, sweep_speed_deg_s=25.0)
    with pytest.raises(AcquisitionError, match=r"the sweeps there and back differ as if the light came -5\d ± \d ms"):
        list(run(build_sweeping(plan, limits=bench.rig.limits.search), bench.scanner))
