"""Messages of the packages as a person reads them who writes no Python."""

from __future__ import annotations

import pytest

from markerseek.core import plain

CASES = {
    "an argument": ("leave `first_frame` out", "leave first frame out"),
    "with a value": ("`first_and_step_deg=(-35, 0.5)` or none", "first and step deg (-35, 0.5) or none"),
    "a function": ("see `read_bank('a, b.mat')`", "see read_bank('a, b.mat')"),
    "neither": ("the key `[probe]`, and `A`", "the key `[probe]`, and `A`"),
}


@pytest.mark.parametrize(("message", "shown"), CASES.values(), ids=CASES.keys())
def test_a_message_is_plain(message: str, shown: str) -> None:
    assert plain(message) == shown


def test_an_argument_has_the_label_of_who_shows_it() -> None:
    assert plain("leave `sweep` out, or `mm=3`", label=str.upper) == ("leave SWEEP out, or MM 3")
