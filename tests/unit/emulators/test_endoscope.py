"""What a person types to move the spot of an emulated endoscope."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from markerseek.emulators import EmulatedEndoscope
from markerseek.rigs import draw_scene
from markerseek.sim import SimulatedSettings, VirtualClock
from markerseek.vision import decoded_image


@pytest.fixture(scope="module")
def endoscope(tmp_path_factory: pytest.TempPathFactory) -> EmulatedEndoscope:
    settings = SimulatedSettings()
    rng = np.random.default_rng(1)
    world = draw_scene(settings, rng).world(settings, rng)
    folder = tmp_path_factory.mktemp("bench")
    return EmulatedEndoscope(world=world, settings=settings, folder=folder, clock=VirtualClock(), rng=rng)


@pytest.mark.parametrize("line", ["640 512\n", "640, 512", "640,512\n", "(640, 512)"])
def test_a_place_is_two_numbers(endoscope: EmulatedEndoscope, line: str) -> None:
    assert endoscope.type(line) == "the spot is at (640, 512) px of the left image"


@pytest.mark.parametrize("line", ["\n", "640", "640 512 3", "left", "640;512"])
def test_what_is_no_place_is_said(endoscope: EmulatedEndoscope, line: str) -> None:
    assert "a place is two numbers, in pixels of the left image" in endoscope.type(line)


@pytest.mark.parametrize("line", ["5000 5000", "-3 10", "nan 5", "1e400 2"])
def test_a_place_outside_of_the_image_moves_nothing(endoscope: EmulatedEndoscope, line: str) -> None:
    before = endoscope.images._spot_m
    assert "outside the image of 1280 x 1024; the spot stays where it is" in endoscope.type(line)
    assert endoscope.images._spot_m is before


def test_an_image_of_each_camera_is_written_ten_times_a_second(tmp_path: Path) -> None:
    settings = SimulatedSettings()
    rng = np.random.default_rng(1)
    clock = VirtualClock()
    world = draw_scene(settings, rng).world(settings, rng)
    emulated = EmulatedEndoscope(world=world, settings=settings, folder=tmp_path, clock=clock, rng=rng)
    for _ in range(10):
        clock.wait(0.05)
        emulated.advance()
    for folder in emulated.folders:
        assert sorted(path.name for path in folder.iterdir()) == [f"0{number}.pgm" for number in range(5)]
        image = decoded_image((folder / "00.pgm").read_bytes())
        assert image is not None
        assert image.shape == (1024, 1280)
