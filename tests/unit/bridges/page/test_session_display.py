"""What a registration session says and draws, from steps that a whole session rarely has."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from msgspec import structs

from markerseek.bridges.page.session_display import session_marks, session_table, session_verdict
from markerseek.core import MarkerCandidate, MarkerPosition
from markerseek.registration import (
    SessionView,
    Spot,
    SpotRefused,
    SpotSeen,
    StereoSettings,
    TakenMarker,
    Waiting,
    camera_text,
    target_pixels,
)
from markerseek.sim import endoscope
from tests import registration_sessions as sessions

STEREO = StereoSettings.of(endoscope(), calibration_sigma_px=0.3)
SPOT = Spot(left_px=(600.0, 500.0), right_px=(560.0, 500.0), sigma_px=0.1)


BEGUN = structs.replace(sessions.BEGUN, cameras=camera_text(STEREO), size_px=STEREO.left.size_px)
REGISTERED = structs.replace(sessions.registered(4), left_out=("2",), open=("3",))


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


def test_the_ellipse_of_the_target_is_that_of_95_percent():
    state = SessionView().after(BEGUN).after(REGISTERED)
    pixels = target_pixels(state.last.report, stereo=STEREO)
    for side, (pixel, covariance_px2) in zip(("left", "right"), pixels, strict=True):
        drawn = re.search(
            r"translate\((\S+) (\S+)\) rotate\((\S+)\)\"><ellipse class=\"ms-mark-target\" rx=\"(\S+)\" ry=\"(\S+)\"",
            session_marks(state, side),
        )
        x, y, turn_deg, large, small = map(float, drawn.groups())
        assert (x, y) == pytest.approx(tuple(pixel), abs=0.06)
        along = math.radians(turn_deg)
        for radius, direction in ((large, along), (small, along + math.pi / 2)):
            end = radius * np.array([math.cos(direction), math.sin(direction)])
            # Rounded to a tenth of a pixel.
            assert end @ np.linalg.solve(covariance_px2, end) == pytest.approx(5.991, rel=0.4 / radius)


@pytest.mark.parametrize("way", [-1, 1])
def test_the_name_of_the_target_stands_off_a_marker_beside_it(way):
    state = SessionView().after(BEGUN).after(REGISTERED)
    x, y = target_pixels(state.last.report, stereo=STEREO)[0][0]
    beside = structs.replace(SPOT, left_px=(x, y + 40.0 * way))
    marks = session_marks(state.after(structs.replace(marker("1"), spot=beside)), "left")
    across, down = map(float, re.search(r'ms-mark-name" x="(\S+)" y="(\S+)"', marks).groups())
    assert math.dist((across, down), (x, y + 40.0 * way)) > 60.0


def test_a_refused_spot_stays_said_until_one_is_seen():
    asked = Waiting(name="1", place=None, said="light a spot")
    state = SessionView().after(BEGUN).after(asked).after(SpotRefused(name="1", reason="the spot moved")).after(asked)
    verdict = session_verdict(state, next_step="")
    assert (verdict.word, verdict.kind, verdict.problem) == ("LIGHT A SPOT", "unsure", "the spot moved")
    seen = state.after(SpotSeen(name="1", spot=SPOT, camera_m=(0.0, 0.0, 0.1), prediction=None, journal=None))
    assert (session_verdict(seen, next_step="").word, session_verdict(seen, next_step="").problem) == ("SEARCHING", "")


def test_what_a_registration_makes_of_each_marker_is_named_and_texts_are_no_html():
    state = SessionView().after(BEGUN)
    candidate = MarkerCandidate(
        angle_deg=-3.0, probability=1.0, position=MarkerPosition(position_m=(0.0, 0.0, 0.06), sigma_m=(1e-4,) * 3)
    )
    for name in ("1", "2", "3", "4"):
        state = state.after(structs.replace(marker(name), candidates=[] if name == "4" else [candidate]))
    state = state.after(REGISTERED)
    assert [state.use_of(each) for each in state.markers] == ["used", "left out", "open", "not found"]
    assert re.findall(r"<td>([^<]*)</td></tr>", session_table(state)) == ["used", "left out", "open", "not found"]
    assert 'title="&lt;noise&gt; alone"' in session_table(state)
    assert (
        session_marks(state, "left").count("ms-mark-marker"),
        session_marks(state, "left").count("ms-mark-out"),
    ) == (1, 3)


def test_a_marker_that_has_moved_takes_the_word_and_the_expected_error_back():
    view = SessionView()
    for step in (BEGUN, sessions.registered(4), sessions.ENDED):
        view = view.after(step)
    held = session_verdict(view, next_step="")
    assert (held.word, held.lead) == ("REGISTERED ABOVE GOAL", "expected error")
    for step in (sessions.MOVED, sessions.ENDED, sessions.registered(4)):
        view = view.after(step)
        verdict = session_verdict(view, next_step="")
        assert (verdict.word, verdict.kind, verdict.angle) == ("NOT REGISTERED", "unsure", "")
        assert "marker 1 has moved" in verdict.reason
        assert "not reached" in verdict.turn
        assert "ms-mark-target" not in session_marks(view, "left")


@pytest.mark.parametrize(
    ("share", "word", "kind", "said"),
    [(1.02, "REGISTERED", "found", "mm is reached"), (0.97, "REGISTERED ABOVE GOAL", "unsure", "is not reached")],
)
def test_the_word_at_the_end_says_whether_the_goal_is_reached(share, word, kind, said):
    newest = sessions.registered(4)
    view = SessionView()
    for step in (structs.replace(BEGUN, goal_m=share * newest.report.tre_m), newest, sessions.ENDED):
        view = view.after(step)
    verdict = session_verdict(view, next_step="")
    assert (verdict.word, verdict.kind, said in verdict.turn) == (word, kind, True)
    assert view.goal_reached == (kind == "found")


def test_a_session_that_waits_in_the_dark_says_what_to_press():
    view = SessionView().after(BEGUN)
    lit = view.after(Waiting(name="1", place=None, said="light a spot"))
    dark = view.after(Waiting(name="1", place=None, said="light a spot", dark=True))
    assert "Spot is set" not in session_verdict(lit, next_step="").turn
    assert "the laser is dark: press Spot is set once it is there" in session_verdict(dark, next_step="").turn


def test_the_reason_of_a_refusal_is_drawn_at_its_place_in_the_image_that_shows_it():
    reason = "left camera: two places are about as <bright>, at (300, 180) and (210, 140) px; cover reflections"
    refused = SpotRefused(name="1", reason=reason, left_px=[(300.0, 180.0), (1270.0, 140.0)])
    state = SessionView().after(BEGUN).after(Waiting(name="1", place=None, said="light a spot")).after(refused)
    left = session_marks(state, "left")
    rings = re.findall(r'class="ms-mark-refused" cx="(\S+)" cy="(\S+)"', left)
    assert rings == [("300.0", "180.0"), ("1270.0", "140.0")]
    text = " ".join(re.findall(r'ms-mark-why"[^>]*>([^<]*)<', left))
    assert text.startswith("two places are about as &lt;bright&gt;, at (300, 180)")
    assert text.count("two places") == 1
    # What to do stands in the verdict, and nothing is drawn where nothing is seen.
    assert "cover" not in text
    assert "ms-mark-refused" not in session_marks(state, "right")
    # Of a text at the edge nothing is cut off.
    places = [float(x) for x in re.findall(r'text-anchor="middle" x="(\S+)"', left)]
    assert 0.3 * 1280 <= min(places) <= max(places) <= 0.7 * 1280
    accepted = state.after(SpotSeen(name="1", spot=SPOT, camera_m=(0.0, 0.0, 0.1), prediction=None, journal=None))
    assert "ms-mark-refused" not in session_marks(accepted, "left")
