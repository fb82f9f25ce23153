"""What the packages log as warnings: a test says what it expects, and anything else fails it."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

_ALL = logging.getLogger("markerseek")


class _Collector(logging.Handler):
    """Keeps the messages."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


class _Refusal(logging.Handler):
    """Fails a test that does not collect what is said."""

    def emit(self, record: logging.LogRecord) -> None:
        if not any(isinstance(each, _Collector) for each in _ALL.handlers):
            raise AssertionError(f"nobody expects the note {record.getMessage()!r}")


@contextmanager
def notes_refused() -> Iterator[None]:
    """Fail on every note outside of the two below, as pytest does on warnings."""
    handler = _Refusal(logging.WARNING)
    _ALL.addHandler(handler)
    try:
        yield
    finally:
        _ALL.removeHandler(handler)


@contextmanager
def notes_collected() -> Iterator[list[str]]:
    """Collect the notes of a block."""
    handler = _Collector()
    _ALL.addHandler(handler)
    try:
        yield handler.said
    finally:
        _ALL.removeHandler(handler)


@contextmanager
def noted(match: str) -> Iterator[list[str]]:
    """Collect the notes of a block, and require one in which the expression is found."""
    with notes_collected() as said:
        try:
            yield said
        finally:
            assert any(re.search(match, each) for each in said), f"{match!r} is in none of {said}"
