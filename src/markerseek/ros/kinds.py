"""Classes of rclpy's messages by name."""

from __future__ import annotations

import array
import importlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np


class Kinds(Mapping[str, Any]):
    """Classes of messages by name, imported when they are asked for; NumPy arrays become those of the message."""

    def __init__(self) -> None:
        self._classes: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        kind = self.kind(name)
        return lambda **fields: kind(**{key: _native(value) for key, value in fields.items()})

    def kind(self, name: str) -> Any:
        """The class itself; `KeyError` if its package is not installed."""
        if name not in self._classes:
            package, folder, member = name.split("/")
            try:
                self._classes[name] = getattr(importlib.import_module(f"{package}.{folder}"), member)
            except (ImportError, AttributeError) as problem:
                raise KeyError(name) from problem
        return self._classes[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._classes)

    def __len__(self) -> int:
        return len(self._classes)


def _native(value: object) -> object:
    # An image as an array of NumPy costs rclpy 100 ms, which takes each pixel for itself; as an array of bytes nothing.
    return array.array(value.dtype.char, value.tobytes()) if isinstance(value, np.ndarray) else value
