"""What a registration session says and draws, from steps that a whole session rarely has."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from msgspec import structs

from markerseek.bridges.page.session_state import SessionState
from markerseek.core import MarkerCandidate, MarkerPosition
from markerseek.registration import (
    Begun,
    PointPair,
    Registered,
    Spot,
    SpotRefused,
    SpotSeen,
    StereoSettings,
    TakenMarker,
    Waiting,
    camera_text,
    register_pairs,
    target_pixels,
)
from markerseek.sim import endoscope

STEREO = StereoSettings.of(endoscope(), calibration_sigma_px=0.3)
SPOT = Spot(left_px=(600.0, 500.0), right_px=(560.0, 500.0), sigma_px=0.1)


def begun() -> Begun:
    return Begun(
        rig="r",
        description="a rig",
        simulated=True,
        images="images",
        cameras=camera_text(STEREO),
        size_px=STEREO.left.size_px,
        goal_m=5e-4,
        target_trus_m=None,
        begun="2026-01-01T00:00:00+00:00",
    )


def marker(name: str) -> TakenMarker:
    return TakenMarker(
        name=name,
        spot=SPOT,
        camera_m=[0.0, 0.0, 0.1],
        camera_covariance_m2=np.eye(3).tolist(),
        camera_shared_m=np.zeros((3, 0)).tolist(),
        answer="not-found",
        reason="<noise> alone",
        candidates=[],
        acquisitions=7,
        rig_s=1.0,
        prior=None,
        journal=None,
        at="2026-01-01T00:00:00+00:00",
    )


def registered() -> Registered:
    rng = np.random.default_rng(3)
    camera_m = np.array([[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.0, 0.02, 0.103], [0.005, -0.005, 0.11]])
    pairs = [
        PointPair(
            name=str(number),
            camera_m=at_m,
            trus_m=at_m + (0.01, -0.03, -0.06) + 2e-4 * rng.standard_normal(3),
            camera_covariance_m2=np.diag([1e-8, 1e-8, 9e-8]),
            trus_covariance_m2=4e-8 * np.eye(3),
            camera_shared_m=np.zeros((3, 0)),
        )
        for number, at_m in enumerate(camera_m, start=1)
    ]
    report = register_pairs(pairs)
    assert report.registered
    return Registered(
        report=report,
        decided=True,
        chosen={},
        left_out=("2",),
        open=("3",),
        reason=None,
        place=None,
        done=False,
        said="registered",
    )


def test_the_ellipse_of_the_target_is_that_of_95_percent():
    state = SessionState().add(begun()).add(registered())
    pixels = target_pixels(state.last.report, stereo=STEREO)
    for side, (pixel, covariance_px2) in zip(("left", "right"), pixels, strict=True):
        drawn = re.search(
            r"translate\((\S+) (\S+)\) rotate\((\S+)\)\"><ellipse class=\"ms-mark-target\" rx=\"(\S+)\" ry=\"(\S+)\"",
            state.marks(side),
        )
        x, y, turn_deg, large, small = map(float, drawn.groups())
        assert (x, y) == pytest.approx(tuple(pixel), abs=0.06)
        along = math.radians(turn_deg)
        for radius, direction in ((large, along), (small, along + math.pi / 2)):
            end = radius * np.array([math.cos(direction), math.sin(direction)])
            # Rounded to a tenth of a pixel.
            assert end @ np.linalg.solve(covariance_px2, end) == pytest.approx(5.991, rel=0.4 / radius)


def test_a_refused_spot_stays_said_until_one_is_seen():
    asked = Waiting(name="1", place=None, said="light a spot")
    state = SessionState().add(begun()).add(asked).add(SpotRefused(name="1", reason="the spot moved")).add(asked)
    verdict = state.verdict(next_step="")
    assert (verdict.word, verdict.kind, verdict.problem) == ("LIGHT A SPOT", "unsure", "the spot moved")
    seen = state.add(SpotSeen(name="1", spot=SPOT, camera_m=(0.0, 0.0, 0.1), prediction=None, journal=None))
    assert (seen.verdict(next_step="").word, seen.verdict(next_step="").problem) == ("SEARCHING", "")


def test_what_a_registration_makes_of_each_marker_is_named_and_texts_are_no_html():
    state = SessionState().add(begun())
    candidate = MarkerCandidate(
        angle_deg=-3.0, probability=1.0, position=MarkerPosition(position_m=(0.0, 0.0, 0.06), sigma_m=(1e-4,) * 3)
    )
    for name in ("1", "2", "3", "4"):
        state = state.add(structs.replace(marker(name), candidates=[] if name == "4" else [candidate]))
    state = state.add(registered())
    assert [state.use_of(each) for each in state.taken] == ["used", "left out", "open", "not found"]
    assert re.findall(r"<td>([^<]*)</td></tr>", state.table()) == ["used", "left out", "open", "not found"]
    assert 'title="&lt;noise&gt; alone"' in state.table()
    assert (state.marks("left").count("ms-mark-marker"), state.marks("left").count("ms-mark-out")) == (1, 3)
