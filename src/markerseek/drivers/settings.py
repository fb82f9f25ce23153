"""Everything that must be said about a rig of real devices: a rig file of kind "bench", one value a name.

What has no default cannot be guessed: a port, a folder, and the stage's reading at which the probe points at 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from markerseek.core import ConfigError
from markerseek.guard import FiringLimits, Limits


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchStage:
    """The rotation stage; speeds and approach as in `markerseek.drivers.kdc101.StageSettings`.

    Attributes
    ----------
    port
        Serial port of its controller.
    zero_deg
        The stage's own reading at which the probe points at 0, in degrees.
    direction
        Whether the probe's angle grows with the stage's own reading ("forward") or falls ("reverse"). The default is an
        assumption: ``markerseek doctor --rig RIG.toml --source-deg ANGLE`` proves it.
    driver
        Which stage it is.
    serial_number
        Which controller it must be; None takes any.
    speed_deg_s, acceleration_deg_s2
        How it moves, in degrees per second and per second squared.
    approach_from, approach_deg
        Side from which every target is arrived at, and on how long a way, in degrees.
    begin_s
        How long it may stand still before it is taken to be stuck, in seconds.
    age_s
        How old the controller's answer may be, in seconds.
    """

    port: str
    zero_deg: float
    direction: Literal["forward", "reverse"] = "forward"
    driver: Literal["kdc101"] = "kdc101"
    serial_number: int | None = None
    speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 1.0
    begin_s: float = 0.5
    age_s: float = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchLaser:
    """The light.

    Attributes
    ----------
    port
        Serial port of the laser box, or of the PicoLAS driver.
    driver
        Which of them it is; the second was never tested on hardware, counts no pulses and has no lease of its own.
    pulses
        Pulses averaged in one acquisition.
    rate_hz
        Pulses per second.
    answer_s
        Longest time for the laser box's answer, in seconds; a PicoLAS driver has its own.
    """

    port: str
    driver: Literal["laserbox", "picolas"] = "laserbox"
    pulses: int = 16
    rate_hz: float = 100.0
    answer_s: float = 0.5

    def __post_init__(self) -> None:
        if not 1 <= self.pulses <= 1024:
            raise ConfigError(f"laser: pulses is {self.pulses}, it must lie between 1 and 1024")
        if not 0 < self.rate_hz <= 1000:
            raise ConfigError(f"laser: rate_hz is {self.rate_hz} Hz, it must lie in (0, 1000] Hz")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchReceiver:
    """The data acquisition; as in `markerseek.drivers.sonixdaq.SonixDaqSettings`.

    Attributes
    ----------
    folder
        Where the SonixDAQ's software writes its channel files, of either SDK.
    driver
        Which data acquisition it is.
    sampling_hz
        Sampling frequency in Hz.
    timeout_s, stable_s
        Longest time to the complete files, and how long they must be left alone, in seconds.
    start_command, start_timeout_s
        Program and arguments that get it ready for a trigger, and how long that may take, in seconds.
    noise_ratio
        Factor by which a frame's noise may differ from that of the run's first, see `markerseek.guard.Admission`.
    """

    folder: str
    driver: Literal["sonixdaq"] = "sonixdaq"
    sampling_hz: float = 40e6
    timeout_s: float = 60.0
    stable_s: float = 0.2
    start_command: tuple[str, ...] | None = None
    start_timeout_s: float = 10.0
    noise_ratio: float = 2.0

    def __post_init__(self) -> None:
        if not 1 < self.noise_ratio < math.inf:
            raise ConfigError(f"receiver: noise_ratio is {self.noise_ratio}, it must be a finite factor above 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchProbe:
    """The probe, as the imaging must know it.

    Attributes
    ----------
    preset
        Name of array, band and aperture: see ``markerseek frame --probe``.
    sound_speed_m_s
        Speed of sound in m/s; None takes the preset's.
    trigger_offset_s
        Time from the trigger to the middle of the laser's pulse, in seconds.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres; None where it is not known, and the marker is
        then given by its angle alone.
    """

    preset: str = "BPL9-5/55"
    sound_speed_m_s: float | None = None
    trigger_offset_s: float = 0.0
    face_radius_m: float | None = None

    def __post_init__(self) -> None:
        if self.face_radius_m is not None and not 0 < self.face_radius_m <= 0.05:
            raise ConfigError(f"probe: face_radius_m is {self.face_radius_m} m, it must lie in (0, 0.05] m")
        if self.sound_speed_m_s is not None and not 1000 <= self.sound_speed_m_s <= 2000:
            raise ConfigError(
                f"probe: sound_speed_m_s is {self.sound_speed_m_s} m/s, it must lie between 1000 and 2000 m/s"
            )
        if not math.fabs(self.trigger_offset_s) <= 1e-4:
            raise ConfigError(
                f"probe: trigger_offset_s is {self.trigger_offset_s} s, it must lie between -1e-4 and 1e-4 s"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSupervisor:
    """The process that holds the lines and lets go of them when the search dies or hangs.

    Attributes
    ----------
    enabled
        Whether there is one. Without it a search that is killed leaves the laser to the laser box's own lease, and
        the stage to the few degrees that its target is ahead.
    lease_s
        Longest silence of the control loop while it moves or fires, in seconds.
    """

    enabled: bool = True
    lease_s: float = 0.1

    def __post_init__(self) -> None:
        if not 0.05 <= self.lease_s <= 1:
            raise ConfigError(f"supervisor: lease_s is {self.lease_s} s, it must lie between 0.05 and 1 s")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSettings:
    """A rig of real devices, or of what emulates them byte for byte.

    Attributes
    ----------
    stage, laser, receiver, probe, supervisor
        See the classes.
    limits
        Where the probe may look, and be.
    firing
        What may be fired.
    """

    stage: BenchStage
    laser: BenchLaser
    receiver: BenchReceiver
    probe: BenchProbe = field(default_factory=BenchProbe)
    limits: Limits = field(default_factory=Limits)
    firing: FiringLimits = field(default_factory=FiringLimits)
    supervisor: BenchSupervisor = field(default_factory=BenchSupervisor)

    def __post_init__(self) -> None:
        if not self.laser.pulses <= self.firing.pulses_per_permit:
            raise ConfigError(
                f"laser: pulses is {self.laser.pulses}, firing.pulses_per_permit is {self.firing.pulses_per_permit}; "
                "average fewer, or permit more"
            )
        # Arrived at from the other side, an angle would be off by the gears' play and the marker with it.
        from_below = self.stage.approach_from == "below"
        farthest_deg = self.limits.search.low_deg if from_below else self.limits.search.high_deg
        start_deg = farthest_deg - self.stage.approach_deg if from_below else farthest_deg + self.stage.approach_deg
        if start_deg not in self.limits.travel:
            raise ConfigError(
                f"stage: to arrive at {farthest_deg:g} deg from {self.stage.approach_from} it must begin at "
                f"{start_deg:g} deg, outside the travel range {self.limits.travel}; narrow limits.search, widen "
                "limits.travel, or shorten stage.approach_deg"
            )
        if self.laser.driver == "picolas" and not self.supervisor.enabled:
            raise ConfigError(
                "supervisor: enabled is false, and a PicoLAS driver has no lease of its own; leave the supervisor on"
            )
