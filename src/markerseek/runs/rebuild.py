"""Policy, rig and imaging chain of a journal, rebuilt from its configuration."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import ConfigError, Measured, Policy, Reader, RecordError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import Configuration, RecordedRun
from markerseek.rigs import BenchRecipe, Recipe, ReplayedRecipe, Rig, SimulatedRecipe, replayed, simulated
from markerseek.runs.same_bench import require_same_measurement
from markerseek.search import policy_for
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


def rebuild_rig(configuration: Configuration, *, bench_settings: BenchSettings | None = None) -> Rig:
    """The rig of a journal, as it was before the run; devices of a bench are connected, and must be closed.

    Parameters
    ----------
    configuration
        The journal's configuration.
    bench_settings
        Settings of a bench from the rig file that a person named; those of the journal are not used.

    Raises
    ------
    RecordError
        If the rig was not made from settings, or its recording was changed since.
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
        from markerseek.rigs import bench

        require_same_measurement(configuration, recipe.settings, bench_settings)
        return bench(bench_settings)
    if bench_settings is not None:
        raise ConfigError(
            f"the journal is of a {configuration.facts.kind} rig and describes it in full; leave --rig out"
        )
    if isinstance(recipe, SimulatedRecipe):
        rig = simulated(seed=recipe.seed, settings=recipe.settings, pace=recipe.pace)
    else:
        rig = _replayed(recipe)
        # A simulated rig is made from the recipe alone; a recording can change beside it.
        if rig.facts.fingerprint != configuration.facts.fingerprint:
            raise RecordError(
                f"{recipe.path}: the recording is not what it was when the run began: its fingerprint was "
                f"{configuration.facts.fingerprint} and is {rig.facts.fingerprint}; begin a new replay"
            )
    return rig


def rebuild_reader(configuration: Configuration) -> Reader:
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
    if recipe is not None and recipe.__struct_config__.tag != configuration.facts.kind:
        raise RecordError(
            f"the journal says that its rig is {configuration.facts.kind} and holds the settings of another kind, "
            f"{recipe.__struct_config__.tag}; it is damaged or foreign"
        )
    return recipe


def rebuild_policy(configuration: Configuration) -> Policy:
    """The policy of a journal, as it was before the run.

    Raises
    ------
    ConfigError
        If there is no such method any more.
    """
    return policy_for(configuration.plan, limits=configuration.facts.search)


def next_angle(held: RecordedRun, policy: Policy) -> float | None:
    """Angle in degrees at which a run would measure next; None if the policy wants none.

    Parameters
    ----------
    held
        The journal of a run that is not over.
    policy
        As it was before the run; it receives what was measured.
    """
    for entry in held.entries:
        if isinstance(entry.event, Measured) and entry.event.role != "confirmation":
            policy.tell(entry.event.sample)
    return policy.ask()
