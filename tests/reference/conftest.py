"""Helpers that several folders of tests share are beside the unit tests, imported by name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))


@pytest.fixture(scope="module")
def unchecked_shapes() -> Iterator[None]:
    """For thousands of searches, half of whose time the checks take; unit tests check the same functions."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
