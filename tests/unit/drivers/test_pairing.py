"""Which images are a pair: against the pairs that are chosen once all images are there."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from markerseek.drivers._pair_source import WAIT_S, CameraImage, Key, Pairing


def image(number: int, time_s: float, now_s: float, key: Key | None = None) -> CameraImage:
    return CameraImage(np.full((1, 1), number, np.uint8), time_s=time_s, at_s=now_s, since_s=now_s, key=key)


def chosen_at_the_end(lefts_s: list[float], rights_s: list[float], near_s: float) -> set[tuple[int, int]]:
    """The two that are nearest to one another, then the nearest of what is left, and so on."""
    off_s = np.abs(np.subtract.outer(lefts_s, rights_s))
    pairs = set()
    while off_s.size and off_s.min() <= near_s:
        left, right = (int(index) for index in np.unravel_index(np.argmin(off_s), off_s.shape))
        pairs.add((left, right))
        off_s[left, :] = off_s[:, right] = np.inf
    return pairs


@given(st.integers(0, 2**31), st.floats(0.0, 0.3), st.floats(0.0, 0.02))
@example(420, 0.28125, 0.0)
def test_pairs_are_those_that_are_chosen_once_all_images_are_there(seed: int, lost: float, jitter_s: float) -> None:
    rng = np.random.default_rng(seed)
    times_s = [
        [k / 30 + offset_s + jitter_s * rng.uniform(-0.5, 0.5) for k in range(40) if rng.random() > lost]
        for offset_s in (0.0, rng.uniform(-0.03, 0.03))
    ]
    # One camera is behind: its images come later than those of the other.
    behind_s = rng.uniform(0, 0.4, 2)
    come = sorted(
        (time_s + behind_s[side] + 0.5, side, number, time_s)
        for side in (0, 1)
        for number, time_s in enumerate(times_s[side])
    )
    pairing = Pairing(near_s=0.05)
    found = []
    for now_s, side, number, time_s in come:
        pairing.add(side, image(number, time_s, now_s))
        found += pairing.pairs(now_s)
    # A pair may become certain by another one: the next look finds it, as a source looks again and again.
    for later_s in np.linspace(0.0, 0.9 * WAIT_S, 10):
        found += pairing.pairs(come[-1][0] + later_s if come else 0.0)
    numbers = [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in found]
    assert set(numbers) == chosen_at_the_end(*times_s, 0.05)
    assert len(set(numbers)) == len(numbers)


def test_names_count_before_times_and_only_within_a_second() -> None:
    pairing = Pairing(near_s=0.05, named_s=1.0)
    for number, (side, time_s, key) in enumerate(
        [(0, 0.0, (7,)), (1, 0.01, (8,)), (1, 0.4, (7,)), (0, 5.0, (9,)), (1, 6.5, (9,)), (1, 5.01, (3,))]
    ):
        pairing.add(side, image(number, time_s, 0.0, key))
    named = pairing.pairs(0.1)
    assert [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in named] == [(0, 2)]
    by_time = pairing.pairs(1.5)
    assert [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in by_time] == [(3, 5)]
    assert pairing.pairs(3.0) == []
    assert pairing.dropped == [0, 2]


def test_a_nearer_image_that_came_after_its_partner_is_awaited() -> None:
    pairing = Pairing(near_s=0.05, named_s=1.0)
    for side, number, time_s, now_s in [(0, 26, 0.0, 0.0), (1, 27, 0.041, 0.05), (0, 27, 0.04, 0.09)]:
        pairing.add(side, image(number, time_s, now_s, (1000 * side + number,)))
    found = [pair for now_s in (0.1, 1.06, 1.1, 1.2) for pair in pairing.pairs(now_s)]
    assert [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in found] == [(27, 27)]


def test_an_image_whose_namesake_was_left_out_is_part_of_no_pair() -> None:
    pairing = Pairing(near_s=0.05, named_s=1.0)
    # Of each pair one image is read, and the other was there.
    for side, number, time_s in [(0, 79, 0.04), (1, 78, 0.0)]:
        pairing.announce(1 - side, (number,), time_s)
        pairing.add(side, image(number, time_s, 0.1, (number,)))
    assert [pair for now_s in (0.2, 1.2, 1.5) for pair in pairing.pairs(now_s)] == []
    # A namesake of long ago is another image.
    pairing.announce(1, (90,), 5.0)
    for side, number, time_s in [(0, 90, 10.0), (1, 95, 10.01)]:
        pairing.add(side, image(number, time_s, 10.0, (number,)))
    found = [pair for now_s in (10.2, 11.2) for pair in pairing.pairs(now_s)]
    assert [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in found] == [(90, 95)]
