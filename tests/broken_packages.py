"""Packages whose import fails."""

from __future__ import annotations

import sys

import pytest


class Broken:
    """Finds a module whose import fails as one does whose library of the system is missing."""

    def __init__(self, name: str, error: Exception) -> None:
        self.name = name
        self.error = error

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == self.name:
            raise self.error


BROKEN = {
    "a library of the system": ImportError("libGL.so.1: cannot open shared object file: No such file or directory"),
    "another package": ModuleNotFoundError("No module named 'libgl_bindings'", name="libgl_bindings"),
    "a module of it": ModuleNotFoundError("No module named 'cv2.cv2'", name="cv2.cv2"),
}


def break_package(patched: pytest.MonkeyPatch, module: str, error: Exception) -> None:
    """Let the import of a module fail, also where it is imported already."""
    for name in [each for each in sys.modules if each.partition(".")[0] == module]:
        patched.delitem(sys.modules, name)
    patched.setattr(sys, "meta_path", [Broken(module, error), *sys.meta_path])
