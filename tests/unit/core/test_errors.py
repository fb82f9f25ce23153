"""Errors cross from one process to another with their words."""

from __future__ import annotations

import pickle

import pytest

from markerseek.core import MarkerseekError, MissingExtraError, errors

KINDS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, MarkerseekError)]


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_arrives_in_another_process_as_it_was(kind):
    """One that cannot be made again there ends the pool, which then blames a lack of memory."""
    words = ("botorch", "botorch", "the method botorch") if kind is MissingExtraError else ("the stage is at 3 deg",)
    error = kind(*words)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (kind, str(error))
    assert words[-1] in str(again)
