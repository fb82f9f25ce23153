"""Assembles a rig of real or emulated devices, or one part of it: drivers, guard and supervised serial lines.

Serial lines are opened with their supervisor first, then each driver by its entry. A foreign driver is tried by the
public contract as soon as it is open, without light and without a move.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from msgspec import structs

from markerseek.contract import RuleCheck, check_laser, check_receiver, check_stage
from markerseek.core import (
    Clock,
    ConfigError,
    Laser,
    NotConnectedError,
    Permit,
    Receiver,
    RecordError,
    RigFacts,
    SpotToSource,
    Stage,
)
from markerseek.drivers import (
    PARTS,
    BenchProbe,
    BenchSettings,
    DeviceKeys,
    GuidedStageSettings,
    Opening,
    Part,
    SerialPort,
    SimulatedLaserSettings,
    SimulatedReceiverSettings,
    SimulatedStageSettings,
    SystemClock,
    bench_settings_from,
    entry_of,
    is_emulated,
    metered,
    trace_to,
    traced,
)
from markerseek.guard import Admission, Guard
from markerseek.rigs.rig import Rig, fingerprint_of, with_probe
from markerseek.rigs.rig_file import read_simulated
from markerseek.rigs.scene import draw_scene
from markerseek.rigs.simulation import DARK_FRAMES
from markerseek.ros import RosNode
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, probe_preset
from markerseek.sim import (
    LaserSettings,
    SimulatedHand,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedStage,
    World,
)
from markerseek.supervisor import Supervisor
from markerseek.wire import Port

_LOG = logging.getLogger(__name__)

DARK_ALARM = 1e-6
"""False-alarm probability of one dark frame: a threshold of 7.3 standard deviations for an image."""


class OpenDevices:
    """The devices of a bench: its serial lines, with or without a supervisor, and what is opened over them.

    ``settings``: gives drivers and ports, and whether a supervisor owns the lines. ``parts``: what is opened of it.
    ``checks``: rules of the contract that foreign drivers were tried by. ``ports``, ``stack``, ``beats``, ``enables``:
    the lines by part, what is left at the end, and what `beat` and `arm` call; a driver adds to them as it is opened.
    """

    def __init__(self, settings: BenchSettings, *, parts: Collection[Part] = ("stage", "laser", "receiver")) -> None:
        self._settings = settings
        self.ports: dict[str, Port] = {}
        self._node: RosNode | None = None
        self._simulated: SimulatedParts | None = None
        self._opened_stage: Stage | None = None
        self.enables: list[Callable[[], None]] = []
        self.supervisor: Supervisor | None = None
        self.checks: dict[str, tuple[RuleCheck, ...]] = {}
        lines = [line for line in settings.lines if line.name in parts]
        with ExitStack() as opening:
            if settings.trace is not None:
                opening.enter_context(trace_to(Path(settings.trace)))
            if settings.supervisor.enabled and lines:
                self.supervisor = opening.enter_context(Supervisor(lines=lines, period_s=settings.supervisor.lease_s))
                self.ports = {line.name: traced(self.supervisor.port(line.name), line.name) for line in lines}
            else:
                for line in lines:
                    serial = SerialPort(line.path, baud=line.baud, parity=line.parity, handshake=line.rtscts)
                    self.ports[line.name] = traced(opening.enter_context(serial), line.name)
            self.beats: list[Callable[[], None]] = [] if self.supervisor is None else [self.supervisor.beat]
            # Only now: if the second line fails to open, the first is closed by the inner stack.
            self.stack = opening.pop_all()

    def stage(self, clock: Clock) -> tuple[Stage, str]:
        """Return the stage, and what it is."""
        opened, name = self._open("stage", clock)
        self._opened_stage = opened
        return opened, name

    def acquisition(self, clock: Clock) -> tuple[Laser, Receiver, str]:
        """Return the laser and receiver, and what they are."""
        receiver, receiver_name = self._open("receiver", clock)
        laser, laser_name = self._open("laser", clock, receiver=receiver)
        return laser, receiver, ", ".join(filter(None, (laser_name, receiver_name)))

    def _open(self, part: Part, clock: Clock, *, receiver: Receiver | None = None) -> tuple[Any, str]:
        settings = getattr(self._settings, part)
        entry = entry_of(settings)
        opening = Opening(
            clock=clock,
            limits=self._settings.limits,
            pulses=self._settings.laser.pulses,
            port=self.ports.get(part),
            receiver=receiver,
            beats=self.beats,
            enables=self.enables,
            stack=self.stack,
            node=self._ros_node,
            simulated=partial(self._simulated_device, clock=clock),
        )
        device = entry.open(settings, opening)
        description = entry.describe(settings, device)
        _LOG.debug("%s: %s", part, description)
        self._try(part, device)
        return device, description

    def _try(self, part: Part, device: Any) -> None:
        """Try a foreign driver by the contract of its part; `NotConnectedError` if it does not keep it."""
        foreign = self._settings.foreign.get(part)
        if foreign is None:
            return
        if part == "stage":
            checks = check_stage(device, search=self._settings.limits.search)
        else:
            checks = check_laser(device) if part == "laser" else check_receiver(device)
        broken = "; ".join(f"{each.rule!r} {each.problem}" for each in checks if each.problem)
        if broken:
            raise NotConnectedError(f"{foreign.driver} breaks rules of a {part}: {broken}; correct the driver")
        self.checks[f"{part} {foreign.driver}"] = checks

    def beat(self) -> None:
        """Renew each lease: of the supervisor, and of a laser that has its own."""
        for each in self.beats:
            each()

    def _ros_node(self) -> RosNode:
        """Return the rig's ROS 2 node, made for its first device."""
        if self._node is None:
            self._node = self.stack.enter_context(RosNode("markerseek_rig"))
        return self._node

    def _simulated_device(self, settings: DeviceKeys, *, clock: Clock) -> Any:
        """Return a simulated device in the world of this rig."""
        if self._simulated is None:
            self._simulated = SimulatedParts(self._settings)
        return self._simulated.opened(settings, clock=clock, stage=self._opened_stage)

    def arm(self) -> None:
        """Enable writes, also after the supervisor has blocked them, and what needs a person's word to be enabled."""
        if self.supervisor is not None:
            self.supervisor.arm()
        for each in self.enables:
            each()

    def close(self) -> None:
        """Close the lines; a supervisor sends each line's safe command first. Allowed twice."""
        self.stack.close()


def guard_of(settings: BenchSettings) -> Guard:
    """Return the guard of a bench."""
    admission = Admission(noise_ratio=settings.receiver.noise_ratio, dark_alarm=DARK_ALARM)
    guard = partial(Guard, limits=settings.limits, firing=settings.firing)
    hand = entry_of(settings.stage).by_hand(settings.stage)
    if hand is None:
        return guard(admission=admission)
    # A hand drifts on from where it came to rest until the laser has fired.
    return guard(admission=replace(admission, settled_deg=hand.drift_deg), arrival_deg=hand.arrival_deg)


class SimulatedParts:
    """The simulated devices of a rig, and the world that they share."""

    def __init__(self, bench: BenchSettings) -> None:
        keys = bench.receiver if isinstance(bench.receiver, SimulatedReceiverSettings) else SimulatedReceiverSettings()
        settings = read_simulated(None if keys.world is None else Path(keys.world), cure="name one of kind simulated")
        settings = structs.replace(settings, receiver=structs.replace(settings.receiver, sampling_hz=keys.sampling_hz))
        rng = np.random.default_rng(keys.seed)
        self._settings = settings
        self._bench = bench
        self._readout_s = keys.readout_s
        self._rng = rng
        self._world = draw_scene(settings, rng).world(settings, rng)

    def opened(self, settings: DeviceKeys, *, clock: Clock, stage: Stage | None) -> Any:
        """Return the device that has these settings; ``stage``: of the rig, whatever drives it."""
        if isinstance(settings, SimulatedStageSettings):
            return _Stage(world=self._world, clock=clock, motion=self._settings.stage, travel=self._bench.limits.travel)
        if isinstance(settings, GuidedStageSettings):
            return SimulatedHand(
                world=self._world, clock=clock, limits=self._bench.limits.search, rng=self._rng.spawn(1)[0]
            )
        if stage is None:
            raise ConfigError(
                "simulated laser and receiver need the stage of their rig; serve them as nodes of one simulated rig"
            )
        if isinstance(settings, SimulatedLaserSettings):
            return _Laser(self._world, clock, stage, LaserSettings(rate_hz=settings.rate_hz))
        return _Receiver(world=self._world, clock=clock, readout_s=self._readout_s)


class _Stage(SimulatedStage):
    emulated = True


class _Receiver(SimulatedReceiver):
    emulated = True


class _Laser(SimulatedLaser):
    """Lights the world with its probe where the rig's stage is."""

    emulated = True

    def __init__(self, world: World, clock: Clock, stage: Stage, light: LaserSettings) -> None:
        super().__init__(world=world, clock=clock, light=light)
        self._stage = stage

    def fire(self, permit: Permit) -> int:
        # A simulated stage turns the probe itself, with its own backlash.
        if not isinstance(self._stage, _Stage):
            self._world.angle_deg = self._stage.angle_deg
        return super().fire(permit)


class BenchRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="bench"):
    """Arguments of `markerseek.rigs.bench_rig.bench`, as the tables of its rig file."""

    # Plain values: the drivers that they name are looked up when they are compared with a rig file.
    tables: dict[str, Any] = msgspec.field(name="settings")

    @classmethod
    def of(cls, settings: BenchSettings) -> BenchRecipe:
        """Return the recipe with these settings."""
        return cls(tables=settings.table())

    @property
    def settings(self) -> BenchSettings:
        """The settings; `RecordError` if the tables hold none."""
        try:
            return bench_settings_from(self.tables)
        except (ConfigError, RecursionError) as problem:
            raise RecordError(f"the journal's rig cannot be read: {problem}") from problem


def bench_fingerprint(settings: BenchSettings) -> str:
    """Return the fingerprint of a bench with these settings."""
    table = settings.table()
    # Fingerprints of rigs are older than this key.
    if settings.spot == SpotToSource():
        del table["spot"]
    return fingerprint_of(table)


def bench(settings: BenchSettings) -> Rig:
    """Return a rig of real devices; connecting to them moves nothing and fires nothing.

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
        fingerprint=bench_fingerprint(settings),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
        motion_mm=settings.tissue.motion_mm,
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
        spot=settings.spot,
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
    """Return the imaging chain of a bench with this probe and the sampling frequency of its receiver in Hz."""
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
