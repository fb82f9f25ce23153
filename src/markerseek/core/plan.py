"""Plan of a search and options of a simulated rig, one class of settings each; and the facts of a rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import msgspec

from markerseek.core.angle_prior import AnglePrior
from markerseek.core.checks import Within, is_finite, is_whole, require_fields, require_range
from markerseek.core.errors import ConfigError
from markerseek.core.estimate import MarkerCurve
from markerseek.core.interval import Interval
from markerseek.core.options import Help, arguments_of
from markerseek.core.reading import MAX_ACQUISITIONS
from markerseek.core.values import repr_without

_FARTHEST_DEG = 360.0
"""Largest angle of a range that is searched, as of a bank: in a far larger one, no grid of angles has an end."""

MAX_DARK_FRAMES = 100
"""Most dark frames before a search."""


class Tolerance(msgspec.Struct, frozen=True, kw_only=True):
    """How far the 95 % interval of a marker that is found may reach from its angle.

    Attributes
    ----------
    mm
        As a length at the marker to either side, in millimetres.
    deg
        As an angle to either side, in degrees, where the distance of the marker from the axis is not known.

    Raises
    ------
    ConfigError
        If one of them is not positive.
    """

    mm: float = 1.0
    deg: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mm", "deg"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0):
                raise ConfigError(f"tolerance_{name} is {value}, it must be a positive number")

    def half_width_deg(self, radius_m: float | None) -> float:
        """Return the tolerance to either side in degrees, for a marker at this distance from the axis in metres."""
        return self.deg if radius_m is None else math.degrees(1e-3 * self.mm / radius_m)


class ByHand(msgspec.Struct, frozen=True, kw_only=True):
    """How a person turns the probe, on a rig without a motor.

    Attributes
    ----------
    step_deg
        Angles asked for are multiples of it: whole degrees can be read from a scale.
    reversal_deg
        Rotation that is as much effort as turning back, in degrees.
    reach_deg
        Most that the angle reached may differ from the one asked for, in degrees.
    drift_deg
        Most that the angle may change during an acquisition, in degrees.

    Raises
    ------
    ConfigError
        If one of them cannot be used.
    """

    step_deg: Annotated[float, Within(0.1, 5.0, "deg")] = 1.0
    reversal_deg: Annotated[float, Within(0.0, 360.0, "deg")] = 150.0
    reach_deg: Annotated[float, Within(0.1, 3.0, "deg")] = 1.0
    drift_deg: Annotated[float, Within(0.01, 0.9, "deg")] = 0.3

    def __post_init__(self) -> None:
        require_fields(self, "by hand")

    @property
    def arrival_deg(self) -> float:
        """Most that an acquisition may lie off the angle asked for, in degrees: a hand at rest drifts."""
        return self.reach_deg + self.drift_deg


class RunPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How a search on a rig begins and ends, whatever its policy.

    Raises
    ------
    ConfigError
        If the number of dark frames cannot be used.
    """

    stay: Annotated[bool, Help("Do not turn to the marker at the end, and confirm nothing.")] = False
    dark_frames: int = 0
    """Acquisitions without laser before the first, from which the policy learns the noise."""
    closing_dark: bool = False
    """End with a dark frame at the angle of the last acquisition with light. If frames are late by one, it holds that
    light, and the run ends with a fault. For receivers that cannot prove which trigger a frame belongs to."""

    def __post_init__(self) -> None:
        if not (is_whole(self.dark_frames) and 0 <= self.dark_frames <= MAX_DARK_FRAMES):
            raise ConfigError(f"dark_frames is {self.dark_frames}, it must lie between 0 and {MAX_DARK_FRAMES}")


class SearchPlan(RunPlan, frozen=True, kw_only=True):
    """Settings of a search: what a person chooses, and what follows from the rig.

    The fields with `Help` are what a person chooses: on the command line, on the page, over ROS 2 or OpenIGTLink, in a
    study. `markerseek.runs.plan_on` fills in what follows from the rig, and a journal holds the whole. The range of
    angles belongs to the rig (`RigFacts.search`).

    Raises
    ------
    ConfigError
        If a number cannot be used; `markerseek.search.require_plan` asks whether the method exists, and can do this.
    """

    method: Annotated[str, Help("How to search; an unknown name lists the methods.")] = "posterior"
    acquisitions: Annotated[
        int | None,
        Help(
            "Most acquisitions. An odd number is reduced by one where a method makes two per iteration.",
            least=2,
            shown="that of the method",
        ),
    ] = None
    tolerance_mm: Annotated[
        float,
        Help(
            "How well the angle of a marker that is found must be known: 95 % within this length at the marker, "
            "to either side, in mm."
        ),
    ] = 1.0
    tolerance_deg: Annotated[
        float,
        Help("The same in degrees, where the marker's distance from the axis is not known."),
    ] = 1.0
    sweep: Annotated[
        bool,
        Help("Turn the probe while the laser fires, one frame a pulse: an answer in seconds (posterior only)."),
    ] = False
    others: Annotated[
        float | None,
        Help(
            "Prior probability of a second source as strong; a smaller one takes fewer acquisitions, with 0 the "
            "search looks for no second source (posterior only).",
            shown="0.05",
        ),
    ] = None
    near: Annotated[
        AnglePrior | None,
        Help(
            "Where the marker is expected, as ANGLE±SIGMA in degrees: the search begins there, and takes the "
            "whole range where the samples contradict it (posterior only)."
        ),
    ] = None
    as_published: Annotated[bool, Help("The paper's form of the method, which always answers.")] = False

    early_end: bool = True
    """Whether a weighted average ends once its peak is recorded and passed, and a posterior once its angle is known
    well enough; the other methods have no early end."""
    prior: MarkerCurve | None = None
    """Intensity curve of a former marker on this rig, from which a posterior begins; None if there was none."""
    cues: tuple[str, ...] | None = None
    """Features of a reading that a posterior uses, as for `markerseek.search.posterior.Posterior`; None: all."""
    start_deg: float | None = None
    """Angle of the probe before the search, in degrees: checked sweeps and the manual search begin at the nearer end.
    None: where the probe of the rig is; without a rig, at the low end."""
    angles_deg: tuple[float, ...] | None = None
    """Angles that can be measured, each once, in degrees: those of a recording, among which a posterior chooses. None:
    any of the range."""
    whole: bool = False
    """Whether the angles that the search leaves of ``angles_deg`` are taken after it, and the answer is from all."""
    by_hand: ByHand | None = None
    """How a person turns the probe, for a posterior; None: a motor does."""
    motion_mm: Annotated[float | None, Within(0, 30, "mm")] = None
    """Amplitude of the tissue's motion, for a posterior: half of the way; 0: it rests. None: not known."""
    sweep_speed_deg_s: float | None = None
    """Speed of the sweeps of a posterior, in degrees per second; None: it stops for each acquisition."""
    sweep_from_end: bool = False
    """Whether the first sweep begins at the nearer end of the range, to which the probe turns without light, instead of
    where the probe is, and turns back in light: one sweep instead of two, for a receiver that reads the frames of a
    sweep at its end."""

    def __post_init__(self) -> None:
        # Checked before any device is opened: a plan comes from a command line or a page.
        super().__post_init__()
        number = self.acquisitions
        if number is not None and not (is_whole(number) and 0 <= number <= MAX_ACQUISITIONS):
            raise ConfigError(
                f"acquisitions is {number}, it must be a whole number between 0 and {MAX_ACQUISITIONS}; leave it out "
                "for the number of the method"
            )
        if self.others is not None and not (is_finite(self.others) and 0 <= self.others < 1):
            raise ConfigError(f"others is {self.others}, it must be a probability from 0 to below 1")
        if self.start_deg is not None and not is_finite(self.start_deg):
            raise ConfigError(f"start_deg is {self.start_deg} deg, it must be a finite number")
        speed = self.sweep_speed_deg_s
        if speed is not None and not (is_finite(speed) and speed > 0):
            raise ConfigError(f"sweep_speed_deg_s is {speed} deg/s, it must be a positive number")
        Tolerance(mm=self.tolerance_mm, deg=self.tolerance_deg)
        if self.motion_mm is not None:
            require_range("motion_mm", self.motion_mm, low=0, high=30, unit="mm")

    @property
    def tolerance(self) -> Tolerance:
        """How well the angle of a marker that is found must be known."""
        return Tolerance(mm=self.tolerance_mm, deg=self.tolerance_deg)


RigKind: TypeAlias = Literal["simulated", "replayed", "bench"]
"""Whether a rig is simulated, plays back a recording, or is one of devices."""


def rig_in_words(kind: str, emulated: Sequence[str]) -> str:
    """Return the kind of rig for people, emulated devices named: "bench rig with emulated stage and laser"."""
    return f"{kind} rig" + (f" with emulated {listed(emulated)}" if emulated else "")


def listed(names: Sequence[str]) -> str:
    """Return the names for people: "stage", "stage and laser", "stage, laser and receiver"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def counted(number: int, thing: str, things: str | None = None) -> str:
    """Return a number of things for people: "1 journal", "2 journals"; ``things``: their plural, if not by an s."""
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"


class RigFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Facts about a rig, which journals, banks and results store.

    Attributes
    ----------
    kind
        See `RigKind`.
    description
        Description for people.
    fingerprint
        Hash of its settings, or of the recording: equal for equal rigs.
    search
        Angles that may be searched.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres; None if not known.
    truth_deg
        True angle of the marker in a simulation, in degrees; None if not known.
    reference_deg
        Angle of the marker from another measurement, in degrees, for comparison; None without one.
    seed
        Seed of a simulation; None of any other rig.
    probe
        Name of the preset of the imaging chain; None, as the next four, where there are intensities only.
    probe_settings
        Description of the imaging chain's probe as JSON where it is one of the user's own; None for a preset of ours.
    sampling_hz
        Sampling frequency in Hz.
    sound_speed_m_s
        Speed of sound that the imaging assumes, in m/s.
    pitch_m
        Distance from one element of the array to the next, in metres.
    motion_mm
        Amplitude of the tissue's motion that is stated of the rig, in mm: half of the way; None if nothing is.
    emulated
        Devices of a bench that say of themselves that they are emulators: "stage", "laser".

    Raises
    ------
    ConfigError
        If an angle is not finite, or an end of the range is more than a turn away.
    """

    kind: RigKind
    description: str
    fingerprint: str
    search: Interval
    face_radius_m: float | None = None
    truth_deg: float | None = None
    reference_deg: float | None = None
    seed: int | None = None
    probe: str | None = None
    probe_settings: str | None = None
    sampling_hz: float | None = None
    sound_speed_m_s: float | None = None
    pitch_m: float | None = None
    motion_mm: float | None = None
    emulated: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("truth_deg", "reference_deg"):
            angle_deg = getattr(self, name)
            if angle_deg is not None and not is_finite(angle_deg):
                raise ConfigError(f"{name} is {angle_deg} deg, it must be a finite number")
        for end_deg in (self.search.low_deg, self.search.high_deg):
            require_range("search: an end", end_deg, low=-_FARTHEST_DEG, high=_FARTHEST_DEG, unit="deg")

    def __repr__(self) -> str:
        # Whoever prints a rig would know the answer before the search.
        return repr_without(self, "truth_deg")

    @property
    def rig_name(self) -> str:
        """As of `rig_in_words`."""
        return rig_in_words(self.kind, self.emulated)

    @property
    def known_deg(self) -> float | None:
        """Angle of the marker in degrees, true in a simulation, else the reference; None if neither is known."""
        return self.reference_deg if self.truth_deg is None else self.truth_deg


USUAL_SEED = 1
"""Seed of a simulation, where a person names none."""


MAX_PACE = 100.0
"""Slowest simulation, in real seconds for a virtual one: a search of five minutes takes a working day."""


class SceneOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a simulated rig, but for its markers, in place of those of its rig file.

    None leaves the file's value.

    Raises
    ------
    ConfigError
        If a number cannot be used.
    """

    seed: Annotated[
        int | None,
        Help("Seed of the simulation: the same seed gives the same search.", shown=str(USUAL_SEED), least=0),
    ] = None
    snr_db: Annotated[
        float | None,
        Help("Peak SNR of the simulated image with the probe on the marker, in dB.", shown="40"),
    ] = None
    tissue: Annotated[
        str | None,
        Help("Simulated material, instead of the rig's; an unknown name lists them all."),
    ] = None
    readout_s: Annotated[
        float | None,
        Help("Seconds to read one acquisition of a simulated rig, instead of the rig's.", shown="10"),
    ] = None
    breathing_mm: Annotated[
        float | None,
        Help("Breathing of the simulated tissue: it moves by this to either side of its middle, in mm.", shown="0"),
    ] = None
    breathing_period_s: Annotated[
        float | None,
        Help("Seconds from breath to breath of the simulated tissue.", shown="4"),
    ] = None
    pace: Annotated[float, Help("Real seconds per virtual second: 0 does not wait, 1 is real time.")] = 0.0

    def __post_init__(self) -> None:
        if self.seed is not None and not (is_whole(self.seed) and 0 <= self.seed < 2**63):
            raise ConfigError(f"seed is {self.seed!r}, it must be a whole number from 0 to 2**63 - 1")
        require_pace(self.pace)

    def given(self) -> list[str]:
        """Return the options that were given, as they are typed."""
        return [each.replace("=", " ") for each in arguments_of(self)]


class SimulationOptions(SceneOptions, frozen=True, kw_only=True):
    """Settings of a simulated rig in place of those of its rig file (`markerseek.sim.with_options`).

    None leaves the file's value.

    Raises
    ------
    ConfigError
        If they contradict each other, or a number cannot be used.
    """

    marker_deg: Annotated[
        float | None,
        Help("Angle of the simulated marker, in degrees.", shown="drawn at random"),
    ] = None
    second_marker_deg: Annotated[
        float | None,
        Help("Angle of a second simulated marker, as strong, elsewhere along the array."),
    ] = None
    no_marker: Annotated[bool, Help("Simulate noise and clutter alone.")] = False

    def __post_init__(self) -> None:
        if self.no_marker and (self.marker_deg, self.second_marker_deg) != (None, None):
            raise ConfigError("`no_marker` contradicts `marker_deg` and `second_marker_deg`; leave it or them out")
        super().__post_init__()


def require_pace(pace: float) -> None:
    """Refuse a pace that cannot be meant."""
    if not 0 <= pace <= MAX_PACE:
        raise ConfigError(f"pace is {pace}, it must lie between 0 (does not wait) and {MAX_PACE:g}; 1 is real speed")
