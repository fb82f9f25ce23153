"""The shapes and types in the signatures of the pure packages are checked while the tests run (tests/conftest.py)."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from markerseek.search.average import weighted_average


def test_an_array_of_the_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError, match="intensity"):
        weighted_average(np.zeros((2, 3)), np.zeros((2, 4)))


@pytest.mark.parametrize("module", ["core.interval", "search.floor", "signals.filtering", "acoustics.band"])
def test_every_pure_package_is_loaded_by_the_hook(module):
    loader = importlib.import_module(f"markerseek.{module}").__spec__.loader
    assert type(loader).__module__.startswith("jaxtyping")
