"""Policy, rig and reader of a journal, put together again; and its result worked out anew from the stored frames."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec

from markerseek.core import ChannelFrame, ConfigError, Finished, Measured, Policy, Reader, RecordError
from markerseek.drivers.settings import BenchSettings
from markerseek.guard import Limits
from markerseek.records.journal import Configuration, Entry, JournalEvent, Recording
from markerseek.rigs.recipe import BenchRecipe, Recipe, ReplayedRecipe
from markerseek.rigs.replay import replayed
from markerseek.rigs.resuming import TOLD
from markerseek.rigs.retelling import Retelling
from markerseek.rigs.rig import Rig
from markerseek.rigs.same_bench import require_same_measurement
from markerseek.rigs.simulation import simulated
from markerseek.scan import run
from markerseek.search import build
from markerseek.signals import ImageReader, IntensityReader, ProbePreset


def recorded_bench(configuration: Configuration) -> BenchSettings | None:
    """Settings of the bench in a journal, to be compared with a rig file; None for any other rig.

    Raises
    ------
    RecordError
        If the journal's rig cannot be read.
    """
    recipe = _recipe(configuration)
    return recipe.settings if isinstance(recipe, BenchRecipe) else None


def rig_again(configuration: Configuration, *, bench_settings: BenchSettings | None = None) -> Rig:
    """The rig of a journal, as it was before the run; of a bench the devices are connected to, and must be closed.

    Parameters
    ----------
    configuration
        The journal's configuration.
    bench_settings
        Settings of a bench from the rig file that a person named; a journal is not asked for them.

    Raises
    ------
    RecordError
        If the rig was not put together from settings, or is not the same any more: its recording was changed.
    ConfigError
        If the journal is of a bench and no settings are given, or settings of another bench; or of no bench.
    """
    recipe = _recipe(configuration)
    if recipe is None:
        raise RecordError("the journal does not say how to put its rig together; resume it from Python, with the rig")
    if isinstance(recipe, BenchRecipe):
        if bench_settings is None:
            raise ConfigError(
                "the journal is of a rig of devices, and a journal does not bring its own rig; name the rig file: "
                "markerseek resume FILE --rig RIG.toml --arm"
            )
        from markerseek.rigs.bench import bench

        require_same_measurement(configuration, recipe.settings, bench_settings)
        return bench(bench_settings)
    if bench_settings is not None:
        raise ConfigError(f"the journal is of a {configuration.rig} rig and describes it in full; leave --rig out")
    if isinstance(recipe, ReplayedRecipe):
        rig = _replayed(recipe)
        # Any other rig is put together from the recipe itself, and so is the same.
        if rig.configuration != configuration.fingerprint:
            raise RecordError(
                f"{recipe.path}: the recording is not what it was when the run began: its fingerprint was "
                f"{configuration.fingerprint} and is {rig.configuration}; begin a new replay"
            )
    else:
        rig = simulated(seed=recipe.seed, settings=recipe.settings, pace=recipe.pace)
    return rig


def reader_again(configuration: Configuration) -> Reader:
    """The imaging chain of a journal's rig; neither devices nor a recording are needed.

    Raises
    ------
    RecordError
        If its settings cannot be read.
    """
    preset = _preset(configuration.imaging)
    return IntensityReader() if preset is None else ImageReader(preset)


def _replayed(recipe: ReplayedRecipe) -> Rig:
    return replayed(Path(recipe.path), probe=recipe.probe, reference_deg=recipe.reference_deg, between=recipe.between)


def _preset(imaging: msgspec.Raw) -> ProbePreset | None:
    try:
        preset: ProbePreset | None = msgspec.json.decode(imaging, type=ProbePreset | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's imaging chain cannot be read: {problem}") from problem
    return preset


def _recipe(configuration: Configuration) -> Recipe | None:
    try:
        recipe: Recipe | None = msgspec.json.decode(configuration.recipe, type=Recipe | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's rig cannot be read: {problem}") from problem
    if recipe is not None and recipe.__struct_config__.tag != configuration.rig:
        raise RecordError(
            f"the journal says that its rig is {configuration.rig} and holds the settings of another kind, "
            f"{recipe.__struct_config__.tag}; it is damaged or foreign"
        )
    return recipe


def policy_again(configuration: Configuration) -> Policy:
    """The policy of a journal, as it was before the run.

    Raises
    ------
    ConfigError
        If there is no such method any more.
    """
    return build(
        configuration.method,
        limits=configuration.search,
        acquisitions=configuration.acquisitions,
        as_published=configuration.as_published,
        start_deg=configuration.start_deg,
    )


def differences(held: Recording, policy: Policy, reader: Reader) -> list[str]:
    """What comes out otherwise, bit for bit, when a run is worked out again from its frames alone.

    Each stored frame is read anew, the policy is told what came out, and its decisions and its answer are compared
    with those of the journal.

    Parameters
    ----------
    held
        The journal.
    policy
        As it was before the run.
    reader
        Imaging chain of the rig.
    """
    told = [entry for entry in held.entries if isinstance(entry.event, TOLD)]
    if not told:
        return []
    found: list[str] = []
    again = [_read_again(entry, reader, found) for entry in told]
    begun_with = held.configuration
    scanner = Retelling(again, limits=Limits(search=begun_with.search, travel=begun_with.search))
    events = run(policy, scanner, dark_frames=begun_with.dark_frames, stay=begun_with.stay)
    with closing(events):
        for entry, event in zip(again, events, strict=False):
            if _timeless(event) != _timeless(entry.event):
                found.append(f"entry {entry.number}: {event} where the journal has {entry.event}")
                break
    return found


def _timeless(event: JournalEvent) -> JournalEvent:
    """The event without how long a run took: frames do not tell."""
    return replace(event, elapsed_s=0.0) if isinstance(event, Finished) else event


def _read_again(entry: Entry, reader: Reader, found: list[str]) -> Entry:
    """The entry with what its frame says now; a difference is added to those found."""
    event = entry.event
    if not isinstance(event, Measured) or event.sample.frame is None:
        return entry
    frame = event.sample.frame
    reading = (reader if isinstance(frame, ChannelFrame) else IntensityReader()).read(frame)
    if reading != event.sample.reading:
        found.append(f"entry {entry.number}: its frame is read as {reading}, the journal has {event.sample.reading}")
    return replace(entry, event=replace(event, sample=replace(event.sample, reading=reading)))


def next_angle(held: Recording, policy: Policy) -> float | None:
    """Angle in degrees at which a run would measure next; None if the policy wants none.

    Parameters
    ----------
    held
        The journal of a run that is not over.
    policy
        As it was before the run; it is told of what was measured.
    """
    for entry in held.entries:
        if isinstance(entry.event, Measured) and entry.event.role != "confirmation":
            policy.tell(entry.event.sample)
    return policy.ask()
