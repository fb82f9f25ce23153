"""The shapes and types in the signatures of the pure packages are checked while the tests run (tests/conftest.py)."""

from __future__ import annotations

import importlib

import jaxtyping
import numpy as np
import pytest
from beartype import beartype
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float64

from markerseek.core import Interval
from markerseek.search import weighted_average
from markerseek.search.floor import noise_factor

pytestmark = pytest.mark.long


def test_an_array_of_the_wrong_shape_is_refused():
    with pytest.raises(BeartypeCallHintViolation, match="intensity"):
        weighted_average(np.zeros((2, 3)), np.zeros((2, 4)))
    # What a call has bound ends with it.
    assert weighted_average(np.zeros((2, 4)), np.ones((2, 4))).shape == (2,)


def test_a_result_is_held_against_the_arguments():
    @jaxtyping.jaxtyped(typechecker=beartype)
    def cut(values: Float64[np.ndarray, " samples"], *, by: int) -> Float64[np.ndarray, " samples"]:
        return values[by:]

    assert cut(np.zeros(3), by=0).shape == (3,)
    with pytest.raises(BeartypeCallHintViolation, match="return"):
        cut(np.zeros(3), by=1)


def test_what_is_no_number_is_refused_by_functions_and_values_without_arrays():
    with pytest.raises(BeartypeCallHintViolation, match="cells"):
        noise_factor(cells="many", frames=1)
    with pytest.raises(BeartypeCallHintViolation, match="high_deg"):
        Interval(low_deg=0.0, high_deg="35")


@pytest.mark.parametrize("module", ["core.interval", "search.floor", "signals.filtering", "acoustics.band"])
def test_every_pure_package_is_loaded_by_the_hook(module):
    loader = importlib.import_module(f"markerseek.{module}").__spec__.loader
    assert type(loader).__module__.startswith("jaxtyping")
