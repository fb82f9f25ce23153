"""Driver of a rotation stage on a Standa 8SMC5 controller, by Standa's library ``libximc``.

The library holds the device, so that the supervisor has no line to it. What remains when the search dies is that no
target is ever more than 5 degrees ahead.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from types import ModuleType
from typing import Annotated

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
    Interval,
    MoveError,
    NotConnectedError,
    Within,
    needs_package,
)
from markerseek.drivers._stage_rules import StageRules, StageStatus
from markerseek.drivers.entry import Entry, MotorKeys, Opening
from markerseek.drivers.standard_stage import StandardStage

_UNEXPECTED_DEG = 0.5
"""Farthest that it may be from where it should be, in degrees: nobody has measured what a sound one does."""

_VIRTUAL = "xi-emu:"
"""How the address of a virtual device of the library begins."""


class XimcSettings(MotorKeys, frozen=True, kw_only=True, tag="ximc"):
    """A rotation stage on an 8SMC5 controller; every target is approached from below."""

    uri: str
    """Address as the library has it: "xi-com:/dev/ttyACM0"; "xi-emu:///tmp/stage.bin" is a virtual device."""
    steps_per_deg: Annotated[float, Within(1, 10_000)]
    """Whole motor steps for a degree, from the data sheet of the stage."""
    arrival_deg: Annotated[float, Within(0.001, 0.1, "deg")] = 0.02
    """Largest distance from its target at which it counts as arrived."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.uri.startswith(_VIRTUAL) and not self.uri.endswith(".bin"):
            raise ConfigError(
                f"stage: uri is {self.uri!r}; the file of a virtual device must end in .bin, because the library "
                "overwrites what it names"
            )
        if self.arrival_deg * self.steps_per_deg < 1 / 256:
            raise ConfigError(
                f"stage: arrival_deg is {self.arrival_deg} deg, less than a microstep; "
                "widen it, or correct steps_per_deg"
            )


def _library() -> ModuleType:
    try:
        with needs_package("libximc", extra="standa", purpose="a stage with driver = 'ximc'"):
            import libximc.highlevel
    except RuntimeError as problem:
        # So it says that it has no library for this system.
        raise NotConnectedError(f"stage: libximc cannot be loaded: {problem}; it runs on 64 bit Linux") from problem
    module: ModuleType = libximc.highlevel
    return module


class XimcLogic:
    """The verbs of an 8SMC5. Making one connects, checks and configures it; nothing moves."""

    def __init__(self, *, settings: XimcSettings, travel: Interval) -> None:
        if not settings.uri.startswith("xi-"):
            raise ConfigError(
                f"stage: uri is {settings.uri!r}, it must begin with xi-com:, xi-tcp:, xi-net: or xi-emu:"
            )
        self.emulated = settings.uri.startswith(_VIRTUAL)
        self._settings = settings
        self._travel = travel
        self._sense = settings.sense
        self.serial_number = 0
        self._microsteps = 1
        self._ximc = _library()
        with self._errors(NotConnectedError, "connecting"):
            self._axis = self._ximc.Axis(settings.uri)
            self._axis.open_device()
        try:
            with self._errors(NotConnectedError, "setting it up"):
                self._set_up()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection; allowed twice."""
        with self._errors(NotConnectedError, "closing"):
            self._axis.close_device()

    @contextmanager
    def _errors(self, kind: type[DeviceError], what: str) -> Iterator[None]:
        """Turn the library's errors into one of a device."""
        try:
            yield
        except ConfigError:
            raise
        # `ConnectionError`, `RuntimeError`, `ValueError` and more, as the library has it.
        except (OSError, RuntimeError, ValueError, NotImplementedError) as problem:
            reason = " ".join(str(problem).split())[:200]
            raise kind(
                f"stage: {self._settings.uri}: {what} failed: {reason}; check its address, cable and power"
            ) from problem

    def _set_up(self) -> None:
        """Check the controller, and write speed, borders and backlash, which are wrong after it was switched on."""
        settings = self._settings
        axis = self._axis
        self.serial_number = int(axis.get_serial_number())
        if settings.serial_number not in (None, self.serial_number):
            raise NotConnectedError(
                f"stage: {settings.uri} has the serial number {self.serial_number}, not {settings.serial_number}"
            )
        engine = axis.get_engine_settings()
        self._microsteps = 1 << (int(engine.MicrostepMode) - 1)
        self._require_microsteps()
        # Its own approach goes beyond a target, and back.
        engine.EngineFlags &= ~self._ximc.EngineFlags.ENGINE_ANTIPLAY
        axis.set_engine_settings(engine)
        speed = self._in_steps(settings.speed_deg_s)
        acceleration = self._in_steps(settings.acceleration_deg_s2)
        if not 1 <= speed <= 100_000:
            raise ConfigError(f"stage: {speed:g} steps/s is no speed of an 8SMC5; correct steps_per_deg or speed_deg_s")
        moves = axis.get_move_settings()
        moves.Speed, moves.uSpeed = self._split(settings.speed_deg_s)
        moves.Accel = max(1, round(acceleration))
        moves.Decel = moves.Accel
        axis.set_move_settings(moves)
        borders = axis.get_edges_settings()
        flags = self._ximc.BorderFlags
        # By angle and not by switches, which a rotation stage need not have.
        borders.BorderFlags = flags.BORDER_IS_ENCODER | flags.BORDER_STOP_LEFT | flags.BORDER_STOP_RIGHT
        low, high = sorted(self._own_deg(end_deg) for end_deg in (self._travel.low_deg, self._travel.high_deg))
        borders.LeftBorder, borders.uLeftBorder = self._split(low)
        borders.RightBorder, borders.uRightBorder = self._split(high)
        axis.set_edges_settings(borders)
        kept = axis.get_move_settings()
        kept_borders = axis.get_edges_settings()
        written = (moves.Speed, moves.Accel, moves.Decel, borders.LeftBorder, borders.RightBorder)
        read = (kept.Speed, kept.Accel, kept.Decel, kept_borders.LeftBorder, kept_borders.RightBorder)
        if written != read or kept_borders.BorderFlags != borders.BorderFlags:
            raise MoveError(f"stage: it keeps {read} of the {written} that were written; check the controller")
        status = axis.get_status()
        if status.MvCmdSts & self._ximc.MvcmdStatus.MVCMD_RUNNING:
            raise MoveError("stage: it moves; stop it, and begin again")
        # A virtual device does not say that it is homed.
        if not (self.emulated or status.Flags & self._ximc.StateFlags.STATE_IS_HOMED):
            raise MoveError("stage: it is not homed; home it with the probe outside the patient")

    def _require_microsteps(self) -> None:
        """Refuse steps between which a target can lie too far from both."""
        if self.step_deg / 2 <= self._settings.arrival_deg:
            return
        raise ConfigError(
            f"stage: the controller turns in {self.steps_said} of {self.step_deg:.4g} deg, too coarse for an "
            f"arrival_deg of {self._settings.arrival_deg:g} deg; set 1/256 as its microstep mode in XiLab, and save it "
            "in the controller, or correct steps_per_deg"
        )

    @property
    def steps_said(self) -> str:
        """Kind of its steps, in words."""
        return "full steps" if self._microsteps == 1 else f"1/{self._microsteps} steps"

    def _in_steps(self, value_deg: float) -> float:
        return value_deg * self._settings.steps_per_deg

    def _split(self, value_deg: float) -> tuple[int, int]:
        """Return the whole steps, and microsteps of the same sign."""
        total = round(self._in_steps(value_deg) * self._microsteps)
        sign = 1 if total >= 0 else -1
        whole, rest = divmod(abs(total), self._microsteps)
        return sign * whole, sign * rest

    def _own_deg(self, angle_deg: float) -> float:
        """Return the stage's own reading at an angle of the probe."""
        return self._sense * angle_deg + self._settings.zero_deg

    @property
    def step_deg(self) -> float:
        """A microstep, in degrees."""
        return 1 / (self._settings.steps_per_deg * self._microsteps)

    def read(self) -> StageStatus:
        """Return its angle: of the encoder where the controller uses one, else the count of its steps.

        Its errors come with it.
        """
        with self._errors(NotConnectedError, "asking for its status"):
            status = self._axis.get_status()
        flags = self._ximc.StateFlags
        command = self._ximc.MvcmdStatus
        wrong = (
            flags.STATE_ALARM | flags.STATE_CTP_ERROR | flags.STATE_ENCODER_FAULT | flags.STATE_ENGINE_RESPONSE_ERROR
        )
        problem = ""
        if status.Flags & wrong or status.MvCmdSts & command.MVCMD_ERROR:
            problem = f"stage: its controller reports {status.Flags & wrong!r}, {status.MvCmdSts!r}; look at the stage"
        steps = status.CurPosition + status.uCurPosition / self._microsteps
        return StageStatus(
            angle_deg=float(self._sense * (steps / self._settings.steps_per_deg - self._settings.zero_deg)),
            moving=bool(status.MvCmdSts & command.MVCMD_RUNNING),
            problem=problem,
        )

    def go(self, angle_deg: float) -> None:
        """Give a target."""
        with self._errors(MoveError, "a move"):
            self._axis.command_move(*self._split(self._own_deg(angle_deg)))

    def stop(self) -> None:
        """Brake: a stepper that is stopped at once loses steps, and its angle with them."""
        with self._errors(MoveError, "stopping"):
            self._axis.command_sstp()


class XimcStage(StandardStage[XimcLogic]):
    """A stage on an 8SMC5.

    Without an encoder the angle is a count of commanded steps: steps that the motor loses do not show.

    ``travel``: angles at which the probe may be; written to the controller as its borders. Raises `NotConnectedError`
    if it does not answer, or is another one. Raises `MoveError` if it moves, is not homed, or does not keep what is
    written.
    """

    def __init__(self, *, settings: XimcSettings, clock: Clock, travel: Interval) -> None:
        logic = XimcLogic(settings=settings, travel=travel)
        rules = StageRules(
            speed_deg_s=settings.speed_deg_s,
            resolution_deg=logic.step_deg,
            arrival_deg=settings.arrival_deg,
            unexpected_deg=_UNEXPECTED_DEG,
            unsteady_deg=_UNEXPECTED_DEG,
            begin_s=settings.begin_s,
            brake_s=settings.speed_deg_s / settings.acceleration_deg_s2,
            approach_deg=settings.approach_deg,
        )
        super().__init__(logic, clock=clock, travel=travel, rules=rules)


def _open(settings: XimcSettings, opening: Opening) -> XimcStage:
    stage = XimcStage(settings=settings, clock=opening.clock, travel=opening.limits.travel)
    opening.stack.enter_context(closing(stage.logic))
    return stage


ENTRY: Entry[XimcSettings, XimcStage] = Entry(
    settings=XimcSettings,
    open=_open,
    describe=lambda settings, stage: (
        f"{'VIRTUAL ' if stage.emulated else ''}8SMC5 {stage.logic.serial_number} at {settings.uri} in "
        f"{stage.logic.steps_said} of {stage.logic.step_deg:.4g} deg, beyond the supervisor"
    ),
    same=("steps_per_deg", "zero_deg", "direction"),
)
