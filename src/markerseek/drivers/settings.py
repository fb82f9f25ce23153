"""Settings of a rig of real devices: the keys of a rig file of kind "bench".

What has no default cannot be guessed: a port, a folder, and the stage's reading at which the probe points at 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from markerseek.core import ConfigError, require_range
from markerseek.drivers._kdc101_settings import Kdc101Keys
from markerseek.drivers._light import LaserKeys
from markerseek.drivers._plus_settings import PlusSettings
from markerseek.drivers._receivers import require_noise_ratio
from markerseek.drivers._ros2_settings import Ros2StageSettings, RosLaser, RosReceiver
from markerseek.drivers._sonixdaq_settings import SonixDaqKeys
from markerseek.guard import FiringLimits, Limits
from markerseek.signals import ProbeKeys, probe_preset
from markerseek.wire import sonixdaq


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchStage(Kdc101Keys):
    """The rotation stage: its port and the keys of `Kdc101Keys`; ``zero_deg`` is required."""

    port: str
    """Serial port of its controller."""
    zero_deg: float
    driver: Literal["kdc101"] = "kdc101"


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchLaser(LaserKeys):
    """The laser: its port and the keys of `LaserKeys`."""

    port: str
    """Serial port of the laser box, or of the PicoLAS driver."""
    driver: Literal["laserbox", "picolas"] = "laserbox"
    """Which of them it is; ``picolas`` was never tested on hardware, counts no pulses and has no lease of its own."""
    answer_s: float = 0.5
    """Longest time for the laser box's answer; the PicoLAS driver's is fixed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchReceiver(SonixDaqKeys):
    """The data acquisition: its folder and the keys of `SonixDaqKeys`."""

    folder: str
    """Where the SonixDAQ's software writes its channel files, of either SDK."""
    driver: Literal["sonixdaq"] = "sonixdaq"
    """Driver of the data acquisition."""
    frames: Literal["triggered", "fixed"] = "fixed"
    """How many pulses it records: as many as it is triggered, or a fixed number. With ``triggered`` their number varies
    from acquisition to acquisition, so that a file shows which trigger it answers."""
    noise_ratio: float = 2.0
    """Factor by which a frame's noise may differ from that of the run's first, see `markerseek.guard.Admission`."""

    def __post_init__(self) -> None:
        SonixDaqKeys.__post_init__(self)
        require_noise_ratio(self.noise_ratio)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchProbe(ProbeKeys):
    """Properties of the probe that the imaging needs: a preset, and the keys of `ProbeKeys` in which it differs."""

    preset: str = "BPL9-5/55"
    """Name of array, band and aperture: see ``markerseek frame --probe``."""
    sound_speed_m_s: float | None = None
    """None takes the preset's."""
    trigger_offset_s: float = 0.0
    """Time from the trigger to the middle of the laser's pulse."""
    face_radius_m: float | None = None
    """Distance of the array's face from the axis of rotation; None if not known, and the result is then the marker's
    angle alone."""

    def __post_init__(self) -> None:
        if self.elements not in (None, sonixdaq.CHANNELS):
            raise ConfigError(
                f"probe: elements is {self.elements}, the SonixDAQ records {sonixdaq.CHANNELS} channels; leave it out"
            )
        if self.face_radius_m is not None:
            require_range("probe: face_radius_m", self.face_radius_m, low=0, high=0.05, unit="m", open_low=True)
        if self.sound_speed_m_s is not None:
            require_range("probe: sound_speed_m_s", self.sound_speed_m_s, low=1000, high=2000, unit="m/s")
        require_range("probe: trigger_offset_s", self.trigger_offset_s, low=-1e-4, high=1e-4, unit="s")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSupervisor:
    """The process that holds the lines and releases them when the search dies or hangs."""

    enabled: bool = True
    """Whether it is started. Without it, when a search is killed, only the laser box's own lease stops the laser, and
    the stage moves on by the few degrees that its target is ahead."""
    lease_s: float = 0.1
    """Longest time between two beats of the control loop while it moves or fires."""

    def __post_init__(self) -> None:
        require_range("supervisor: lease_s", self.lease_s, low=0.05, high=1, unit="s")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSettings:
    """A rig of real devices, or of what emulates them byte for byte."""

    stage: BenchStage | Ros2StageSettings
    laser: BenchLaser | RosLaser
    receiver: BenchReceiver | PlusSettings | RosReceiver
    probe: BenchProbe = field(default_factory=BenchProbe)
    limits: Limits = field(default_factory=Limits)
    """Angles that may be searched, and at which the probe may be."""
    firing: FiringLimits = field(default_factory=FiringLimits)
    """Limits of the laser's pulses."""
    supervisor: BenchSupervisor = field(default_factory=BenchSupervisor)

    def __post_init__(self) -> None:
        # Raises where the keys do not fit one another, before anything is opened.
        self.probe.on(probe_preset(self.probe.preset), sampling_hz=self.receiver.sampling_hz)
        if not max(self.pulses) <= min(self.firing.pulses_per_permit, 1024):
            raise ConfigError(
                f"laser: pulses is {self.laser.pulses}, firing.pulses_per_permit is {self.firing.pulses_per_permit}, "
                f"and up to {max(self.pulses)} are fired at once, at most 1024; average fewer, or permit more"
            )
        if isinstance(self.laser, RosLaser) != isinstance(self.receiver, RosReceiver):
            raise ConfigError(
                f"laser.driver is {self.laser.driver!r} and receiver.driver is {self.receiver.driver!r}; an "
                "acquisition node has both: name ros2 in both, or in neither"
            )
        if isinstance(self.stage, BenchStage):
            self._require_room_to_approach(self.stage)
        # Nothing else would switch that laser off when the search is killed.
        if self.laser.driver == "picolas" and not self.supervisor.enabled:
            raise ConfigError(
                "supervisor: enabled is false, and a PicoLAS driver has no lease of its own; keep it enabled"
            )

    def _require_room_to_approach(self, stage: BenchStage) -> None:
        # Approached from the other side, an angle would be off by the backlash of the gears, and the marker with it.
        from_below = stage.approach_from == "below"
        farthest_deg = self.limits.search.low_deg if from_below else self.limits.search.high_deg
        start_deg = farthest_deg - stage.approach_deg if from_below else farthest_deg + stage.approach_deg
        if start_deg not in self.limits.travel:
            raise ConfigError(
                f"stage: to arrive at {farthest_deg:g} deg from {stage.approach_from} the stage must start at "
                f"{start_deg:g} deg, outside the travel range {self.limits.travel}; narrow limits.search, widen "
                "limits.travel, or shorten stage.approach_deg"
            )

    @property
    def pulses(self) -> tuple[int, ...]:
        """Laser pulses of one acquisition, or of successive ones in turn where the receiver records every trigger.

        Only the last equals the number of a dark frame's triggers, so that neighbours always differ.
        """
        usual = self.laser.pulses
        receiver = self.receiver
        if isinstance(receiver, RosReceiver) or (isinstance(receiver, BenchReceiver) and receiver.frames == "fixed"):
            return (usual,)
        # One more, one less, as set: close to the pulses that were set, and no two neighbours equal.
        return tuple(number for number in (usual + 1, usual - 1, usual) if number > 0)
