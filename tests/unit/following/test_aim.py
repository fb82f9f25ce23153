"""Where the probe turns to see a target: against rotations in space, and a registration that is carried along."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Interval
from markerseek.following import Aim, HeldRegistration, ProbeReach, Target
from markerseek.registration import EndoscopeMotion
from tests.faults.followed_runs import CAMERA_TO_TRUS, registration

REACH = ProbeReach(angles=Interval(low_deg=-30, high_deg=30), lateral_m=20e-3, radius_m=(10e-3, 90e-3))


def target(trus_m: np.ndarray, *, sigma_m: float = 0.2e-3) -> Target:
    """A target at this place of the probe's frame, as the camera sees it."""
    return Target(at_s=1.0, camera_m=CAMERA_TO_TRUS.inverse().apply(trus_m), covariance_m2=np.eye(3) * sigma_m**2)


@given(st.floats(-35, 35), st.floats(20e-3, 90e-3), st.floats(-0.02, 0.02))
def test_a_probe_that_is_turned_there_has_the_target_in_its_plane(angle_deg: float, radius_m: float, y: float) -> None:
    place_m = Rotation.from_euler("y", angle_deg, degrees=True).apply([0.0, y, radius_m])
    held = HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True)
    aim = held.aim(target(place_m))
    assert aim.trus_m == pytest.approx(place_m, abs=1e-6)
    in_probe_m = Rotation.from_euler("y", aim.angle_deg, degrees=True).inv().apply(place_m)
    assert in_probe_m[0] == pytest.approx(0.0, abs=1e-6)
    assert aim.radius_m == pytest.approx(radius_m, abs=1e-6)


def test_the_uncertainty_of_the_angle_is_that_across_the_plane() -> None:
    covariance_m2 = np.diag([1e-3, 2e-3, 3e-3]) ** 2
    aim = Aim(at_s=0.0, trus_m=np.array([0.0, 0.0, 0.05]), covariance_m2=covariance_m2, noise_m2=covariance_m2)
    assert aim.sigma_deg == pytest.approx(math.degrees(1e-3 / 0.05))
    turned = Aim(at_s=0.0, trus_m=np.array([0.05, 0.0, 0.0]), covariance_m2=covariance_m2, noise_m2=covariance_m2)
    assert turned.sigma_deg == pytest.approx(math.degrees(3e-3 / 0.05))


def test_the_source_of_a_spot_is_below_it_along_the_sight() -> None:
    held = HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True)
    seen = target(np.array([0.0, 0.0, 0.06]))
    below_m = held.aim(seen, depth_m=1e-3).trus_m - held.aim(seen).trus_m
    sight_m = np.array([0.0, 0.0, 0.06]) - CAMERA_TO_TRUS.translation_m
    assert below_m == pytest.approx(1e-3 * sight_m / np.linalg.norm(sight_m), abs=1e-6)


@given(st.floats(-5, 5), st.floats(-3, 3))
def test_a_registration_is_carried_along_with_the_endoscope(shift_mm: float, turn_deg: float) -> None:
    """A point that rests in the tissue has the same place in the probe's frame, wherever the camera stands."""
    held = HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True)
    before_m = np.array([0.002, -0.003, 0.1])
    motion = EndoscopeMotion(
        since="1",
        after="4",
        displacement_mm=(shift_mm, 0.5, -0.3),
        rotation_deg=(0.2, turn_deg, -0.1),
        middle_mm=(shift_mm, 0.5, 99.7),
        covariance=tuple(tuple(row) for row in (0.01 * np.eye(6)).tolist()),
    )
    place_m = held.aim(Target(at_s=0.0, camera_m=before_m, covariance_m2=np.eye(3) * 1e-8)).trus_m
    expected_m = held.tre_m
    held.carry(motion)
    now = Target(at_s=1.0, camera_m=motion.transform.apply(before_m), covariance_m2=np.eye(3) * 1e-8)
    assert held.aim(now).trus_m == pytest.approx(place_m, abs=1e-9)
    assert held.tre_m > expected_m


@pytest.mark.parametrize(
    ("place_mm", "said"),
    [
        ((0, 0, 60), None),
        ((40, 0, 60), "the target is at 33.7 deg, the probe turns within [-30, 30] deg"),
        ((0, 21, 60), "the target is 21 mm along the array, it sees ± 20 mm"),
        ((0, 0, 95), "the target is 95 mm from the axis, the probe sees 10 to 90 mm"),
        ((0, 0, 5), "the target is 5 mm from the axis, the probe sees 10 to 90 mm"),
    ],
)
def test_what_is_out_of_reach_is_said(place_mm: tuple[float, float, float], said: str | None) -> None:
    noise_m2 = np.eye(3) * 1e-8
    aim = Aim(at_s=0.0, trus_m=1e-3 * np.array(place_mm), covariance_m2=noise_m2, noise_m2=noise_m2)
    assert REACH.objection(aim) == said


def test_what_is_no_target_is_refused() -> None:
    with pytest.raises(ConfigError, match="these must be finite numbers"):
        Target(at_s=0.0, camera_m=np.array([0.0, math.nan, 0.1]), covariance_m2=np.eye(3))
    with pytest.raises(ConfigError, match="the covariance positive"):
        Target(at_s=0.0, camera_m=np.array([0.0, 0.0, 0.1]), covariance_m2=-np.eye(3))
    held = HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True)
    with pytest.raises(ConfigError, match="from the axis of the probe, 1 mm at least"):
        held.aim(target(np.array([0.0, 0.01, 0.0])))
