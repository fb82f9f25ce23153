"""Rebuilds policy, rig and imaging chain of a run from the configuration in its journal, and computes it again."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import msgspec

from markerseek.core import (
    MAX_ACQUISITIONS,
    AnyPolicy,
    ConfigError,
    ConfirmablePolicy,
    Finished,
    Measured,
    Reader,
    ReadingFrame,
    RecordError,
    Sweep,
    SweepingPolicy,
    Swept,
)
from markerseek.drivers import BenchSettings
from markerseek.guard import Limits
from markerseek.records.journal import Configuration, Entry, JournalEvent, RecordedRun
from markerseek.rigs import (
    BenchRecipe,
    ReaderRecipe,
    Recipe,
    Rig,
    SimulatedRecipe,
    SpareRecipe,
    TipRecipe,
    fingerprint,
    replayed,
    simulated,
)
from markerseek.runs.journalled import Beliefs, is_scan, limits_of
from markerseek.runs.recorded_scanner import RecordedScanner
from markerseek.runs.resume import RUN_EVENTS
from markerseek.scan import run
from markerseek.search import build_sweeping
from markerseek.signals import AnyImageReader, ImageReader, IntensityReader, ProbePreset, SpareReader
from markerseek.vision import TipReader


def recorded_bench(configuration: Configuration) -> BenchSettings | None:
    """Bench settings in a journal, for comparison with a rig file; None for any other rig."""
    recipe = _recipe(configuration)
    return recipe.settings if isinstance(recipe, BenchRecipe) else None


def rebuild_rig(configuration: Configuration, *, bench_settings: BenchSettings | None = None) -> Rig:
    """The rig of a journal in its state before the run; a bench is connected, and must be closed.

    ``bench_settings``: bench settings from the user's rig file; those of the journal are never used.
    """
    recipe = _recipe(configuration)
    if recipe is None:
        raise RecordError("the journal does not say how to put its rig together; resume it from Python, with the rig")
    if isinstance(recipe, BenchRecipe):
        if bench_settings is None:
            raise ConfigError(
                "the journal is of a rig of devices, which is not taken from a journal; name the rig file: "
                "markerseek resume FILE --rig RIG.toml --arm"
            )
        from markerseek.rigs import bench

        # Before the devices are connected, which would already start a supervisor.
        require_same_measurement(configuration, recipe.settings, bench_settings)
        return _require_as_emulated(bench(bench_settings), configuration)
    if bench_settings is not None:
        raise ConfigError(
            f"the journal is of a {configuration.facts.kind} rig and describes it in full; leave --rig out"
        )
    if isinstance(recipe, SimulatedRecipe):
        rig = simulated(seed=recipe.seed, settings=recipe.settings, pace=recipe.pace)
    else:
        rig = replayed(
            Path(recipe.path),
            probe=recipe.probe,
            reference_deg=recipe.reference_deg,
            between=recipe.between,
            table=recipe.table,
        )
        # A simulated rig depends on the recipe alone; a recording is a file that can change.
        if rig.facts.fingerprint != configuration.facts.fingerprint:
            raise RecordError(
                f"{recipe.path}: the recording has changed since the run began: its fingerprint was "
                f"{configuration.facts.fingerprint} and is {rig.facts.fingerprint}; begin a new replay"
            )
    return rig


def _require_as_emulated(rig: Rig, configuration: Configuration) -> Rig:
    """The connected rig, unless emulated devices have replaced the journal's real ones, or the reverse."""
    was, now = configuration.facts.emulated, rig.facts.emulated
    if was == now:
        return rig
    rig.close()
    raise ConfigError(
        f"the emulated devices of the journal are: {', '.join(was) or 'none'}; those of the rig file are: "
        f"{', '.join(now) or 'none'}; name the rig that the search was begun on, or begin a new search"
    )


def rebuild_reader(configuration: Configuration) -> Reader:
    """The reader of a journal's rig, without its devices or recording."""
    return _reader(bytes(configuration.imaging))


def rebuild_image_reader(configuration: Configuration) -> AnyImageReader | None:
    """The reader of a journal's rig where it makes photoacoustic images; None where it makes none."""
    return _image_reader(bytes(configuration.imaging))


@lru_cache(maxsize=2)
def _image_reader(imaging: bytes) -> AnyImageReader | None:
    """Cached, because its tables take a quarter of a second."""
    reader = _reader(imaging)
    return reader if isinstance(reader, ImageReader | SpareReader) else None


def _reader(imaging: bytes) -> Reader:
    recipe = _reader_recipe(imaging)
    match recipe:
        case SpareRecipe():
            return SpareReader(recipe.preset, receive_focus_m=recipe.receive_focus_m)
        case TipRecipe():
            return TipReader(recipe.settings)
        case None:
            return IntensityReader()
    return ImageReader(recipe)


def _reader_recipe(imaging: bytes) -> ReaderRecipe:
    try:
        values = msgspec.json.decode(imaging)
        # msgspec distinguishes structs by their tag, and a preset, which is no struct, has none.
        named = isinstance(values, dict) and "reader" in values
        recipe: ReaderRecipe = msgspec.convert(values, SpareRecipe | TipRecipe if named else ProbePreset | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's imaging chain cannot be read: {problem}") from problem
    return recipe


def _recipe(configuration: Configuration) -> Recipe | None:
    try:
        recipe: Recipe | None = msgspec.json.decode(configuration.recipe, type=Recipe | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's rig cannot be read: {problem}") from problem
    # The kind decides whether a person is asked to arm: it must be that of the settings.
    if recipe is not None and recipe.__struct_config__.tag != configuration.facts.kind:
        raise RecordError(
            f"the journal says that its rig is {configuration.facts.kind} and holds the settings of another kind, "
            f"{recipe.__struct_config__.tag}; it is damaged or foreign"
        )
    return recipe


def rebuild_policy(configuration: Configuration) -> AnyPolicy:
    """The policy of a journal in its state before the run."""
    if is_scan(configuration) and configuration.plan.acquisitions is None:
        raise RecordError(
            f"the journal is of a scan of more than {MAX_ACQUISITIONS} angles, the most that can be resumed or "
            "computed again; make a bank of it: 'markerseek bank import JOURNAL NEW.hdf5'"
        )
    return build_sweeping(configuration.plan, limits=configuration.facts.search)


def next_angle(recorded: RecordedRun, policy: AnyPolicy) -> float | None:
    """Next angle of a run in degrees, of a sweep its end; None if the policy needs no more.

    ``policy``: the policy in its state before the run; it is fed the recorded samples.
    """
    for entry in recorded.entries:
        match entry.event:
            case Measured(role="confirmation", sample=sample):
                if isinstance(policy, ConfirmablePolicy):
                    policy.confirm(sample)
            case Measured(sample=sample):
                policy.tell(sample)
            case Swept() if isinstance(policy, SweepingPolicy):
                policy.end_sweep()
    asked = policy.ask()
    return asked.to_deg if isinstance(asked, Sweep) else asked


def differences_of_benches(recorded: BenchSettings, named: BenchSettings) -> dict[str, str]:
    """Settings in the user's rig file that differ from those in the journal: a description by dotted key."""
    was, now = _by_key(recorded.table()), _by_key(named.table())
    keys = sorted(was.keys() | now.keys())
    return {key: f"{key} is {now.get(key)}, was {was.get(key)}" for key in keys if was.get(key) != now.get(key)}


def require_same_measurement(configuration: Configuration, recorded: BenchSettings, named: BenchSettings) -> list[str]:
    """Refuse a rig file whose acquisitions are not comparable with the journal's; return all other differences.

    ``named``: settings in the user's rig file. Returns differences that do not change what is measured, such as ports,
    travel limits and budgets.
    """
    found = differences_of_benches(recorded, named)
    # A port may change from day to day: it says where a device is plugged in, and not what it measures.
    refused = [text for key, text in found.items() if key.startswith(named.comparable) and not key.endswith(".port")]
    # The journal states the range twice, in the recipe and in the facts; both must be that of the file.
    if not refused and configuration.facts.search != named.limits.search:
        refused = [f"limits.search is {named.limits.search}, the journal searches {configuration.facts.search}"]
    if refused:
        was = configuration.facts.fingerprint
        raise ConfigError(
            f"the rig file does not describe the rig of the journal: {'; '.join(refused)} (fingerprint "
            f"{fingerprint(named)}, was {was}); name the rig file that the search was begun with, "
            "or begin a new search"
        )
    return list(found.values())


def _by_key(table: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Nested settings as a flat table with dotted keys."""
    flat: dict[str, object] = {}
    for name, value in table.items():
        flat |= _by_key(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


def recompute_differences(recorded: RecordedRun, policy: AnyPolicy, reader: Reader) -> list[str]:
    """Differences, bit for bit, between a run recomputed from its frames and its journal; empty if there are none.

    Each stored frame is read again, the policy, in its state before the run, receives the readings, and its decisions
    and its answer are compared with those of the journal.
    """
    found: list[str] = []
    again = [_read_again(entry, reader, found) for entry in recorded.entries if isinstance(entry.event, RUN_EVENTS)]
    if not again:
        return []
    search = recorded.configuration.facts.search
    # A journal does not hold the limits of travel; nothing moves here.
    scanner = RecordedScanner(again, limits=Limits(search=search, travel=search))
    plan = recorded.configuration.plan
    events = run(policy, scanner, plan, limits=limits_of(recorded.configuration))
    beliefs = Beliefs(policy, plan)
    with closing(events):
        # Not strict: the journal of an interrupted run ends before the run does.
        for entry, event in zip(again, map(beliefs.added, events), strict=False):
            if _timeless(event) != _timeless(entry.event):
                found.append(f"entry {entry.number}: {event} where the journal has {entry.event}")
                # Later decisions depend on this one, so that their differences would say nothing new.
                break
    return found


def _timeless(event: JournalEvent) -> JournalEvent:
    """The event without the duration of the run, which cannot be recomputed from frames."""
    return replace(event, elapsed_s=0.0) if isinstance(event, Finished) else event


def _read_again(entry: Entry, reader: Reader, found: list[str]) -> Entry:
    """The entry with its reading recomputed; appends a difference to `found`."""
    event = entry.event
    if not isinstance(event, Measured) or event.sample.frame is None:
        return entry
    frame = event.sample.frame
    reading = (IntensityReader() if isinstance(frame, ReadingFrame) else reader).read(frame)
    if reading != event.sample.reading:
        found.append(f"entry {entry.number}: its frame is read as {reading}, the journal has {event.sample.reading}")
    return replace(entry, event=replace(event, sample=replace(event.sample, reading=reading)))
