"""Makes the rig of a run again from the recipe in its record; that of devices must be the one of a rig file."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.drivers import BenchSettings
from markerseek.files import recorded_settings
from markerseek.records.journal import Configuration, RecordedRun
from markerseek.rigs import BenchRecipe, Recipe, Rig, SimulatedRecipe, bench, bench_fingerprint, simulated


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
            f"{bench_fingerprint(named)}, was {was}); name the rig file that the search was begun with, "
            "or begin a new search"
        )
    return list(found.values())


def _by_key(table: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Return the nested settings as a flat table with dotted keys."""
    flat: dict[str, object] = {}
    for name, value in table.items():
        flat |= _by_key(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
