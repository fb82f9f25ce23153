"""The energy of the pulses from the photodiode of the laser box, from their pick-up, and from a PLUS server's field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from msgspec.structs import replace as changed_keys

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    Finished,
    Found,
    Frame,
    FrameHeader,
    Interval,
    Measured,
    NotConnectedError,
    Permit,
    Receiver,
    RunPlan,
    SearchPlan,
)
from markerseek.drivers import EnergyMeter, LaserBoxSettings, metered
from markerseek.drivers.kdc101 import Kdc101Stage
from markerseek.drivers.laserbox import LaserBox
from markerseek.drivers.sonixdaq import SonixDaqReceiver, SonixDaqSettings
from markerseek.emulators import LIGHT_COUNTS, EmulatedBench
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs.scene import image_reader
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.signals import pickup_amplitude
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from tests.emulated_lines import BenchClock, DirectPort

FULL_SCALE = 2047
NEAR = Interval(low_deg=-12.0, high_deg=-4.0)
KEYS = LaserBoxSettings(port="", energy_from="photodiode", usual_energy=LIGHT_COUNTS)
STEADY = LaserSettings(energy_jitter=0.0, energy_meter_noise=0.0)
UNSTEADY = structs.replace(STEADY, energy_spread=0.05)


def found_on(folder: Path, laser: LaserSettings, keys: LaserBoxSettings) -> tuple[list[Measured], Found]:
    """Search the emulated bench with the drivers, in virtual time."""
    settings = SimulatedSettings(
        marker=MarkerSettings(angle_deg=-8.0),
        receiver=ReceiverSettings(readout_s=0.3),
        noise=NoiseSettings(peak_snr_db=70.0),
        laser=laser,
    )
    bench = EmulatedBench(settings=settings, rng=np.random.default_rng(7), folder=folder)
    clock = BenchClock()
    clock.lead(bench.daq.advance)
    box = LaserBox(port=DirectPort(device=bench.laser_box, clock=clock), clock=clock)
    receiver = SonixDaqReceiver(settings=SonixDaqSettings(folder=folder, timeout_s=3.0), clock=clock)
    scanner = Scanner(
        stage=Kdc101Stage(port=DirectPort(device=bench.stage, clock=clock), clock=clock),
        laser=box,
        receiver=metered(keys, box, receiver, full_scale=FULL_SCALE),
        reader=image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz),
        clock=clock,
        guard=Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission()),
    )
    scanner.guard.arm(by="test")
    # The vertex of a parabola through the top: a function of the intensities alone.
    policy = build(SearchPlan(method="exhaustive", acquisitions=9, as_published=True), limits=NEAR)
    events = list(run(policy, scanner, RunPlan(dark_frames=1)))
    finished = events[-1]
    assert isinstance(finished, Finished)
    assert isinstance(finished.estimate, Found)
    return [event for event in events if isinstance(event, Measured)], finished.estimate


def test_an_unsteady_laser_on_the_emulated_bench_with_a_light_meter_gives_the_answer_of_a_steady_one(
    tmp_path: Path,
) -> None:
    _, steady = found_on(tmp_path / "steady", STEADY, KEYS)
    events, measured = found_on(tmp_path / "measured", UNSTEADY, KEYS)
    _, unmeasured = found_on(tmp_path / "unmeasured", UNSTEADY, structs.replace(KEYS, energy_from=None))
    energies = [event.sample.frame.header.energy for event in events if event.sample.frame is not None]
    assert energies[0] is None  # the dark frame
    assert 0.01 < np.std([energy for energy in energies if energy is not None]) < 0.1
    assert measured.mean_deg == pytest.approx(steady.mean_deg, abs=0.02)
    assert abs(measured.mean_deg - steady.mean_deg) < abs(unmeasured.mean_deg - steady.mean_deg)


def test_a_box_without_a_light_meter_is_used_and_is_no_energy_meter(tmp_path: Path) -> None:
    counting = structs.replace(STEADY, energy_meter_noise=None)
    _, found = found_on(tmp_path / "counting", counting, changed_keys(KEYS, energy_from=None))
    assert found.mean_deg == pytest.approx(-8.0, abs=0.5)
    with pytest.raises(NotConnectedError, match=r"only counts pulses, .*build a light meter"):
        found_on(tmp_path / "asked", counting, KEYS)


class WithPickup:
    """A receiver whose channels have the pick-up of each pulse, as high as its energy, and a zero of their own."""

    def __init__(self, receiver: Receiver, energies: list[float]) -> None:
        self._receiver = receiver
        self._energies = energies

    def settle(self) -> None:
        self._receiver.settle()

    def arm(self, permit: Permit) -> None:
        self._receiver.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        frame = self._receiver.acquire(permit)
        return pickup_in(frame, self._energies.pop(0)) if permit.pulses else frame


def pickup_in(frame: Frame, energy: float) -> ChannelFrame:
    assert isinstance(frame, ChannelFrame)
    samples = frame.samples.astype(float) + np.linspace(-20, 20, frame.samples.shape[0])[:, None]
    samples[:, :40] += 1200 * energy * np.cos(np.arange(40)) * np.exp(-np.arange(40) / 10)
    return structs.replace(frame, samples=np.rint(samples).astype(np.int16))


def test_the_pick_up_in_the_channels_measures_the_energy() -> None:
    """Energies that differ by 30 %, from a window of 1 µs; a dark frame has none."""
    rig = rigs.simulated(seed=4, settings=SimulatedSettings(noise=NoiseSettings(peak_snr_db=40.0)))
    energies = [1.0, 0.7, 1.3, 0.9]
    keys = structs.replace(KEYS, energy_from="pickup", pickup_us=(0.0, 1.0), usual_energy=None)
    receiver = WithPickup(rig.receiver, [*energies, *energies])
    unscaled = metered(keys, rig.laser, receiver, full_scale=FULL_SCALE)
    assert isinstance(unscaled, EnergyMeter)
    assert unscaled.usual is None
    assert [energy_of(rig, unscaled, pulses=16) for _ in energies] == [None] * 4
    usual = unscaled.usual
    assert usual is not None
    scaled = metered(
        structs.replace(keys, usual_energy=usual / np.mean(energies)), rig.laser, receiver, full_scale=FULL_SCALE
    )
    assert [energy_of(rig, scaled, pulses=16) for _ in energies] == pytest.approx(energies, rel=0.01)
    assert energy_of(rig, scaled, pulses=0) is None


def energy_of(rig: rigs.Rig, receiver: Receiver, *, pulses: int) -> float | None:
    permit = Permit(token=f"{rig.scanner.clock.now_s()}", angle_deg=0.0, pulses=pulses, expires_s=np.inf)
    receiver.arm(permit)
    rig.laser.fire(permit)
    rig.scanner.clock.wait(0.1)
    return receiver.acquire(permit).header.energy


FRAME = ChannelFrame(
    header=FrameHeader(sequence=1, token="", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0),
    samples=np.random.default_rng(1).normal(0, 5, (16, 1000)).astype(np.int16),
    sampling_hz=40e6,
)


def test_noise_alone_has_no_pick_up_and_one_that_is_clipped_is_refused() -> None:
    assert pickup_amplitude(FRAME, window_us=(0.0, 1.0), full_scale=FULL_SCALE) < 1.5
    clipped = structs.replace(FRAME, samples=np.where(np.arange(1000) < 3, 2047, FRAME.samples).astype(np.int16))
    with pytest.raises(AcquisitionError, match="the pick-up reaches 2047 counts"):
        pickup_amplitude(clipped, window_us=(0.0, 1.0), full_scale=FULL_SCALE)
    with pytest.raises(ConfigError, match="must lie between the trigger and the last 256"):
        pickup_amplitude(FRAME, window_us=(0.0, 20.0), full_scale=FULL_SCALE)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"energy_from": "pickup"}, "pickup_us belongs to energy_from = 'pickup'"),
        ({"pickup_us": (0.0, 1.0)}, "pickup_us belongs to energy_from = 'pickup', but energy_from is None"),
        ({"energy_from": "metadata"}, "energy_field belongs to"),
        ({"energy_from": "pickup", "pickup_us": (2.0, 1.0)}, "a first and a later moment"),
    ],
)
def test_keys_that_do_not_fit_are_refused(keys: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        LaserBoxSettings(port="", **keys)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (KEYS, "energy_from is photodiode, which needs laser.driver laserbox"),
        (structs.replace(KEYS, energy_from="metadata", energy_field="Energy"), "which needs receiver.driver plus"),
    ],
)
def test_a_rig_without_such_a_meter_is_refused(keys: LaserBoxSettings, message: str) -> None:
    rig = rigs.simulated(seed=1)
    with pytest.raises(ConfigError, match=message):
        metered(keys, rig.laser, rig.receiver, full_scale=FULL_SCALE)


def test_what_only_works_at_rest_says_why_it_cannot_sweep() -> None:
    still: Any = object()
    with pytest.raises(ConfigError, match=r"its receiver \(object\) only works with the probe at rest"):
        _ = EnergyMeter(still, measured=lambda _: None, usual_energy=1.0).frame_period_s
