"""What the table of drivers holds of each: its settings, how it is opened, and what a rig must know of it.

A driver's file ends with its ``ENTRY``. A rig looks it up by the key ``driver`` of its file
(`markerseek.drivers.table`), and treats all drivers alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

import msgspec

from markerseek.core import ByHand, Clock, ConfigError, Receiver, Within, require_fields
from markerseek.files import Line
from markerseek.guard import Limits
from markerseek.wire import Port

if TYPE_CHECKING:
    from markerseek.ros import RosNode

Part: TypeAlias = Literal["stage", "laser", "receiver"]
"""The tables of a rig file that name a driver."""

PARTS: tuple[Part, ...] = ("stage", "laser", "receiver")


class DeviceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="driver"):
    """The keys of one table of a rig file; each driver has its own, tagged with its name."""

    part: ClassVar[Part]
    """Name of the table."""

    def __post_init__(self) -> None:
        require_fields(self, self.part)

    @property
    def driver(self) -> str:
        """Name of the driver, as the rig file has it."""
        return str(self.__struct_config__.tag)


class StageSettings(DeviceSettings, frozen=True, kw_only=True):
    """Keys of any stage."""

    part = "stage"


class MotorSettings(StageSettings, frozen=True, kw_only=True):
    """Keys of a stage with a motor of its own; angles are the probe's unless they are called the stage's own."""

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
    """Distance over which every target is approached from one side: longer than the gears' play."""
    begin_s: Annotated[float, Within(0.1, 5, "s")] = 0.5
    """Time without motion after which the stage counts as stuck."""

    @property
    def sense(self) -> int:
        """1 if the probe's angle grows with the stage's own reading, -1 if it falls."""
        return 1 if self.direction == "forward" else -1


LIGHT = ("wavelength_nm", "pulse_energy_j", "pulse_width_s", "spot_diameter_m")
"""Keys of the light on the skin. Their ranges are those in which the limits of skin exposure hold, or which a suitable
laser can have."""


class LaserSettings(DeviceSettings, frozen=True, kw_only=True):
    """Keys of any laser."""

    part = "laser"

    pulses: Annotated[int, Within(1, 1024)] = 16
    """Pulses averaged in one acquisition."""
    rate_hz: Annotated[float, Within(0, 1000, "Hz", open_low=True)] = 100.0
    """Pulses per second."""
    wavelength_nm: Annotated[float | None, Within(400, 1400, "nm")] = None
    pulse_energy_j: Annotated[float | None, Within(1e-9, 10, "J")] = None
    pulse_width_s: Annotated[float | None, Within(1e-9, 1e-3, "s")] = None
    spot_diameter_m: Annotated[float | None, Within(1e-5, 1, "m")] = None
    """``wavelength_nm``, ``pulse_energy_j``, ``pulse_width_s`` and ``spot_diameter_m``: the light on the skin:
    wavelength in nm, energy and duration of a pulse in J and s, and diameter of the lit spot in metres. They only serve
    to show the exposure of skin when the rig is armed; None if not known."""
    energy_from: Literal["photodiode", "pickup", "metadata"] | None = None
    """What measures the energy of each acquisition, by which readings are divided: the photodiode of a laser box with a
    light meter, the laser's pick-up in the channels, or a field of a PLUS server's images. None: nothing does."""
    usual_energy: Annotated[float | None, Within(0, 1e12, open_low=True)] = None
    """What it says of a usual pulse, in a unit of its own; None: it is measured and not used."""
    pickup_us: tuple[float, float] | None = None
    """Where the pick-up is: first and last moment after the trigger, in microseconds."""
    energy_field: str | None = None
    """Name of the field of a PLUS server's images."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, source in (("pickup_us", "pickup"), ("energy_field", "metadata")):
            if (getattr(self, name) is None) == (self.energy_from == source):
                raise ConfigError(
                    f"laser: {name} belongs to energy_from = {source!r}, which is {self.energy_from!r}; name both, or "
                    "neither"
                )
        if self.pickup_us is not None and not 0 <= self.pickup_us[0] < self.pickup_us[1] <= 1000:
            raise ConfigError(
                f"laser: pickup_us is {list(self.pickup_us)} us, it must be a first and a later moment of 0 to 1000 us"
            )


class ReceiverSettings(DeviceSettings, frozen=True, kw_only=True):
    """Keys of any receiver."""

    part = "receiver"

    channels: ClassVar[int | None] = None
    """Channels that it records; None: as many as the probe has elements."""

    sampling_hz: Annotated[float, Within(0, 1e9, "Hz", open_low=True)] = 40e6
    """Sampling frequency, which frames of a device do not hold."""
    noise_ratio: float = 2.0
    """Factor by which a frame's noise may differ from that of the run's first, see `markerseek.guard.Admission`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 < self.noise_ratio < math.inf:
            raise ConfigError(f"receiver: noise_ratio is {self.noise_ratio}, it must be a finite factor above 1")

    @property
    def varied(self) -> bool:
        """Whether the number of pulses may vary from acquisition to acquisition, which shows the trigger of a frame."""
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Opening:
    """What a rig has for the driver that it opens."""

    clock: Clock
    """All waiting is done on it, because each wait renews a lease."""
    limits: Limits
    """Angles that may be searched, and at which the probe may be."""
    pulses: int
    """Laser pulses of one acquisition, as set, and so the triggers of a dark frame."""
    port: Port | None
    """The device's serial line, which the supervisor holds; None where its entry names none."""
    receiver: Receiver | None
    """The rig's receiver, which is opened before the laser."""
    beats: list[Callable[[], None]]
    """Called in each wait of the clock: so the control loop's own steps renew a device's lease."""
    enables: list[Callable[[], None]]
    """Called when a person arms the rig."""
    stack: ExitStack
    """What is left when the rig is closed."""
    node: Callable[[], RosNode]
    """The rig's ROS 2 node, which all its devices share."""
    simulated: Callable[[DeviceSettings], Any]
    """A simulated device, in the world that all simulated devices of this rig share."""

    @property
    def line(self) -> Port:
        """The device's serial line; only where its entry names one."""
        assert self.port is not None  # noqa: S101  by its entry
        return self.port


SettingsT = TypeVar("SettingsT", bound=DeviceSettings)
DeviceT = TypeVar("DeviceT")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry(Generic[SettingsT, DeviceT]):
    """One driver of a stage, a laser or a receiver."""

    settings: type[SettingsT]
    """Keys of its table in a rig file."""
    open: Callable[[SettingsT, Opening], DeviceT]
    """Connects to the device; nothing moves and nothing is fired."""
    describe: Callable[[SettingsT, DeviceT], str]
    """What was connected, for people; empty if another part says it."""
    line: Callable[[SettingsT], Line | None] = lambda _settings: None
    """Serial line that the supervisor holds, with the command that makes the device safe; None if it has none."""
    paths: tuple[str, ...] = ()
    """Keys that name a file or folder, from where the rig file lies."""
    same: tuple[str, ...] = ()
    """Keys that change what an angle or an intensity is: a search is not resumed with others. ``("",)``: all but
    ``port``."""
    require_room: Callable[[SettingsT, Limits], None] = lambda _settings, _limits: None
    """Raises `ConfigError` if the travel range leaves no room to approach the ends of the search range."""
    by_hand: Callable[[SettingsT], ByHand | None] = lambda _settings: None
    """How a person turns a stage; None: a motor does."""
    paired: bool = False
    """Whether laser and receiver must both have this driver, or neither."""
    is_node: bool = False
    """Whether a ROS 2 node drives it."""
    without_supervisor: str = ""
    """Why a laser must not be used without the supervisor, as the end of a sentence; empty if it may."""


AnyEntry: TypeAlias = Entry[Any, Any]


def is_emulated(device: object) -> bool:
    """Whether a device says of itself that it is an emulator, or simulated."""
    return bool(getattr(device, "emulated", False))
