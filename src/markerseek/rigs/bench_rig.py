"""Assembles a rig of real or emulated devices: drivers, guard and supervised serial lines."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import Any

from markerseek.core import Clock, Laser, RigFacts
from markerseek.drivers import (
    BenchProbe,
    BenchSettings,
    Kdc101Stage,
    LaserBox,
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
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, probe_preset
from markerseek.supervisor import Line, Supervisor
from markerseek.wire import Port, apt
from markerseek.wire import laserbox as laserbox_wire

DARK_ALARM = 1e-6
"""False-alarm probability of one dark frame: a threshold of 7.3 standard deviations for an image."""


class OpenDevices:
    """The open serial lines of a bench, with or without a supervisor.

    Parameters
    ----------
    settings
        Gives the ports, and whether a supervisor owns them.

    Raises
    ------
    NotConnectedError
        If a line cannot be opened.
    """

    def __init__(self, settings: BenchSettings) -> None:
        self._stack = ExitStack()
        self._ports: dict[str, Port] = {}
        self.supervisor: Supervisor | None = None
        lines = _lines(settings)
        with ExitStack() as opening:
            if settings.supervisor.enabled:
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
    laser = _laser(settings, devices.laser, clock)
    stage_settings = StageSettings(travel=settings.limits.travel, **_values(settings.stage, StageKeys))
    stage = Kdc101Stage(port=devices.stage, clock=clock, settings=stage_settings)
    receiver_settings = SonixDaqSettings(
        folder=Path(settings.receiver.folder),
        dark_triggers=settings.laser.pulses,
        **_values(settings.receiver, SonixDaqKeys),
    )
    receiver = SonixDaqReceiver(settings=receiver_settings, clock=clock)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging,
        clock=clock,
        guard=Guard(
            limits=settings.limits,
            firing=settings.firing,
            admission=Admission(noise_ratio=settings.receiver.noise_ratio, dark_alarm=DARK_ALARM),
        ),
        pulses=settings.pulses,
        dead_man=devices.supervisor,
    )
    facts = RigFacts(
        kind="bench",
        description=(
            f"{stage.identity.model} {stage.identity.serial_number} at {settings.stage.port}, "
            f"{settings.laser.driver} at {settings.laser.port}, SonixDAQ in {settings.receiver.folder}"
            + (" (a fixed number of pulses, no watermark)" if settings.receiver.frames == "fixed" else "")
            + ("" if settings.supervisor.enabled else ", WITHOUT a supervisor")
        ),
        fingerprint=fingerprint(settings),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
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
        recipe=BenchRecipe(settings=settings),
        devices=devices,
    )


def _lines(settings: BenchSettings) -> list[Line]:
    """The two serial lines, each with the command that makes its device safe."""
    # The laser first: the supervisor sends the safe commands in this order.
    laser, stage = settings.laser, settings.stage
    box = laserbox_wire.encode(laserbox_wire.Disarm())
    return [
        Line(name="laser", path=laser.port, safe_command=box)
        if laser.driver == "laserbox"
        else Line(
            name="laser", path=laser.port, safe_command=picolas.SAFE_COMMAND, baud=picolas.BAUD, parity=picolas.PARITY
        ),
        Line(name="stage", path=stage.port, safe_command=apt.stop(), rtscts=True),
    ]


def _laser(settings: BenchSettings, port: Port, clock: Clock) -> Laser:
    if settings.laser.driver == "picolas":
        return picolas.PicolasLaser(port=port, clock=clock, rate_hz=settings.laser.rate_hz)
    return LaserBox(
        port=port,
        clock=clock,
        rate_hz=settings.laser.rate_hz,
        dark_triggers=settings.laser.pulses,
        answer_s=settings.laser.answer_s,
    )


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
