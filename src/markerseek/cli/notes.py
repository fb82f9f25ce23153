"""Prints what the packages log as warnings, and keeps it for the result of a command."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from markerseek.cli.in_options import in_options
from markerseek.cli.terminal import print_warning

_ALL = logging.getLogger("markerseek")

_said: list[str] = []


class _Terminal(logging.Handler):
    """Prints each sentence once: a command may read a file twice."""

    def emit(self, record: logging.LogRecord) -> None:
        message = in_options(record.getMessage())
        if message not in _said:
            _said.append(message)
            print_warning(message)


@contextmanager
def notes_printed() -> Iterator[None]:
    """Print what is logged as a warning on standard error, until the end of the block.

    A trace (`markerseek.drivers.trace`) is another handler, and gets these lines too.
    """
    _said.clear()
    handler = _Terminal(logging.WARNING)
    _ALL.addHandler(handler)
    try:
        yield
    finally:
        _ALL.removeHandler(handler)


def notes_said() -> tuple[str, ...]:
    """Return what the command has said so far."""
    return tuple(_said)
