"""What advances evenly and is seen at uncertain moments: its rate and its times are bounded, and a jump is noticed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.drivers._even import Even

SEEDS = st.integers(0, 2**32 - 1)


def seen(
    seed: int, *, rate: float, jump: float = 0.0, width_s: float = 0.01
) -> list[tuple[float, float, float, float]]:
    """Values, earliest and latest moments, and true ones, of something that jumps after 30 of 60."""
    rng = np.random.Generator(np.random.PCG64(seed))
    made = []
    for number in range(60):
        true_s = 0.05 * number + float(rng.uniform(0.0, 0.01))
        before_s, after_s = rng.uniform(0.0, width_s, 2).tolist()
        value = true_s / rate + (jump if number >= 30 else 0.0)
        made.append((value, true_s - before_s, true_s + after_s, true_s))
    return made


@given(SEEDS, st.floats(0.05, 20.0))
def test_what_advances_evenly_never_jumps_and_its_times_are_within_their_bounds(seed: int, rate: float) -> None:
    even = Even()
    for value, earliest_s, latest_s, true_s in seen(seed, rate=rate):
        assert even.jump_s(value, earliest_s=earliest_s, latest_s=latest_s) <= 1e-9
        even.add(value, earliest_s=earliest_s, latest_s=latest_s)
        low_s, high_s = even.bounds_s(value, slowest=even.slowest, fastest=even.fastest)
        assert low_s - 1e-9 <= true_s <= high_s + 1e-9
    assert even.slowest <= rate * (1 + 1e-9)
    assert even.fastest >= rate * (1 - 1e-9)
    assert even.fastest - even.slowest < 0.02 * rate


@pytest.mark.parametrize("jump_s", [-0.2, -0.06, 0.06, 0.3])
@given(SEEDS)
def test_a_jump_beyond_the_uncertainty_is_noticed_and_never_overstated(jump_s: float, seed: int) -> None:
    rate = 0.04
    even = Even()
    noticed = []
    for value, earliest_s, latest_s, _ in seen(seed, rate=rate, jump=jump_s / rate):
        by_s = even.jump_s(value, earliest_s=earliest_s, latest_s=latest_s)
        if by_s > 0:
            noticed.append(by_s)
            break
        even.add(value, earliest_s=earliest_s, latest_s=latest_s)
    assert noticed
    assert noticed[0] <= abs(jump_s) + 1e-9
