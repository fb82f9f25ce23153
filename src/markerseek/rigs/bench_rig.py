"""Assembles a rig of real or emulated devices, or one part of it: drivers, guard and supervised serial lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from markerseek.core import Clock, ConfigError, Laser, Receiver, RigFacts, Stage
from markerseek.drivers import PARTS, BenchProbe, BenchSettings, Part, SystemClock, entry_of, is_emulated, metered
from markerseek.guard import Guard
from markerseek.rigs.bench_devices import OpenDevices, guard_of
from markerseek.rigs.rig import BenchRecipe, Rig, fingerprint, with_probe
from markerseek.rigs.simulated_devices import DARK_FRAMES
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, probe_preset


def bench(settings: BenchSettings) -> Rig:
    """A rig of real devices; connecting to them moves nothing and fires nothing.

    A person must arm it (`Rig.arm`) before each search. Use it as a context manager, which closes it.

    ``settings``: devices, ports, limits and budgets.
    """
    imaging = imaging_of(settings.probe, sampling_hz=settings.receiver.sampling_hz)
    devices = OpenDevices(settings)
    try:
        # An error or Ctrl-C while connecting must not leave the lines locked.
        return _assembled(settings, devices, imaging)
    except BaseException:
        devices.close()
        raise


def _assembled(settings: BenchSettings, devices: OpenDevices, imaging: ImageReader) -> Rig:
    # Each wait of the control loop renews the supervisor's lease and the laser's; a hung loop does not, and is stopped.
    clock = SystemClock(beat=devices.beat)
    stage, stage_name = devices.stage(clock)
    laser, receiver, acquisition_name = devices.acquisition(clock)
    opened = zip(PARTS, (stage, laser, receiver), strict=True)
    emulated = tuple(part for part, device in opened if is_emulated(device))
    receiver = metered(settings.laser, laser, receiver, full_scale=imaging.preset.full_scale)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging,
        clock=clock,
        guard=guard_of(settings),
        pulses=settings.pulses,
        watchdog=devices.supervisor,
    )
    facts = RigFacts(
        kind="bench",
        description=f"{stage_name}, {acquisition_name}"
        + ("" if settings.supervisor.enabled or not settings.lines else ", WITHOUT a supervisor"),
        fingerprint=fingerprint(settings),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
        # By what the devices answer and not by a key: a rig file may be copied from an emulated bench to a real one.
        emulated=emulated,
    )
    return Rig(
        facts=with_probe(facts, imaging),
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=DARK_FRAMES,
        # If the receiver's frames come one acquisition late, a final dark frame contains light, and shows it.
        closing_dark=True,
        recipe=BenchRecipe.of(settings),
        by_hand=entry_of(settings.stage).by_hand(settings.stage),
        devices=devices,
        bench=settings,
        checks=devices.checks,
    )


def imaging_of(probe: BenchProbe, *, sampling_hz: float) -> ImageReader:
    """Imaging chain of a bench with this probe and the sampling frequency of its receiver in Hz."""
    preset = probe_preset(probe.preset)
    # Another array or band makes another probe: a bank has to describe it in full.
    own = (probe.pitch_m, probe.low_hz, probe.high_hz, probe.f_number, probe.pickup_samples, probe.full_scale)
    name = None if all(each is None for each in own) else f"{preset.name} with own keys"
    return ImageReader(probe.on(preset, sampling_hz=sampling_hz, name=name))


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchPart:
    """The stage of a bench, or its laser and receiver, with a guard of their own: for a node that serves them."""

    part: Stage | tuple[Laser, Receiver]
    guard: Guard
    """Permits each step; it begins disarmed."""
    clock: Clock
    description: str
    devices: OpenDevices
    """The lines, to be armed and closed."""

    def arm(self, *, by: str) -> None:
        """As `Rig.arm`."""
        self.guard.arm(by=by)
        self.devices.arm()


def bench_part(
    settings: BenchSettings, part: Literal["stage", "acquisition"], *, beat: Callable[[], None]
) -> BenchPart:
    """Connect the stage of a bench, or its laser and receiver, and nothing else; close its devices at the end.

    ``beat``: called while a device works, at least every 20 ms; it may raise an exception, which ends the step.
    """
    served: tuple[Part, ...] = ("stage",) if part == "stage" else ("laser", "receiver")
    if any(entry_of(getattr(settings, each)).is_node for each in served):
        raise ConfigError(f"the {part} of this rig file is itself a ROS 2 node; name the rig file of its devices")
    devices = OpenDevices(settings, parts=served)
    try:

        def step() -> None:
            devices.beat()
            beat()

        clock = SystemClock(beat=step)
        held: Stage | tuple[Laser, Receiver]
        if part == "stage":
            held, description = devices.stage(clock)
        else:
            laser, receiver, description = devices.acquisition(clock)
            preset = imaging_of(settings.probe, sampling_hz=settings.receiver.sampling_hz).preset
            held = laser, metered(settings.laser, laser, receiver, full_scale=preset.full_scale)
        return BenchPart(part=held, guard=guard_of(settings), clock=clock, description=description, devices=devices)
    except BaseException:
        devices.close()
        raise
