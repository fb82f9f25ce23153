"""Shapes unchecked where thousands of searches are run."""

from __future__ import annotations

from collections.abc import Iterator

import jaxtyping
import pytest


@pytest.fixture(scope="module")
def unchecked_shapes() -> Iterator[None]:
    """For thousands of searches, half of whose time the checks take; unit tests check the same functions."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
