"""The emulated bench in virtual time, in one process: equal to the simulation count for count; and its lines."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import ConfigError, Found, LaserError, Measured, NotConnectedError, Policy, RunPlan, SearchPlan
from markerseek.drivers import Kdc101Stage, LaserBox, SerialPort, SonixDaqReceiver, SonixDaqSettings, SystemClock
from markerseek.drivers.clock import LONGEST_WAIT_S
from markerseek.emulators import EmulatedBench, PtyLine
from markerseek.emulators.bench import ServingClock
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings, VirtualClock
from markerseek.wire import apt
from tests.emulated_lines import BenchClock, DirectPort

SETTINGS = SimulatedSettings(marker=MarkerSettings(angle_deg=-8.0), receiver=ReceiverSettings(readout_s=0.3))


class VirtualBench:
    """Real drivers on emulated devices, in virtual time."""

    def __init__(self, folder: Path, *, seed: int) -> None:
        self.emulated = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(seed), folder=folder)
        clock = BenchClock()
        clock.lead(self.emulated.daq.advance)
        self.stage = Kdc101Stage(port=DirectPort(device=self.emulated.stage, clock=clock), clock=clock)
        self.guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission())
        self.scanner = Scanner(
            stage=self.stage,
            laser=LaserBox(port=DirectPort(device=self.emulated.laser_box, clock=clock), clock=clock),
            receiver=SonixDaqReceiver(settings=SonixDaqSettings(folder=str(folder), timeout_s=3.0), clock=clock),
            reader=image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz),
            clock=clock,
            guard=self.guard,
        )
        self.guard.arm(by="test")


def golden() -> Policy:
    return build(SearchPlan(method="golden-section", acquisitions=10, as_published=True), limits=SETTINGS.limits.search)


def test_a_search_receives_count_for_count_what_the_simulation_receives(tmp_path: Path) -> None:
    bench = VirtualBench(tmp_path, seed=7)
    over_bytes = list(run(golden(), bench.scanner, RunPlan(dark_frames=2)))
    simulated = rigs.simulated(seed=7, settings=SETTINGS)
    direct = list(run(golden(), simulated.scanner, RunPlan(dark_frames=2)))
    assert len(over_bytes) == len(direct)
    for received, expected in zip(over_bytes, direct, strict=True):
        if isinstance(received, Measured) and isinstance(expected, Measured):
            assert received.sample.frame is not None
            assert expected.sample.frame is not None
            np.testing.assert_array_equal(received.sample.frame.samples, expected.sample.frame.samples)
            assert received.sample == expected.sample
    assert over_bytes[-1].estimate == direct[-1].estimate  # type: ignore[union-attr]
    assert isinstance(over_bytes[-1].estimate, Found)  # type: ignore[union-attr]
    lit = [event.sample for event in over_bytes if isinstance(event, Measured) and not event.sample.dark]
    truth_deg = [pulse.angle_deg for pulse in bench.emulated.laser_box.pulses]
    assert truth_deg == pytest.approx([sample.angle_deg for sample in lit for _ in range(16)], abs=1e-3)


def test_a_serving_clock_leaves_out_what_the_computer_held_up() -> None:
    real = VirtualClock()
    clock = ServingClock(real)
    for step_s in (0.002, 0.01, 5.0, 0.002):
        real.wait(step_s)
        clock.now_s()
    assert clock.now_s() == pytest.approx(0.002 + 0.01 + 0.02 + 0.002)


def test_the_clock_of_real_devices_beats_in_every_slice_and_a_late_beat_is_detected() -> None:
    beats: list[float] = []
    clock = SystemClock(beat=lambda: beats.append(clock.now_s()))
    began_s = clock.now_s()
    clock.wait(3.5 * LONGEST_WAIT_S)
    assert clock.now_s() - began_s >= 3.5 * LONGEST_WAIT_S
    assert 2 <= len(beats) <= 6
    clock.wait(0.0)
    with pytest.raises(ConfigError, match="a wait of -1"):
        clock.wait(-1)

    def lapsed() -> None:
        raise LaserError("the lease has lapsed")

    with pytest.raises(LaserError, match="lapsed"):
        SystemClock(beat=lapsed).wait(1.0)


def test_the_stage_of_a_bench_turns_on_while_the_computer_holds_up_its_emulator(tmp_path: Path) -> None:
    """A motor that stood still meanwhile, and had its speed again, is no motor that its driver believes."""
    bench = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(1), folder=tmp_path / "daq")
    clock = VirtualClock()
    with bench.line("stage", clock=clock, link=tmp_path / "stage") as line:
        end = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
        os.write(end, apt.set_target(apt.counts_of(5.0)) + apt.move())
        line.serve_once(wait_s=1.0)
        clock.wait(0.01)
        line.serve_once(wait_s=0.0)
        clock.wait(0.5)
        line.serve_once(wait_s=0.0)
        os.close(end)
    # half a second at 20 deg/s², since the parameters are those after power-up
    assert bench.stage._stage.motor.angle_deg == pytest.approx(2.5, abs=0.15)


class Echo:
    """Echoes what it receives, and repeats the last of it after a second."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._later: list[tuple[float, bytes]] = []

    def advance(self, now_s: float) -> bytes:
        self._now_s = now_s
        due = b"".join(said for at_s, said in self._later if at_s <= now_s)
        self._later = [(at_s, said) for at_s, said in self._later if at_s > now_s]
        return due

    def feed(self, data: bytes) -> bytes:
        self._later.append((self._now_s + 1.0, data.upper()))
        return data


def test_every_byte_crosses_a_pseudo_terminal_unchanged() -> None:
    clock = SystemClock()
    done = threading.Event()
    with PtyLine(device=Echo(), clock=clock) as line:

        def serve() -> None:
            while not done.is_set():
                line.serve_once(wait_s=2e-3)

        serving = threading.Thread(target=serve)
        serving.start()
        try:
            with SerialPort(line.path, handshake=True) as port:
                every = bytes(range(256)) * 8
                port.write(every)
                received = port.read(len(every), timeout_s=5.0)
        finally:
            done.set()
            serving.join()
    assert received == every


class HeldUp(VirtualClock):
    """Holds up the server for 0.1 s when it takes the time, while the program at the other end goes on writing."""

    def __init__(self) -> None:
        super().__init__()
        self.end = -1

    def now_s(self) -> float:
        taken_s = super().now_s()
        self.wait(0.1)
        os.write(self.end, b"b")
        return taken_s


class Stamped:
    """Keeps when it was fed what."""

    def __init__(self) -> None:
        self.fed: list[tuple[float, bytes]] = []
        self._now_s = 0.0

    def advance(self, now_s: float) -> bytes:
        self._now_s = now_s
        return b""

    def feed(self, data: bytes) -> bytes:
        self.fed.append((self._now_s, data))
        return b""


def test_no_question_is_answered_as_of_a_time_before_it_was_asked() -> None:
    clock = HeldUp()
    device = Stamped()
    with PtyLine(device=device, clock=clock) as line:
        clock.end = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
        os.write(clock.end, b"a")
        line.serve_once(wait_s=1.0)
        line.serve_once(wait_s=1.0)
        os.close(clock.end)
    assert device.fed == [(0.0, b"a"), (pytest.approx(0.1), b"b")]


def test_one_program_holds_the_port() -> None:
    with (
        PtyLine(device=Echo(), clock=SystemClock()) as line,
        SerialPort(line.path),
        pytest.raises(NotConnectedError, match="close other programs"),
    ):
        SerialPort(line.path)


def test_a_line_taken_away_is_gone() -> None:
    line = PtyLine(device=Echo(), clock=SystemClock())
    port = SerialPort(line.path)
    line.close()
    line.close()
    with pytest.raises(NotConnectedError, match="gone"):
        port.read(1, timeout_s=1.0)
    with pytest.raises(NotConnectedError, match="gone"):
        port.write(b"a")
    port.close()
    port.close()


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(NotConnectedError, match=r"/none cannot be opened \(No such file or directory\); plug"):
        SerialPort(str(tmp_path / "none"))
    with pytest.raises(ConfigError, match="path"):
        SerialPort("")
    with pytest.raises(ConfigError, match="baud"):
        SerialPort("/dev/ttyUSB0", baud=0)
