"""Names in natural order."""

from __future__ import annotations

import pytest

from markerseek.files import natural


@pytest.mark.parametrize(
    "names",
    [
        ["frame1", "frame2", "frame10"],
        ["-10.0", "-2.5", "0", "2.25", "2.5", "10.0"],
        ["a_-10", "a_-9", "a_1"],
        ["img-2.5", "img-10"],
        ["2024-05-03 scan 2 of 11", "2024-05-03 scan 11 of 11"],
        ["Frame_099", "frame_100", "Frame_1000"],
        ["1.2.840.9.1", "1.2.840.10.1"],
        ["", "7", "007a", "7b", "x"],
        ["detection_element_9", "detection_element_10", "detection_element_0127"],
        ["n" + "8" * 5000, "n" + "9" * 5000],
    ],
    ids=lambda names: names[0][:12],
)
def test_numbers_in_names_count_as_numbers(names: list[str]) -> None:
    assert sorted(sorted(names, reverse=True), key=natural) == names
