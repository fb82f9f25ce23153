"""A whole session with the drivers of real devices, over emulated bytes and in virtual time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import StereoPair
from markerseek.drivers import Kdc101Stage, LaserBox, SonixDaqReceiver, SonixDaqSettings
from markerseek.emulators import EmulatedBench, EmulatedEndoscope
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.registration import (
    DeviceRoom,
    Ended,
    RegistrationSession,
    Searching,
    SessionPlan,
    SessionRecord,
    SpotRefused,
    SpotSeen,
    Step,
    StereoSettings,
    TakenMarker,
    Waiting,
)
from markerseek.registration.room import SHOWN_S
from markerseek.rigs import image_reader
from markerseek.scan import Scanner
from markerseek.sim import MarkerSettings, ReceiverSettings, SimulatedSettings
from tests.emulated_lines import BenchClock, DirectPort
from tests.registration_sessions import BEGUN

SETTINGS = SimulatedSettings(marker=MarkerSettings(angle_deg=0.0), receiver=ReceiverSettings(readout_s=0.1))


@dataclass(slots=True, kw_only=True)
class Person(DeviceRoom):
    """Lights the place that is asked for."""

    endoscope: EmulatedEndoscope

    def ask(self, waiting: Waiting) -> bool:
        if waiting.place is not None:
            self.endoscope.light(waiting.place.left_px)
        return DeviceRoom.ask(self, waiting)


def room(folder: Path, *, wait_s: float = 6.0) -> tuple[Person, EmulatedBench]:
    """The room, and its emulated bench."""
    emulated = EmulatedBench(settings=SETTINGS, rng=np.random.default_rng(1), folder=folder / "daq")
    clock = BenchClock()
    clock.lead(emulated.daq.advance)
    endoscope = EmulatedEndoscope(
        world=emulated.world, settings=SETTINGS, folder=folder, clock=clock, rng=np.random.default_rng(2)
    )
    stage = Kdc101Stage(port=DirectPort(device=emulated.stage, clock=clock), clock=clock)
    laser = LaserBox(port=DirectPort(device=emulated.laser_box, clock=clock), clock=clock)
    receiver = SonixDaqReceiver(
        settings=SonixDaqSettings(folder=str(folder / "daq"), timeout_s=3.0, readout_s=0.5, frames="triggered"),
        clock=clock,
    )
    reader = image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=reader,
        clock=clock,
        guard=Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission()),
    )
    simulated = rigs.simulated(seed=1, settings=SETTINGS)
    rig = replace(simulated, stage=stage, laser=laser, receiver=receiver, scanner=scanner, closing_dark=True)
    stereo = StereoSettings.of(endoscope.cameras, calibration_sigma_px=0.2)
    images = endoscope.images
    person = Person(
        rig=rig, images=images, stereo=stereo, by="test", wait_s=wait_s, endoscope=endoscope, endoscope_held=True
    )
    return person, emulated


def test_a_session_with_devices_registers_from_three_spots_and_is_on_record(tmp_path: Path) -> None:
    person, emulated = room(tmp_path)
    record = SessionRecord.create(tmp_path / "session", BEGUN)
    session = RegistrationSession(person, plan=SessionPlan(markers=3), record=record)
    steps: list[Step] = [step for step in session.steps() if not isinstance(step, Searching)]
    record.close()
    taken = [step for step in steps if isinstance(step, TakenMarker)]
    assert [marker.answer for marker in taken] == ["found"] * 3
    assert not [step for step in steps if isinstance(step, SpotRefused)]
    # What the receiver heard of the light for the cameras is refused in no search.
    assert not any("stale" in str(marker.reason) for marker in taken)
    known = session.view.registration
    assert known is not None
    found = known.davinci_to_trus
    target_m = np.array([0.0, 0.0, 0.04])
    error_m = np.linalg.norm(found.apply(person.endoscope.true.inverse().apply(target_m)) - target_m)
    assert error_m < 2 * known.report.tre95_m < 6e-3
    assert isinstance(steps[-1], Ended)
    assert steps[-1].registered
    # Three searches, and it is dark and still at the end.
    assert not emulated.laser_box.permitted
    low_deg, high_deg = emulated.stage.truth_range_deg
    assert -36.5 <= low_deg <= high_deg <= 36.5
    again = SessionRecord.reopen(tmp_path / "session")
    assert [marker.name for marker in again.view.markers] == ["1", "2", "3"]
    again.close()


def test_a_room_that_nobody_lights_ends_after_its_wait_and_fires_no_more(tmp_path: Path) -> None:
    person, emulated = room(tmp_path, wait_s=4.0)
    person.endoscope.images.show(None)
    steps = list(RegistrationSession(person).steps())
    refused = [step for step in steps if isinstance(step, SpotRefused)]
    assert len(refused) == 1
    assert "no light is seen" in refused[0].reason
    assert isinstance(steps[-1], Ended)
    assert not steps[-1].registered
    assert steps[-1].said.startswith("no new spot was accepted in the time allowed; ")
    assert 4.0 <= person.rig.scanner.clock.now_s() <= 8.0
    assert not emulated.laser_box.permitted


def set_at(person: Person, *times_s: float) -> list[float]:
    """Let the person say at these times that the spot is set."""
    left = list(times_s)

    def is_set() -> bool:
        if not left or person.rig.scanner.clock.now_s() < left[0]:
            return False
        left.pop(0)
        return True

    person.is_set = is_set
    return left


def pulses_at(emulated: EmulatedBench) -> list[float]:
    """The time of each pulse."""
    return [flash.at_s for flash in emulated.world.flashes for _ in range(flash.pulses)]


def test_it_is_dark_until_the_person_says_that_the_spot_is_set_and_again_after_each_refusal(tmp_path: Path) -> None:
    person, emulated = room(tmp_path, wait_s=30.0)
    person.endoscope.images.show(None)
    # The first is of before: it is asked for now.
    set_at(person, 0.0, 20.0, 45.0)
    steps = list(RegistrationSession(person).steps())
    waiting = next(step for step in steps if isinstance(step, Waiting))
    assert waiting.dark
    refused = [step for step in steps if isinstance(step, SpotRefused)]
    assert [("no light is seen" in step.reason) for step in refused] == [True, True]
    times_s = pulses_at(emulated)
    assert sum(step.pulses or 0 for step in refused) == len(times_s) > 0
    assert all(sum(at_s <= other_s < at_s + 1 for other_s in times_s) <= 10 for at_s in times_s)
    assert all(20.0 <= at_s <= 27.0 or 45.0 <= at_s <= 52.0 for at_s in times_s)
    assert steps[-1].said.startswith("no new spot was accepted in the time allowed; ")
    assert not emulated.laser_box.permitted


def test_a_session_looks_by_itself_after_its_time_in_the_dark_only_if_somebody_wants_that(tmp_path: Path) -> None:
    person, emulated = room(tmp_path, wait_s=25.0)
    person.endoscope.images.show(None)
    set_at(person)
    assert not any(isinstance(step, SpotRefused) for step in RegistrationSession(person).steps())
    assert pulses_at(emulated) == []
    person.idle_s = 10.0
    for step in RegistrationSession(person).steps():
        if isinstance(step, SpotRefused):
            break
    assert 35.0 <= min(pulses_at(emulated)) <= 40.0


def test_a_session_that_waits_in_the_dark_registers_as_one_in_the_light(tmp_path: Path) -> None:
    person, emulated = room(tmp_path)
    asked = iter([False, True] * 10)
    person.is_set = lambda: next(asked)
    session = RegistrationSession(person, plan=SessionPlan(markers=3))
    seen = [step for step in session.steps() if isinstance(step, SpotSeen)]
    assert session.view.registration is not None
    assert all(0 < (step.pulses or 0) <= 30 for step in seen)
    assert not emulated.laser_box.permitted


def test_devices_are_checked_by_a_spot_that_takes_no_part_and_whose_search_is_not_led(tmp_path: Path) -> None:
    person, emulated = room(tmp_path)
    session = RegistrationSession(person, plan=SessionPlan(markers=3, check=True))
    steps: list[Step] = [step for step in session.steps() if not isinstance(step, Searching)]
    known = session.view.registration
    assert known is not None
    assert [point.name for point in known.report.points] == ["1", "2", "3"]
    [check] = known.report.checks
    # The bench's errors are those that are expected.
    assert check.off_m < 2 * check.expected95_m < 8e-3
    [seen] = [step for step in steps if isinstance(step, SpotSeen) and step.name == check.name == "check-1"]
    assert seen.prediction is None
    assert not emulated.laser_box.permitted


def test_the_images_are_live_while_a_person_moves_the_spot_in_the_dark(tmp_path: Path) -> None:
    person, emulated = room(tmp_path, wait_s=4.0)
    shown: list[StereoPair] = []
    person.show = shown.append
    # Nobody says that it is set.
    person.is_set = lambda: False
    person.endoscope.images.show(None)
    begun_s = person.rig.scanner.clock.now_s()
    assert not person.ask(Waiting(name="1", place=None, said="light a spot", dark=True))
    waited_s = person.rig.scanner.clock.now_s() - begun_s
    assert len(shown) == pytest.approx(waited_s / SHOWN_S, abs=2)
    assert [each.at_s for each in shown] == sorted({each.at_s for each in shown})
    assert not emulated.laser_box.permitted
