"""The scene of a simulated registration: the order of its markers where the probe sweeps, and its rig."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from markerseek.cli.register import SceneOptions
from markerseek.core import ConfigError
from markerseek.registration.simulated import MARKER_PLACES, on_alternate_sides


def turned(places: tuple[tuple[int, int], ...]) -> int:
    """How far the probe turns for sweeps to markers at these places, in steps; the range ends at -2 and 2."""
    place, way = 0, 0
    for x, _ in places:
        near = 2 if place > 0 else -2
        way += abs(near - place) + 4 + abs(-near - x)
        place = x
    return way


@pytest.mark.parametrize("number", MARKER_PLACES)
def test_markers_are_taken_on_alternate_sides_which_is_the_shorter_way_for_sweeps(number: int) -> None:
    places = MARKER_PLACES[number]
    order = on_alternate_sides(places)
    assert sorted(order) == sorted(places)
    sides = [x for x, _ in order if x]
    assert sides[0] == 1
    assert all(before == -after for before, after in pairwise(sides))
    assert turned(order) < turned(places)


def test_a_rig_file_gives_stage_and_laser_of_the_scene(tmp_path: Path) -> None:
    file = tmp_path / "fast.toml"
    file.write_text('kind = "simulated"\n[stage]\nspeed_deg_s = 12.5\nacceleration_deg_s2 = 25.0\n')
    scene = SceneOptions(rig=file, sweep=True, readout_s=0.05).scene()
    assert (scene.rig.stage.speed_deg_s, scene.rig.receiver.readout_s, scene.sweep) == (12.5, 0.05, True)
    bench = Path(__file__).parents[3] / "examples" / "rigs" / "bench.toml"
    with pytest.raises(ConfigError, match="its kind is bench; register --journal takes the searches"):
        SceneOptions(rig=bench).scene()
