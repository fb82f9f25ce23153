"""Sessions of registration on the simulated rig and endoscope, under the conditions of each row, every one counted.

``python -m benchmarks.registration.sessions --sessions 30 --out docs/data/sessions.csv`` runs those that the file does
not have yet, and prints the table; the file grows session by session, so that an interrupted run is continued.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import cast

import numpy as np
from msgspec import structs

from benchmarks.registration.forged_markers import REACH, STEREO, ForgedScene
from benchmarks.registration.session_rows import SessionOutcome, run_missing, session_parser
from benchmarks.registration.trials import GRID_STEP_M, MARKER_PLACES
from markerseek.acoustics import Absorber, Clutter
from markerseek.core import AnglePrior, ConfigError, MarkerseekError, StereoPair
from markerseek.registration import (
    Registered,
    RegistrationSession,
    SessionPlan,
    SimulatedRoom,
    SimulatedRoomSettings,
    Spot,
    SpotRefused,
)
from markerseek.registration.choice import SeenMarker, choose
from markerseek.registration.poses import Place, Poses, Prediction
from markerseek.registration.spots import _POLL_S, Looked, SpotFinder
from markerseek.rigs import Scene, image_peak
from markerseek.sim import STREAMING, SimulatedEndoscope, SimulatedSettings

FIRST_SEED = 50_001
"""Seed of the first session of each row; nothing was chosen on these."""

WRONG_M = 3e-3
"""Distance of a chosen marker from its spot from which it is another source."""

PRIOR_OFF_DEG = 15.0
"""How far a wrong prediction is off, towards the middle of the range; it says that it is sure to 1 deg."""

SPOT_SIGMA_PX = 0.1
LIGHT_TIMES = 3
"""Standard deviation of a spot that a session without images is told, and how often the laser is fired to look: as of
sessions with images."""


GOALS_MM = (0.5, 0.7, 1.0)
"""Expected TRE for which the markers are counted."""


class _NoImages:
    """The source of images of a session that is told where the spots are."""

    name = "spots as images show them"

    def __init__(self, endoscope: SimulatedEndoscope) -> None:
        self.show = endoscope.show
        self.pose = endoscope.pose
        self.move = endoscope.move

    def newest(self) -> list[StereoPair]:
        return []

    def close(self) -> None:
        pass


class _Room(SimulatedRoom):
    """A room that tells where both cameras see the spot."""

    def __init__(self, settings: SimulatedRoomSettings, *, seed: int, images: bool) -> None:
        super().__init__(settings, seed=seed)
        self._endoscope = self.images
        if not images:
            self.images = cast("SimulatedEndoscope", _NoImages(self._endoscope))
        self._scatter = np.random.default_rng((seed, 1))

    def spot(self) -> Spot:
        """The spot, as the mean of some images shows it."""
        # What no image source tells.
        now = self._endoscope._scene(self.rig.scanner.clock.now_s())  # noqa: SLF001
        exact_px = self._endoscope._places(now)  # noqa: SLF001
        if exact_px is None or exact_px["left"] is None or exact_px["right"] is None:
            raise ConfigError("the spot is behind a camera")
        places = []
        for exact in (exact_px["left"], exact_px["right"]):
            x_px, y_px = (exact + SPOT_SIGMA_PX * self._scatter.standard_normal(2)).tolist()
            places.append((x_px, y_px))
        return Spot(left_px=places[0], right_px=places[1], sigma_px=SPOT_SIGMA_PX)


class _ToldSpots(SpotFinder):
    """Spots drawn as images show them; images take two thirds of the computing time.

    With the calibration's error of their place, the scatter of the mean of some images, and the time that looking
    takes; they stand still.
    """

    def __init__(self, room: _Room) -> None:
        super().__init__(room)
        self._told = room

    def look(self) -> Looked:
        self._told.arm()
        scanner = self._told.rig.scanner
        scanner.clock.wait(_POLL_S)
        for _ in range(LIGHT_TIMES):
            scanner.light()
            scanner.clock.wait(_POLL_S)
        return Looked(spot=self._told.spot())

    def require_still(self, looked: Looked, later: Sequence[StereoPair]) -> None:
        pass


class _Session(RegistrationSession):
    """A session that may be without images, or be misled."""

    def __init__(self, room: _Room, row: Row, *, images: bool) -> None:
        super().__init__(
            room, plan=SessionPlan(markers=row.markers, guided=row.guided, sweep=row.sweep, endoscope_held=True)
        )
        self._row = row
        if not images:
            self._spots = _ToldSpots(room)

    def _prediction(self, seen: SeenMarker) -> Prediction | None:
        prediction = super()._prediction(seen)
        if prediction is None or not self._row.misled or len(self.view.markers) < 2:
            return prediction
        mean_deg = prediction.prior.mean_deg
        inwards_deg = -PRIOR_OFF_DEG if mean_deg > self._room.rig.limits.search.centre_deg else PRIOR_OFF_DEG
        return structs.replace(prediction, prior=AnglePrior(mean_deg=mean_deg + inwards_deg, sigma_deg=1.0))


def _eight_absorbers(scene: Scene, rng: np.random.Generator) -> tuple[Absorber, ...]:
    """Eight absorbers, the loudest 3 to 20 dB below the marker in the image, as in ``studies/answers-clutter.toml``."""
    drawn = Clutter(count=8, strength=1.0, nearest_m=35e-3, farthest_m=70e-3).draw(rng)
    scale = 10 ** (rng.uniform(-20.0, -3.0) / 20) / max(abs(each.strength) for each in drawn)
    return tuple(
        structs.replace(
            each,
            strength=each.strength
            * scale
            * scene.peak
            / image_peak([structs.replace(each, strength=1.0)], scene.model, angle_deg=each.angle_deg),
        )
        for each in drawn
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Conditions of sessions."""

    title: str
    rig: SimulatedSettings = STREAMING
    sweep: bool = True
    guided: bool = True
    markers: int = 4
    places_m: tuple[tuple[float, float], ...] | None = None
    beside: Callable[[Scene, np.random.Generator], tuple[Absorber, ...]] | None = None
    searches: bool = True
    """Whether markers are searched; else each is found where it is heard, but for the error of a search on a point."""
    misled: bool = False
    """Whether predictions are wrong from the third marker on."""


_GRID = tuple((GRID_STEP_M * x, GRID_STEP_M * y) for x, y in MARKER_PLACES[9])

ROWS = {
    "points": Row(title="points, sweeps"),
    "muscle": Row(title="muscle, sweeps", rig=structs.replace(STREAMING, tissue="muscle")),
    "liver": Row(title="liver, sweeps", rig=structs.replace(STREAMING, tissue="liver")),
    "rest": Row(title="stop and go, 10 s a read-out", rig=SimulatedSettings(), sweep=False),
    "rest-alone": Row(title="the same, not guided by the camera", rig=SimulatedSettings(), sweep=False, guided=False),
    "clutter": Row(title="eight absorbers around each marker, sweeps", beside=_eight_absorbers),
    "misled": Row(title="predictions 15° wrong from the third marker on, sweeps", misled=True),
    "places": Row(title="the places of the session, searches drawn", markers=9, searches=False),
    "grid": Row(title="the paper's 3 × 3 grid in its order, searches drawn", places_m=_GRID, markers=9, searches=False),
}
"""The rows, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome(SessionOutcome):
    """What came of one session; lengths in millimetres."""

    registered: bool
    rig_s: float
    acquisitions: int
    markers: int
    """Markers that were searched."""
    chosen: int
    """Markers that the registration uses."""
    wrong: int
    """Of these, those that are another source."""
    refused: int
    """Spots that were refused."""
    target_error_mm: float | None
    tre_mm: float | None
    tre95_mm: float | None
    tre_by_marker_mm: str
    """Expected TRE after each marker that was searched; - where there is no registration."""
    error_by_marker_mm: str
    """The true error at the target then."""
    images: bool
    """Whether it had images; else it was told where the spots are."""
    error: str
    """Why the session broke off; empty if it did not."""
    cpu_s: float
    commit: str


def run(name: str, seed: int, *, commit: str, images: bool = False) -> Outcome:
    """Run one session of a row."""
    row = ROWS[name]
    if not row.searches:
        return _drawn(name, seed, commit=commit)
    began_s = process_time()
    receiver = structs.replace(row.rig.receiver, single_pulses=row.sweep)
    settings = SimulatedRoomSettings(
        rig=structs.replace(row.rig, receiver=receiver), places_m=row.places_m, beside=row.beside
    )
    room = _Room(settings, seed=seed, images=images)
    session = _Session(room, row, images=images)
    expected_mm = list[str]()
    errors_mm = list[str]()
    refused = 0
    error = ""
    try:
        for step in session.steps():
            refused += isinstance(step, SpotRefused)
            if isinstance(step, Registered):
                report = step.report
                known = report is not None and report.registered
                expected_mm.append(f"{1e3 * report.tre_m:.3f}" if report is not None and known else "-")
                true_m = room.truth(session.view).target_error_m
                errors_mm.append("-" if true_m is None else f"{1e3 * true_m:.3f}")
    except MarkerseekError as problem:
        error = f"{type(problem).__name__}: {problem}"
    view = session.view
    truth = room.truth(view)
    report = None if view.registration is None else view.registration.report
    chosen = {} if view.last is None else view.last.chosen
    return Outcome(
        row=name,
        seed=seed,
        registered=report is not None and not error,
        rig_s=round(view.rig_s, 2),
        acquisitions=sum(marker.acquisitions for marker in view.markers),
        markers=len(view.markers),
        chosen=len(chosen),
        wrong=sum(off_m > WRONG_M for off_m in truth.marker_errors_m.values()),
        refused=refused,
        target_error_mm=None if truth.target_error_m is None else round(1e3 * truth.target_error_m, 4),
        tre_mm=None if report is None else round(1e3 * report.tre_m, 4),
        tre95_mm=None if report is None else round(1e3 * report.tre95_m, 4),
        tre_by_marker_mm=" ".join(expected_mm),
        error_by_marker_mm=" ".join(errors_mm),
        images=images,
        error=error[:300],
        cpu_s=round(process_time() - began_s, 1),
        commit=commit,
    )


def _drawn(name: str, seed: int, *, commit: str) -> Outcome:
    """A registration of markers whose searches are drawn, at the places of the session or of the row."""
    row = ROWS[name]
    scene = ForgedScene(seed)
    began_s = process_time()
    markers = list[SeenMarker]()
    expected_mm = list[str]()
    errors_mm = list[str]()
    place: Place | None = None
    choice = choose([])
    for number in range(row.markers):
        spot_m = scene.lit(place) if row.places_m is None else scene.at(*row.places_m[number])
        markers.append(scene.seen(str(number + 1), spot_m))
        choice = choose(markers)
        error_m = None if choice.report is None else scene.error_m(choice.report)
        known = choice.report is not None and error_m is not None
        expected_mm.append(f"{1e3 * choice.report.tre_m:.3f}" if choice.report is not None and known else "-")
        errors_mm.append("-" if error_m is None else f"{1e3 * error_m:.3f}")
        poses = Poses.of(markers, choice, REACH, rng=np.random.default_rng(0)) if row.places_m is None else None
        if poses is not None and number + 1 < row.markers:
            probe_deg = math.degrees(math.atan2(spot_m[0], spot_m[2]))
            place = poses.best_place(STEREO, REACH, target_trus_m=None, probe_deg=probe_deg)
    report = choice.report
    error_m = None if report is None else scene.error_m(report)
    return Outcome(
        row=name,
        seed=seed,
        registered=error_m is not None,
        rig_s=0.0,
        acquisitions=0,
        markers=row.markers,
        chosen=len(choice.chosen),
        wrong=0,
        refused=0,
        target_error_mm=None if error_m is None else round(1e3 * error_m, 4),
        tre_mm=None if report is None else round(1e3 * report.tre_m, 4),
        tre95_mm=None if report is None else round(1e3 * report.tre95_m, 4),
        tre_by_marker_mm=" ".join(expected_mm),
        error_by_marker_mm=" ".join(errors_mm),
        images=False,
        error="",
        cpu_s=round(process_time() - began_s, 1),
        commit=commit,
    )


def table(found: list[Outcome]) -> str:
    """The table of all rows as Markdown."""
    lines = [
        "| sessions | registered | rig, s | acquisitions | TRE mean, rms, mm | 95 % covers | other source |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name, row in ROWS.items():
        mine = [each for each in found if each.row == name]
        if mine and row.searches:
            lines.append(f"| {row.title} ({len(mine)}) | {' | '.join(_cells(mine))} |")
    for number in (4, 6, 9):
        both = [f"{ROWS[name].title}: {_mean_after(found, name, number)}" for name in ("places", "grid")]
        lines.append(f"\nTrue, and expected TRE after {number} markers, mean, mm: {'; '.join(both)}.")
    for goal_mm in GOALS_MM:
        needed = [f"{ROWS[name].title}: {markers_until(found, name, goal_mm)}" for name in ("places", "grid")]
        lines.append(f"\nMarkers until an expected TRE of {goal_mm} mm, mean: {'; '.join(needed)}.")
    return "\n".join(lines) + "\n"


def _cells(mine: list[Outcome]) -> list[str]:
    known = [each for each in mine if each.registered and each.target_error_mm is not None]
    tre_mm = np.array([each.target_error_mm for each in known], dtype=float)
    covered = [(each.target_error_mm or 0.0) <= (each.tre95_mm or 0.0) for each in known]
    some = len(known) > 0
    return [
        f"{sum(each.registered for each in mine)} of {len(mine)}",
        f"{np.mean([each.rig_s for each in mine]):.1f}",
        f"{np.mean([each.acquisitions for each in mine]):.0f}",
        f"{tre_mm.mean():.2f}, {np.sqrt(np.mean(tre_mm**2)):.2f}" if some else "",
        f"{100 * np.mean(covered):.0f} %" if some else "",
        f"{sum(each.wrong > 0 for each in mine)} of {len(mine)}",
    ]


def _mean_after(found: list[Outcome], name: str, markers: int) -> str:
    """Mean of the true and of the expected TRE of a row after so many markers."""
    means = []
    for key in ("error_by_marker_mm", "tre_by_marker_mm"):
        values = [getattr(each, key).split()[markers - 1] for each in found if each.row == name]
        means.append(np.mean([float(value) for value in values if value != "-"]) if values else math.nan)
    return f"{means[0]:.2f}, {means[1]:.2f}"


def markers_until(found: list[Outcome], name: str, goal_mm: float) -> str:
    """Mean number of markers that a row searched until the expected TRE was so small, and how many sessions got there.

    A session that does not get there counts with one marker more than it searched.
    """
    needed = []
    reached = 0
    for each in found:
        if each.row == name:
            said = [float(part) if part != "-" else np.inf for part in each.tre_by_marker_mm.split()]
            below = [number for number, tre_mm in enumerate(said, start=1) if tre_mm <= goal_mm]
            reached += bool(below)
            needed.append(below[0] if below else len(said) + 1)
    return f"{np.mean(needed):.2f} ({reached} of {len(needed)} sessions)" if needed else "none run"


def main() -> None:
    """Run what is missing, and print the table."""
    parser = session_parser("benchmarks.registration.sessions", __doc__, ROWS, sessions=30)
    parser.add_argument("--images", action="store_true", help="with camera images, at three times the computing time")
    asked = parser.parse_args()
    images: bool = asked.images
    found = run_missing(
        asked,
        partial(run, images=images),
        Outcome,
        first_seed=FIRST_SEED,
        counts=lambda each: each.images == images,
    )
    sys.stdout.write(table(found))


if __name__ == "__main__":
    main()
