"""The short form of the kills: what was acknowledged is readable, and the next run starts."""

from __future__ import annotations

import pytest

from tests.faults.kills import kill


@pytest.mark.parametrize("number", range(6))
def test_a_run_that_is_killed_keeps_what_it_acknowledged_and_goes_on(number: int) -> None:
    kill(number, seed=0)
