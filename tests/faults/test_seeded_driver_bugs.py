"""Bugs seeded into the drivers, each detected by its check; see `seeded_bugs`."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from markerseek.core import DeviceError, MoveError, Permit
from markerseek.drivers import Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.emulators import DirectPort, EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.emulators.laserbox import EmulatedLaserBox, LaserBoxFaults
from markerseek.emulators.stage_faults import STAGE_FAULTS
from markerseek.sim import VirtualClock
from markerseek.wire import AptFramer, apt
from markerseek.wire import sonixdaq as daq
from tests.faults.seeding import Bug, caught


def stage_at(start_deg: float = 0.0) -> tuple[Kdc101Stage, Kdc101Emulator, SimpleNamespace, VirtualClock, DirectPort]:
    clock, probe = VirtualClock(), SimpleNamespace(angle_deg=start_deg)
    emulator = Kdc101Emulator(probe=probe, settings=EmulatedKdc101(play_deg=0.0))
    port = DirectPort(device=emulator, clock=clock)
    return Kdc101Stage(port=port, clock=clock), emulator, probe, clock, port


def permit(token: str = "a", *, pulses: int = 4) -> Permit:
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=math.inf)


def a_stage_has_come_to_rest_where_it_is_said_to_have_arrived() -> None:
    stage, emulator, _, _, _ = stage_at()
    for target_deg in (-1.0, 5.0, 5.5):
        with contextlib.suppress(DeviceError):
            stage.move_to(target_deg)
            assert not emulator.moving


def the_stage_goes_where_it_is_sent() -> None:
    stage, _, probe, _, _ = stage_at()
    for target_deg in (3.0, -4.0):
        with contextlib.suppress(DeviceError):
            stage.move_to(target_deg)
        assert abs(probe.angle_deg - target_deg) < 0.01


def the_controller_adds_no_backlash_of_its_own() -> None:
    _, _, _, _, port = stage_at()
    port.write(apt.ask_backlash())
    answers = [apt.decode(message) for message in AptFramer().feed(port.read(4096, timeout_s=0.0))]
    assert answers == [apt.Counts(counts=0)]


def refusal_of(stage: Kdc101Stage, *targets_deg: float) -> str:
    """The refusal of a move; empty if all are accepted."""
    try:
        for target_deg in targets_deg:
            stage.move_to(target_deg)
    except MoveError as refusal:
        return str(refusal)
    return ""


def a_stage_that_only_says_it_is_there_is_refused() -> None:
    stage, emulator, _, _, _ = stage_at()
    stage.move_to(1.0)
    emulator.inject(STAGE_FAULTS["says it is there"])
    assert "faster than" in refusal_of(stage, 1.4)


def an_encoder_that_falls_back_is_refused() -> None:
    stage, emulator, _, _, _ = stage_at()
    emulator.inject(replace(STAGE_FAULTS["jump on its way"], amount=-0.5))
    assert "fell back by" in refusal_of(stage, 20.0)


def an_encoder_that_loses_a_little_is_refused() -> None:
    stage, emulator, _, _, _ = stage_at()
    emulator.inject(replace(STAGE_FAULTS["jump on its way"], amount=-0.2))
    assert "its acceleration allows" in refusal_of(stage, 20.0)


def a_stage_on_a_slow_line_is_believed() -> None:
    for late_s in (0.01, 0.05, 0.12):
        stage, emulator, _, _, _ = stage_at()
        emulator.inject(replace(STAGE_FAULTS["late answers"], amount=late_s))
        assert refusal_of(stage, 20.0, -20.0, 7.0) == ""


def no_target_is_far_ahead() -> None:
    stage, emulator, _, _, _ = stage_at()
    stage.move_to(30.0)
    assert emulator.largest_lead_deg <= 5.0


class Struck(VirtualClock):
    """Time in which the program is interrupted once."""

    strikes_s = math.inf

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s)
        if self.now_s() >= self.strikes_s:
            self.strikes_s = math.inf
            raise KeyboardInterrupt


def an_interrupted_move_is_stopped() -> None:
    clock, probe = Struck(), SimpleNamespace(angle_deg=0.0)
    emulator = Kdc101Emulator(probe=probe)
    stage = Kdc101Stage(port=DirectPort(device=emulator, clock=clock), clock=clock)
    clock.strikes_s = 1.0
    with contextlib.suppress(KeyboardInterrupt):
        stage.move_to(30.0)
    emulator.advance(clock.now_s())
    assert not emulator.moving


def fired_by(faults: LaserBoxFaults) -> tuple[int | None, list[object]]:
    """Pulses that the driver of a box with these faults reports; None if it refuses."""
    clock = VirtualClock()
    world: Any = SimpleNamespace(flash=lambda **_: None, angle_deg=0.0)
    box = EmulatedLaserBox(world=world, on_triggers=lambda _: None, faults=faults)
    laser = LaserBox(port=DirectPort(device=box, clock=clock), clock=clock)
    try:
        return laser.fire(replace(permit(), expires_s=9.0)), list(box.pulses)
    except DeviceError:
        return None, list(box.pulses)


def pulses_that_nobody_saw_are_refused() -> None:
    assert fired_by(LaserBoxFaults(photodiode_dead=True))[0] is None


def a_lease_lasts_as_long_as_the_pulses() -> None:
    fired, seen = fired_by(LaserBoxFaults())
    assert fired == len(seen) == 4


def a_permit_fires_once_at_the_box() -> None:
    clock = VirtualClock()
    world: Any = SimpleNamespace(flash=lambda **_: None, angle_deg=0.0)
    box = EmulatedLaserBox(world=world, on_triggers=lambda _: None)
    laser = LaserBox(port=DirectPort(device=box, clock=clock), clock=clock)
    for _ in range(2):
        with contextlib.suppress(DeviceError):
            laser.fire(replace(permit(), expires_s=9.0))
    assert len(box.pulses) == 4


class Writer(VirtualClock):
    """Time in which a program writes channel files: at a wait, those of that number."""

    def __init__(self, folder: Path, waits: dict[int, Callable[[Path], None]]) -> None:
        super().__init__()
        self._folder = folder
        self._waits = waits
        self._count = 0

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s)
        self._count += 1
        self._waits.get(self._count, lambda _: None)(self._folder)


def files(*, count: int = daq.CHANNELS, samples: int = 6, value: int = 7) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        for number in range(count):
            place = folder / f"CH{number:03d}.daq"
            place.with_suffix(".part").write_bytes(
                daq.encode_file(np.full((4, samples), value, np.int16), number=number)
            )
            place.with_suffix(".part").replace(place)

    return write


def acquired(waits: dict[int, Callable[[Path], None]]) -> Any:
    """A frame of a folder that is filled so; an acquisition of before lies in it. None if it is refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files(value=1)(folder)
        clock = Writer(folder, waits)
        receiver = SonixDaqReceiver(settings=SonixDaqSettings(folder=folder, timeout_s=1.0), clock=clock)
        try:
            receiver.arm(permit())
            return receiver.acquire(permit())
        except DeviceError:
            return None


def an_old_acquisition_is_no_new_one() -> None:
    assert acquired({}) is None


def part_of_an_acquisition_is_none() -> None:
    assert acquired({3: files(count=100)}) is None


def files_that_still_change_are_waited_for() -> None:
    frame = acquired({2: files(value=2), 4: files(value=3)})
    assert frame is not None
    assert frame.samples[0, 0] == 3


def a_folder_that_changes_by_itself_is_refused() -> None:
    assert acquired({1: files(value=2), 3: files(value=3)}) is None


def the_files_are_put_in_the_order_of_the_elements() -> None:
    def numbered(folder: Path) -> None:
        for number in range(daq.CHANNELS):
            place = folder / f"CH{number:03d}.daq"
            place.unlink()
            place.write_bytes(daq.encode_file(np.full((4, 6), number, np.int16), number=number))

    frame = acquired({3: numbered})
    assert frame is not None
    assert frame.samples[:17, 0].tolist() == [0, 8, 16, 24, 32, 40, 48, 56, 64, 72, 80, 88, 96, 104, 112, 120, 1]


DRIVER_BUGS = {
    "arrival while it moves, at one reading": Bug(
        where="drivers._kdc101_move:Move._settles",
        old="if status.moving or abs(status.position - target) > self._rules.arrival:",
        new="return abs(status.position - target) <= 50 * self._rules.arrival\n    if False:",
        check=a_stage_has_come_to_rest_where_it_is_said_to_have_arrived,
    ),
    "the sign of the angle": Bug(
        where="drivers.kdc101:Kdc101Stage._counts_of",
        old="self._zero + apt.counts_of(",
        new="self._zero - apt.counts_of(",
        check=the_stage_goes_where_it_is_sent,
    ),
    "the controller's backlash left as it was": Bug(
        where="drivers._kdc101_setup:set_up",
        old='_write(line, "backlash", no_backlash',
        new='(lambda *_: None)(line, "backlash", no_backlash',
        check=the_controller_adds_no_backlash_of_its_own,
    ),
    "arrival believed however soon": Bug(
        where="drivers._kdc101_move:MoveRules.reach",
        old="return _TOO_FAST *",
        new="return 1e9 + _TOO_FAST *",
        check=a_stage_that_only_says_it_is_there_is_refused,
    ),
    "a fall-back that is believed": Bug(
        where="drivers._kdc101_course:Course.objection",
        old="if back > self._unsteady:",
        new="if back > 10_000:",
        check=an_encoder_that_falls_back_is_refused,
    ),
    "a fall-back against the wrong heading": Bug(
        where="drivers._kdc101_course:Course.objection",
        old="self._heading * (self._farthest - reading.counts)",
        new="self._heading * (reading.counts - self._farthest)",
        check=the_stage_goes_where_it_is_sent,
    ),
    "the age of answers left out": Bug(
        where="drivers._kdc101_course:Course._advances",
        old="third.asked_s - second.answered_s",
        new="third.answered_s - first.asked_s",
        check=a_stage_on_a_slow_line_is_believed,
    ),
    "a motor that may lose its speed at once": Bug(
        where="drivers._kdc101_course:Course.objection",
        old="if low <= advance <= high:",
        new="if True:",
        check=an_encoder_that_loses_a_little_is_refused,
    ),
    "the whole way as one target": Bug(
        where="drivers._kdc101_move:Move.go",
        old="next_aim = target if heading * (target - here) <= rules.lead else here + heading * rules.lead",
        new="next_aim = target",
        check=no_target_is_far_ahead,
    ),
    "an error that leaves the motor running": Bug(
        where="drivers.kdc101:Kdc101Stage._stop_after_error",
        old="self.stop()",
        new="pass",
        check=an_interrupted_move_is_stopped,
    ),
    "pulses sent not compared with those seen": Bug(
        where="drivers.laserbox:LaserBox._fire",
        old="if not done.sent == done.photodiode == pulses:",
        new="if not done.sent == pulses:",
        check=pulses_that_nobody_saw_are_refused,
    ),
    "a box that is fired twice by one permit": Bug(
        where="drivers.laserbox:LaserBox.fire",
        old="self._used.add(permit.token)",
        new="pass",
        check=a_permit_fires_once_at_the_box,
    ),
    "files of before taken for new": Bug(
        where="drivers.sonixdaq:SonixDaqReceiver._await_files",
        old="if before.get(name) != file",
        new="",
        check=an_old_acquisition_is_no_new_one,
    ),
    "one new file makes all of them new": Bug(
        where="drivers.sonixdaq:SonixDaqReceiver._await_files",
        old="if before.get(name) != file",
        new="if before != state",
        check=part_of_an_acquisition_is_none,
    ),
    "files that are still written": Bug(
        where="drivers.sonixdaq:SonixDaqReceiver._await_files",
        old="if complete and now_s - since_s >= self._settings.stable_s:",
        new="if complete:",
        check=files_that_still_change_are_waited_for,
    ),
    "a folder that nobody watched before the trigger": Bug(
        where="drivers.sonixdaq:SonixDaqReceiver.arm",
        old="if self._folder.state() != before:",
        new="if False:",
        check=a_folder_that_changes_by_itself_is_refused,
    ),
    "the elements in the order of the files": Bug(
        where="drivers.daq_folder:DaqFolder.read",
        old="averaged[wire.element_of_file(number)]",
        new="averaged[number]",
        check=the_files_are_put_in_the_order_of_the_elements,
    ),
}


@pytest.mark.parametrize("name", DRIVER_BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    assert caught(DRIVER_BUGS[name])


@pytest.mark.parametrize(
    "check", dict.fromkeys(bug.check for bug in DRIVER_BUGS.values()), ids=lambda check: check.__name__
)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()
