"""A benchmark of searches: frozen worlds in three tiers, which an entry from elsewhere meets like our methods.

Each world of a tier is a study whose settings never change (`WORLDS`, a hash of them). Without entries the seed never
changes either, so that equal methods have equal rows; more searches add rows. The tiers differ in what a search is
told: one intensity, also the largest envelope of each block of the image, also the channel data. Methods are in groups
of their own studies, as an entry must not change the rows of the others, and sweeps need a receiver set for single
pulses.
"""

from __future__ import annotations

import hashlib
import math
import secrets
import shlex
import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
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
from markerseek.studies.policies import StudyPolicy, study_policy
from markerseek.studies.runner import (
    ROWS,
    computed_rows,
    read_rows,
    recorded_seed,
    rows_of,
    run_study,
    write_json,
    write_rows,
)
from markerseek.studies.scene import ClutterAround, SceneSettings, SecondSource
from markerseek.studies.statistics import Mean, Share
from markerseek.studies.study import Axis, CurveSettings, Study, cells
from markerseek.studies.summary import CLAIM_TOLERANCES, covers
from markerseek.studies.trial import Row, fault_of

RESULTS = "results.json"
"""Name of the file of results in the benchmark's folder."""

FAULT = "fault.txt"
"""Name of the file with the fault of an entry, in its folder of the world in which it failed."""

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


class EntryResult(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an entry; ``failure``: in which world it failed, and how, empty where it did not."""

    method: str
    command: tuple[str, ...]
    files: dict[str, str]
    failure: str


class BenchmarkResults(msgspec.Struct, frozen=True, kw_only=True):
    """The results.

    ``worlds``: hash of the worlds. ``seeds``: the seed of each world by its folder's name. ``files``: SHA-256 of each
    table of rows.
    """

    benchmark: int
    version: str
    worlds: str
    seeds: dict[str, int]
    searches: dict[str, int]
    scores: list[Score]
    entries: list[EntryResult]
    files: dict[str, str]


def benchmark_size(*, scale: float, entries: int) -> int:
    """Searches of a whole benchmark with so many entries."""
    methods = {world: sum(len(policies) for _, policies in _groups(world)) + entries for world in WORLDS}
    return sum(_searches(world.tier, scale) * count for world, count in methods.items())


def run_benchmark(
    folder: Path,
    *,
    entries: Sequence[Entry] = (),
    scale: float = 1.0,
    seed: int | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> BenchmarkResults:
    """Run the benchmark, or the rest of it, and write `RESULTS` into its folder.

    An entry could compute the marker from the seed of its world. So the seed of a world that entries search is drawn,
    another one for each world, and only this process has it, in its memory, until all of them have searched the world.
    Then their rows are written, and our methods search the same world.

    ``folder``: created if it does not exist. ``scale``: searches over the usual number. ``seed``: of all worlds,
    instead of `SEED`, where no entry is there. ``progress``: receives the number of searches that are done.
    """
    if entries and seed is not None:
        raise ConfigError(f"--seed is {seed}, and an entry could compute the markers from it; leave --seed out")
    scores: list[Score] = []
    files: dict[str, str] = {}
    failures: dict[str, str] = {}
    seeds: dict[str, int] = {}
    done = 0
    for world in WORLDS:
        searches = _searches(world.tier, scale)
        place = f"{world.place}-{searches}"
        left = [entry for entry in entries if entry.group not in failures]
        policies = {entry.group: (_as_policy(entry, world.tier),) for entry in left}
        seeds[place] = _seed_of(folder, place, policies) if policies else SEED if seed is None else seed
        studies = {
            group: world.study(group, each, searches=searches, seed=seeds[place])
            for group, each in (*policies.items(), *_groups(world))
        }
        failures |= _run_entries(
            folder, place, {group: studies[group] for group in policies}, world=world, workers=workers
        )
        for group, study in studies.items():
            if group in failures and not (folder / group / place / ROWS).exists():
                continue
            finished = run_study(study, folder / group / place, workers=workers)
            files[str(finished.rows.relative_to(folder))] = _sha256(finished.rows)
            rows = list(read_rows(finished.rows, study))
            scores += [
                _score(world, str(policy), [row for row in rows if row.policy == number])
                for number, policy in enumerate(study.policies)
            ]
            done += study.rows
            if progress is not None:
                progress(done)
    results = BenchmarkResults(
        benchmark=2,
        version=__version__,
        worlds=worlds_hash(),
        seeds=seeds,
        searches={tier: _searches(tier, scale) for tier in _LEVELS},
        scores=scores,
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


def _seed_of(folder: Path, place: str, groups: Collection[str]) -> int:
    """The seed of a world that all of these entries have searched; else one that nobody knows, in an empty place."""
    known = {recorded_seed(folder / group / place) for group in groups}
    if len(known) == 1 and (found := known.pop()) is not None:
        return found
    # What is there is of a seed that an entry may have read.
    for before in folder.glob(f"*/{place}"):
        shutil.rmtree(before)
    return secrets.randbits(62)


def _run_entries(
    folder: Path, place: str, studies: Mapping[str, Study], *, world: World, workers: int | None
) -> dict[str, str]:
    """Let entries search a world, then write their rows; returns the faults of those that failed.

    Nothing of the world is written before, and no argument or variable holds it.
    """
    faults: dict[str, str] = {}
    tables: dict[str, bytes] = {}
    for group, study in studies.items():
        if (before := folder / group / place / FAULT).exists():
            faults[group] = before.read_text(encoding="utf-8")
            continue
        if (folder / group / place / ROWS).exists():
            continue
        # Its first search, before a world full of failures.
        fault = fault_of(study, 0)
        if not fault:
            table = computed_rows(study, workers=workers)
            failed = next((row for row in rows_of(table, study) if row.answer == "failed"), None)
            fault = "" if failed is None else fault_of(study, failed.row) or "it failed once"
            tables[group] = table
        if fault:
            faults[group] = f"{world.tier}, {world.name}: {fault}"
    for group in studies:
        write_rows(studies[group], folder / group / place, tables.get(group))
        if group in faults:
            (folder / group / place / FAULT).write_text(faults[group], encoding="utf-8")
    return faults


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
