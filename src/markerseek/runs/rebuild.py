"""Rebuilds policy, rig and imaging chain of a run from the configuration in its journal."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import msgspec

from markerseek.core import (
    AnyPolicy,
    ConfigError,
    ConfirmablePolicy,
    Measured,
    Reader,
    RecordError,
    Sweep,
    SweepingPolicy,
    Swept,
)
from markerseek.drivers import BenchSettings
from markerseek.records.journal import Configuration, RecordedRun
from markerseek.rigs import (
    BenchRecipe,
    ReaderRecipe,
    Recipe,
    Rig,
    SimulatedRecipe,
    SpareRecipe,
    TipRecipe,
    replayed,
    simulated,
)
from markerseek.runs.same_bench import require_same_measurement
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
