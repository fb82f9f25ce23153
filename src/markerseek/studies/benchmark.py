"""A benchmark of searches: frozen worlds in three tiers, which an entry from elsewhere meets like our methods.

Each world of a tier is a study whose settings never change (`WORLDS`, a hash of them). Without entries its seed does
not change either, so that equal methods have equal rows; entries meet worlds of a new seed, and so do our methods
beside them. More searches add rows. The tiers differ in what a search receives: one intensity, also the largest
envelope of each block of the image, also the channel data. Methods are in groups of their own studies, as an entry
must not change the rows of the others, and sweeps need a receiver set for single pulses.
"""

from __future__ import annotations

import hashlib
import math
import secrets
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
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
from markerseek.studies import entry_child
from markerseek.studies.policies import StudyPolicy, study_policy
from markerseek.studies.runner import read_json, read_rows, run_study, write_json
from markerseek.studies.scene import ClutterAround, SceneSettings, SecondSource
from markerseek.studies.statistics import Mean, Share
from markerseek.studies.study import Axis, CurveSettings, Study, cells
from markerseek.studies.summary import CLAIM_TOLERANCES, covers
from markerseek.studies.trial import Row

RESULTS = "results.json"
"""Name of the file of results in the benchmark's folder."""

DRAWN = "seed.json"
"""Name of the file of the drawn seed, in the folder of these entries."""

SEED = 20261124
"""Seed of all worlds without entries."""

MOST = 64
"""Most acquisitions that an entry may make in a search."""

Progress: TypeAlias = Callable[[str, int, int], None]

Tier: TypeAlias = Literal["intensities", "block maxima", "raw channels"]
"""What a search receives."""

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

METHODS = ("ternary", "golden-section", "weighted-average", "posterior", "exhaustive")
"""The paper's three, ours, and every angle."""


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

    def study(self, group: str, policies: Sequence[StudyPolicy], *, searches: int, seed: int = SEED) -> Study:
        """The study of a group of policies in it."""
        level = _LEVELS[self.tier]
        return Study(
            name=f"{group} {self.place}",
            policies=tuple(policies),
            seed=self._seed(seed),
            trials=math.ceil(searches / max(1, math.prod(len(axis.values) for axis in self.vary))),
            level=level,
            drawn="marker" if level == "curves" else "everything",
            curve=self.curve,
            rig=self.rig,
            scene=self.scene,
            vary=self.vary,
        )

    def _seed(self, seed: int) -> int:
        """Seed of the world: an entry must not meet a marker again that it has found in another tier."""
        # The usual worlds were frozen with one seed; there is no secret.
        return seed if seed == SEED else int(hashlib.sha256(f"{seed} {self.place}".encode()).hexdigest()[:15], 16)


def _worlds() -> Iterator[World]:
    nothing = replace(_RIG, marker=MarkerSettings(present=False))
    edge = (Axis(key="rig.marker.angle_deg", values=(-34.0, 34.0)),)
    two = SceneSettings(second=SecondSource())
    for tier in _LEVELS:
        yield World(tier=tier, name="none", rig=nothing)
        yield World(tier=tier, name="one")
        yield World(tier=tier, name="edge", vary=edge)
    # Two sources are curves of a closed form; clutter needs images.
    yield World(tier="intensities", name="two", scene=two, curve=CurveSettings(family="sech", fwhm_deg=12.0))
    yield World(tier="intensities", name="spot", rig=replace(_RIG, tissue="muscle"))
    yield World(tier="raw channels", name="two", scene=two)
    yield World(tier="raw channels", name="clutter", scene=SceneSettings(clutter=ClutterAround()))
    yield World(tier="raw channels", name="spot", rig=replace(_RIG, tissue="muscle"))


WORLDS: tuple[World, ...] = tuple(_worlds())
"""The frozen worlds."""


def worlds_hash(seed: int = SEED) -> str:
    """Hash of the worlds: of the settings and seed from which every search is drawn."""
    posterior = (study_policy(method="posterior"),)
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
        file, _, name = words[-1].rpartition(":")
        if len(words) == 1 and file.endswith(".py") and name.isidentifier():
            if not Path(file).is_file():
                raise ConfigError(f"--entry {text}: there is no file {file}; name the Python file and its class")
            return cls(
                command=(sys.executable, "-P", entry_child.__file__, f"{Path(file).absolute()}:{name}"),
                files=((Path(file).name, _sha256(Path(file))),),
            )
        if shutil.which(words[0]) is None:
            raise ConfigError(
                f"--entry {text}: {words[0]} is no program that can be started; give a command, or FILE.py:Class"
            )
        # It begins in a folder of its own. A program on the PATH may have the name of a file that is here.
        local = [bool(place) and Path(word).exists() for place, word in enumerate(words)]
        local[0] = "/" in words[0]
        words = [str(Path(word).absolute()) if here else word for word, here in zip(words, local, strict=True)]
        files = tuple((Path(word).name, _sha256(Path(word))) for word in words if Path(word).is_file())
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
    """One method in one world, or, with the world "all", in all worlds of a tier."""

    tier: str
    world: str
    method: str
    searches: int
    right: Share
    """Searches that found the marker within the tolerance, or, without a marker, found nothing."""
    acquisitions: float | None
    """Of all searches for a marker, over the number of those that found it within the tolerance; None if none did."""
    seconds: float | None
    """Time on the simulated clock, counted as the acquisitions."""
    error_deg: Mean
    covered: Share
    false_found: Share
    """Found without a marker, or off by more than twice the tolerance."""
    missed: Share
    travel_deg: Mean
    failed: int


class EntryResult(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an entry."""

    method: str
    command: tuple[str, ...]
    files: dict[str, str]
    """SHA-256 of the entry's files, by name."""
    failure: str
    """In which world the entry failed, and how; empty if it did not fail."""


class BenchmarkResults(msgspec.Struct, frozen=True, kw_only=True):
    """The results of a benchmark."""

    benchmark: int
    """Version of the benchmark."""
    version: str
    """Version of the package."""
    worlds: str
    """Hash of the worlds."""
    seed: int
    searches: dict[str, int]
    """Searches of each method in each world, by tier."""
    scores: list[Score]
    totals: list[Score]
    """Of each method over all worlds of a tier."""
    entries: list[EntryResult]
    files: dict[str, str]
    """SHA-256 of each table of rows, by path."""


def benchmark_size(*, scale: float, entries: int) -> int:
    """Searches of a whole benchmark, with this number of entries."""
    methods = {world: sum(len(policies) for _, policies in _groups(world)) + entries for world in WORLDS}
    return sum(_searches(world.tier, scale) * count for world, count in methods.items())


def run_benchmark(
    folder: Path,
    *,
    entries: Sequence[Entry] = (),
    scale: float = 1.0,
    seed: int | None = None,
    workers: int | None = None,
    progress: Progress = lambda _stage, _done, _total: None,
) -> BenchmarkResults:
    """Run the benchmark, or the rest of it, and write `RESULTS` into its folder.

    Beside entries all worlds have a seed that is drawn for them: nobody can have tuned a method on their markers.

    ``folder``: created if it does not exist. ``scale``: searches over the usual number. ``seed``: of all worlds; None:
    `SEED`, or beside entries the drawn one. ``progress``: receives a stage, and how many of its searches are done, of
    how many.
    """
    rows_in, used = folder, SEED if seed is None else seed
    if entries:
        key = [[entry.group for entry in entries], scale, seed, __version__]
        rows_in = folder / f"entries-{hashlib.sha256(msgspec.json.encode(key)).hexdigest()[:12]}"
        used = _drawn_seed(rows_in) if seed is None else seed
    failures: dict[str, str] = {}
    files: dict[str, str] = {}
    searched: list[tuple[str, World, StudyPolicy, list[Row]]] = []
    done, size = 0, benchmark_size(scale=scale, entries=len(entries))
    for world in WORLDS:
        entered = [(entry.group, (_as_policy(entry, world.tier),)) for entry in entries if entry.group not in failures]
        for group, policies in (*_groups(world), *entered):
            searches = _searches(world.tier, scale)
            study = world.study(group, policies, searches=searches, seed=used)
            place = rows_in / group / f"{world.place}-{searches}"
            finished = run_study(study, place, workers=workers, progress=partial(_advance, progress, done, size))
            done += study.rows
            files[str(finished.rows.relative_to(folder))] = _sha256(finished.rows)
            rows = list(read_rows(finished.rows, study))
            for number, policy in enumerate(policies):
                searched.append((group, world, policy, [row for row in rows if row.policy == number]))
            fault = next((row.fault for row in rows if policies[0].command and row.fault is not None), None)
            if fault is not None:
                failures[group] = f"{world.tier}, {world.name}: {fault}"
    scores: list[Score] = []
    by_method: dict[tuple[Tier, str], list[Row]] = {}
    for group, world, policy, rows in searched:
        if group not in failures:
            scores.append(_score(world.tier, world.name, str(policy), rows))
            by_method.setdefault((world.tier, str(policy)), []).extend(rows)
    results = BenchmarkResults(
        benchmark=2,
        version=__version__,
        worlds=worlds_hash(used),
        seed=used,
        searches={tier: _searches(tier, scale) for tier in _LEVELS},
        scores=scores,
        totals=[_score(tier, "all", method, rows) for (tier, method), rows in by_method.items()],
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


def _advance(progress: Progress, before: int, size: int, rows: int) -> None:
    progress("searches", before + rows, size)


def _drawn_seed(folder: Path) -> int:
    """The seed of a benchmark with entries, drawn when it begins."""
    path = folder / DRAWN
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, secrets.randbits(60))
    return read_json(path, int)


def _searches(tier: Tier, scale: float) -> int:
    if not 0 < scale <= 1000:
        raise ConfigError(f"scale is {scale:g}, it must lie in (0, 1000]; 1 takes the usual number of searches")
    # Even: the worlds at the edge have two ends.
    return 2 * max(1, round(scale * USUAL_SEARCHES[tier] / 2))


def _groups(world: World) -> list[tuple[str, tuple[StudyPolicy, ...]]]:
    ours = ("methods", tuple(study_policy(method=method) for method in METHODS))
    if world.tier == "intensities":
        return [ours]
    return [ours, ("sweeps", (study_policy(method="posterior", sweep=True),))]


def _as_policy(entry: Entry, tier: Tier) -> StudyPolicy:
    channels = tier == "raw channels"
    return study_policy(method=entry.label, acquisitions=MOST, command=entry.command, channels=channels)


def _score(tier: Tier, world: str, method: str, rows: Sequence[Row]) -> Score:
    marked = [row for row in rows if row.truth_deg is not None]
    found = [row for row in rows if row.answer == "found"]
    within = sum(_within(row, 1.0) for row in found)
    nothing = sum(row.truth_deg is None and row.answer not in ("found", "failed") for row in rows)
    covering = [row for row in marked if row.low_deg is not None]
    return Score(
        tier=tier,
        world=world,
        method=method,
        searches=len(rows),
        right=Share.of(within + nothing, len(rows)),
        acquisitions=sum(row.acquisitions or 0 for row in marked) / within if within else None,
        seconds=sum(row.elapsed_s or 0.0 for row in marked) / within if within else None,
        error_deg=Mean.of([row.error_deg for row in found if row.error_deg is not None]),
        covered=Share.of(sum(covers(row) for row in covering), len(covering)),
        false_found=Share.of(sum(not _within(row, CLAIM_TOLERANCES) for row in found), len(rows)),
        missed=Share.of(sum(row.answer == "not found" for row in marked), len(marked)),
        travel_deg=Mean.of([row.travel_deg for row in rows if row.travel_deg is not None]),
        failed=sum(row.answer == "failed" for row in rows),
    )


def _within(row: Row, tolerances: float) -> bool:
    """Whether the error is known, and at most this many tolerances."""
    return row.error_deg is not None and row.error_deg <= tolerances * row.tolerance_deg


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror}") from problem
