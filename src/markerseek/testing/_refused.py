"""Expects a refusal. Not pytest.raises: the contracts are part of the package, and pytest is not one of its needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def refused(error: type[Exception], otherwise: str) -> Iterator[None]:
    """Fail with a sentence unless the block raises that error."""
    try:
        yield
    except error:
        return
    raise AssertionError(otherwise)
