"""Python of the user: a module that a rig file, a study or a command names as ``module:Class``."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from functools import cache
from pathlib import Path
from types import ModuleType

from markerseek.core import ConfigError, MarkerseekError, described, is_absent


def own_module(module_name: str, folder: str, *, named_by: str, place: str) -> ModuleType:
    """Return a module of the user's own, imported.

    Parameters
    ----------
    module_name
        Its name, without a folder and without ``.py``.
    folder
        Folder in which its file may lie; empty: only an installed module is meant.
    named_by
        What names it, which begins a message.
    place
        Where that folder is, for a message: "beside the rig file".

    Raises
    ------
    ConfigError
        If it is not found, or fails while it is imported.
    """
    file = Path(folder) / f"{module_name}.py"
    if folder and folder not in sys.path:
        # After all that is installed: what lies there replaces no library.
        sys.path.append(folder)
    try:
        is_beside = bool(folder) and file.is_file()
        return _from_file(module_name, str(file)) if is_beside else importlib.import_module(module_name)
    except ModuleNotFoundError as problem:
        if not is_absent(module_name, problem):
            raise ConfigError(
                f"{named_by}: importing {module_name} failed: {problem}; install what it needs"
            ) from problem
        raise ConfigError(
            f"{named_by}: there is no file {file}, and no module {module_name} is installed; correct the name, or put "
            f"the file {place}"
        ) from problem
    except MarkerseekError:
        raise
    # Code of the user: any error in it is reported under its name, and not as one of this program.
    except (Exception, SystemExit) as problem:
        raise ConfigError(f"{named_by}: importing {module_name} failed: {described(problem)}; correct it") from problem


def is_class_name(named: str) -> bool:
    """Return whether a text is ``module:Class``, without a folder and without ``.py``."""
    module_name, _, class_name = named.partition(":")
    is_named = class_name.isidentifier() and all(word.isidentifier() for word in module_name.split("."))
    return is_named and not module_name.endswith(".py")


@cache
def _from_file(name: str, path: str) -> ModuleType:
    """Return the module of a file; an installed one of that name does not take its place."""
    # A name of its own: the module of another folder may have the same.
    spec = importlib.util.spec_from_file_location(f"markerseek_own.{abs(hash(path)):x}.{name}", path)
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


def own_lines(problem: BaseException) -> str:
    """Return the lines of an error's traceback that are the user's, the last one last, each on a line of its own."""
    package = Path(__file__).parents[1]
    return "".join(
        f"\n  {frame.filename}, line {frame.lineno}, in {frame.name}: {frame.line}"
        for frame in traceback.extract_tb(problem.__traceback__)
        if package not in Path(frame.filename).parents and not frame.filename.startswith("<frozen ")
    )
