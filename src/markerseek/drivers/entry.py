"""Entry of a driver: its settings, how to open the device, and what a rig must know of it; and how it is found.

A driver of this package is a file beside this one that has its name, and ends with its ``ENTRY``; a file of drivers for
several parts ends with ``STAGE_ENTRY``, ``LASER_ENTRY`` or ``RECEIVER_ENTRY``. A rig looks it up by the key ``driver``
of its file, and treats all drivers alike. A name ``module:Class``, or that of an entry point, is a foreign driver
(`markerseek.drivers.foreign`).
"""

from __future__ import annotations

import importlib
import importlib.metadata
import math
import pkgutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

import msgspec

from markerseek.core import ByHand, Clock, ConfigError, Receiver, Within, is_absent, require_fields
from markerseek.files import Line
from markerseek.guard import Limits
from markerseek.wire import Port

if TYPE_CHECKING:
    from markerseek.ros import RosNode

Part: TypeAlias = Literal["stage", "laser", "receiver"]
"""The tables of a rig file that name a driver."""

PARTS: tuple[Part, ...] = ("stage", "laser", "receiver")


class DeviceKeys(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="driver"):
    """The keys of one table of a rig file; each driver has a subclass, tagged with the driver's name."""

    part: ClassVar[Part]
    """Name of the table."""

    def __post_init__(self) -> None:
        require_fields(self, self.part)

    @property
    def driver(self) -> str:
        """Name of the driver, as written in the rig file."""
        return str(self.__struct_config__.tag)


class StageKeys(DeviceKeys, frozen=True, kw_only=True):
    """Keys of any stage."""

    part = "stage"


class MotorKeys(StageKeys, frozen=True, kw_only=True):
    """Keys of a stage with a motor; angles are those of the probe, unless the text names the stage's own reading."""

    zero_deg: Annotated[float, Within(-360, 360, "deg")]
    """The stage's own reading at which the probe points at 0."""
    direction: Literal["forward", "reverse"] = "forward"
    """How the probe is mounted: "forward" if its angle grows with the stage's own reading, "reverse" if it falls. The
    default is an assumption: ``markerseek doctor --rig RIG.toml --source-deg ANGLE`` tests it."""
    serial_number: int | None = None
    """Serial number that the controller must have; None accepts any."""
    speed_deg_s: Annotated[float, Within(0.1, 25, "deg/s")] = 10.0
    """Speed of moves."""
    acceleration_deg_s2: Annotated[float, Within(0.1, 25, "deg/s²")] = 10.0
    """Acceleration of moves."""
    approach_deg: Annotated[float, Within(0.01, 5, "deg")] = 1.0
    """Distance over which every target is approached from one side: longer than the backlash of the gears."""
    begin_s: Annotated[float, Within(0.1, 5, "s")] = 0.5
    """Time without motion after which the stage counts as stuck."""

    @property
    def approach_from(self) -> Literal["below", "above"]:
        """Side, by the probe's angle, from which every target is approached; a key where the driver has both."""
        return "below"

    @property
    def sense(self) -> int:
        """1 if the probe's angle grows with the stage's own reading, -1 if it falls."""
        return 1 if self.direction == "forward" else -1


LIGHT = ("wavelength_nm", "pulse_energy_j", "pulse_width_s", "spot_diameter_m")
"""Keys of the light on the skin. Their ranges are those in which the limits of skin exposure are valid, or those of
suitable lasers."""


class LaserKeys(DeviceKeys, frozen=True, kw_only=True):
    """Keys of any laser."""

    part = "laser"

    pulses: Annotated[int, Within(1, 1024)] = 16
    """Pulses averaged in one acquisition."""
    rate_hz: Annotated[float, Within(0, 1000, "Hz", open_low=True)] = 100.0
    """Pulses per second."""
    # The four keys of the light only serve to show the exposure of skin when the rig is armed.
    wavelength_nm: Annotated[float | None, Within(400, 1400, "nm")] = None
    """Wavelength of the light on the skin; None if not known."""
    pulse_energy_j: Annotated[float | None, Within(1e-9, 10, "J")] = None
    """Energy of a pulse on the skin; None if not known."""
    pulse_width_s: Annotated[float | None, Within(1e-9, 1e-3, "s")] = None
    """Duration of a pulse; None if not known."""
    spot_diameter_m: Annotated[float | None, Within(1e-5, 1, "m")] = None
    """Diameter of the lit spot on the skin; None if not known."""
    energy_from: Literal["photodiode", "pickup", "metadata"] | None = None
    """Source of the pulse energy by which each reading is divided: the photodiode of a laser box with a light meter,
    the laser's pick-up in the channels, or a field of a PLUS server's images. None: readings are not divided."""
    usual_energy: Annotated[float | None, Within(0, 1e12, open_low=True)] = None
    """Reading of that source for a usual pulse, in its own unit; None: the energy is measured but not used."""
    pickup_us: tuple[float, float] | None = None
    """Time window of the pick-up: first and last moment after the trigger, in microseconds."""
    energy_field: str | None = None
    """Name of the field of a PLUS server's images that states the energy."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, source in (("pickup_us", "pickup"), ("energy_field", "metadata")):
            if (getattr(self, name) is None) == (self.energy_from == source):
                raise ConfigError(
                    f"laser: {name} belongs to energy_from = {source!r}, but energy_from is {self.energy_from!r}; set "
                    "both, or neither"
                )
        if self.pickup_us is not None and not 0 <= self.pickup_us[0] < self.pickup_us[1] <= 1000:
            raise ConfigError(
                f"laser: pickup_us is {list(self.pickup_us)} us, it must be a first and a later moment of 0 to 1000 us"
            )


class ReceiverKeys(DeviceKeys, frozen=True, kw_only=True):
    """Keys of any receiver."""

    part = "receiver"

    channels: ClassVar[int | None] = None
    """Number of channels that it records; None: one for each element of the probe."""

    sampling_hz: Annotated[float, Within(0, 1e9, "Hz", open_low=True)] = 40e6
    """Sampling frequency; the frames of a device do not state it."""
    noise_ratio: float = 2.0
    """Factor by which the noise may differ from that of the run's first frame, see `markerseek.guard.Admission`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 < self.noise_ratio < math.inf:
            raise ConfigError(f"receiver: noise_ratio is {self.noise_ratio}, it must be a finite factor above 1")

    @property
    def varied(self) -> bool:
        """Whether the number of pulses may vary between acquisitions, so that a frame shows its trigger."""
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Opening:
    """What a rig gives to the driver that it opens."""

    clock: Clock
    """Clock for all waits, because each wait renews a lease."""
    limits: Limits
    """Search range and travel limits of the probe."""
    pulses: int
    """Laser pulses of one acquisition, as set; a dark frame has as many triggers."""
    port: Port | None
    """The device's serial line, which the supervisor owns; None if the driver's entry has no line."""
    receiver: Receiver | None
    """The rig's receiver, which is opened before the laser."""
    beats: list[Callable[[], None]]
    """Functions that the clock calls in each wait, so that the control loop renews a device's lease."""
    enables: list[Callable[[], None]]
    """Functions that the rig calls when a person arms it."""
    stack: ExitStack
    """Contexts that end when the rig is closed."""
    node: Callable[[], RosNode]
    """The rig's ROS 2 node, which all its devices share."""
    simulated: Callable[[DeviceKeys], Any]
    """Makes a simulated device, in the world that all simulated devices of this rig share."""

    @property
    def line(self) -> Port:
        """The device's serial line; only for a driver whose entry has a line."""
        assert self.port is not None  # noqa: S101  by its entry
        return self.port


KeysT = TypeVar("KeysT", bound=DeviceKeys)
DeviceT = TypeVar("DeviceT")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry(Generic[KeysT, DeviceT]):
    """One driver of a stage, a laser or a receiver."""

    settings: type[KeysT]
    """Keys of its table in a rig file."""
    open: Callable[[KeysT, Opening], DeviceT]
    """Connects to the device; nothing moves and nothing is fired."""
    describe: Callable[[KeysT, DeviceT], str]
    """Text that names the connected device; empty if the text of another part does."""
    line: Callable[[KeysT], Line | None] = lambda _settings: None
    """Serial line that the supervisor owns, with the command that makes the device safe; None if it has none."""
    paths: tuple[str, ...] = ()
    """Keys that name a file or folder relative to the rig file."""
    same: tuple[str, ...] = ()
    """Keys that change the meaning of an angle or an intensity; a search is only resumed if their values are the same.
    ``("",)``: all keys except ``port``."""
    by_hand: Callable[[KeysT], ByHand | None] = lambda _settings: None
    """How a person turns the stage; None if a motor does."""
    paired: bool = False
    """Whether laser and receiver must both have this driver, or neither."""
    is_node: bool = False
    """Whether a ROS 2 node drives the device."""
    without_supervisor: str = ""
    """Why a laser must not be used without the supervisor, as the end of a sentence; empty if it may be used."""


AnyEntry: TypeAlias = Entry[Any, Any]


def is_emulated(device: object) -> bool:
    """Return whether a device says of itself that it is an emulator, or simulated."""
    return bool(getattr(device, "emulated", False))


DEFAULTS: dict[Part, str] = {"stage": "kdc101", "laser": "laserbox", "receiver": "sonixdaq"}
"""Driver of a table that names none."""

GROUP = "markerseek.drivers"
"""Entry points of installed drivers: a name, and ``module:Class``."""


def installed_drivers() -> dict[str, str]:
    """Return the names of the drivers that are installed by entry points, each with its ``module:Class``."""
    return {each.name: each.value for each in importlib.metadata.entry_points(group=GROUP)}


def driver_names(part: Part) -> tuple[str, ...]:
    """Return the names of this package's drivers of a part, the default first: those of the files with its entry."""
    names = sorted(each.name for each in pkgutil.iter_modules([str(Path(__file__).parent)]))
    return tuple(sorted((each for each in names if _entry(part, each)), key=lambda each: each != DEFAULTS[part]))


def entry_named(part: Part, driver: object = None) -> AnyEntry:
    """Return the entry of a driver by its name, of the default one without a name; only its file is imported."""
    driver = DEFAULTS[part] if driver is None else driver
    if isinstance(driver, str):
        if ":" in driver:
            return _foreign(part)
        if (entry := _entry(part, driver)) is not None:
            return entry
    installed = installed_drivers()
    if isinstance(driver, str) and driver in installed:
        return _foreign(part)
    names = ", ".join((*driver_names(part), *installed))
    raise ConfigError(
        f'{part}.driver is {driver!r}, it must be one of: {names}, or a class of your own as "module:Class"'
    )


def entry_of(settings: DeviceKeys) -> AnyEntry:
    """Return the entry of the driver that has these settings."""
    return entry_named(settings.part, settings.driver)


def _entry(part: Part, driver: str) -> AnyEntry | None:
    """Return the entry in the file of that name; None if there is no such file, or it has none of this part."""
    if not driver.isidentifier() or driver.startswith("_"):
        return None
    name = f"markerseek.drivers.{driver}"
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as problem:
        if is_absent(name, problem):
            return None
        raise
    entry = getattr(module, f"{part.upper()}_ENTRY", getattr(module, "ENTRY", None))
    return entry if isinstance(entry, Entry) and entry.settings.part == part else None


def _foreign(part: Part) -> AnyEntry:
    """Return the entry of a driver that is a class of the user's own."""
    entry: AnyEntry = importlib.import_module("markerseek.drivers.foreign").FOREIGN[part]
    return entry
