"""Makes policy, rig and imaging chain of a run from the configuration in its record, and its answer again."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import msgspec
from msgspec.structs import replace

from markerseek.core import AnyPolicy, ConfigError, Estimate, Measured, Reader, ReadingFrame, RecordError
from markerseek.drivers import BenchSettings
from markerseek.files import recorded_settings
from markerseek.records.journal import Configuration, JournalEntry, RecordedRun, RunView, since_started
from markerseek.rigs import (
    BenchRecipe,
    Recipe,
    Rig,
    SimulatedRecipe,
    fingerprint,
    simulated,
)
from markerseek.runs.journalled import is_scan
from markerseek.runs.resume import tell_recorded
from markerseek.scan import apply_confirmation
from markerseek.search import build_sweeping
from markerseek.signals import ImageReader, IntensityReader, ProbePreset


def recorded_bench(configuration: Configuration) -> BenchSettings | None:
    """Return the bench settings in a journal, for comparison with a rig file; None for any other rig."""
    recipe = _recipe(configuration)
    return recipe.settings if isinstance(recipe, BenchRecipe) else None


def rebuild_rig(recorded: RecordedRun, *, bench_settings: BenchSettings | None = None) -> Rig:
    """Return the rig of a record; a bench is connected, and must be closed.

    ``bench_settings``: bench settings from the user's rig file; those of the journal are never used.
    """
    configuration = recorded.configuration
    recipe = _recipe(configuration)
    if recipe is None:
        raise RecordError("the journal does not say how to put its rig together; resume it from Python, with the rig")
    if isinstance(recipe, BenchRecipe):
        if bench_settings is None:
            raise ConfigError(f"{recorded.path}: it is of a rig of devices, which is not taken from a journal; name it")
        from markerseek.rigs import bench

        # Before the devices are connected, which would already start a supervisor.
        require_same_measurement(configuration, recipe.settings, bench_settings)
        return _require_as_emulated(bench(bench_settings), configuration)
    if isinstance(recipe, SimulatedRecipe):
        return simulated(
            seed=recipe.seed, settings=recipe.settings, pace=recipe.pace, resumed_after=len(recorded.entries)
        )
    raise RecordError(f"{recorded.path}: it is of a recorded scan, which takes seconds: replay {recipe.path} again")


def _require_as_emulated(rig: Rig, configuration: Configuration) -> Rig:
    """Return the connected rig, unless emulated devices have replaced the journal's real ones, or the reverse."""
    was = configuration.facts.emulated
    now = rig.facts.emulated
    if was == now:
        return rig
    rig.close()
    raise ConfigError(
        f"the emulated devices of the journal are: {', '.join(was) or 'none'}; those of the rig file are: "
        f"{', '.join(now) or 'none'}; name the rig that the search was begun on, or begin a new search"
    )


def rebuild_reader(configuration: Configuration) -> Reader:
    """Return the reader of a journal's rig, without its devices or recording."""
    return _reader(bytes(configuration.imaging))


def rebuild_image_reader(configuration: Configuration) -> ImageReader | None:
    """Return the reader of a journal's rig where it makes photoacoustic images; None if it makes none."""
    reader = rebuild_reader(configuration)
    return reader if isinstance(reader, ImageReader) else None


@lru_cache(maxsize=2)
def _reader(imaging: bytes) -> ImageReader | IntensityReader:
    """Return the imaging chain; cached, because its tables take a quarter of a second."""
    try:
        preset = recorded_settings(imaging, ProbePreset | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's imaging chain cannot be read: {problem}") from problem
    return IntensityReader() if preset is None else ImageReader(preset)


def _recipe(configuration: Configuration) -> Recipe | None:
    try:
        recipe: Recipe | None = recorded_settings(bytes(configuration.recipe), Recipe | None)
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
    """Return the policy of a journal in its state before the run."""
    if is_scan(configuration):
        raise RecordError(
            "the journal is of a scan, not of a search; go on with it: `scan_bank(BANK)`, or make a "
            "bank of it: `journal_bank(JOURNAL, BANK)`"
        )
    return build_sweeping(configuration.plan, limits=configuration.facts.search)


def answer_again(recorded: RecordedRun, *, read_frames: bool) -> Estimate:
    """Return the answer of a run, computed again from its recorded samples.

    ``read_frames``: whether samples whose frame was kept are read from it again.
    """
    policy = rebuild_policy(recorded.configuration)
    entries = since_started(recorded.entries)
    if read_frames:
        reader = rebuild_reader(recorded.configuration)
        entries = tuple(_read_again(entry, reader) for entry in entries)
    tell_recorded(policy, entries)
    estimate = policy.estimate()
    view = RunView.of(recorded.configuration)
    for entry in entries:
        view = view.add_entry(entry)
    return estimate if view.confirmation is None else apply_confirmation(estimate, view.confirmation, view.samples)


def _read_again(entry: JournalEntry, reader: Reader) -> JournalEntry:
    event = entry.event
    if not isinstance(event, Measured) or (frame := event.sample.frame) is None:
        return entry
    reading = (IntensityReader() if isinstance(frame, ReadingFrame) else reader).read(frame)
    return replace(entry, event=replace(event, sample=replace(event.sample, reading=reading)))


def differences_of_benches(recorded: BenchSettings, named: BenchSettings) -> dict[str, str]:
    """Return the settings in the user's rig file that differ from those in the journal: a description by dotted key."""
    was = _by_key(recorded.table())
    now = _by_key(named.table())
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
    """Return the nested settings as a flat table with dotted keys."""
    flat: dict[str, object] = {}
    for name, value in table.items():
        flat |= _by_key(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
