"""Where a registration session takes place: a rig of devices with a stereo endoscope, or a simulated room.

In the simulated room somebody lights the place that is asked for.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import msgspec
import numpy as np

from markerseek.core import Float64, StereoImages, StereoPair
from markerseek.geometry import RigidTransform
from markerseek.registration.poses import reach_of
from markerseek.registration.report import KnownRegistration
from markerseek.registration.shared_errors import BASE_LENGTH, FOCAL_LENGTH, trus_shared_m
from markerseek.registration.steps import TakenMarker, Waiting
from markerseek.registration.stereo_files import StereoSettings
from markerseek.registration.view import SessionView
from markerseek.rigs import DrawExtraSources, Rig, movable
from markerseek.sim import (
    EndoscopeSettings,
    SimulatedEndoscope,
    SimulatedSettings,
    TexturedTissue,
    TissueMotion,
    camera_above,
    endoscope,
    on_tissue_m,
)


class Room(Protocol):
    """Where a session takes place: a rig, the images of its endoscope, and somebody who moves the spot."""

    @property
    def rig(self) -> Rig:
        """The rig, armed."""

    @property
    def images(self) -> StereoImages:
        """Images of both cameras."""

    @property
    def stereo(self) -> StereoSettings:
        """Calibration of the cameras."""

    @property
    def waits_dark(self) -> bool:
        """Whether the laser is dark until the person says that the spot is set."""

    @property
    def endoscope_held(self) -> bool:
        """Whether the endoscope cannot move: its images are then not compared from marker to marker."""

    @property
    def fired(self) -> int | None:
        """Pulses of `light` since the spot was set; None where the laser fires while the session waits."""

    def ask(self, waiting: Waiting) -> bool:
        """Ask for a spot; whether to look for one now. False ends the session."""

    def light(self) -> int:
        """Fire for the cameras; returns the number of pulses."""

    def arm(self) -> None:
        """Arm the rig in the name of the person who is there: each search disarms it at its end."""

    def following(self, look: Callable[[StereoPair], None]) -> AbstractContextManager[None]:
        """Hand the newest pairs of images on as time goes by, until the context ends; no other call of `images`."""


BETWEEN_S = 1.0
"""Time between two looks for a spot, in seconds, where the laser fires in each while the session waits."""

SHOWN_S = 0.5
"""Time between two image pairs that are shown while the session waits, in seconds."""

FOLLOW_S = 0.15
"""Least time from one pair that is followed to the next, in seconds: a pulse train of an acquisition takes 0.16 s."""

_ASKED_S = 0.1
"""Time between two questions whether the spot is set, in seconds."""


@dataclass(slots=True, kw_only=True)
class DeviceRoom:
    """A `Room` of devices: a person lights the spots.

    The laser is dark, and disarmed, until the person says that a spot is set. Then it fires ten pulses a second, until
    the cameras see the spot, or the look for it ends after some seconds.
    """

    rig: Rig
    """The rig, armed by a person."""
    images: StereoImages
    stereo: StereoSettings
    by: str
    """Who has armed the rig for the session: each search disarms it at its end."""
    wait_s: float = 300.0
    """Longest wait for a spot, in seconds; then the session ends."""
    is_set: Callable[[], bool] | None = None
    """Whether the person has said, since this was called last, that the spot is set. None: the laser fires once a
    second while the session waits, until the cameras see a spot."""
    idle_s: float | None = None
    """Time in the dark after which the session looks for a spot although nobody has said that it is set, in seconds;
    None: never."""
    endoscope_held: bool = False
    """Whether the endoscope is held so that it cannot move."""
    show: Callable[[StereoPair], None] = lambda _pair: None
    """Takes the newest pair once in `SHOWN_S` while the session waits in the dark, for those who look on."""
    fired: int | None = field(default=None, init=False)
    """Pulses of `light` since the spot was set; None where the laser fires while the session waits."""
    _waiting: tuple[str, float] = field(default=("", 0.0), init=False)

    @property
    def waits_dark(self) -> bool:
        """Whether the laser is dark until the person says that the spot is set."""
        return self.is_set is not None

    def ask(self, waiting: Waiting) -> bool:
        """Wait until the spot is set, or a moment; False if nobody has set or lit a spot for too long."""
        if self.is_set is not None:
            return self._wait_dark(self.is_set)
        clock = self.rig.scanner.clock
        name, since_s = self._waiting
        if name != waiting.name:
            self._waiting = (waiting.name, clock.now_s())
        elif clock.now_s() - since_s > self.wait_s:
            return False
        else:
            clock.wait(BETWEEN_S)
        return True

    def _wait_dark(self, is_set: Callable[[], bool]) -> bool:
        """Wait with the laser disarmed until the person says that the spot is set; False after the longest wait."""
        clock = self.rig.scanner.clock
        self.rig.scanner.stop()
        # What was said before was said of an earlier spot.
        is_set()
        begun_s = clock.now_s()
        shown_s = begun_s
        while not is_set():
            waited_s = clock.now_s() - begun_s
            if clock.now_s() - shown_s >= SHOWN_S and (pairs := self.images.newest()):
                shown_s = clock.now_s()
                self.show(pairs[-1])
            if waited_s > self.wait_s:
                return False
            if self.idle_s is not None and waited_s >= self.idle_s:
                break
            clock.wait(_ASKED_S)
        self.fired = 0
        return True

    def light(self) -> int:
        """Fire for the cameras: one pulse, or those of an acquisition where the laser fires while it waits."""
        if self.fired is None:
            return self.rig.scanner.light()
        pulses = self.rig.scanner.light(1)
        self.fired += pulses
        return pulses

    def arm(self) -> None:
        """Arm the rig in the name of the person who armed it for the session."""
        self.rig.arm(by=self.by)

    @contextmanager
    def following(self, look: Callable[[StereoPair], None]) -> Iterator[None]:
        """Look at the newest pair again and again, in a thread of its own, so that nobody waits for it.

        What the source or the look raises is raised at the end.
        """
        over = threading.Event()
        problems: list[BaseException] = []

        def follow() -> None:
            rest_s = FOLLOW_S
            try:
                while not over.wait(rest_s):
                    begun_s = time.monotonic()
                    pairs = self.images.newest()
                    if pairs:
                        look(pairs[-1])
                    # It takes half of one core at most.
                    rest_s = max(FOLLOW_S, time.monotonic() - begun_s)
            except BaseException as problem:  # noqa: BLE001  it is raised where it is waited for
                problems.append(problem)

        thread = threading.Thread(target=follow, name="follow the scene", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
        if problems:
            raise problems[0]


RELIEF_M = 5e-3
"""Range of the heights of the tissue."""

CAMERA_M = 0.1
"""Distance of the endoscope from the tissue."""

# A camera that looks straight down is turned by 180 deg about an axis across its view, whatever its roll, so that its
# transform is nearly its own inverse (1.5 to 2.2 mm apart at the markers): one that is applied in the wrong direction
# would not show. With a tilt like that of a 30 deg endoscope, and less roll, the two are 15 mm or more apart.
CAMERA_TILT_DEG = (25.0, 35.0)
CAMERA_ROLL_DEG = (-60.0, 60.0)
"""Tilt of the line of sight against the tissue's normal, and rotation about it, in degrees; drawn evenly."""

MISSED_M = 2e-3
"""Standard deviation, along each axis, by which the simulated person misses the place that is asked for."""

MOST_TRIES = 5
"""How often the simulated person lights the same spot before giving up."""

BY_HAND_S = (120.0, 420.0)
"""Time of a search by hand for one registration: 2 to 3 minutes, and "as much as 7 min" (the paper)."""


LATE_S = 0.06
"""How long after its exposure a pair of textured tissue comes."""

CONTRAST = 0.25
"""Standard deviation of the brightness of textured tissue over its mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EndoscopeMove:
    """Somebody moves the simulated endoscope."""

    marker: int
    """Number of the place that is lit when it is moved, counted from 1."""
    after_s: float = 0.0
    """Time from the light on that place to the beginning of the move; 0 is before the cameras look for the spot."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Way of the left camera along its own axes."""
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation about its own axes: its axis, and its length in degrees."""
    lasts_s: float = 0.0
    """Duration of the move; a long one creeps."""

    def from_place(self, camera_to_trus: RigidTransform) -> RigidTransform:
        """Return where the camera stands after the move, from where it stood before."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_rotvec(self.turn_deg, degrees=True).as_matrix()
        return RigidTransform(
            source=camera_to_trus.source,
            target=camera_to_trus.target,
            rotation=camera_to_trus.rotation @ turned,
            translation_m=camera_to_trus.apply(np.array(self.shift_m)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRoomSettings:
    """Settings of a simulated operating room."""

    rig: SimulatedSettings = field(default_factory=SimulatedSettings)
    """The simulated rig; its marker is moved from place to place."""
    pace: float = 0.0
    """Real seconds per second of the rig's clock; 0 does not wait."""
    beside: DrawExtraSources | None = None
    """Draws what is beside each marker; None: nothing but the clutter of the material."""
    places_m: tuple[tuple[float, float], ...] | None = None
    """Places (x, y) in the TRUS frame that are lit in turn, whatever is asked for; None: the places asked for."""
    look: EndoscopeSettings = field(default_factory=EndoscopeSettings)
    """Errors of the cameras, and the look of their images."""
    textured: bool = False
    """Whether the cameras see tissue with texture, relief and highlights, and not uneven brightness alone."""
    moves: tuple[EndoscopeMove, ...] = ()
    """Moves of the endoscope, in their order."""
    endoscope_held: bool = True
    """Whether the session is told that nobody moves the endoscope; images without texture do not show it."""


class SimulatedTruth(msgspec.Struct, frozen=True, kw_only=True):
    """What only a simulation knows of a session.

    ``target_error_m`` is the true error at the target, None without a registration. ``marker_errors_m`` are the
    distances of the chosen markers from the sources of their spots, without the errors that all share, and
    ``beside_spot_m`` those of these sources from the spots. ``by_hand_s`` is what
    the paper gives for a search by hand.
    """

    simulated: bool
    seed: int
    target_error_m: float | None
    marker_errors_m: dict[str, float]
    rig_s: float
    beside_spot_m: dict[str, float] = {}
    by_hand_s: tuple[float, float] = BY_HAND_S


class SimulatedRoom:
    """A `Room` in which everything is simulated.

    ``seed``: of everything that is drawn. ``motion``: how the tissue moves; None: as the settings of the rig say.
    """

    waits_dark = False
    """The simulated person lights each place at once."""
    fired: int | None = None
    """Not counted."""

    def __init__(self, settings: SimulatedRoomSettings, *, seed: int, motion: TissueMotion | None = None) -> None:
        self._settings = settings
        self._seed = seed
        self.endoscope_held = settings.endoscope_held
        """Whether the session is told that nobody moves the endoscope."""
        rng = np.random.default_rng(seed)
        self._rng = rng
        self._look: Callable[[StereoPair], None] | None = None
        self._looked_s = -math.inf
        # Textured tissue alone can be followed; a clock without a beat is faster.
        beat = self._look_on if settings.textured else None
        self._movable = movable(seed=seed, settings=settings.rig, pace=settings.pace, beat=beat, beside=settings.beside)
        world = self._movable.world
        world.motion = motion or world.motion
        self.rig: Rig = self._movable.rig
        """The simulated rig; another one for each place of the marker."""
        tissue_m = settings.rig.marker.radius_m
        self._tissue_m = tissue_m
        first = camera_above(
            np.array([0.0, 0.0, tissue_m]),
            distance_m=CAMERA_M,
            roll_deg=rng.uniform(*CAMERA_ROLL_DEG),
            tilt_deg=rng.uniform(*CAMERA_TILT_DEG),
        )
        self._tissue: TexturedTissue | None = None
        if settings.textured:
            self._tissue = TexturedTissue.drawn(seed=seed, level_m=tissue_m, relief_m=RELIEF_M, contrast=CONTRAST)
        # Sound speed, face radius, zero of the angle, focal length, base, vergence and the depth of the source are
        # wrong, as a registration assumes of each.
        drawn = rng.standard_normal(4)
        self._shared = drawn[:3]
        self._beside = np.random.default_rng((seed, 1))
        base, vergence, depth = self._beside.standard_normal(3).tolist()
        spot = settings.rig.spot
        self._depth_m = max(spot.depth_m + spot.depth_sigma_m * depth, 0.0)
        cameras = endoscope()
        look = settings.look
        self.stereo = StereoSettings.of(cameras, calibration_sigma_px=look.calibration_sigma_px)
        """The calibration of the cameras."""
        self.images = SimulatedEndoscope(
            cameras=cameras,
            camera_to_trus=first,
            settings=look,
            rng=rng,
            clock=self.rig.scanner.clock,
            flashes=lambda: len(self._movable.world.flashes),
            focal_error=FOCAL_LENGTH * float(drawn[3]),
            base_error=BASE_LENGTH * base,
            vergence_px=math.sqrt(2) * look.calibration_sigma_px * vergence,
            tissue=self._tissue,
            displacement_m=lambda at_s: world.motion.displacement_m(np.array([at_s]))[0],
            is_lit=self._movable.world.is_lit if settings.textured else None,
            late_s=LATE_S if settings.textured else 0.0,
        )
        self._spots_m: dict[str, Float64[np.ndarray, " 3"]] = {}
        self._sources_m: dict[tuple[float, ...], Float64[np.ndarray, " 3"]] = {}
        self._turn = 0
        self._asked = dict[str, int]()
        self._recalled: set[str] = set()

    @property
    def true(self) -> RigidTransform:
        """The true transform from the left camera, where it stands now, to the probe."""
        return self.images.pose(self.rig.scanner.clock.now_s())

    def ask(self, waiting: Waiting) -> bool:
        """Light the place that is asked for, or the next of the settings, as well as a person hits it."""
        self._asked[waiting.name] = self._asked.get(waiting.name, 0) + 1
        if self._asked[waiting.name] > MOST_TRIES:
            return False
        spot_m = self._spots_m.get(waiting.name)
        if spot_m is None:
            places = self._settings.places_m
            if places is not None and self._turn >= len(places):
                return False
            spot_m = self._draw(waiting) if places is None else self._at(*places[self._turn])
            self._turn += 1
            self._spots_m[waiting.name] = spot_m
            self._move_endoscope()
        self._light(spot_m)
        return True

    def _move_endoscope(self) -> None:
        """Begin the moves of the endoscope at this marker."""
        to = self.true
        for each in self._settings.moves:
            if each.marker == self._turn:
                to = each.from_place(to)
                self.images.move(to, after_s=each.after_s, lasts_s=each.lasts_s)

    def light(self) -> int:
        """Fire the pulses of an acquisition for the cameras."""
        return self.rig.scanner.light()

    def arm(self) -> None:
        """Nothing to arm: no hardware is involved."""

    @contextmanager
    def following(self, look: Callable[[StereoPair], None]) -> Iterator[None]:
        """Look at the newest pair every `FOLLOW_S` of the rig's clock."""
        self._look = look
        try:
            yield
        finally:
            self._look = None

    def _look_on(self) -> None:
        """Look at the newest pair, if it is time."""
        if self._look is None or self.rig.scanner.clock.now_s() - self._looked_s < FOLLOW_S:
            return
        self._looked_s = self.rig.scanner.clock.now_s()
        for pair in self.images.newest(1):
            self._look(pair)

    def skip(self, taken: Sequence[TakenMarker]) -> None:
        """Go on behind the markers of a session that is continued; their spots are where its cameras saw them."""
        self._turn = len(taken)
        self._recalled = {marker.name for marker in taken}
        for marker in taken:
            self._spots_m[marker.name] = self.true.apply(np.array(marker.camera_m))

    def truth(self, view: SessionView) -> SimulatedTruth:
        """Return how far the registration of a session and its markers are from the truth."""
        chosen = {} if view.last is None else view.last.chosen
        errors_m = {
            marker.name: float(
                np.linalg.norm(
                    np.array(marker.candidates[chosen[marker.name]].position.position_m)
                    - self._heard_m(self._spots_m[marker.name])
                )
            )
            for marker in view.markers
            if marker.name in chosen and marker.name not in self._recalled
        }
        known = view.registration
        return SimulatedTruth(
            simulated=True,
            seed=self._seed,
            target_error_m=None if known is None else _error_m(known, self.true),
            marker_errors_m=errors_m,
            rig_s=view.rig_s,
            beside_spot_m={
                name: float(np.linalg.norm(self._source_m(self._spots_m[name]) - self._spots_m[name]))
                for name in errors_m
            },
        )

    def _light(self, spot_m: Float64[np.ndarray, " 3"]) -> None:
        """Put the fibre there: the camera sees it, and the probe hears it where its errors put it."""
        self.images.show(spot_m)
        x, y, z = self._heard_m(spot_m).tolist()
        self.rig = self._movable.move(angle_deg=math.degrees(math.atan2(x, z)), radius_m=math.hypot(x, z), lateral_m=y)

    def _heard_m(self, spot_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"]:
        """Return where a probe whose sound speed, face radius and zero are wrong finds the source of a spot."""
        source_m = self._source_m(spot_m)
        return np.asarray(source_m + trus_shared_m(source_m[None])[0] @ self._shared)

    def _source_m(self, spot_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"]:
        """Return where the light of a spot is absorbed: below it, and beside it.

        It is the same whenever the spot comes back.
        """
        key = tuple(spot_m.tolist())
        if key not in self._sources_m:
            sight = spot_m - self.true.translation_m
            beside_m = self._settings.rig.marker.beside_spot_m * self._beside.standard_normal(3)
            self._sources_m[key] = spot_m + self._depth_m * sight / np.linalg.norm(sight) + beside_m
        return self._sources_m[key]

    def _draw(self, waiting: Waiting) -> Float64[np.ndarray, " 3"]:
        """Return where the person lights the tissue: near the place that is asked for, else anywhere in reach."""
        reach = reach_of(self.rig)
        if waiting.place is None:
            # Somewhere in the middle of what the probe can reach.
            across_m = self._tissue_m * math.sin(math.radians(reach.angles.width_deg / 4))
            return self._at(self._rng.uniform(-across_m, across_m), self._rng.uniform(-0.5, 0.5) * reach.lateral_m)
        point_m = on_tissue_m(self.true, np.array(waiting.place.camera_m), height_m=self._tissue_m)
        missed_m = MISSED_M * self._rng.standard_normal(2)
        return self._at(point_m[0] + missed_m[0], point_m[1] + missed_m[1])

    def _at(self, x_m: float, y_m: float) -> Float64[np.ndarray, " 3"]:
        """Return a point of the tissue, whose height is uneven."""
        # Drawn in any case: what is drawn later does not depend on the look of the tissue.
        height_m = self._tissue_m + RELIEF_M * self._rng.uniform(-0.5, 0.5)
        if self._tissue is not None:
            height_m = float(self._tissue.height_m(np.array([[x_m, y_m]]))[0])
        return np.array([x_m, y_m, height_m])


def _error_m(known: KnownRegistration, true: RigidTransform) -> float:
    """Return how far a registration puts the target from where it is."""
    target_m = np.array(known.report.target_trus_m)
    return float(np.linalg.norm(known.davinci_to_trus.apply(true.inverse().apply(target_m)) - target_m))
