"""The SonixDAQ's driver and the folder writer in virtual time: which files count as an acquisition, or as a sweep.

Files that arrive without a trigger are waited for, reported, and never used.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.acoustics import AcousticModel, Noise
from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    DeviceTimeoutError,
    NotConnectedError,
    SweepPermit,
)
from markerseek.drivers import SonixDaqReceiver, SonixDaqSettings, SystemClock
from markerseek.drivers.sonixdaq import _numbered, run_to_its_end
from markerseek.emulators import EmulatedSonixDaq
from markerseek.records.banks.frames import load_frame
from markerseek.sim import World
from markerseek.wire import sonixdaq as wire
from tests.emulated_lines import BenchClock, permit


class Bench:
    """A folder, who writes it, and who watches it."""

    def __init__(
        self,
        folder: Path,
        *,
        readout_s: float = 1.0,
        white_sigma: float = 300.0,
        start_deg: float = 0.0,
        averaged: int | None = None,
    ) -> None:
        self.world = World(
            model=AcousticModel(samples=64),
            absorbers=(),
            noise=Noise(white_sigma=white_sigma),
            energy_jitter=0.0,
            start_deg=start_deg,
            rng=np.random.default_rng(1),
            averaged=averaged,
        )
        self.received: list[np.ndarray] = []
        self.angles_deg: list[float | None] = []
        world_frame = self.world.frame

        def frame(flash, *, header):  # type: ignore[no-untyped-def]
            made = world_frame(flash, header=header)
            self.received.append(made.samples)
            self.angles_deg.append(None if flash is None else flash.angle_deg)
            return made

        self.world.frame = frame  # type: ignore[method-assign]
        self.folder = folder
        self.clock = BenchClock()
        self.daq = EmulatedSonixDaq(world=self.world, folder=folder, readout_s=readout_s)
        self.clock.lead(self.daq.advance)
        watched = SonixDaqSettings(folder=str(folder), timeout_s=5.0)
        self.receiver = SonixDaqReceiver(settings=watched, clock=self.clock, dark_triggers=4)

    def take(self, token: str = "a", *, triggers: int = 4, pulses: int = 4) -> ChannelFrame:
        allowed = permit(token, pulses=pulses)
        self.receiver.arm(allowed)
        self.daq.trigger(triggers)
        return self.receiver.acquire(allowed)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "daq")


@pytest.mark.parametrize("triggers", [1, 5])
def test_a_frame_is_the_world_s_count_for_count(tmp_path: Path, triggers: int) -> None:
    bench = Bench(tmp_path)
    for number in range(3):
        frame = bench.take(f"permit {number}", triggers=triggers, pulses=triggers)
        np.testing.assert_array_equal(frame.samples, bench.received[-1])
        assert (frame.header.sequence, frame.header.token, frame.header.pulses) == (
            number + 1,
            f"permit {number}",
            triggers,
        )
    # the reader of recorded folders is another program
    np.testing.assert_array_equal(load_frame(tmp_path).samples, bench.received[-1])


def test_a_dark_frame_averages_as_many_triggers_as_the_box_gives(bench: Bench) -> None:
    assert bench.take(triggers=4, pulses=0).header.pulses == 0
    with pytest.raises(AcquisitionError, match="hold 3 pulses, 4 were triggered"):
        bench.take("b", triggers=3, pulses=0)


def test_nothing_written_and_half_written_end_in_time_with_what_is_missing(bench: Bench) -> None:
    bench.daq.faults.inject("off")
    with pytest.raises(DeviceTimeoutError, match="after 5 s 0 of 128 channel files"):
        bench.take("off")
    bench.daq.faults.heal("off")
    bench.daq.faults.inject("part of the files", 100)
    with pytest.raises(DeviceTimeoutError, match=r"after 5 s 101 of 128 channel files .* not all are complete"):
        bench.take("partial")


def test_a_file_that_stays_half_written_is_not_taken(bench: Bench) -> None:
    bench.daq.faults.inject("part of the files", 127)
    with pytest.raises(DeviceTimeoutError, match=r"128 of 128 channel files .* are new and not all are complete"):
        bench.take()


@pytest.mark.parametrize("late_s", [0.3, 1.7])
def test_files_that_have_their_size_before_their_contents_are_waited_for(bench: Bench, late_s: float) -> None:
    """As on a network share, or while they are copied: neither size nor time shows that the contents come."""
    bench.daq.faults.inject("size first", late_s)
    for token in "ab":
        np.testing.assert_array_equal(bench.take(token).samples, bench.received[-1])


def test_files_whose_contents_do_not_come_are_refused_by_name(bench: Bench) -> None:
    bench.daq.faults.inject("size first", 60.0)
    with pytest.raises(DeviceTimeoutError, match=r"CH000\.daq: the last 10\d of 262 values are 0, its contents"):
        bench.take()


@pytest.mark.parametrize("white_sigma", [0.2, 0.4])
def test_noise_of_less_than_a_count_is_no_hole(tmp_path: Path, white_sigma: float) -> None:
    """Most of it is 0, also at the end."""
    bench = Bench(tmp_path, white_sigma=white_sigma)
    np.testing.assert_array_equal(bench.take().samples, bench.received[-1])


def test_a_dead_channel_is_no_hole_and_a_folder_of_zeros_is(bench: Bench) -> None:
    bench.world._noise = Noise(white_sigma=0.0)
    with pytest.raises(DeviceTimeoutError, match="all samples of all files are 0; their contents have not come"):
        bench.take()
    pulses = np.random.default_rng(2).integers(-50, 50, (3, 400)).astype(np.int16)
    for dead, missing in ((pulses * 0, ""), (pulses, "")):
        assert wire.unwritten(wire.encode_file(dead, number=7), name="CH007.daq") == missing
    pulses[2, 330:] = 0
    assert wire.unwritten(wire.encode_file(pulses, number=None), name="x").startswith("x: the last 70 of 1204 values")
    pulses[2, 340:] = 1
    assert not wire.unwritten(wire.encode_file(pulses, number=None), name="x")


def test_a_slow_device_is_waited_for_and_a_too_slow_one_is_not(tmp_path: Path) -> None:
    slow = Bench(tmp_path / "slow", readout_s=4.5)
    np.testing.assert_array_equal(slow.take().samples, slow.received[-1])
    slow.daq.faults.inject("late files", 2.0)
    with pytest.raises(DeviceTimeoutError, match="check trigger, folder and free space, or raise timeout_s"):
        slow.take("b")
    # the late files come in the end, and are no answer to what is asked next
    slow.daq.faults.heal("late files")
    with pytest.raises(AcquisitionError, match="change although nothing was triggered"):
        slow.receiver.arm(permit("c"))


def test_old_files_are_no_frame_whatever_their_date(bench: Bench) -> None:
    bench.take("first")
    for path in bench.folder.iterdir():
        os.utime(path, (4e9, 4e9))  # a clock far in the future
    allowed = permit("b")
    bench.receiver.arm(allowed)
    with pytest.raises(DeviceTimeoutError, match="0 of 128"):
        bench.receiver.acquire(allowed)


@pytest.mark.parametrize("fault", ["swapped channels", "garbled headers"])
def test_files_that_are_out_of_order_or_noise_are_refused(bench: Bench, fault: str) -> None:
    bench.daq.faults.inject(fault)
    with pytest.raises((AcquisitionError, DeviceTimeoutError), match=r"out of order|not all are complete"):
        bench.take()


def test_two_layouts_in_one_folder_are_not_mixed(bench: Bench) -> None:
    with pytest.raises(AcquisitionError, match=r"CH003.daq and CH003-0000.daq are both channel 3; .* one program"):
        _numbered(["CH003.daq", "CH003-0000.daq"])
    # The other layout's files stay, and are old; pulses of which only the mean is even.
    allowed = permit("a", pulses=2)
    bench.take()
    bench.receiver.arm(allowed)
    for number in range(wire.CHANNEL_COUNT):
        pulses = np.array([[number, 3], [number + 2, -1]], np.int16)
        (bench.folder / f"CH{number:03d}-0000.daq").write_bytes(wire.encode_file(pulses, number=None))
    samples = bench.receiver.acquire(allowed).samples
    assert samples[[wire.element_of_file(number) for number in range(wire.CHANNEL_COUNT)]].tolist() == [
        [number + 1, 1] for number in range(wire.CHANNEL_COUNT)
    ]


def test_a_folder_that_is_not_there_is_not_connected(tmp_path: Path) -> None:
    watched = SonixDaqSettings(folder=str(tmp_path / "nowhere"))
    with pytest.raises(NotConnectedError, match="nowhere cannot be read"):
        SonixDaqReceiver(settings=watched, clock=BenchClock())


class TestStartCommand:
    def run(self, *words: str, timeout_s: float = 20.0, beat: Callable[[], None] = lambda: None) -> None:
        run_to_its_end(words, timeout_s=timeout_s, clock=SystemClock(beat=beat))

    def test_it_runs_to_its_end_beside_the_beat_and_no_shell_reads_it(self, tmp_path: Path) -> None:
        beats: list[int] = []
        code = "import pathlib, sys; pathlib.Path(sys.argv[1]).write_text(sys.argv[2])"
        self.run(sys.executable, "-c", code, str(tmp_path / "said"), "$HOME; ls", beat=lambda: beats.append(1))
        assert (tmp_path / "said").read_text() == "$HOME; ls"
        assert beats

    def test_a_failure_is_reported_with_its_reason(self) -> None:
        with pytest.raises(NotConnectedError, match=r"ended with code 3: no such board; try it by hand"):
            self.run(sys.executable, "-c", "import sys; print('no such board', file=sys.stderr); sys.exit(3)")

    def test_one_that_cannot_be_run_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(NotConnectedError, match="nothing-here' cannot be run"):
            self.run(str(tmp_path / "nothing-here"))

    def test_one_that_hangs_is_ended(self) -> None:
        with pytest.raises(DeviceTimeoutError, match=r"took more than 0.1 s and was ended"):
            self.run(sys.executable, "-c", "import time; time.sleep(60)", timeout_s=0.1)


@pytest.mark.parametrize(
    "change",
    [
        {"stable_s": -0.1},
        {"stable_s": 60.0},
        {"start_command": ()},
        {"start_command": ("",)},
    ],
)
def test_settings_that_cannot_be_used_are_refused(tmp_path: Path, change: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=f"receiver: {next(iter(change))} is "):
        SonixDaqSettings(folder=str(tmp_path), **change)  # type: ignore[arg-type]


def settling(bench: Bench) -> SonixDaqReceiver:
    """Another process's driver on the same folder."""
    watched = SonixDaqSettings(folder=str(bench.folder), timeout_s=5.0, readout_s=2.0)
    return SonixDaqReceiver(settings=watched, clock=bench.clock, dark_triggers=4)


def test_a_folder_that_is_left_alone_is_settled_after_a_readout_counted_from_the_connection(bench: Bench) -> None:
    receiver = settling(bench)
    bench.clock.wait(1.5)
    began_s = bench.clock.now_s()
    receiver.settle()
    assert bench.clock.now_s() - began_s == pytest.approx(0.5, abs=0.06)
    receiver.settle()  # and it stays so
    assert bench.clock.now_s() - began_s == pytest.approx(0.5, abs=0.06)


def test_late_files_of_a_search_that_died_are_named_waited_out_and_not_used(bench: Bench) -> None:
    bench.daq.faults.inject("late files", 1.5)
    bench.daq.trigger(4)
    bench.clock.wait(0.1)
    receiver = settling(bench)
    with pytest.raises(AcquisitionError, match=r"stale files: 128 channel files, CH000\.daq to CH127\.daq, arrived"):
        receiver.settle()
    settled_s = bench.clock.now_s()
    assert settled_s == pytest.approx(1.5 + 1.0 + 2.0, abs=0.2)
    receiver.settle()
    assert bench.clock.now_s() == settled_s
    receiver.arm(permit())
    bench.daq.trigger(4)
    frame = receiver.acquire(permit())
    np.testing.assert_array_equal(frame.samples, bench.received[-1])
    assert len(bench.received) == 2


def test_after_a_trigger_it_waits_again(bench: Bench) -> None:
    receiver = settling(bench)
    receiver.settle()
    receiver.arm(permit())
    began_s = bench.clock.now_s()
    receiver.settle()
    assert bench.clock.now_s() - began_s == pytest.approx(2.0, abs=0.06)


def test_a_folder_that_never_comes_to_rest_ends_in_time(bench: Bench) -> None:
    bench.clock.lead(lambda now_s: (bench.folder / "CH003.daq").write_bytes(b"x" * (1 + int(now_s) % 7)))
    receiver = settling(bench)
    began_s = bench.clock.now_s()
    with pytest.raises(DeviceTimeoutError, match="files keep arriving"):
        receiver.settle()
    assert bench.clock.now_s() - began_s == pytest.approx(5.0 + 2.0, abs=0.1)


def test_acquisitions_are_written_one_after_the_other_though_the_host_is_gone(bench: Bench) -> None:
    """The emulated device is a computer of its own: at once fired again, it would be one behind."""
    bench.daq.faults.inject("late files", 0.5)
    bench.daq.trigger(4)
    bench.daq.trigger(4)
    bench.clock.wait(1.45)
    first = (bench.folder / "CH000.daq").read_bytes()
    bench.clock.wait(1.2)
    assert len(bench.received) == 2
    assert (bench.folder / "CH000.daq").read_bytes() != first


def test_the_start_command_gets_the_number_of_pulses(bench: Bench, tmp_path: Path) -> None:
    code = "import pathlib, sys; pathlib.Path(sys.argv[1]).write_text(sys.argv[2])"
    command = (sys.executable, "-c", code, str(tmp_path / "said"), "n={frames}")
    watched = SonixDaqSettings(folder=str(bench.folder), stable_s=0.0, start_command=command)
    receiver = SonixDaqReceiver(settings=watched, clock=SystemClock(), dark_triggers=4)
    for pulses, said in ((5, "n=5"), (0, "n=4")):
        receiver.arm(permit(str(pulses), pulses=pulses))
        assert (tmp_path / "said").read_text() == said


SWEEP = SweepPermit(
    token="s",
    angle_deg=-35.0,
    pulses=9,
    expires_s=math.inf,
    to_deg=35.0,
    slowest_deg_s=2.0,
    fastest_deg_s=12.0,
    period_s=0.05,
)


class SweepBench(Bench):
    """A folder of bursts: each pulse has a frame of its own."""

    def __init__(self, folder: Path, *, frames: str = "triggered") -> None:
        super().__init__(folder, white_sigma=30.0, start_deg=-35.0, averaged=16)
        settings = SonixDaqSettings(folder=str(folder), timeout_s=3.0, frames=frames)  # type: ignore[arg-type]
        self.receiver = SonixDaqReceiver(settings=settings, clock=self.clock, dark_triggers=2)

    def sweep(self, *, lit: int = 7) -> list[ChannelFrame]:
        self.receiver.begin_sweep(SWEEP)
        for number in range(lit):
            self.world.flash(pulses=1, at_s=0.05 * number)
            self.world.flashes[-1] = replace(self.world.flashes[-1], angle_deg=-35.0 + number)
        assert self.receiver.frames() == ()
        self.daq.trigger(9)
        frames = self.receiver.end_sweep(pulses=lit)
        return [frame for frame in frames if isinstance(frame, ChannelFrame)]


def test_each_pulse_is_a_frame_and_the_last_dark_triggers_are_one(tmp_path: Path) -> None:
    bench = SweepBench(tmp_path)
    *frames, dark = bench.sweep()
    assert bench.angles_deg[:7] == [-35.0 + number for number in range(7)]
    for frame, samples in zip(frames, bench.received[:7], strict=True):
        np.testing.assert_array_equal(frame.samples, samples)
        assert (frame.header.pulses, frame.header.token, frame.header.commanded_deg) == (1, "s", 35.0)
    assert [frame.header.sequence for frame in frames] == list(range(1, 8))
    # A single pulse has four times the noise of the mean of sixteen, with light and without.
    assert np.std(bench.received) == pytest.approx(120.0, rel=0.05)
    assert (dark.header.pulses, dark.header.token, dark.header.sequence) == (0, "s", 8)
    np.testing.assert_array_equal(dark.samples, np.rint(np.mean(bench.received[-2:], 0)))
    # and an acquisition at rest goes on from there
    allowed = permit("p", pulses=16)
    bench.receiver.arm(allowed)
    bench.world.flash(pulses=16, at_s=5.0)
    bench.daq.trigger(16)
    assert bench.receiver.acquire(allowed).header.sequence == 9


def test_light_in_the_triggers_that_must_be_dark_refuses_the_sweep_whole(tmp_path: Path) -> None:
    bench = SweepBench(tmp_path)
    with pytest.raises(AcquisitionError, match="8 of 9 triggers had light, and the last 2 must be dark"):
        bench.sweep(lit=8)


def test_files_that_have_come_since_it_was_connected_are_not_the_answer(tmp_path: Path) -> None:
    bench = SweepBench(tmp_path)
    bench.daq.trigger(9)
    bench.clock.wait(0.3)
    with pytest.raises(AcquisitionError, match=r"files have arrived in .* although nothing was triggered"):
        bench.receiver.begin_sweep(SWEEP)
    with pytest.raises(AcquisitionError, match="stale files"):
        bench.receiver.settle()
    bench.receiver.settle()
    assert len(bench.sweep()) == 8


@pytest.mark.parametrize(
    ("fault", "said"),
    [("lost trigger", "hold 8 pulses, 9 were triggered"), ("double trigger", "hold 10 pulses, 9 were triggered")],
)
def test_a_trigger_that_is_lost_or_doubled_refuses_the_sweep_whole(tmp_path: Path, fault: str, said: str) -> None:
    bench = SweepBench(tmp_path)
    bench.daq.faults.inject(fault, 4)
    with pytest.raises(AcquisitionError, match=f"{said}: a trigger was lost or doubled"):
        bench.sweep()
    # and no part of it can be asked for again
    with pytest.raises(AcquisitionError, match="was not armed for a sweep"):
        bench.receiver.end_sweep(pulses=7)


def test_a_device_that_records_a_fixed_number_says_why_it_cannot_sweep(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="this rig cannot sweep: its SonixDAQ records a fixed number of pulses"):
        _ = SweepBench(tmp_path, frames="fixed").receiver.frame_period_s
    receiver = SweepBench(tmp_path).receiver
    assert (receiver.frame_period_s, receiver.sweep_readout_s) == (0.05, 12.0)
