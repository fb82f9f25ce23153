"""Settings of a simulated rig: one value for each unknown of the physics table."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from msgspec import structs

from markerseek.acoustics import Bursts, Probe
from markerseek.core import (
    ConfigError,
    Interval,
    SceneOptions,
    SimulationOptions,
    SpotToSource,
    Within,
    require_fields,
)
from markerseek.guard import FiringLimits, Limits
from markerseek.sim.motion import TissueMotion
from markerseek.sim.stage import StageMotion
from markerseek.sim.tissues import tissue_named


class MarkerSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The laser spot."""

    present: bool = True
    angle_deg: float | None = None
    """Angle of the centroid of the absorbed energy; None draws it anywhere in the search range."""
    radius_m: float = 60e-3
    """Distance from the axis of rotation."""
    lateral_m: float | None = None
    """Position along the axis; None draws it at most 20 mm from the middle, and in front of the array's inner four
    fifths."""
    source_radius_m: Annotated[float | None, Within(0, 5e-3, "m", open_low=True, cure="0.15 mm is usual")] = None
    """Radius of a single Gaussian absorber in place of the material's spot: the larger it is, the wider the intensity
    curve. None leaves the spot as the material has it."""

    beside_spot_m: Annotated[float, Within(0, 5e-3, "m", cure="0.1 to 0.5 mm are usual in tissue")] = 0.0
    """True standard deviation, along each direction, of the way from the visible spot of a registration to the centroid
    of the absorbed energy; a point in a phantom has none."""

    def __post_init__(self) -> None:
        require_fields(self, "marker")


class LaserSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The light."""

    pulses: Annotated[int, Within(1, FiringLimits().pulses_per_permit)] = 16
    """Pulses averaged in one acquisition."""
    pulse_s: float = 500e-9
    """Length of the rectangular pulse."""
    rate_hz: Annotated[float, Within(0, 1000, "Hz", open_low=True)] = 100.0
    """Pulses per second."""
    energy_jitter: Annotated[float, Within(0, 1)] = 0.03
    """Standard deviation of one pulse's energy over its mean."""
    energy_spread: Annotated[float, Within(0, 1)] = 0.0
    """Standard deviation of ln energy from one acquisition to the next, beside that of the pulses."""
    energy_drift_per_min: Annotated[float, Within(-1, 1)] = 0.0
    """Change of ln energy in a minute."""
    stamp_delay_s: Annotated[float, Within(-0.1, 0.1, "s")] = 0.0
    """True time from the stamp of a pulse to its light in a sweep."""
    stamp_delay_sigma_s: Annotated[float | None, Within(0, 0.1, "s")] = None
    """Standard deviation to which the rig knows it, as after ``markerseek calibrate --delay``; None: it does not, and
    takes 0 ± 10 ms."""
    stamp_jitter_s: Annotated[float, Within(0, 0.01, "s")] = 0.0
    """Standard deviation of the stamp of one pulse by itself."""
    without_light: Annotated[float, Within(0, 0.5)] = 0.0
    """Share of the pulses that give no light."""
    energy_meter_noise: Annotated[float | None, Within(0, 0.3)] = None
    """Relative standard deviation of an energy meter, whose value stands in the header of each frame."""

    def __post_init__(self) -> None:
        require_fields(self, "laser")


class NoiseSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The noise of one acquisition, after averaging."""

    peak_snr_db: Annotated[float, Within(-20, 100, "dB")] = 40.0
    """Envelope peak of the noise-free image with the probe on the marker, over the standard deviation of the beamformed
    noise, 20 log10."""
    coloured: Annotated[float, Within(0, 1)] = 0.0
    """Share of the noise power that has the spectrum of the receive band; the rest is white."""
    bursts: Bursts | None = None

    def __post_init__(self) -> None:
        require_fields(self, "noise")


class ReceiverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The data acquisition."""

    sampling_hz: float = 40e6
    samples: Annotated[int, Within(512, 65_536, cure="2080 is usual")] = 2080
    readout_s: Annotated[float, Within(0, 3600, "s", cure="10 s is usual")] = 10.0
    """Time to read one acquisition: 10 s with SonixDAQ files (paper, section 4)."""
    frame_period_s: Annotated[float, Within(1e-3, 10, "s")] = 0.05
    """Least time between two frames of a sweep; if readout_s is longer, all are read at the end of the sweep."""
    single_pulses: bool = False
    """Whether the gain that it chooses leaves room for the noise of a single pulse, as a sweep needs."""
    trigger_offset_s: float = 0.0
    """Time from the trigger to the middle of the laser pulse."""
    # Values above full scale (2047) are allowed, to try what saturation does.
    peak_counts: Annotated[float | None, Within(0, 1e6, open_low=True, cure="leave it out for one that fits")] = None
    """Largest count that the marker alone gives a channel with the probe on it; full scale is 2047. None chooses the
    gain so that marker and noise both fit: 600 counts, fewer where the noise is strong, more where it is weak."""

    def __post_init__(self) -> None:
        require_fields(self, "receiver")


class SimulatedSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A simulated rig; every part may be left at its default."""

    tissue: str = "plastisol-phantom"
    """Name of the simulated material."""
    start_deg: float = 0.0
    """Angle of the probe at the start."""
    marker: MarkerSettings = MarkerSettings()
    second: MarkerSettings = MarkerSettings(present=False)
    """A second spot, as strong as the marker; usually not present. Where its lateral position is left open, it lies on
    the other side of the array's middle."""
    probe: Probe = Probe()
    laser: LaserSettings = LaserSettings()
    noise: NoiseSettings = NoiseSettings()
    stage: StageMotion = StageMotion()
    receiver: ReceiverSettings = ReceiverSettings()
    motion: TissueMotion = TissueMotion()
    """How the tissue moves; the marker's place is that in the pause of breathing."""
    limits: Limits = Limits()
    spot: SpotToSource = SpotToSource()
    """Where the light of a visible spot is absorbed, as a registration assumes; the depth is drawn from this."""

    def __post_init__(self) -> None:
        if self.start_deg not in self.limits.travel:
            raise ConfigError(f"start_deg is {self.start_deg} deg, outside the travel range {self.limits.travel}")
        turn = Interval(low_deg=-180.0, high_deg=180.0)
        if not (self.limits.travel.low_deg in turn and self.limits.travel.high_deg in turn):
            raise ConfigError(f"limits: the travel range {self.limits.travel} is more than one turn, {turn}")
        for name, angle_deg in (("marker", self.marker.angle_deg), ("second", self.second.angle_deg)):
            if angle_deg is not None and not -90 <= angle_deg <= 90:
                raise ConfigError(f"{name}: angle_deg is {angle_deg} deg, it must lie between -90 and 90 deg")


STREAMING = SimulatedSettings(
    stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
    receiver=ReceiverSettings(readout_s=0.02, single_pulses=True),
)
"""A rig for sweeps: a PRM1Z8 at its limits, and a receiver that streams 20 frames a second."""


def with_options(settings: SimulatedSettings, options: SceneOptions) -> SimulatedSettings:
    """Return the settings of a simulated rig with the values that a person has chosen."""
    if isinstance(options, SimulationOptions):
        settings = _with_markers(settings, options)
    noise = settings.noise
    receiver = settings.receiver
    if options.snr_db is not None:
        noise = structs.replace(noise, peak_snr_db=options.snr_db)
    if options.readout_s is not None:
        receiver = structs.replace(receiver, readout_s=options.readout_s)
    motion = settings.motion
    if options.breathing_mm is not None:
        motion = structs.replace(motion, breathing_mm=options.breathing_mm)
    if options.breathing_period_s is not None:
        motion = structs.replace(motion, period_s=options.breathing_period_s)
    tissue = settings.tissue
    if options.tissue is not None:
        tissue_named(options.tissue)
        tissue = options.tissue
    return structs.replace(settings, tissue=tissue, noise=noise, receiver=receiver, motion=motion)


def _with_markers(settings: SimulatedSettings, options: SimulationOptions) -> SimulatedSettings:
    """Return the settings with the markers that a person has chosen."""
    marker = settings.marker
    second = settings.second
    if options.no_marker:
        marker = structs.replace(marker, present=False)
        second = structs.replace(second, present=False)
    if options.marker_deg is not None:
        marker = structs.replace(marker, present=True, angle_deg=options.marker_deg)
    if options.second_marker_deg is not None:
        second = structs.replace(second, present=True, angle_deg=options.second_marker_deg)
    return structs.replace(settings, marker=marker, second=second)


_NEWER_RECEIVER = ("frame_period_s", "single_pulses")
_NEWER_LASER = (
    *("energy_spread", "energy_drift_per_min", "energy_meter_noise", "stamp_delay_s"),
    *("stamp_delay_sigma_s", "stamp_jitter_s", "without_light"),
)


def hashable_values(settings: SimulatedSettings) -> dict[str, Any]:
    """Return the settings as plain values for a hash, without defaults of settings newer than the hashes.

    Seeds of studies and fingerprints of rigs are such hashes: a new setting that is not used must not change them.
    """
    values: dict[str, Any] = msgspec.to_builtins(settings)
    usual: dict[str, Any] = msgspec.to_builtins(SimulatedSettings())
    newer = [("receiver", name) for name in _NEWER_RECEIVER]
    newer += [("laser", name) for name in _NEWER_LASER]
    newer += [("stage", "stated_backlash_deg"), ("marker", "beside_spot_m")]
    for part, name in newer:
        if values[part][name] == usual[part][name]:
            del values[part][name]
    del values["second"]["beside_spot_m"]
    del usual["second"]["beside_spot_m"]
    for part in ("second", "motion", "spot"):
        if values[part] == usual[part]:
            del values[part]
    if settings.receiver.peak_counts is None:
        # The default that the hashes have been made with.
        values["receiver"]["peak_counts"] = 600.0
    return values
