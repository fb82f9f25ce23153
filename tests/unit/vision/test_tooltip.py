"""The tip of an instrument in drawn and in simulated B-mode images, and what happens where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.acoustics import Probe, two_way_elevation
from markerseek.core import ConfigError
from markerseek.sim import BModeSettings
from markerseek.vision import Rectangle, published_sensitive_range, sensitive_range
from markerseek.vision.as_published import brightest_blob, find_tip
from tests.tip_images import scanned, tip_world

PIXEL_M = (0.15e-3, 0.15e-3)


def drawn(rng, *tips, shape=(160, 200), tissue=80.0, sd=15.0):
    """Even tissue with discs: row, column, radius in pixels, and grey value."""
    image = rng.normal(tissue, sd, shape)
    row, column = np.indices(shape)
    for middle_row, middle_column, radius, grey in tips:
        image[np.hypot(row - middle_row, column - middle_column) <= radius] = grey
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def test_the_centroid_of_a_drawn_disc_is_its_middle_and_the_intensity_its_grey_value():
    image = drawn(np.random.default_rng(1), (90.0, 70.0, 8.0, 230.0))
    rectangle, _ = brightest_blob(image, pixel_m=PIXEL_M)
    tip = find_tip(image, rectangle, pixel_m=PIXEL_M)
    assert tip.visible
    assert (tip.row, tip.column) == pytest.approx((90, 70), abs=0.5)
    assert tip.intensity == 230
    # A disc of radius 8, seen under a blur of two pixels: at most as large as one of two deviations more.
    assert math.pi * 7.5**2 <= tip.area_px <= math.pi * 12**2
    # Mean and three deviations of the tissue, to the accuracy of some thousand pixels.
    assert tip.level == pytest.approx(80 + 3 * 15, abs=5)


def test_ten_runs_are_equal_whatever_came_before():
    import cv2

    image = scanned(tip_world(), [2.0])[0]
    rectangle, _ = brightest_blob(image, pixel_m=PIXEL_M)
    found = []
    for run in range(10):
        cv2.setRNGSeed(1000 + run)
        found.append(find_tip(image, rectangle, pixel_m=PIXEL_M))
    assert all(each == found[0] for each in found)


def test_the_tip_is_found_where_it_was_put_and_followed_to_where_it_disappears():
    angles = np.arange(-10, 11).tolist()
    measured = sensitive_range(angles, scanned(tip_world(), angles), pixel_m=PIXEL_M)
    assert abs(measured.reference_deg) <= 1
    geometry = BModeSettings().geometry
    reference = next(frame.tip for frame in measured.frames if frame.angle_deg == measured.reference_deg)
    lateral_m, depth_m = geometry.position_m(row=reference.row, column=reference.column)
    assert (lateral_m, depth_m) == pytest.approx((2e-3, 50e-3), abs=0.3e-3)
    # Both ends are where the beam says: inside it is seen, two degrees farther out the echo is below the speckle.
    settings = BModeSettings()
    face_deg = math.degrees(settings.tip_m / 2 / 60e-3)
    gone = next(
        t
        for t in np.arange(0, 9, 0.1)
        if settings.tip_db + 20 * np.log10(two_way_elevation(Probe(), radius_m=60e-3, off_plane_deg=np.array([t]))[0])
        < 10
    )
    for half in (measured.below_deg, measured.above_deg):
        assert gone - 1 <= half <= gone + face_deg + 1
    assert (measured.open_below, measured.open_above) == (False, False)
    assert measured.full_deg == measured.below_deg + measured.above_deg


def test_a_stronger_tip_is_seen_farther():
    angles = np.arange(0, 9).tolist()
    halves = [
        sensitive_range(angles, scanned(tip_world(tip_db=level), angles), pixel_m=PIXEL_M).above_deg
        for level in (22.0, 30.0, 40.0)
    ]
    assert halves == sorted(halves)
    assert halves[0] < halves[2]


def test_a_scan_that_ends_too_early_says_so_and_one_side_stands_for_both():
    angles = [0.0, 1.0, 2.0, 3.0, 4.0]
    measured = sensitive_range(angles, scanned(tip_world(), angles), pixel_m=PIXEL_M)
    assert measured.open_above
    assert measured.below_deg is None
    assert measured.full_deg == 2 * measured.above_deg == 8.0


@pytest.mark.parametrize("seed", range(4))
def test_without_a_tip_there_is_none(seed):
    angles = [0.0, 1.0, 2.0, 3.0]
    measured = sensitive_range(angles, scanned(tip_world(present=False, seed=seed), angles), pixel_m=PIXEL_M)
    assert measured.reference_deg is None
    assert measured.half_deg is None
    assert "no tip: nothing stands out near one angle only" in measured.remark


def test_of_two_tips_the_larger_is_taken_and_the_other_is_named():
    rng = np.random.default_rng(2)
    tips = ((80.0, 80.0, 8.0, 230.0), (80.0, 145.0, 7.0, 225.0))
    images = [drawn(rng, *tips, shape=(160, 260)), drawn(rng, *tips, shape=(160, 260))]
    rectangle = Rectangle(row=55, column=60, rows=50, columns=105)
    measured = published_sensitive_range([0.0, 1.0], images, pixel_m=PIXEL_M, rectangle=rectangle)
    assert "two bright regions near one another" in measured.remark
    assert measured.frames[0].tip.column == pytest.approx(80, abs=1)
    alone = published_sensitive_range(
        [0.0, 1.0], images, pixel_m=PIXEL_M, rectangle=Rectangle(row=65, column=65, rows=30, columns=30)
    )
    assert alone.remark == ""


@pytest.mark.parametrize("edge", [(80.0, 0.0), (80.0, 199.0), (159.0, 100.0), (0.0, 100.0)])
def test_a_bright_wall_that_reaches_the_edge_is_no_tip_unless_a_person_names_it(edge):
    images = [drawn(np.random.default_rng(k), (*edge, 14.0, 190.0 + k)) for k in range(3)]
    walls = published_sensitive_range((0.0, 1.0, 2.0), images, pixel_m=PIXEL_M)
    assert walls.reference_deg is None
    assert "reaches the edge of the image; name the rectangle around the tip" in walls.remark
    assert not any(frame.tip.visible for frame in walls.frames if frame.tip is not None)
    row, column = (int(max(0, each - 30)) for each in edge)
    named = Rectangle(row=row, column=column, rows=60, columns=60)
    assert published_sensitive_range((0.0, 1.0, 2.0), images, pixel_m=PIXEL_M, rectangle=named).reference_deg == 2.0


def test_saturated_images_are_refused_and_a_white_tip_is_not():
    angles = np.arange(-8, 9).tolist()
    white = sensitive_range(angles, scanned(tip_world(white_db=-3.0), angles), pixel_m=PIXEL_M)
    assert white.reference_deg is None
    assert "saturated" in white.remark
    usual = sensitive_range(angles, scanned(tip_world(), angles), pixel_m=PIXEL_M)
    # The tip's echo is 30 dB, 8 dB beyond white.
    clipped = sensitive_range(angles, scanned(tip_world(white_db=22.0), angles), pixel_m=PIXEL_M)
    assert clipped.half_deg == pytest.approx(usual.half_deg, abs=1)


@pytest.mark.parametrize("way", [sensitive_range, published_sensitive_range])
def test_no_wall_that_is_there_at_all_angles_is_a_tip(way):
    images = [drawn(np.random.default_rng(k), (80.0, 199.0, 14.0, 190.0)) for k in range(8)]
    assert way(np.arange(8.0).tolist(), images, pixel_m=PIXEL_M).reference_deg is None


def test_an_even_image_and_one_of_two_grey_values_have_no_tip():
    rectangle = Rectangle(row=40, column=40, rows=30, columns=30)
    for image in (np.zeros((120, 120), np.uint8), np.full((120, 120), 255, np.uint8)):
        assert not find_tip(image, rectangle, pixel_m=PIXEL_M).visible
        assert sensitive_range([0.0, 1.0], [image, image], pixel_m=PIXEL_M).reference_deg is None


@pytest.mark.parametrize(
    ("angles", "images", "message"),
    [
        ([0.0, 1.0], [np.zeros((50, 50), np.uint8)], "2 angles for 1 images"),
        ([0.0, 0.0], [np.zeros((50, 50), np.uint8)] * 2, "two images have the same angle"),
        ([0.0, 1.0], [np.zeros((50, 5), np.uint8)] * 2, "50 × 5 pixels, 16 to 8192 are needed"),
    ],
)
def test_a_series_that_is_none_is_refused(angles, images, message):
    with pytest.raises(ConfigError, match=message):
        sensitive_range(angles, images, pixel_m=PIXEL_M)


def test_a_rectangle_outside_of_the_image_or_as_wide_as_it_is_refused():
    image = drawn(np.random.default_rng(3), (55.0, 100.0, 8.0, 230.0))
    with pytest.raises(ConfigError, match="outside of the image of 160 × 200 pixels"):
        find_tip(image, Rectangle(row=500, column=0, rows=9, columns=9), pixel_m=PIXEL_M)
    with pytest.raises(ConfigError, match="there is no tissue beside it"):
        find_tip(image, Rectangle(row=40, column=0, rows=30, columns=200), pixel_m=PIXEL_M)
    with pytest.raises(ConfigError, match="rectangle: rows is 2"):
        Rectangle(row=0, column=0, rows=2, columns=9)


def test_speckle_is_rayleigh_distributed_and_changes_with_the_angle_as_the_beam():
    """The amplitude has the moments of Rayleigh's law; the correlation over the angle is that of the response."""
    made = tip_world(present=False, noise_db=-80.0)
    rows = slice(120, 160)
    fields = [made._speckle.field(angle_deg)[rows] for angle_deg in (0.0, 0.5, 1.0, 6.0)]
    amplitude = np.abs(fields[0])
    assert amplitude.mean() / np.sqrt(np.mean(amplitude**2)) == pytest.approx(math.sqrt(math.pi) / 2, abs=0.01)
    assert np.mean(amplitude**2) == pytest.approx(1.0, rel=0.1)
    t = np.arange(-8, 8.01, 0.01)
    beam = two_way_elevation(Probe(), radius_m=60e-3, off_plane_deg=t)
    for field, shift_deg in zip(fields[1:], (0.5, 1.0, 6.0), strict=True):
        moved = np.interp(t - shift_deg, t, beam, left=0.0, right=0.0)
        expected = np.sum(beam * moved) / np.sum(beam**2)
        power = np.sqrt(np.mean(np.abs(field) ** 2) * np.mean(amplitude**2))
        found = np.real(np.mean(field * np.conj(fields[0]))) / power
        assert found == pytest.approx(expected, abs=0.08)


def test_an_image_depends_on_the_angle_and_not_on_the_way_there():
    direct = tip_world()
    around = tip_world()
    scanned(around, [-20.0, 7.0, 3.0])
    np.testing.assert_array_equal(direct._speckle.field(4.0), around._speckle.field(4.0))
    # The receiver's noise is new in each image.
    assert not np.array_equal(around.pixels(), around.pixels())


def test_a_tip_outside_of_the_image_is_refused():
    with pytest.raises(ConfigError, match=r"the tip is 0\.05 m deep, outside of the image"):
        tip_world(first_depth_m=10e-3, last_depth_m=40e-3)
    with pytest.raises(ConfigError, match="b_mode: tip_m is 0"):
        BModeSettings(tip_m=0.0)
