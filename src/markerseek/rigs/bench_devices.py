"""Opens the devices of a bench: serial lines with their supervisor, a ROS 2 node, and the drivers over them."""

from __future__ import annotations

import socket
from collections.abc import Collection
from contextlib import ExitStack, closing
from dataclasses import fields
from pathlib import Path
from typing import Any

from markerseek.core import Clock, Laser, Receiver, Stage
from markerseek.drivers import (
    BenchLaser,
    BenchSettings,
    Kdc101DriverSettings,
    Kdc101Keys,
    Kdc101Stage,
    LaserBox,
    PlusReceiver,
    PlusSettings,
    Ros2Acquisition,
    Ros2Stage,
    Ros2StageSettings,
    RosLaser,
    RosReceiver,
    SerialPort,
    SonixDaqKeys,
    SonixDaqReceiver,
    SonixDaqSettings,
    connect_plus,
    picolas,
)
from markerseek.guard import Admission, Guard
from markerseek.ros import RosNode
from markerseek.supervisor import Line, Supervisor
from markerseek.wire import Port, apt
from markerseek.wire import laserbox as laserbox_wire

DARK_ALARM = 1e-6
"""False-alarm probability of one dark frame: a threshold of 7.3 standard deviations for an image."""


class OpenDevices:
    """The open serial lines of a bench, with or without a supervisor, and its ROS 2 node where it needs one.

    ``settings``: gives the ports, and whether a supervisor owns them.
    """

    def __init__(self, settings: BenchSettings, *, names: Collection[str] = ("laser", "stage")) -> None:
        self._stack = ExitStack()
        self._ports: dict[str, Port] = {}
        self.supervisor: Supervisor | None = None
        self.node: RosNode | None = None
        self.plus: socket.socket | None = None
        lines = [line for line in lines_of(settings) if line.name in names]
        with ExitStack() as opening:
            if isinstance(settings.stage, Ros2StageSettings) or isinstance(settings.receiver, RosReceiver):
                self.node = opening.enter_context(RosNode("markerseek_rig", enclave="/markerseek/rig"))
            if isinstance(settings.receiver, PlusSettings) and "laser" in names:
                self.plus = opening.enter_context(closing(connect_plus(settings.receiver)))
            if settings.supervisor.enabled and lines:
                self.supervisor = opening.enter_context(Supervisor(lines=lines, period_s=settings.supervisor.lease_s))
                self._ports = {line.name: self.supervisor.port(line.name) for line in lines}
            else:
                for line in lines:
                    serial = SerialPort(line.path, baud=line.baud, parity=line.parity, handshake=line.rtscts)
                    self._ports[line.name] = opening.enter_context(serial)
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


def guard_of(settings: BenchSettings) -> Guard:
    """Guard of a bench."""
    return Guard(
        limits=settings.limits,
        firing=settings.firing,
        admission=Admission(noise_ratio=settings.receiver.noise_ratio, dark_alarm=DARK_ALARM),
    )


def emulated(stage: Stage, laser: Laser, receiver: Receiver) -> tuple[str, ...]:
    """Names of the devices that say of themselves that they are emulators, or simulated."""
    box = isinstance(laser, LaserBox) and laser.identity == laserbox_wire.EMULATOR
    controller = isinstance(stage, Kdc101Stage) and stage.identity.emulated
    node = isinstance(stage, Ros2Stage) and stage.simulated
    server = isinstance(receiver, PlusReceiver) and receiver.emulated
    both = isinstance(receiver, Ros2Acquisition) and receiver.simulated
    answers = (("stage", controller or node), ("laser", box or both), ("receiver", server or both))
    return tuple(name for name, is_so in answers if is_so)


def lines_of(settings: BenchSettings) -> list[Line]:
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
    if not isinstance(stage, Ros2StageSettings):
        lines.append(Line(name="stage", path=stage.port, safe_command=apt.stop(), rtscts=True))
    return lines


def stage_of(settings: BenchSettings, devices: OpenDevices, clock: Clock) -> tuple[Stage, str]:
    """The stage, and what it is."""
    keys, travel = settings.stage, settings.limits.travel
    if isinstance(keys, Ros2StageSettings):
        over_ros = Ros2Stage(node=_node(devices), clock=clock, settings=keys, travel=travel)
        return over_ros, f"{'SIMULATED ' if over_ros.simulated else ''}stage node on {keys.command_topic}"
    stage = Kdc101Stage(
        port=devices.stage, clock=clock, settings=Kdc101DriverSettings(travel=travel, **_values(keys, Kdc101Keys))
    )
    return stage, f"{stage.identity.model} {stage.identity.serial_number} at {keys.port}"


def acquisition_of(settings: BenchSettings, devices: OpenDevices, clock: Clock) -> tuple[Laser, Receiver, str]:
    """Laser and receiver, and what they are."""
    keys, laser = settings.receiver, settings.laser
    if isinstance(keys, RosReceiver) or isinstance(laser, RosLaser):
        # `BenchSettings` has checked that they go together.
        assert isinstance(keys, RosReceiver)  # noqa: S101
        node = Ros2Acquisition(node=_node(devices), clock=clock, settings=keys)
        return node, node, f"{'SIMULATED ' if node.simulated else ''}acquisition node on {keys.request_topic}"
    if isinstance(keys, PlusSettings):
        assert devices.plus is not None  # noqa: S101  `OpenDevices` connected it for these settings
        images = PlusReceiver(connection=devices.plus, clock=clock, settings=keys, dark_triggers=laser.pulses)
        where = f"PLUS server at {keys.host}, port {keys.port}"
        return _laser(laser, devices.laser, clock), images, f"{laser.driver} at {laser.port}, {where}"
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


def _values(settings: Kdc101Keys | SonixDaqKeys, keys: type[Kdc101Keys] | type[SonixDaqKeys]) -> dict[str, Any]:
    """Values of a rig file that a driver's settings have under the same names."""
    return {field.name: getattr(settings, field.name) for field in fields(keys)}
