"""Notes: sentences on what was assumed, changed or left out when a file was read, which its user must know.

A note is logged as a warning under the name of this package, so that it is printed where nobody has set up Python's
`logging`, and it becomes a field of what is read, such as ``notes`` of a bank. It is no Python warning, because
PYTHONWARNINGS would hide it, or make an error of it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

_LOG = logging.getLogger(__package__)

_NOTED: ContextVar[list[str] | None] = ContextVar("noted", default=None)


def note(path: Path, message: str) -> None:
    """Note what was assumed, changed or left out when a file was read."""
    text = f"{path}: {message}"
    _LOG.warning("%s", text)
    noted = _NOTED.get()
    if noted is not None and text not in noted:
        noted.append(text)


@contextmanager
def noting() -> Iterator[list[str]]:
    """Collect the notes of a block, each once."""
    noted: list[str] = []
    token = _NOTED.set(noted)
    try:
        yield noted
    finally:
        _NOTED.reset(token)
