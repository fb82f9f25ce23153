"""Markers that are carried from one place of the endoscope to another."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.geometry import RigidTransform
from markerseek.registration import (
    EndoscopeMotion,
    EndoscopeNotKnown,
    SearchScene,
    SessionView,
    TakenMarker,
    station_names,
)
from markerseek.registration.stations import carry, stands_elsewhere
from tests.registration_sessions import taken

SPOT_M = np.array([0.012, -0.004, 0.09])
TRUE = {
    "2": RigidTransform(
        source="DaVinciBefore",
        target="DaVinci",
        rotation=Rotation.from_rotvec([2.0, -3.0, 8.0], degrees=True).as_matrix(),
        translation_m=np.array([4e-3, -2e-3, 6e-3]),
    ),
    "3": RigidTransform(
        source="DaVinciBefore",
        target="DaVinci",
        rotation=Rotation.from_rotvec([-5.0, 1.0, -2.0], degrees=True).as_matrix(),
        translation_m=np.array([-7e-3, 1e-3, 2e-3]),
    ),
}
COVARIANCE = np.diag([0.1, 0.12, 0.2, 0.05, 0.06, 0.2]) ** 2


def motion(transform: RigidTransform, *, since: str, after: str | None = None) -> EndoscopeMotion:
    """A motion as it is recorded, with the middle of the scene 90 mm away."""
    middle_m = np.array([0.0, 0.0, 0.09])
    return EndoscopeMotion(
        since=since,
        after=after or since,
        displacement_mm=tuple((1e3 * (middle_m - transform.inverse().apply(middle_m))).tolist()),
        rotation_deg=tuple(np.degrees(Rotation.from_matrix(transform.rotation).as_rotvec()).tolist()),
        middle_mm=tuple((1e3 * middle_m).tolist()),
        covariance=tuple(map(tuple, COVARIANCE.tolist())),
    )


STILL = RigidTransform(source="DaVinciBefore", target="DaVinci", rotation=np.eye(3), translation_m=np.zeros(3))
LOST = EndoscopeNotKnown(after="1", reason="the picture is dark")


def marker(name: str, endoscope: EndoscopeMotion | EndoscopeNotKnown | None = None) -> TakenMarker:
    """A marker whose spot lies at `SPOT_M` of the camera as it stands at this marker."""
    covariance = np.diag([1e-8, 4e-8, 9e-8]).tolist()
    return taken(name, camera_m=SPOT_M.tolist(), camera_covariance_m2=covariance, endoscope=endoscope)


def test_markers_of_before_the_endoscope_was_looked_at_are_of_one_station() -> None:
    markers = [marker("1"), marker("2"), marker("3")]
    assert set(station_names(markers).values()) == {"1"}
    carried = carry(markers)
    assert carried.lost == ()
    for each in carried.seen:
        np.testing.assert_array_equal(each.camera_m, SPOT_M)
        assert each.camera_motion_m is not None
        assert each.camera_motion_m.shape == (3, 0)


def test_markers_are_carried_over_two_moves_to_the_last() -> None:
    markers = [
        marker("1"),
        marker("2", motion(TRUE["2"], since="1")),
        marker("3", motion(TRUE["3"], since="2")),
        marker("4", motion(STILL, since="3")),
    ]
    first, second, third, last = carry(markers).seen
    np.testing.assert_allclose(first.camera_m, TRUE["3"].apply(TRUE["2"].apply(SPOT_M)), atol=1e-12)
    np.testing.assert_allclose(second.camera_m, TRUE["3"].apply(SPOT_M), atol=1e-12)
    np.testing.assert_array_equal(third.camera_m, SPOT_M)
    turned = TRUE["3"].rotation @ TRUE["2"].rotation
    np.testing.assert_allclose(first.camera_covariance_m2, turned @ np.diag([1e-8, 4e-8, 9e-8]) @ turned.T, atol=1e-20)
    for each in (third, last):
        np.testing.assert_array_equal(each.camera_motion_m, np.zeros((3, 12)))
    # The second marker is carried by the later motion only.
    assert np.count_nonzero(np.abs(second.camera_motion_m).sum(axis=0)) == 6


def test_the_errors_of_a_motion_displace_carried_markers_as_the_motion_itself_would() -> None:
    rng = np.random.default_rng(1)
    exact = motion(TRUE["2"], since="1")
    (seen, _) = carry([marker("1"), marker("2", exact)]).seen
    (turns_deg, shifts_mm) = np.split(rng.multivariate_normal(np.zeros(6), COVARIANCE, size=20_000).T, 2)
    middle_m = np.array([0.0, 0.0, 0.09])
    turned = Rotation.from_rotvec(turns_deg.T, degrees=True).apply(TRUE["2"].apply(SPOT_M) - middle_m)
    drawn_m = turned + middle_m + 1e-3 * shifts_mm.T
    # 20,000 draws know a covariance to 1 %; the sum over columns is that of all errors.
    expected = np.cov(drawn_m.T)
    np.testing.assert_allclose(seen.camera_motion_m @ seen.camera_motion_m.T, expected, atol=0.05 * expected.max())


def test_back_at_a_former_place_the_later_markers_are_carried_back() -> None:
    markers = [marker("1"), marker("2", motion(TRUE["2"], since="1"))]
    back = motion(STILL, since="1", after="2")
    assert stands_elsewhere(markers, back)
    first, second = carry(markers, now=back).seen
    np.testing.assert_array_equal(first.camera_m, SPOT_M)
    np.testing.assert_allclose(second.camera_m, TRUE["2"].inverse().apply(SPOT_M), atol=1e-12)
    assert not stands_elsewhere([*markers, marker("3", back)], motion(STILL, since="1", after="3"))


@pytest.mark.parametrize(
    ("later", "lost"),
    [((LOST,), ("1",)), ((LOST, motion(STILL, since="2")), ("1",)), ((LOST, motion(STILL, since="1")), ("2",))],
)
def test_markers_from_which_no_known_motion_leads_here_are_lost(
    later: tuple[EndoscopeMotion | EndoscopeNotKnown, ...], lost: tuple[str, ...]
) -> None:
    markers = [marker("1"), *(marker(str(number), each) for number, each in enumerate(later, start=2))]
    carried = carry(markers)
    assert carried.lost == lost
    assert {each.name for each in carried.seen} == {each.name for each in markers} - {*lost}
    everything_lost = carry(markers, now=EndoscopeNotKnown(after="3", reason="the picture is dark"))
    assert everything_lost.seen == ()


def test_other_programs_get_what_the_cameras_saw_and_what_was_done_about_it() -> None:
    moved = motion(TRUE["2"], since="1")
    markers = (marker("1"), structs.replace(marker("2", moved), scene=SearchScene(pairs=10, known=1.0)))
    view = SessionView(markers=markers, endoscope=moved)
    assert view.known["motion"] == {
        "endoscope": {"state": "moved", "said": moved.said},
        "carried": ["1"],
        "lost": [],
        "searches": [{"marker": "2", "said": markers[1].scene.said, "known": True, "moved": False}],
    }
    assert SessionView(markers=(marker("1"),)).known["motion"] is None
