"""The class of a foreign driver: found and imported by its name, checked, and its arguments taken from a rig file."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import inspect
import sys
import typing
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from markerseek.core import ConfigError, MarkerseekError, described, is_absent
from markerseek.drivers.entry import Part
from markerseek.files import nearest_key, setting_from

METHODS: dict[Part, tuple[str, ...]] = {
    "stage": ("read", "go", "stop"),
    "laser": ("fire", "fired", "off"),
    "receiver": ("read",),
}
"""Verbs that a class must have."""

GROUP = "markerseek.drivers"
"""Entry points of installed drivers: a name, and ``module:Class``."""


OFFERED = {
    "clock": "all waiting is done on it",
    "travel": "angles at which the probe may be",
    "pulses": "pulses of one acquisition",
    "rate_hz": "pulses per second",
    "sampling_hz": "sampling frequency",
}
"""What a class may ask for by name, besides ``line`` and the keys of its table."""


def installed_drivers() -> dict[str, str]:
    """Names of the drivers that are installed by entry points, each with its ``module:Class``."""
    return {each.name: each.value for each in importlib.metadata.entry_points(group=GROUP)}


def class_of(part: Part, driver: str, *, beside: str) -> type:
    """The class that a rig file names, with the methods of its part.

    ``beside``: folder of the rig file. Raises `ConfigError` where it is not found, fails, or lacks a method.
    """
    name = f'{part}.driver = "{driver}"'
    module_name, _, class_name = installed_drivers().get(driver, driver).partition(":")
    named = class_name.isidentifier() and all(word.isidentifier() for word in module_name.split("."))
    if not named or module_name.endswith(".py"):
        raise ConfigError(
            f'{name}: it must be "module:Class", as in "my_stage:Stage": the name of the file without its folder and '
            ".py, a colon, and that of the class"
        )
    if not beside:
        raise ConfigError(f"{name}: a foreign driver is only imported for a rig file; name the rig file")
    module = _module(module_name, beside if ":" in driver else "", name=name)
    made = getattr(module, class_name, None)
    if not isinstance(made, type):
        there = [
            key
            for key, value in vars(module).items()
            if isinstance(value, type) and value.__module__ == module.__name__ and not key.startswith("_")
        ]
        raise ConfigError(
            f"{name}: {module_name} has no class {class_name}; its classes are: {', '.join(there) or 'none'}"
        )
    missing = [method for method in METHODS[part] if not callable(getattr(made, method, None))]
    if missing:
        raise ConfigError(
            f"{name}: {class_name} has no {' and no '.join(missing)}; a {part} has {', '.join(METHODS[part])} "
            "(docs/how-to/bring-your-own-stage.md)"
        )
    return made


def _module(module_name: str, beside: str, *, name: str) -> Any:
    """The module, imported.

    ``beside``: folder of the rig file; empty: only an installed one is meant. ``name``: for messages.
    """
    file = Path(beside) / f"{module_name}.py"
    if beside and beside not in sys.path:
        # After all that is installed: what lies there replaces no library.
        sys.path.append(beside)
    try:
        is_beside = bool(beside) and file.is_file()
        return _from_file(module_name, str(file)) if is_beside else importlib.import_module(module_name)
    except ModuleNotFoundError as problem:
        if not is_absent(module_name, problem):
            raise ConfigError(f"{name}: importing {module_name} failed: {problem}; install what it needs") from problem
        raise ConfigError(
            f"{name}: there is no file {file}, and no module {module_name} is installed; correct the name, or put the "
            "file beside the rig file"
        ) from problem
    except MarkerseekError:
        raise
    # Code of the user: any error in it is reported under its name, and not as one of this program.
    except (Exception, SystemExit) as problem:
        raise ConfigError(f"{name}: importing {module_name} failed: {described(problem)}; correct it") from problem


@cache
def _from_file(name: str, path: str) -> Any:
    """Module of a file beside the rig file; an installed one of that name does not take its place."""
    # A name of its own: another rig file's module may have the same.
    spec = importlib.util.spec_from_file_location(f"markerseek_rig.{abs(hash(path)):x}.{name}", path)
    assert spec is not None  # noqa: S101  a path that ends with .py has a loader
    assert spec.loader is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[spec.name]
        raise
    return module


def arguments_of(
    made: type, keys: Mapping[str, object], *, offered: Mapping[str, object], part: Part, driver: str
) -> dict[str, object]:
    """Keyword arguments of the class, from the keys of its table and what the rig has for it.

    Raises `ConfigError` if a key is unknown, missing, or of another type.
    """
    try:
        parameters = inspect.signature(made).parameters
    except (ValueError, TypeError) as problem:
        raise ConfigError(
            f'{part}.driver = "{driver}": its arguments are not known ({problem}); derive a class with an __init__'
        ) from problem
    takes_any = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    named = {
        name: each for name, each in parameters.items() if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
    }
    hints = _hints(made)
    given: dict[str, object] = {}
    supervised_port = hasattr(made, "safe_command")
    # Before the keys: without a safe command the class has no port, and its key would be called unknown.
    if "line" in named and "line" in offered and not supervised_port:
        raise ConfigError(
            f'{part}.driver = "{driver}": it asks for a line, and has no safe_command; give the class the '
            "bytes that make the device safe, as in safe_command = b'STOP\\r'"
        )
    for key, value in keys.items():
        if key == "port" and supervised_port and "port" not in named:
            continue
        if key not in named and takes_any and key not in offered:
            given[key] = value
            continue
        nearest_key(key, [name for name in named if name not in offered], prefix=f"{part}.")
        given[key] = setting_from(value, hints[key], name=f"{part}.{key}") if key in hints else value
    for name, parameter in named.items():
        if name in given:
            continue
        if name in offered:
            given[name] = offered[name]
        elif parameter.default is parameter.empty:
            raise ConfigError(f"the key {part}.{name} is missing; add it: {driver} needs it")
    return given


def _hints(made: type) -> dict[str, Any]:
    try:
        return typing.get_type_hints(made.__init__)  # type: ignore[misc]
    # An annotation that only a type checker can resolve says nothing here.
    except Exception:  # noqa: BLE001
        return {}
