"""The marker's angle in simulated materials is that of the centroid of the absorbed energy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.acoustics import Absorber, GaussianAbsorber, centroid_m
from markerseek.core import ConfigError
from markerseek.rigs import draw_scene, simulated
from markerseek.sim import TISSUES, MarkerSettings, SimulatedSettings, tissue_named


def angle_deg(point_m: tuple[float, float, float]) -> float:
    return math.degrees(math.atan2(point_m[0], point_m[2]))


def test_the_centroid_of_two_absorbers_lies_between_them_by_their_strengths() -> None:
    """Closed form: on the chord of the two, which is nearer to the axis than either."""
    pair = [
        Absorber(radius_m=0.06, angle_deg=-30.0, lateral_m=0.0, strength=1.0),
        Absorber(radius_m=0.06, angle_deg=30.0, lateral_m=4e-3, strength=3.0),
    ]
    x_m, y_m, z_m = centroid_m(pair)
    assert (x_m, y_m, z_m) == pytest.approx((0.5 * 0.06 * math.sin(math.pi / 6), 3e-3, 0.06 * math.cos(math.pi / 6)))
    # The mean of the angles, by strength, is 15°.
    assert angle_deg((x_m, y_m, z_m)) == pytest.approx(math.degrees(math.atan(0.5 * math.tan(math.pi / 6))))


def test_a_place_and_its_angle_are_one() -> None:
    for degrees in np.linspace(-89, 89, 21).tolist():
        made = Absorber(radius_m=0.04, angle_deg=degrees, lateral_m=-3e-3)
        x_m, y_m, z_m = made.position_m
        again = Absorber.at(x_m=x_m, y_m=y_m, z_m=z_m, strength=1.0, source=GaussianAbsorber())
        assert (again.radius_m, again.angle_deg, again.lateral_m) == pytest.approx((0.04, degrees, -3e-3))


@pytest.mark.parametrize("strengths", [(), (0.0,), (1.0, -0.5)])
def test_a_centroid_needs_absorbed_energy(strengths: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match="positive"):
        centroid_m([Absorber(radius_m=0.06, strength=each) for each in strengths])


@pytest.mark.parametrize("name", TISSUES)
@pytest.mark.parametrize("marker_deg", [-33.0, 0.0, 20.0])
def test_every_spot_has_its_centroid_at_the_marker(name: str, marker_deg: float) -> None:
    marker = Absorber(radius_m=0.06, angle_deg=marker_deg, lateral_m=5e-3, strength=7.0)
    spot = tissue_named(name).spot
    for seed in range(20):
        drawn = spot.draw(marker, np.random.default_rng(seed))
        assert len(drawn) == spot.count
        assert math.fsum(each.strength for each in drawn) == pytest.approx(7.0)
        assert centroid_m(drawn) == pytest.approx(marker.position_m, abs=1e-12)
        across_m = [math.dist(each.position_m[:2], marker.position_m[:2]) for each in drawn]
        assert max(across_m) <= 2 * spot.radius_m


@pytest.mark.parametrize("name", TISSUES)
def test_the_truth_of_a_simulated_rig_is_the_angle_of_the_centroid(name: str) -> None:
    for seed in range(5):
        settings = SimulatedSettings(tissue=name, marker=MarkerSettings(radius_m=0.05))
        scene = draw_scene(settings, np.random.default_rng(seed))
        spot = scene.absorbers[: tissue_named(name).spot.count]
        truth_deg = simulated(seed=seed, settings=settings).facts.truth_deg
        assert truth_deg == pytest.approx(angle_deg(centroid_m(spot)), abs=1e-9)
