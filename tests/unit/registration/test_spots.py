"""The laser spot in images that come late, or that show a light that is not the laser's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import Clock, StereoImages, StereoPair
from markerseek.registration.spots import SpotError, SpotFinder
from tests.unit.registration.test_device_session import Person, room


class LateImages:
    """Image pairs that come later than they were taken."""

    name = "late images"

    def __init__(self, images: StereoImages, clock: Clock, late_s: float) -> None:
        self._images = images
        self._clock = clock
        self._late_s = late_s
        self._coming: list[StereoPair] = []

    def newest(self) -> list[StereoPair]:
        self._coming += [replace(pair, at_s=pair.at_s + self._late_s) for pair in self._images.newest()]
        there = [pair for pair in self._coming if pair.at_s <= self._clock.now_s()]
        self._coming = self._coming[len(there) :]
        return there

    def close(self) -> None:
        self._images.close()


class ChangedImages:
    """Image pairs whose left images are changed."""

    name = "changed images"

    def __init__(self, images: StereoImages, light: np.ndarray) -> None:
        self._images = images
        self._light = light

    def newest(self) -> list[StereoPair]:
        return [
            replace(pair, left=np.clip(pair.left + self._light, 0, 255).astype(np.uint8))
            for pair in self._images.newest()
        ]

    def close(self) -> None:
        self._images.close()


def late(folder: Path, late_s: float) -> Person:
    person, _ = room(folder)
    person.images = LateImages(person.images, person.rig.scanner.clock, late_s)
    return person


@pytest.mark.parametrize("late_s", [0.2, 1.3, 2.7])
def test_the_spot_is_found_in_images_that_come_late_and_their_delay_is_said(tmp_path: Path, late_s: float) -> None:
    person = late(tmp_path, late_s)
    finder = SpotFinder(person)
    # One directly after the other: late images of the second look show the light of the first.
    for place_px in [(560.0, 480.0), (700.0, 560.0)]:
        person.endoscope.light(place_px)
        found = finder.look()
        assert found.spot.left_px == pytest.approx(place_px, abs=1.5)
        assert found.spot.late_s == (None if late_s < 0.5 else pytest.approx(late_s, abs=0.3))
        dark = np.mean([pair.left for pair in found.dark], axis=0)
        x, y = (round(place) for place in place_px)
        assert dark[y, x] < 1.5 * np.median(dark)


def test_images_that_come_too_late_show_no_light_and_the_wait_is_said(tmp_path: Path) -> None:
    person = late(tmp_path, 7.0)
    for _ in range(8):
        person.rig.scanner.clock.wait(1.0)
        person.images.newest()
    with pytest.raises(
        SpotError, match=r"no light is seen in late images while the laser fires and 3\.0 s after that;"
    ):
        SpotFinder(person).look()


def test_a_light_that_is_always_there_is_named_where_the_laser_is_not_seen(tmp_path: Path) -> None:
    person, _ = room(tmp_path)
    width, height = person.endoscope.cameras.left.size_px
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    beam = 120.0 * np.exp(-((columns - 431) ** 2 + (rows - 377) ** 2) / (2 * 5.0**2))
    person.endoscope.images.show(None)
    person.images = ChangedImages(person.images, beam)
    with pytest.raises(
        SpotError,
        match=r"no light is seen in changed images .*; the bright spot at \(431, 377\) px of the left image is lit all "
        "the time: if it is an aiming beam, switch it off",
    ):
        SpotFinder(person).look()


def test_a_light_that_is_always_there_does_not_disturb_a_laser_that_is_seen(tmp_path: Path) -> None:
    person, _ = room(tmp_path)
    width, height = person.endoscope.cameras.left.size_px
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    person.endoscope.light((560.0, 480.0))
    person.images = ChangedImages(person.images, 90.0 * np.exp(-((columns - 431) ** 2 + (rows - 377) ** 2) / 50))
    assert SpotFinder(person).look().spot.left_px == pytest.approx((560.0, 480.0), abs=1.5)
