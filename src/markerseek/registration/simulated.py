"""A whole registration on simulated devices: searches one after another, camera images, transform, true error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import chain

import msgspec
import numpy as np

from markerseek.core import (
    ConfigError,
    Float64,
    MarkerCurve,
    MarkerPosition,
    Measured,
    SearchError,
    SearchPlan,
    Swept,
)
from markerseek.geometry import MIN_POINTS, RigidTransform, StereoCameras
from markerseek.records import SearchResult
from markerseek.registration.report import PointPair, RegistrationReport, davinci_to_probe_home, register_pairs
from markerseek.registration.shared_errors import seen_point
from markerseek.rigs import simulated
from markerseek.runs import new_session, plan_on
from markerseek.sim import EndoscopeSettings, SimulatedSettings, camera_above, endoscope, spot_images
from markerseek.vision import LaserSpot, find_spot

GRID_STEP_M, RELIEF_M = 20e-3, 5e-3
"""Step of the paper's 3 x 3 grid of markers, and the range of the heights of the tissue."""

# A camera that looks straight down is turned by 180 deg about an axis across its view, whatever its roll, so that its
# transform is nearly its own inverse (1.5 to 2.2 mm apart at the markers): one that is applied in the wrong direction
# would not show. With a tilt like that of a 30 deg endoscope, and less roll, the two are 15 mm or more apart.
CAMERA_TILT_DEG, CAMERA_ROLL_DEG = (25.0, 35.0), (-60.0, 60.0)
"""Tilt of the line of sight against the tissue's normal, and rotation about it, in degrees; drawn evenly."""

REGISTRATION_TOLERANCE_MM = 0.3
"""Tolerance of searches for a registration: with the usual 1 mm markers are twice as far off along the turn, for two
acquisitions less each. A search that does not reach it counts by its sigma."""

BY_HAND_S = (120.0, 420.0)
"""Time of a search by hand for one registration: 2 to 3 minutes, and "as much as 7 min" (the paper)."""

MARKER_PLACES: dict[int, tuple[tuple[int, int], ...]] = {
    3: ((-1, -1), (0, 1), (1, -1)),
    4: ((-1, -1), (-1, 1), (1, 1), (1, -1)),
    6: ((-1, -1), (-1, 1), (0, 1), (0, -1), (1, -1), (1, 1)),
    9: ((-1, -1), (-1, 0), (-1, 1), (0, 1), (0, 0), (0, -1), (1, -1), (1, 0), (1, 1)),
}
"""Places of the markers in steps along x and y of the TRUS frame, in an order with little rotation (x is across)."""


def on_alternate_sides(places: Sequence[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """The places in an order for sweeps: right and left in turn, those in the middle last.

    A sweep goes to the nearer end of the range first, and ends at the other: a marker on that side is nearer then. The
    first one starts in the middle and ends at the right.
    """
    right, left, middle = ([place for place in places if np.sign(place[0]) == side] for side in (1, -1, 0))
    return (*chain.from_iterable(zip(right, left, strict=True)), *middle)


class SimulatedSearch(msgspec.Struct, frozen=True, kw_only=True):
    """Search of one simulated marker; ``error_m`` is the distance from the truth, None if it was not found."""

    name: str
    answer: str
    acquisitions: int
    travel_deg: float
    elapsed_s: float
    error_m: float | None


class SimulatedTruth(msgspec.Struct, frozen=True, kw_only=True):
    """What only a simulation knows, and the time of all searches.

    ``target_error_m`` is the true error at the target. ``elapsed_s`` is the time of all searches on the rig's clock and
    ``without_readout_s`` the same without the time to read each acquisition, or sweep, from the receiver (10 s with
    SonixDAQ's files, as in the paper).
    ``by_hand_s`` is what the paper gives for a search by hand.
    """

    simulated: bool
    seed: int
    target_error_m: float | None
    searches: list[SimulatedSearch]
    elapsed_s: float
    without_readout_s: float
    by_hand_s: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedScene:
    """Settings of a simulated registration."""

    markers: int = 4
    """Number of markers, one of `MARKER_PLACES`."""
    camera_m: float = 0.1
    """Distance of the endoscope from the tissue."""
    camera: EndoscopeSettings = field(default_factory=EndoscopeSettings)
    rig: SimulatedSettings = field(default_factory=SimulatedSettings)
    """The simulated rig; its marker is moved from place to place."""
    sweep: bool = False
    """Whether the probe turns while the laser fires."""

    def __post_init__(self) -> None:
        if self.markers not in MARKER_PLACES:
            raise ConfigError(f"markers is {self.markers}, it must be one of {', '.join(map(str, MARKER_PLACES))}")
        if not 0.03 <= self.camera_m <= 0.5:
            raise ConfigError(f"camera distance is {1e3 * self.camera_m:g} mm, it must lie between 30 and 500 mm")


def simulate_registration(
    scene: SimulatedScene,
    *,
    seed: int,
    target_trus_m: tuple[float, float, float] | None = None,
    without: Sequence[str] = (),
    on_search: Callable[[int], object] = lambda _number: None,
) -> tuple[RegistrationReport, SimulatedTruth]:
    """Search the markers, see their spots, register, and compare with the truth.

    ``target_trus_m``, ``without``: the names are the numbers of the markers.
    """
    rng = np.random.default_rng(seed)
    in_turn = MARKER_PLACES[scene.markers]
    places = GRID_STEP_M * np.array(on_alternate_sides(in_turn) if scene.sweep else in_turn, dtype=float)
    radius_m = scene.rig.marker.radius_m
    spots_m = np.column_stack([places, radius_m + RELIEF_M * rng.uniform(-0.5, 0.5, len(places))])
    true = camera_above(
        np.array([0.0, 0.0, radius_m]),
        distance_m=scene.camera_m,
        roll_deg=rng.uniform(*CAMERA_ROLL_DEG),
        tilt_deg=rng.uniform(*CAMERA_TILT_DEG),
    )
    cameras = endoscope()
    pairs, searches = [], []
    rig_seeds = rng.integers(2**31, size=len(spots_m)).tolist()
    angle_deg, readout_s = scene.rig.start_deg, 0.0
    curve: MarkerCurve | None = None
    for number, (spot_m, rig_seed) in enumerate(zip(spots_m, rig_seeds, strict=True), start=1):
        result, angle_deg, readouts = _search(scene, spot_m, seed=rig_seed, start_deg=angle_deg, prior=curve)
        curve = result.curve or curve
        readout_s += readouts * scene.rig.receiver.readout_s
        searches.append(_searched(str(number), result, spot_m))
        on_search(number)
        if result.marker_trus_m is None or result.marker_sigma_m is None:
            continue
        marker = MarkerPosition(position_m=result.marker_trus_m, sigma_m=result.marker_sigma_m)
        camera_m, covariance_m2, shared_m = _seen(true.inverse().apply(spot_m), cameras, scene.camera, rng)
        pairs.append(
            PointPair(
                name=str(number),
                trus_m=np.array(marker.position_m),
                camera_m=camera_m,
                trus_covariance_m2=marker.covariance_m2,
                camera_covariance_m2=covariance_m2,
                camera_shared_m=shared_m,
            )
        )
    if len(pairs) < MIN_POINTS:
        answers = ", ".join(search.answer for search in searches)
        raise SearchError(
            f"{len(pairs)} of {len(searches)} markers were found, at least {MIN_POINTS} are needed (the searches "
            f"ended with: {answers}); search more markers, or another --seed"
        )
    report = register_pairs(pairs, target_trus_m=target_trus_m, without=without)
    elapsed_s = sum(search.elapsed_s for search in searches)
    return report, SimulatedTruth(
        simulated=True,
        seed=seed,
        target_error_m=_error_m(report, true),
        searches=searches,
        elapsed_s=elapsed_s,
        without_readout_s=elapsed_s - readout_s,
        by_hand_s=BY_HAND_S,
    )


def _search(
    scene: SimulatedScene,
    spot_m: Float64[np.ndarray, " 3"],
    *,
    seed: int,
    start_deg: float,
    prior: MarkerCurve | None,
) -> tuple[SearchResult, float, int]:
    """Result of one search for a spot, the angle at which the probe then stands, and how often frames were read."""
    rig = scene.rig
    x, y, z = spot_m.tolist()
    marker = replace(
        rig.marker, angle_deg=math.degrees(math.atan2(x, z)), radius_m=math.hypot(x, z), lateral_m=y, present=True
    )
    receiver = replace(rig.receiver, single_pulses=scene.sweep or rig.receiver.single_pulses)
    assembled = simulated(seed=seed, settings=replace(rig, marker=marker, start_deg=start_deg, receiver=receiver))
    # A search begins with the intensity curve of the last marker, as `search --prior` does.
    plan = SearchPlan(
        method="posterior",
        start_deg=start_deg,
        prior=prior,
        tolerance_mm=REGISTRATION_TOLERANCE_MM,
        sweep_speed_deg_s=assembled.scanner.sweeping.stage.fastest_sweep_deg_s if scene.sweep else None,
        # The next marker is searched from where this search ends.
        stay=scene.sweep,
    )
    session = new_session(assembled, plan_on(assembled, plan))
    with closing(session.events()) as events:
        readouts = sum(
            isinstance(event, Swept) or (isinstance(event, Measured) and event.sample.sweep is None) for event in events
        )
    return session.result(), assembled.stage.angle_deg, readouts


def _searched(name: str, result: SearchResult, spot_m: Float64[np.ndarray, " 3"]) -> SimulatedSearch:
    off = None if result.marker_trus_m is None else float(np.linalg.norm(np.array(result.marker_trus_m) - spot_m))
    return SimulatedSearch(
        name=name,
        answer=result.answer,
        acquisitions=result.acquisitions,
        travel_deg=result.travel_deg or 0.0,
        elapsed_s=result.elapsed_s or 0.0,
        error_m=off,
    )


def _seen(
    spot_m: Float64[np.ndarray, " 3"], cameras: StereoCameras, settings: EndoscopeSettings, rng: np.random.Generator
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3 errors"]]:
    """Position of a spot, its covariance, and its shared errors, from simulated images of both cameras."""
    found = []
    for camera, exact in zip((cameras.left, cameras.right), cameras.project(spot_m[None]), strict=True):
        place = exact[0] + settings.calibration_sigma_px * rng.standard_normal(2)
        answer = find_spot(spot_images(place, size_px=camera.size_px, settings=settings, rng=rng))
        if not isinstance(answer, LaserSpot):
            raise ConfigError(f"the simulated camera: {answer.reason}")
        found.append(answer)
    left, right = (np.array([spot.x_px, spot.y_px]) for spot in found)
    seen_px = max(spot.sigma_px or settings.spot_sigma_px for spot in found)
    return seen_point(left, right, cameras, spot_px=seen_px, calibration_px=settings.calibration_sigma_px)


def _error_m(report: RegistrationReport, true: RigidTransform) -> float | None:
    """How far the registration puts the target from where it is; None without a registration."""
    if report.davinci_to_trus is None:
        return None
    target_m = np.array(report.target_trus_m)
    found = davinci_to_probe_home(report.davinci_to_trus)
    return float(np.linalg.norm(found.apply(true.inverse().apply(target_m)) - target_m))
