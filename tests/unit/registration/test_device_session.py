"""A whole session with the drivers of real devices, over emulated bytes and in virtual time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markerseek import rigs
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
    Step,
    StereoSettings,
    TakenMarker,
    Waiting,
)
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
    return Person(rig=rig, images=images, stereo=stereo, by="test", wait_s=wait_s, endoscope=endoscope), emulated


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
