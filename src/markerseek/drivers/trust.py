"""Which modules that lie beside a rig file a user trusts: each is named and asked for once, before it is imported.

What is trusted is the text of the module and of all that it imports beside it: a change asks again.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import PathFinder, all_suffixes
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files import data_folder


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignModule:
    """A module that lies beside a rig file."""

    name: str
    files: tuple[Path, ...]
    """Its file, then those of the modules that it imports beside it."""
    digest: str
    """Hash of their names and contents."""

    @property
    def is_trusted(self) -> bool:
        """Whether this user has trusted these contents."""
        try:
            return self.digest in _trusted().read_text(encoding="utf-8").split()
        except (OSError, RecordError):
            return False

    def trust(self) -> None:
        """Remember that the user trusts it; `RecordError` where nothing can be remembered."""
        path = _trusted()
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8") as file:
                file.write(f"{self.digest}\n")
        except OSError as problem:
            raise RecordError(
                f"{path}: what is trusted cannot be remembered ({problem.strerror}); set XDG_DATA_HOME to a folder "
                "that can be written"
            ) from problem


def _trusted() -> Path:
    return data_folder() / "trusted-drivers"


def module_beside(name: str, folder: Path) -> ForeignModule | None:
    """The module of this name that lies in the folder of a rig file; None where an installed one is meant, or none."""
    file, (package, *_) = folder / f"{name}.py", name.split(".")
    # As it is imported: a file beside the rig file goes first, a package there comes after all that is installed.
    if not file.is_file() and (_is_installed(package, folder) or not PathFinder.find_spec(package, [str(folder)])):
        return None
    found: set[Path] = set()
    _find(name.split("."), folder, folder, found)
    files = (file, *sorted(found - {file})) if file.is_file() else tuple(sorted(found))
    digest = hashlib.sha256()
    for each in files:
        digest.update(f"{each.relative_to(folder)}\0{each.stat().st_size}\0".encode() + each.read_bytes())
    return ForeignModule(name=name, files=files, digest=digest.hexdigest())


def _is_installed(package: str, folder: Path) -> bool:
    elsewhere = [each for each in sys.path if Path(each).resolve() != folder.resolve()]
    spec = PathFinder.find_spec(package, elsewhere)
    # One without an origin is a bare folder, which a package of that name replaces wherever it lies.
    return package in sys.stdlib_module_names or (spec is not None and spec.origin is not None)


def _find(words: Sequence[str], base: Path, folder: Path, found: set[Path]) -> None:
    """Add the files of a module whose name begins in ``base``, and those of what it imports from ``folder``."""
    path = base
    for word in words:
        here = [path / f"{word}{suffix}" for suffix in all_suffixes()]
        path /= word
        here += [path / f"__init__{suffix}" for suffix in all_suffixes()]
        for each in here:
            if each.is_file() and each not in found:
                found.add(each)
                if each.suffix == ".py":
                    _find_imports(each, folder, found)


def _find_imports(file: Path, folder: Path, found: set[Path]) -> None:
    try:
        tree = ast.parse(file.read_bytes())
    # Its import will say what is wrong with it.
    except (SyntaxError, ValueError, RecursionError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                _find(alias.name.split("."), folder, folder, found)
        elif isinstance(node, ast.ImportFrom):
            # Dots are relative to the package of the file.
            base = file.parents[min(node.level, len(file.parents)) - 1] if node.level else folder
            words = node.module.split(".") if node.module else []
            for alias in node.names if base.is_relative_to(folder) else []:
                _find([*words, alias.name], base, folder, found)
