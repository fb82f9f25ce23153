"""Files that arrive without a trigger: the SonixDAQ's driver waits for them, reports them, and uses none."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import AcquisitionError, DeviceTimeoutError, Permit
from markerseek.drivers import SonixDaqReceiver, SonixDaqSettings, SystemClock
from tests.unit.drivers.test_sonixdaq import Bench


def settling(bench: Bench, *, readout_s: float = 2.0) -> SonixDaqReceiver:
    """Another process's driver on the same folder."""
    watched = SonixDaqSettings(folder=str(bench.folder), timeout_s=5.0, readout_s=readout_s)
    return SonixDaqReceiver(settings=watched, clock=bench.clock, dark_triggers=4)


def permit(token: str = "a", pulses: int = 4) -> Permit:
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=math.inf)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "daq")


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
        receiver.arm(permit(str(pulses), pulses))
        assert (tmp_path / "said").read_text() == said
