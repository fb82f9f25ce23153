"""A benchmark of searches: frozen worlds and seeds in three tiers, which an entry from elsewhere meets like ours.

Each world of a tier is a study whose settings and seed never change (`WORLDS`, a hash of them), so that equal methods
have equal rows; more searches add rows. The tiers differ in what a search is told: one intensity, also the largest
envelope of each block of the image, also the channel data. Methods are in groups of their own studies, as an entry
must not change the rows of the others, and sweeps need a receiver set for single pulses.
"""

from __future__ import annotations

import hashlib
import math
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec

from markerseek._version import __version__
from markerseek.core import ConfigError, RecordError
from markerseek.sim import (
    LaserSettings,
    MarkerSettings,
    NoiseSettings,
    ReceiverSettings,
    SimulatedSettings,
    StageMotion,
)
from markerseek.studies.bound import mean_bounds
from markerseek.studies.policies import PolicySettings
from markerseek.studies.runner import read_rows, run_study, write_json
from markerseek.studies.scene import ClutterAround, SceneSettings, SecondSource
from markerseek.studies.statistics import Mean, Share
from markerseek.studies.study import Axis, CurveSettings, Study, cells
from markerseek.studies.summary import CLAIM_TOLERANCES, covers
from markerseek.studies.trial import Row, fault_of

RESULTS = "results.json"
"""Name of the file of results in the benchmark's folder."""

SEED = 20261124
"""Seed of all worlds, unless another one is given."""

MOST = 64
"""Most acquisitions that an entry may make in a search."""

Tier: TypeAlias = Literal["intensities", "block maxima", "raw channels"]
"""What a search is told."""

_LEVELS: dict[Tier, Literal["curves", "frames"]] = {
    "intensities": "curves",
    "block maxima": "frames",
    "raw channels": "frames",
}

USUAL_SEARCHES: dict[Tier, int] = {"intensities": 100, "block maxima": 40, "raw channels": 20}
"""Searches of each method in each world: a quarter of an hour in all on two cores."""

_RIG = SimulatedSettings(
    start_deg=-35.0,
    noise=NoiseSettings(peak_snr_db=30.0),
    laser=LaserSettings(rate_hz=20.0),
    stage=StageMotion(speed_deg_s=12.5, acceleration_deg_s2=25.0),
    receiver=ReceiverSettings(readout_s=0.05),
)

OPTIMISERS = ("scikit-optimize", "botorch")
"""Methods of other packages that are run if they are asked for: they think for a tenth of a second at each step."""

BOUND_ACQUISITIONS = 8, 16
"""Numbers of acquisitions for which the bound is computed."""

METHODS = ("ternary", "golden-section", "weighted-average", "posterior", "exhaustive", "bounded-minimiser")
"""The paper's three, ours, every angle, and SciPy's optimiser (Brent), whose answers are checked as the paper's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """What is searched in one world of a tier."""

    tier: Tier
    name: str
    """What is there beside one point: none, one, two, clutter, a spot, or a point at the edge of the range."""
    rig: SimulatedSettings = _RIG
    scene: SceneSettings = field(default_factory=SceneSettings)
    curve: CurveSettings = field(default_factory=CurveSettings)
    vary: tuple[Axis, ...] = ()

    @property
    def place(self) -> str:
        """Name of its folder."""
        return f"{self.tier}-{self.name}".replace(" ", "-")

    def study(self, group: str, policies: Sequence[PolicySettings], *, searches: int, seed: int = SEED) -> Study:
        """The study of a group of policies in it."""
        level = _LEVELS[self.tier]
        return Study(
            name=f"{group} {self.place}",
            policies=tuple(policies),
            seed=seed,
            trials=math.ceil(searches / max(1, math.prod(len(axis.values) for axis in self.vary))),
            level=level,
            drawn="marker" if level == "curves" else "everything",
            curve=self.curve,
            rig=self.rig,
            scene=self.scene,
            vary=self.vary,
        )


def _worlds() -> Iterator[World]:
    nothing = replace(_RIG, marker=MarkerSettings(present=False))
    edge = (Axis(key="rig.marker.angle_deg", values=(-34.0, 34.0)),)
    two = SceneSettings(second=SecondSource())
    for tier in _LEVELS:
        yield World(tier=tier, name="none", rig=nothing)
        yield World(tier=tier, name="one")
        yield World(tier=tier, name="edge", vary=edge)
    # Two humps are curves of a closed form; clutter needs images.
    yield World(tier="intensities", name="two", scene=two, curve=CurveSettings(family="sech", fwhm_deg=12.0))
    yield World(tier="intensities", name="spot", rig=replace(_RIG, tissue="muscle"))
    yield World(tier="raw channels", name="two", scene=two)
    yield World(tier="raw channels", name="clutter", scene=SceneSettings(clutter=ClutterAround()))
    yield World(tier="raw channels", name="spot", rig=replace(_RIG, tissue="muscle"))


WORLDS: tuple[World, ...] = tuple(_worlds())
"""The frozen worlds."""


def worlds_hash(seed: int = SEED) -> str:
    """Hash of the worlds: of the settings and seed from which every search is drawn."""
    posterior = (PolicySettings(method="posterior"),)
    drawn = [
        [world.place, seed, [cell.digest for cell in cells(world.study("hash", posterior, searches=1, seed=seed))]]
        for world in WORLDS
    ]
    return hashlib.sha256(msgspec.json.encode(drawn)).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A search method of somebody else."""

    command: tuple[str, ...]
    """Words that start it."""
    files: tuple[tuple[str, str], ...]
    """Files among them, with their SHA-256."""

    @classmethod
    def named(cls, text: str) -> Entry:
        """The entry of a command line; ``FILE.py:Class`` stands for a class that is served by this package."""
        try:
            words = shlex.split(text)
        except ValueError as problem:
            raise ConfigError(f"--entry {text}: it is no command: {problem}") from problem
        if not words:
            raise ConfigError("--entry is empty; give a command, or FILE.py:Class")
        places = [Path(word) for word in words]
        file, _, name = words[-1].rpartition(":")
        if len(words) == 1 and file.endswith(".py") and name.isidentifier():
            places = [Path(file)]
            words = [sys.executable, "-P", "-m", "markerseek.studies.entry_server", words[0]]
        if words[0] == sys.executable and not places[0].is_file():
            raise ConfigError(f"--entry {text}: there is no file {file}; name the Python file and its class")
        if shutil.which(words[0]) is None:
            raise ConfigError(
                f"--entry {text}: {words[0]} is no program that can be started; give a command, or FILE.py:Class"
            )
        files = tuple((place.name, _sha256(place)) for place in places if place.is_file())
        return cls(command=tuple(words), files=files)

    @property
    def label(self) -> str:
        """Its name in the results: of its last file, else of its program."""
        return self.files[-1][0] if self.files else Path(self.command[0]).name

    @property
    def group(self) -> str:
        """Name of its folder, another one for another content of its files."""
        return f"entry-{hashlib.sha256(msgspec.json.encode([self.command, self.files])).hexdigest()[:12]}"


class Score(msgspec.Struct, frozen=True, kw_only=True):
    """One method in one world.

    ``right``: searches that found the marker within the tolerance, or, where there is none, found nothing.
    ``acquisitions`` and ``seconds``: of all searches, over the number of those that found it within the tolerance; None
    where none did. ``false_found``: found where there is none, or off by more than twice the tolerance.
    """

    tier: str
    world: str
    method: str
    searches: int
    right: Share
    acquisitions: float | None
    seconds: float | None
    error_deg: Mean
    covered: Share
    false_found: Share
    missed: Share
    travel_deg: Mean
    failed: int


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """Van Trees' bound on the mean error of a search of so many acquisitions for one point, at the best angles."""

    tier: str
    world: str
    markers: int
    acquisitions: int
    error_deg: float


class EntryResult(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an entry; ``failure``: in which world it failed, and how, empty where it did not."""

    method: str
    command: tuple[str, ...]
    files: dict[str, str]
    failure: str


class BenchmarkResults(msgspec.Struct, frozen=True, kw_only=True):
    """The results: ``worlds`` is the hash of the worlds, ``files`` has the SHA-256 of each table of rows."""

    benchmark: int
    version: str
    worlds: str
    seed: int
    searches: dict[str, int]
    scores: list[Score]
    bounds: list[Bound]
    entries: list[EntryResult]
    files: dict[str, str]


def benchmark_size(*, scale: float, others: int) -> int:
    """Searches of a whole benchmark, ``others`` being the entries and optimisers."""
    methods = {world: sum(len(policies) for _, policies in _groups(world)) + others for world in WORLDS}
    return sum(_searches(world.tier, scale) * count for world, count in methods.items())


def run_benchmark(
    folder: Path,
    *,
    entries: Sequence[Entry] = (),
    optimisers: Sequence[str] = (),
    scale: float = 1.0,
    seed: int | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> BenchmarkResults:
    """Run the benchmark, or the rest of it, and write `RESULTS` into its folder.

    ``folder``: created if it does not exist. ``optimisers``: some of `OPTIMISERS`. ``scale``: searches over the usual
    number. ``seed``: of all worlds, instead of `SEED`. ``progress``: receives the number of searches that are done.
    """
    unknown = [name for name in optimisers if name not in OPTIMISERS]
    if unknown:
        raise ConfigError(f"--optimiser {unknown[0]} is unknown; there are: {', '.join(OPTIMISERS)}")
    seed = SEED if seed is None else seed
    scores: list[Score] = []
    bounds: list[Bound] = []
    asked = [(name, (PolicySettings(method=name),)) for name in optimisers]
    files: dict[str, str] = {}
    failures: dict[str, str] = {}
    done = 0
    for world in WORLDS:
        searches = _searches(world.tier, scale)
        entered = [(entry.group, (_as_policy(entry, world.tier),)) for entry in entries if entry.group not in failures]
        for group, policies in (*_groups(world), *asked, *entered):
            study = world.study(group, policies, searches=searches, seed=seed)
            # Its first search, before a world full of failures.
            fault = fault_of(study, 0) if policies[0].command else ""
            if fault:
                failures[group] = f"{world.tier}, {world.name}: {fault}"
                continue
            finished = run_study(study, folder / group / f"{world.place}-{searches}", workers=workers)
            files[str(finished.rows.relative_to(folder))] = _sha256(finished.rows)
            rows = list(read_rows(finished.rows, study))
            failed = next((row for row in rows if row.answer == "failed" and policies[row.policy].command), None)
            if failed is not None:
                failures[group] = f"{world.tier}, {world.name}: {fault_of(study, failed.row) or 'it failed once'}"
            scores += [
                _score(world, str(policy), [row for row in rows if row.policy == number])
                for number, policy in enumerate(policies)
            ]
            done += study.rows
            if progress is not None:
                progress(done)
        bounds += _bounds(world, searches=searches, seed=seed)
    results = BenchmarkResults(
        benchmark=1,
        version=__version__,
        worlds=worlds_hash(seed),
        seed=seed,
        searches={tier: _searches(tier, scale) for tier in _LEVELS},
        scores=scores,
        bounds=bounds,
        entries=[
            EntryResult(
                method=str(_as_policy(entry, "raw channels")),
                command=entry.command,
                files=dict(entry.files),
                failure=failures.get(entry.group, ""),
            )
            for entry in entries
        ],
        files=files,
    )
    write_json(folder / RESULTS, results)
    return results


def _searches(tier: Tier, scale: float) -> int:
    if not 0 < scale <= 1000:
        raise ConfigError(f"scale is {scale:g}, it must lie in (0, 1000]; 1 takes the usual number of searches")
    # Even: the worlds at the edge have two ends.
    return 2 * max(1, round(scale * USUAL_SEARCHES[tier] / 2))


def _groups(world: World) -> list[tuple[str, tuple[PolicySettings, ...]]]:
    ours = ("methods", tuple(PolicySettings(method=method) for method in METHODS))
    if world.tier == "intensities":
        return [ours]
    return [ours, ("sweeps", (PolicySettings(method="posterior", sweep=True),))]


def _bounds(world: World, *, searches: int, seed: int) -> Iterator[Bound]:
    """The bounds in a world of one point; a closed form's curve has no distances, from which they are computed."""
    if world.name != "one" or world.tier == "intensities":
        return
    study = world.study("bound", (PolicySettings(method="posterior"),), searches=searches, seed=seed)
    errors_deg = mean_bounds(study, cells(study)[0], markers=searches, acquisitions=BOUND_ACQUISITIONS)
    for count, error_deg in zip(BOUND_ACQUISITIONS, errors_deg, strict=True):
        yield Bound(tier=world.tier, world=world.name, markers=searches, acquisitions=count, error_deg=error_deg)


def _as_policy(entry: Entry, tier: Tier) -> PolicySettings:
    channels = tier == "raw channels"
    return PolicySettings(method=entry.label, acquisitions=MOST, command=entry.command, channels=channels)


def _score(world: World, method: str, rows: Sequence[Row]) -> Score:
    marked = [row for row in rows if row.truth_deg is not None]
    found = [row for row in rows if row.answer == "found"]
    errors_deg = [row.error_deg for row in found if row.error_deg is not None]
    within = sum(_within(row, 1.0) for row in found)
    right = within if marked else sum(row.answer not in ("found", "failed") for row in rows)
    covering = [row for row in marked if row.low_deg is not None]
    return Score(
        tier=world.tier,
        world=world.name,
        method=method,
        searches=len(rows),
        right=Share.of(right, len(rows)),
        acquisitions=sum(row.acquisitions or 0 for row in rows) / within if within else None,
        seconds=sum(row.elapsed_s or 0.0 for row in rows) / within if within else None,
        error_deg=Mean.of(errors_deg),
        covered=Share.of(sum(covers(row) for row in covering), len(covering)),
        false_found=Share.of(sum(not _within(row, CLAIM_TOLERANCES) for row in found), len(rows)),
        missed=Share.of(sum(row.answer == "not found" for row in marked), len(marked)),
        travel_deg=Mean.of([row.travel_deg for row in rows if row.travel_deg is not None]),
        failed=sum(row.answer == "failed" for row in rows),
    )


def _within(row: Row, tolerances: float) -> bool:
    """Whether the error is known, and at most so many tolerances."""
    return row.error_deg is not None and row.error_deg <= tolerances * row.tolerance_deg


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror}") from problem
