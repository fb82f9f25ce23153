"""Assembles a rig of real or emulated devices: drivers, guard and supervised serial lines."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from markerseek.core import Clock, ConfigError, Laser, Receiver, RigFacts, Stage
from markerseek.drivers import (
    BenchLaser,
    BenchProbe,
    BenchSettings,
    Kdc101Stage,
    LaserBox,
    Ros2Acquisition,
    Ros2Stage,
    RosLaser,
    RosReceiver,
    RosStage,
    SerialPort,
    SerialSettings,
    SonixDaqKeys,
    SonixDaqReceiver,
    SonixDaqSettings,
    StageKeys,
    StageSettings,
    SystemClock,
    picolas,
)
from markerseek.guard import Admission, Guard
from markerseek.rigs.recipe import BenchRecipe
from markerseek.rigs.rig import Rig, fingerprint, with_probe
from markerseek.rigs.simulation import DARK_FRAMES
from markerseek.ros import RosNode
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, probe_preset
from markerseek.supervisor import Line, Supervisor
from markerseek.wire import Port, apt
from markerseek.wire import laserbox as laserbox_wire

DARK_ALARM = 1e-6
"""False-alarm probability of one dark frame: a threshold of 7.3 standard deviations for an image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchPart:
    """The stage of a bench, or its laser and receiver, with a guard of their own: for a node that serves them.

    Attributes
    ----------
    stage, laser, receiver
        The devices; None where they are not of this part.
    guard
        Permits each step; it begins disarmed.
    clock
        Real time.
    description
        What it is.
    devices
        The lines, to be armed and closed.
    """

    stage: Stage | None
    laser: Laser | None
    receiver: Receiver | None
    guard: Guard
    clock: Clock
    description: str
    devices: OpenDevices

    def arm(self, *, by: str) -> None:
        """As `Rig.arm`."""
        self.guard.arm(by=by)
        self.devices.arm()


def bench_part(
    settings: BenchSettings, part: Literal["stage", "acquisition"], *, beat: Callable[[], None]
) -> BenchPart:
    """Connect the stage of a bench, or its laser and receiver, and nothing else; close its devices at the end.

    Parameters
    ----------
    settings
        Of the whole bench.
    part
        Which part.
    beat
        Called while a device works, at least every 20 ms; it may raise an exception, which ends the step.

    Raises
    ------
    DeviceError
        As `bench`.
    ConfigError
        If that part is itself behind ROS 2.
    """
    over_ros = isinstance(settings.stage if part == "stage" else settings.receiver, RosStage | RosReceiver)
    if over_ros:
        raise ConfigError(f"the {part} of this rig file is itself a ROS 2 node; name the rig file of its devices")
    devices = OpenDevices(settings, names=("stage",) if part == "stage" else ("laser",))
    try:
        supervisor = devices.supervisor

        def step() -> None:
            if supervisor is not None:
                supervisor.beat()
            beat()

        clock = SystemClock(beat=step)
        stage, laser, receiver = None, None, None
        if part == "stage":
            stage, description = _stage(settings, devices, clock)
        else:
            laser, receiver, description = _acquisition(settings, devices, clock)
        return BenchPart(
            stage=stage,
            laser=laser,
            receiver=receiver,
            guard=_guard(settings),
            clock=clock,
            description=description,
            devices=devices,
        )
    except BaseException:
        devices.close()
        raise


def _guard(settings: BenchSettings) -> Guard:
    return Guard(
        limits=settings.limits,
        firing=settings.firing,
        admission=Admission(noise_ratio=settings.receiver.noise_ratio, dark_alarm=DARK_ALARM),
    )


class OpenDevices:
    """The open serial lines of a bench, with or without a supervisor, and its ROS 2 node where it needs one.

    Parameters
    ----------
    settings
        Gives the ports, and whether a supervisor owns them.
    names
        Which lines are opened.

    Raises
    ------
    NotConnectedError
        If a line cannot be opened.
    """

    def __init__(self, settings: BenchSettings, *, names: Collection[str] = ("laser", "stage")) -> None:
        self._stack = ExitStack()
        self._ports: dict[str, Port] = {}
        self.supervisor: Supervisor | None = None
        self.node: RosNode | None = None
        lines = [line for line in _lines(settings) if line.name in names]
        with ExitStack() as opening:
            if isinstance(settings.stage, RosStage) or isinstance(settings.receiver, RosReceiver):
                self.node = opening.enter_context(RosNode("markerseek_rig", enclave="/markerseek/rig"))
            if settings.supervisor.enabled and lines:
                self.supervisor = opening.enter_context(Supervisor(lines=lines, period_s=settings.supervisor.lease_s))
                self._ports = {line.name: self.supervisor.port(line.name) for line in lines}
            else:
                for line in lines:
                    serial = SerialSettings(path=line.path, baud=line.baud, parity=line.parity, handshake=line.rtscts)
                    self._ports[line.name] = opening.enter_context(SerialPort(serial))
            # Only now: if the second line fails to open, the first is closed by the inner stack.
            self._stack = opening.pop_all()

    @property
    def stage(self) -> Port:
        """Line to the stage's controller."""
        return self._ports["stage"]

    @property
    def laser(self) -> Port:
        """Line to the laser box."""
        return self._ports["laser"]

    def arm(self) -> None:
        """Enable writes, also after the supervisor has blocked them."""
        if self.supervisor is not None:
            self.supervisor.arm()

    def close(self) -> None:
        """Close the lines; a supervisor sends each line's safe command first. Allowed twice."""
        self._stack.close()


def bench(settings: BenchSettings) -> Rig:
    """A rig of real devices; connecting to them moves nothing and fires nothing.

    A person must arm it (`Rig.arm`) before each search. Use it as a context manager, which closes it.

    Parameters
    ----------
    settings
        Devices, ports, limits and budgets.

    Raises
    ------
    NotConnectedError
        If a device does not answer, or is of another model.
    DeviceError
        If a device is not ready: the stage is not homed, or is outside its limits.
    ConfigError
        If a setting cannot be used.
    MissingExtraError
        If the packages for serial devices are not installed.
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
    # Each wait of the control loop renews the supervisor's lease; a hung loop does not, and is stopped.
    clock = SystemClock(beat=devices.supervisor.beat if devices.supervisor else None)
    stage, stage_name = _stage(settings, devices, clock)
    laser, receiver, acquisition_name = _acquisition(settings, devices, clock)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging,
        clock=clock,
        guard=_guard(settings),
        pulses=settings.pulses,
        dead_man=devices.supervisor,
    )
    facts = RigFacts(
        kind="bench",
        description=f"{stage_name}, {acquisition_name}"
        + ("" if settings.supervisor.enabled or not _lines(settings) else ", WITHOUT a supervisor"),
        fingerprint=fingerprint(settings),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
        # By what the devices answer and not by a key: a rig file may be copied from an emulated bench to a real one.
        emulated=_emulated(stage, laser),
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
        devices=devices,
    )


def _emulated(stage: Stage, laser: Laser) -> tuple[str, ...]:
    """Names of the devices that say of themselves that they are emulators."""
    box = isinstance(laser, LaserBox) and laser.identity == laserbox_wire.EMULATOR
    controller = isinstance(stage, Kdc101Stage) and stage.identity.emulated
    return tuple(name for name, is_so in (("stage", controller), ("laser", box)) if is_so)


def _lines(settings: BenchSettings) -> list[Line]:
    """The serial lines, each with the command that makes its device safe; a device behind ROS 2 has none."""
    # The laser first: the supervisor sends the safe commands in this order.
    laser, stage = settings.laser, settings.stage
    lines: list[Line] = []
    if not isinstance(laser, RosLaser):
        box = laserbox_wire.encode(laserbox_wire.Disarm())
        lines.append(
            Line(name="laser", path=laser.port, safe_command=box)
            if laser.driver == "laserbox"
            else Line(
                name="laser",
                path=laser.port,
                safe_command=picolas.SAFE_COMMAND,
                baud=picolas.BAUD,
                parity=picolas.PARITY,
            )
        )
    if not isinstance(stage, RosStage):
        lines.append(Line(name="stage", path=stage.port, safe_command=apt.stop(), rtscts=True))
    return lines


def _stage(settings: BenchSettings, devices: OpenDevices, clock: Clock) -> tuple[Stage, str]:
    """The stage, and what it is."""
    keys, travel = settings.stage, settings.limits.travel
    if isinstance(keys, RosStage):
        over_ros = Ros2Stage(node=_node(devices), clock=clock, settings=keys, travel=travel)
        return over_ros, f"stage node on {keys.command_topic}"
    stage = Kdc101Stage(
        port=devices.stage, clock=clock, settings=StageSettings(travel=travel, **_values(keys, StageKeys))
    )
    return stage, f"{stage.identity.model} {stage.identity.serial_number} at {keys.port}"


def _acquisition(settings: BenchSettings, devices: OpenDevices, clock: Clock) -> tuple[Laser, Receiver, str]:
    """Laser and receiver, and what they are."""
    keys, laser = settings.receiver, settings.laser
    if isinstance(keys, RosReceiver) or isinstance(laser, RosLaser):
        # `BenchSettings` has checked that they go together.
        assert isinstance(keys, RosReceiver)  # noqa: S101
        node = Ros2Acquisition(node=_node(devices), clock=clock, settings=keys)
        return node, node, f"acquisition node on {keys.request_topic}"
    receiver = SonixDaqReceiver(
        settings=SonixDaqSettings(folder=Path(keys.folder), dark_triggers=laser.pulses, **_values(keys, SonixDaqKeys)),
        clock=clock,
    )
    fixed = " (a fixed number of pulses, no watermark)" if keys.frames == "fixed" else ""
    return (
        _laser(laser, devices.laser, clock),
        receiver,
        f"{laser.driver} at {laser.port}, SonixDAQ in {keys.folder}{fixed}",
    )


def _node(devices: OpenDevices) -> RosNode:
    assert devices.node is not None  # noqa: S101  `OpenDevices` made it for these settings
    return devices.node


def _laser(laser: BenchLaser, port: Port, clock: Clock) -> Laser:
    if laser.driver == "picolas":
        return picolas.PicolasLaser(port=port, clock=clock, rate_hz=laser.rate_hz)
    return LaserBox(port=port, clock=clock, rate_hz=laser.rate_hz, dark_triggers=laser.pulses, answer_s=laser.answer_s)


def _values(settings: StageKeys | SonixDaqKeys, keys: type[StageKeys] | type[SonixDaqKeys]) -> dict[str, Any]:
    """Values of a rig file that a driver's settings have under the same names."""
    return {field.name: getattr(settings, field.name) for field in fields(keys)}


def imaging_of(probe: BenchProbe, *, sampling_hz: float) -> ImageReader:
    """Imaging chain of a bench.

    Parameters
    ----------
    probe
        Its probe.
    sampling_hz
        Sampling frequency of its receiver in Hz.
    """
    preset = probe_preset(probe.preset)
    # Another array or band makes another probe: a bank has to describe it in full.
    own = (probe.pitch_m, probe.low_hz, probe.high_hz, probe.f_number, probe.pickup_samples, probe.full_scale)
    name = None if set(own) == {None} else f"{preset.name} with own keys"
    return ImageReader(probe.on(preset, sampling_hz=sampling_hz, name=name))
