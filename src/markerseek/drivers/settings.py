"""Settings of a rig of devices: the keys of a rig file of kind "bench".

A table that names a driver has the keys of that driver, which stand in its file.
What has no default cannot be guessed: a port, a folder, and the stage's reading at which the probe points at 0.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import msgspec

from markerseek.core import ConfigError, SpotToSource, Within, require_fields
from markerseek.drivers.entry import (
    PARTS,
    DeviceKeys,
    LaserKeys,
    MotorKeys,
    Part,
    ReceiverKeys,
    StageKeys,
    entry_named,
    entry_of,
)
from markerseek.drivers.foreign import Foreign, foreign_line, require_class, split_keys
from markerseek.drivers.standard_stage import require_approach
from markerseek.files import Line, require_key, setting_from, settings_from
from markerseek.guard import FiringLimits, Limits
from markerseek.signals import ProbeKeys, probe_preset


class BenchProbe(ProbeKeys, frozen=True, kw_only=True):
    """Properties of the probe that the imaging needs: a preset, and the keys of `ProbeKeys` in which it differs."""

    preset: str = "BPL9-5/55"
    """Name of array, band and aperture: see ``markerseek frame --probe``."""
    sound_speed_m_s: Annotated[float | None, Within(1000, 2000, "m/s")] = None
    """None takes the preset's."""
    trigger_offset_s: Annotated[float, Within(-1e-4, 1e-4, "s")] = 0.0
    """Time from the trigger to the middle of the laser's pulse."""
    face_radius_m: Annotated[float | None, Within(0, 0.05, "m", open_low=True)] = None
    """Distance of the array's face from the axis of rotation; None if not known, and the result is then the marker's
    angle alone."""

    def __post_init__(self) -> None:
        require_fields(self, "probe")


class BenchSupervisor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The process that holds the lines and releases them when the search dies or hangs."""

    enabled: bool = True
    """Whether it is started. Without it, when a search is killed, only the laser box's own lease stops the laser, and
    the stage moves on by the few degrees that its target is ahead."""
    lease_s: Annotated[float, Within(0.05, 1, "s")] = 0.1
    """Longest time between two beats of the control loop while it moves or fires."""

    def __post_init__(self) -> None:
        require_fields(self, "supervisor")


class BenchTissue(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is known of the tissue."""

    motion_mm: Annotated[float | None, Within(0, 30, "mm")] = None
    """Amplitude of its motion, as by breathing: half of the way; 0 of a phantom at rest. None: not known."""

    def __post_init__(self) -> None:
        require_fields(self, "tissue")


class BenchSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rig of real devices, or of devices that are emulated byte for byte."""

    stage: StageKeys
    laser: LaserKeys
    receiver: ReceiverKeys
    probe: BenchProbe = BenchProbe()
    tissue: BenchTissue = BenchTissue()
    limits: Limits = Limits()
    """Angles that may be searched, and at which the probe may be."""
    firing: FiringLimits = FiringLimits()
    """Limits of the laser's pulses."""
    supervisor: BenchSupervisor = BenchSupervisor()
    spot: SpotToSource = SpotToSource()
    """Where the light of a visible spot is absorbed, for a registration."""
    trace: str | None = None
    """File to which all that devices say and are told is appended, a line each, while the rig is open."""

    def __post_init__(self) -> None:
        # Raises where the keys do not fit one another, before anything is opened.
        self.probe.on(probe_preset(self.probe.preset), sampling_hz=self.receiver.sampling_hz)
        if self.receiver.channels is not None and self.probe.elements not in (None, self.receiver.channels):
            raise ConfigError(
                f"probe: elements is {self.probe.elements}, the receiver ({self.receiver.driver}) records "
                f"{self.receiver.channels} channels; leave it out"
            )
        if not max(self.pulses) <= min(self.firing.pulses_per_permit, 1024):
            raise ConfigError(
                f"laser: pulses is {self.laser.pulses}, firing.pulses_per_permit is {self.firing.pulses_per_permit}, "
                f"and up to {max(self.pulses)} are fired at once, at most 1024; average fewer, or permit more"
            )
        laser = entry_of(self.laser)
        receiver = entry_of(self.receiver)
        if (laser.paired or receiver.paired) and self.laser.driver != self.receiver.driver:
            name = self.laser.driver if laser.paired else self.receiver.driver
            raise ConfigError(
                f"laser.driver is {self.laser.driver!r} and receiver.driver is {self.receiver.driver!r}; {name} is "
                f"laser and receiver: name {name} in both, or in neither"
            )
        devices = (self.laser, self.stage, self.receiver)
        ports = {each.part: port for each in devices if (port := _serial_port(each))}
        for (other, its), (name, port) in combinations(ports.items(), 2):
            # Links are followed, because the names below /dev/serial/by-id are links.
            if os.path.realpath(port) == os.path.realpath(its):
                raise ConfigError(
                    f"{other} and {name} have one serial port, {port!r}"
                    + ("" if port == its else f" (which is {its!r})")
                    + "; each device has its own: see ls -l /dev/serial/by-id/"
                )
        if isinstance(self.stage, MotorKeys):
            require_approach(self.limits, approach_from=self.stage.approach_from, approach_deg=self.stage.approach_deg)
        if laser.without_supervisor and not self.supervisor.enabled:
            raise ConfigError(f"supervisor: enabled is false, and {laser.without_supervisor}; keep it enabled")

    @property
    def pulses(self) -> tuple[int, ...]:
        """Laser pulses of one acquisition, or of successive ones in turn where the receiver records every trigger.

        Only the last number is that of a dark frame's triggers, so successive acquisitions always differ.
        """
        usual = self.laser.pulses
        if not self.receiver.varied:
            return (usual,)
        # One more, one less, and as set: close to the setting, and no two successive numbers are equal.
        return tuple(number for number in (usual + 1, usual - 1, usual) if number > 0)

    @property
    def lines(self) -> list[Line]:
        """The serial lines, each with the command that makes its device safe."""
        # The laser first: the supervisor sends the safe commands in this order.
        found = [entry_of(each).line(each) for each in (self.laser, self.stage, self.receiver)]
        return [line for line in found if line is not None]

    @property
    def foreign(self) -> dict[Part, Foreign]:
        """Settings of the foreign drivers."""
        devices = (self.stage, self.laser, self.receiver)
        return {each.part: each for each in devices if isinstance(each, Foreign)}

    @property
    def foreign_lines(self) -> list[str]:
        """What a person must know of each foreign driver before arming it."""
        supervised = self.supervisor.enabled
        return [foreign_line(settings, supervised=supervised) for settings in self.foreign.values()]

    @property
    def comparable(self) -> tuple[str, ...]:
        """Keys that change angles or intensities: acquisitions with other values of them are not comparable.

        A name that ends with a dot stands for all keys of that table.
        """
        devices = (self.stage, self.laser, self.receiver)
        keys = [f"{each.part}.{key}" for each in devices for key in entry_of(each).same]
        return (
            *keys,
            "stage.driver",
            "laser.pulses",
            "laser.energy_from",
            "laser.usual_energy",
            "laser.pickup_us",
            "laser.energy_field",
            "receiver.driver",
            "receiver.sampling_hz",
            "probe.",
            "limits.search.",
        )

    def table(self) -> dict[str, Any]:
        """Return the settings as a rig file has them, as plain values."""
        table: dict[str, Any] = msgspec.to_builtins(self)
        # It changes nothing of what is measured.
        del table["trace"]
        # Newer than the records of rigs: a key that is not used must not change them.
        if self.tissue == BenchTissue():
            del table["tissue"]
        for part in self.foreign:
            keys = table[part].pop("keys")
            # The folder of its module follows from the rig file that a person names.
            del table[part]["beside"]
            table[part] |= keys
        return table


def _serial_port(settings: object) -> str | None:
    """Return the serial port in the settings of a device, or None; the class of the device is not imported."""
    port = settings.keys.get("port") if isinstance(settings, Foreign) else getattr(settings, "port", None)
    return port if isinstance(port, str) else None


def bench_settings_from(table: Mapping[str, object], *, beside: str = "") -> BenchSettings:
    """Return the settings of a rig of devices from the tables of a rig file, or from those that a journal holds.

    ``beside``: folder of the rig file, in which the module of a driver may lie; it is imported. Empty for a journal,
    whose drivers are not. Raises `ConfigError` if a key is unknown or missing, or a value does not fit.
    """
    made: dict[str, Any] = {}
    hints = get_type_hints(BenchSettings)
    for key, value in table.items():
        require_key(key, BenchSettings)
        # A device first: its driver has the keys of its table, and is known by its name alone.
        made[key] = _device_settings(key, value, beside) if key in PARTS else setting_from(value, hints[key], name=key)
    for part in PARTS:
        if part not in made:
            raise ConfigError(f"the key {part} is missing; add it")
    if made.get("trace") is not None:
        made["trace"] = str(Path(beside, made["trace"]))
    settings = BenchSettings(**made)
    for each in settings.foreign.values() if beside else ():
        require_class(each)
    return settings


def _device_settings(part: Part, table: object, beside: str) -> DeviceKeys:
    """Return the settings of a device from its table of a rig file."""
    if not isinstance(table, Mapping):
        return settings_from(table, DeviceKeys, name=part)
    entry = entry_named(part, table.get("driver"))
    if issubclass(entry.settings, Foreign):
        table = {**split_keys(table, entry.settings), "beside": beside}
    # Relative to the file, so that the command works from any current folder.
    paths = {key: str(Path(beside, value)) for key in entry.paths if isinstance(value := table.get(key), str)}
    named = {key: path for key, path in paths.items() if table[key] != "none"}
    settings: DeviceKeys = settings_from({**table, **named}, entry.settings, name=part)
    return settings
