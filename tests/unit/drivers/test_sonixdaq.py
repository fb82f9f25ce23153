"""The SonixDAQ's driver and the folder writer in virtual time: which files count as an acquisition."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
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
    Permit,
)
from markerseek.drivers import SonixDaqReceiver, SonixDaqSettings, SystemClock
from markerseek.drivers.sonixdaq import _numbered, run_to_its_end
from markerseek.emulators import EmulatedSonixDaq
from markerseek.records.banks.frames import load_frame
from markerseek.sim import World
from markerseek.wire import sonixdaq as wire
from tests.emulated_lines import BenchClock


class Bench:
    """A folder, who writes it, and who watches it."""

    def __init__(
        self,
        folder: Path,
        *,
        readout_s: float = 1.0,
        timeout_s: float = 5.0,
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
        watched = SonixDaqSettings(folder=str(folder), timeout_s=timeout_s)
        self.receiver = SonixDaqReceiver(settings=watched, clock=self.clock, dark_triggers=4)

    def take(self, token: str = "a", *, triggers: int = 4, pulses: int = 4) -> ChannelFrame:
        permit = Permit(token=token, angle_deg=1.5, pulses=pulses, expires_s=math.inf)
        self.receiver.arm(permit)
        self.daq.trigger(triggers)
        return self.receiver.acquire(permit)


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


def test_a_slow_device_is_waited_for_and_a_too_slow_one_is_not(tmp_path: Path) -> None:
    slow = Bench(tmp_path / "slow", readout_s=4.5)
    np.testing.assert_array_equal(slow.take().samples, slow.received[-1])
    slow.daq.faults.inject("late files", 2.0)
    with pytest.raises(DeviceTimeoutError, match="check trigger, folder and free space, or raise timeout_s"):
        slow.take("b")
    # the late files come in the end, and are no answer to what is asked next
    slow.daq.faults.heal("late files")
    with pytest.raises(AcquisitionError, match="change although nothing was triggered"):
        slow.receiver.arm(Permit(token="c", angle_deg=0, pulses=4, expires_s=math.inf))


def test_old_files_are_no_frame_whatever_their_date(bench: Bench) -> None:
    bench.take("first")
    for path in bench.folder.iterdir():
        os.utime(path, (4e9, 4e9))  # a clock far in the future
    permit = Permit(token="b", angle_deg=0.0, pulses=4, expires_s=math.inf)
    bench.receiver.arm(permit)
    with pytest.raises(DeviceTimeoutError, match="0 of 128"):
        bench.receiver.acquire(permit)


@pytest.mark.parametrize("fault", ["swapped channels", "garbled headers"])
def test_files_that_are_out_of_order_or_noise_are_refused(bench: Bench, fault: str) -> None:
    bench.daq.faults.inject(fault)
    with pytest.raises((AcquisitionError, DeviceTimeoutError), match=r"out of order|not all are complete"):
        bench.take()


def test_two_layouts_in_one_folder_are_not_mixed(bench: Bench) -> None:
    with pytest.raises(AcquisitionError, match=r"CH003.daq and CH003-0000.daq are both channel 3; .* one program"):
        _numbered(["CH003.daq", "CH003-0000.daq"])
    # The other layout's files stay, and are old; pulses of which only the mean is even.
    permit = Permit(token="a", angle_deg=0.0, pulses=2, expires_s=math.inf)
    bench.take()
    bench.receiver.arm(permit)
    for number in range(wire.CHANNELS):
        pulses = np.array([[number, 3], [number + 2, -1]], np.int16)
        (bench.folder / f"CH{number:03d}-0000.daq").write_bytes(wire.encode_file(pulses, number=None))
    samples = bench.receiver.acquire(permit).samples
    assert samples[[wire.element_of_file(number) for number in range(wire.CHANNELS)]].tolist() == [
        [number + 1, 1] for number in range(wire.CHANNELS)
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
