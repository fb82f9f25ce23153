"""Sessions whose endoscope stands still, or is moved, before tissue that the package does not draw; every one counted.

``python -m benchmarks.registration.moves --sessions 30 --out docs/data/moves.csv`` runs those that the file does not
have yet, and prints the table; the file grows session by session, so that an interrupted run is continued.

Images are those of a simulated endoscope and looked at as a session does, in the dark before each marker and once after
the last. Markers and their searches are drawn, with all errors from the priors of the registration, because a session
of images and searches takes minutes. What the cameras see during a search is no part of this.

The textures are not those of `TexturedTissue.drawn`: vessels that branch, cells with dark borders, fibres that all run
in one direction, and smooth tissue with highlights alone, on which nothing can be followed.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from time import process_time

import numpy as np

from benchmarks.registration.forged_markers import CAMERAS, TISSUE_M, PriorScene
from benchmarks.registration.session_rows import SessionOutcome, run_missing, session_parser
from markerseek.core import Float32, Float64, SpotToSource
from markerseek.registration import EndoscopeMove, SeenEndoscope, Spot, TakenMarker
from markerseek.registration.choice import SeenMarker, choose
from markerseek.registration.endoscope_motion import EndoscopeWatch
from markerseek.registration.stations import carry
from markerseek.sim import EndoscopeSettings, SimulatedEndoscope, TexturedTissue, VirtualClock
from markerseek.sim.textured_tissue import BUMP_RADIUS_M, BUMPS, RELIEF_STEP_M, SIZE_M, TEXTURE_M

FIRST_SEED = 71_001
"""Seed of the first session of each row; nothing was chosen on these."""

CONTRAST = 0.2
"""Standard deviation of the brightness over its mean, of tissue with texture."""

Brightness = Float32[np.ndarray, "rows columns"]


def _smooth(rng: np.random.Generator, length_m: float) -> Float64[np.ndarray, "rows columns"]:
    """Waves of random direction and phase, of this length and longer."""
    steps = np.arange(round(SIZE_M / TEXTURE_M)) * TEXTURE_M
    total = np.zeros((len(steps), len(steps)))
    for _ in range(8):
        wave = 2 * math.pi / (length_m * rng.uniform(1.0, 3.0))
        direction, phase = rng.uniform(0, 2 * math.pi, 2)
        total += np.sin(wave * (math.cos(direction) * steps + math.sin(direction) * steps[:, None]) + phase)
    return total / total.std()


def _vessels(rng: np.random.Generator) -> Float64[np.ndarray, "rows columns"]:
    """Dark vessels that wind and branch over smooth tissue."""
    from scipy import ndimage

    count = round(SIZE_M / TEXTURE_M)
    dark = np.zeros((count, count))
    ends = [(rng.uniform(0, count, 2), rng.uniform(0, 2 * math.pi), rng.uniform(3.0, 7.0)) for _ in range(60)]
    while ends:
        place, direction, radius = ends.pop()
        for _ in range(int(60 * radius)):
            direction += 0.08 * rng.standard_normal()
            place = place + 1.5 * np.array([math.sin(direction), math.cos(direction)])
            row, column = np.rint(place).astype(int)
            if not (0 <= row < count and 0 <= column < count):
                break
            dark[row, column] = max(dark[row, column], radius)
            if radius > 1.2 and rng.random() < 0.012:
                ends.append((place, direction + rng.choice([-0.7, 0.7]), 0.6 * radius))
    broad = sum(ndimage.gaussian_filter(np.where(dark > width, width, 0.0), width / 2) for width in (1.0, 2.0, 4.0))
    return 0.3 * _smooth(rng, 20e-3) - np.minimum(broad / np.quantile(broad, 0.98), 1.0)


def _cells(rng: np.random.Generator) -> Float64[np.ndarray, "rows columns"]:
    """Cells of some 4 mm, each of its own brightness, with dark borders."""
    from scipy.spatial import cKDTree

    count = round(SIZE_M / TEXTURE_M)
    middles = rng.uniform(0, count, size=(round((SIZE_M / 4e-3) ** 2), 2))
    places = np.stack(np.meshgrid(np.arange(count), np.arange(count), indexing="ij"), axis=-1).reshape(-1, 2)
    away, nearest = cKDTree(middles).query(places, k=2)
    border = np.exp(-(((away[:, 1] - away[:, 0]) / 2.5) ** 2))
    bright = rng.standard_normal(len(middles))[nearest[:, 0]]
    return (0.4 * bright - 1.2 * border).reshape(count, count) + 0.3 * _smooth(rng, 20e-3)


def _fibres(rng: np.random.Generator) -> Float64[np.ndarray, "rows columns"]:
    """Bundles of fibres that all run in one direction, with little that tells where along them a place is."""
    from scipy import ndimage

    count = round(SIZE_M / TEXTURE_M)
    drawn = ndimage.gaussian_filter(rng.standard_normal((count, count)), (1.5, 12.0))
    return drawn / drawn.std() + 0.5 * _smooth(rng, 20e-3)


def _plain(rng: np.random.Generator) -> Float64[np.ndarray, "rows columns"]:
    """Brightness that changes over centimetres only."""
    return 0.1 * _smooth(rng, 60e-3)


TEXTURES: dict[str, Callable[[np.random.Generator], Float64[np.ndarray, "rows columns"]]] = {
    "vessels": _vessels,
    "cells": _cells,
    "fibres": _fibres,
    "plain": _plain,
}
"""Textures by their names."""


@lru_cache(maxsize=16)
def tissue(texture: str, *, seed: int) -> TexturedTissue:
    """Return tissue of a texture, with folds in place of the relief that the package draws.

    Cached, because drawing it takes seconds.
    """
    rng = np.random.default_rng((seed, 5))
    drawn = TEXTURES[texture](rng)
    scale = CONTRAST / drawn.std() if texture != "plain" else CONTRAST
    brightness = 1 + scale * (drawn - drawn.mean())
    steps_m = np.arange(round(SIZE_M / RELIEF_STEP_M) + 1) * RELIEF_STEP_M
    direction, phase = rng.uniform(0, 2 * math.pi, 2)
    along_m = math.cos(direction) * steps_m + math.sin(direction) * steps_m[:, None]
    return TexturedTissue(
        level_m=TISSUE_M,
        relief_m=2e-3 * np.sin(2 * math.pi * along_m / rng.uniform(20e-3, 40e-3) + phase),
        brightness=np.maximum(brightness, 0.05).astype(np.float32),
        bumps_m=rng.uniform(-SIZE_M / 2, SIZE_M / 2, size=(BUMPS, 2)),
        bump_radius_m=rng.uniform(*BUMP_RADIUS_M, size=BUMPS),
    )


WHEN = ("before the third", "before the last", "after the last")
"""Marker before or after which the endoscope is moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """How far the endoscope is moved, in a random direction and about a random axis."""

    title: str
    shift_m: float = 0.0
    turn_deg: float = 0.0
    textures: tuple[str, ...] = ("vessels", "cells", "fibres")
    """Those of its sessions in turn."""


ROWS = {
    "still": Row(title="nothing moves"),
    "2mm": Row(title="moved by 2 mm", shift_m=2e-3),
    "5mm": Row(title="moved by 5 mm", shift_m=5e-3),
    "20mm": Row(title="moved by 20 mm", shift_m=20e-3),
    "1deg": Row(title="turned by 1°", turn_deg=1.0),
    "3deg": Row(title="turned by 3°", turn_deg=3.0),
    "10deg": Row(title="turned by 10°", turn_deg=10.0),
    "plain": Row(title="smooth tissue, moved by 5 mm", shift_m=5e-3, textures=("plain",)),
}
"""The rows, by name."""

TISSUES = 3
"""Pieces of tissue of each texture."""


class _Scene(PriorScene):
    """A scene whose spots lie on the surface of a piece of tissue."""

    def __init__(self, seed: int, surface: TexturedTissue) -> None:
        super().__init__(seed)
        self._surface = surface

    def at(self, x_m: float, y_m: float) -> Float64[np.ndarray, " 3"]:
        super().at(x_m, y_m)
        return np.array([x_m, y_m, float(self._surface.height_m(np.array([[x_m, y_m]]))[0])])


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome(SessionOutcome):
    """What came of one session; lengths in millimetres."""

    texture: str
    when: str
    """Of `WHEN`; empty: nothing moves."""
    moved: int
    """How often the session says that the endoscope has moved."""
    unknown: int
    """How often it says that this is not known."""
    looks: int
    """How often it looked."""
    lost: int
    """Markers that do not count."""
    registered: bool
    target_error_mm: float | None
    tre_mm: float | None
    tre95_mm: float | None
    still_error_mm: float | None
    """The true error of the same markers if the endoscope had not moved."""
    said: str
    """What it says of the endoscope, or why it is not registered."""
    cpu_s: float
    commit: str


def _way(seed: int, row: Row) -> EndoscopeMove:
    """A move of a row, in a direction of its own."""
    shift, turn = np.random.default_rng((seed, 6)).standard_normal((2, 3))
    shift_x, shift_y, shift_z = (row.shift_m * shift / np.linalg.norm(shift)).tolist()
    turn_x, turn_y, turn_z = (row.turn_deg * turn / np.linalg.norm(turn)).tolist()
    return EndoscopeMove(marker=1, shift_m=(shift_x, shift_y, shift_z), turn_deg=(turn_x, turn_y, turn_z))


def run(name: str, seed: int, *, commit: str) -> Outcome:
    """Run one session of a row."""
    row = ROWS[name]
    number = seed - FIRST_SEED
    texture = row.textures[number % len(row.textures)]
    moves = row.shift_m > 0 or row.turn_deg > 0
    when = WHEN[(number + number // 3) % 3] if moves else ""
    surface = tissue(texture, seed=number // 3 % TISSUES)
    began_s = process_time()
    scene = _Scene(seed, surface)
    clock = VirtualClock()
    images = SimulatedEndoscope(
        cameras=scene.cameras,
        camera_to_trus=scene.true,
        settings=EndoscopeSettings(exposure_swing=0.15, instrument=number % 2 == 1),
        rng=np.random.default_rng((seed, 7)),
        clock=clock,
        flashes=lambda: 0,
        tissue=surface,
        is_lit=lambda _since_s, _until_s: False,
    )
    watch = EndoscopeWatch(CAMERAS)
    spots_m = scene.wide(4)
    still = [scene.seen(str(each), spot_m) for each, spot_m in enumerate(spots_m, start=1)]
    told = list[SeenEndoscope]()
    taken = list[TakenMarker]()
    stood = scene.true

    def look() -> SeenEndoscope | None:
        # Between two markers some time passes: the instrument and the exposure are elsewhere.
        clock.wait(8.0)
        (pair,) = images.newest(1)
        seen = watch.look(pair, after=taken[-1].name) if taken else None
        if len(taken) < len(spots_m) and (seen is None or seen.state != "at rest"):
            watch.begin(str(len(taken) + 1), pair)
        if seen is not None:
            told.append(seen)
        return seen

    for place, spot_m in enumerate(spots_m):
        if (when == WHEN[0] and place == 2) or (when == WHEN[1] and place == 3):
            scene.true = _way(seed, row).from_place(scene.true)
            images.move(scene.true)
        endoscope = look()
        seen = still[place] if scene.true is stood else scene.seen(str(place + 1), spot_m, still[place].candidates)
        taken.append(_taken(seen, endoscope))
    if when == WHEN[2]:
        scene.true = _way(seed, row).from_place(scene.true)
        images.move(scene.true)
    carried = carry(taken, now=look())
    spot = SpotToSource()
    choice = choose(carried.seen, spot=spot)
    report = choice.report if choice.decided else None
    error_m = None if report is None else scene.error_m(report)
    states = [each.state for each in told]
    said = [each.said for each in told if each.state != "at rest"] + ([choice.reason] if choice.reason else [])
    scene.true = stood
    still_report = choose(still, spot=spot).report
    still_m = None if still_report is None else scene.error_m(still_report)
    return Outcome(
        row=name,
        seed=seed,
        texture=texture,
        when=when,
        moved=states.count("moved"),
        unknown=states.count("not known"),
        looks=len(states),
        lost=len(carried.lost),
        registered=error_m is not None,
        target_error_mm=None if error_m is None else round(1e3 * error_m, 4),
        tre_mm=None if report is None else round(1e3 * report.tre_m, 4),
        tre95_mm=None if report is None else round(1e3 * report.tre95_m, 4),
        still_error_mm=None if still_m is None else round(1e3 * still_m, 4),
        said="; ".join(said)[:300],
        cpu_s=round(process_time() - began_s, 1),
        commit=commit,
    )


def _taken(seen: SeenMarker, endoscope: SeenEndoscope | None) -> TakenMarker:
    """A marker as a session takes it."""
    return TakenMarker(
        name=seen.name,
        spot=Spot(left_px=(0.0, 0.0), right_px=(0.0, 0.0), sigma_px=0.1),
        camera_m=seen.camera_m.tolist(),
        camera_covariance_m2=seen.camera_covariance_m2.tolist(),
        camera_shared_m=seen.camera_shared_m.tolist(),
        answer="found",
        reason=None,
        candidates=list(seen.candidates),
        acquisitions=0,
        rig_s=0.0,
        prior=None,
        journal=None,
        at="",
        endoscope=endoscope,
    )


HEADS = (
    "sessions",
    "move noticed",
    "not known",
    "false alarms",
    "registered",
    "TRE mean, rms, mm",
    "still, mm",
    "expected, mm",
    "below 95 % length",
    "beyond twice it",
)


def table(found: Sequence[Outcome]) -> str:
    """The table of all rows as Markdown."""
    lines = [f"| four markers | {' | '.join(HEADS)} |", "|---" + "|---:" * len(HEADS) + "|"]
    for name, row in ROWS.items():
        lines += _line(row.title, [each for each in found if each.row == name])
    moved = [each for each in found if each.when and each.texture != "plain"]
    for when in WHEN:
        lines += _line(f"moved {when}, all sizes", [each for each in moved if each.when == when])
    for texture in TEXTURES:
        lines += _line(f"moved, {texture}", [each for each in moved if each.texture == texture])
    return "\n".join(lines) + "\n"


def _line(title: str, mine: Sequence[Outcome]) -> list[str]:
    return [f"| {title} | {' | '.join(_row_cells(mine))} |"] if mine else []


def _row_cells(mine: Sequence[Outcome]) -> Iterator[str]:
    yield str(len(mine))
    moved = [each for each in mine if each.when]
    yield f"{sum(each.moved > 0 for each in moved)}" if moved else ""
    yield str(sum(each.unknown > 0 and not (each.when and each.moved) for each in mine))
    # A move is seen once; the second time, nothing has moved.
    yield str(sum(each.moved > (1 if each.when else 0) for each in mine))
    yield str(sum(each.registered for each in mine))
    known = [each for each in mine if each.registered and each.target_error_mm is not None]
    if not known:
        yield from ("", "", "", "", "")
        return
    true_mm = np.array([each.target_error_mm for each in known], dtype=float)
    tre95_mm = np.array([each.tre95_mm for each in known], dtype=float)
    yield f"{true_mm.mean():.2f}, {np.sqrt(np.mean(true_mm**2)):.2f}"
    yield f"{np.mean([each.still_error_mm or 0.0 for each in known]):.2f}"
    yield f"{np.mean([each.tre_mm or 0.0 for each in known]):.2f}"
    yield f"{np.sum(true_mm <= tre95_mm)} of {len(known)}"
    yield str(np.sum(true_mm > 2 * tre95_mm))


def main() -> None:
    """Run what is missing, and print the table."""
    asked = session_parser("benchmarks.registration.moves", __doc__, ROWS, sessions=30).parse_args()
    sys.stdout.write(table(run_missing(asked, run, Outcome, first_seed=FIRST_SEED)))


if __name__ == "__main__":
    main()
