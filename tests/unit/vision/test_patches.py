"""Patches are found again to hundredths of a pixel, against SciPy's splines and a closed form of the brightness."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from markerseek.vision.patches import best_of, cut_patches, find_patches

PLACES = np.array([[x, y] for x in (40.0, 70.0, 100.0) for y in (40.0, 80.0)])
UPRIGHT = np.tile(np.eye(2), (len(PLACES), 1, 1))


def picture(seed: int = 1) -> np.ndarray:
    """Smooth noise of 140 × 140 pixels, as numbers that are not rounded."""
    rough = np.random.default_rng(seed).standard_normal((140, 140))
    smooth = ndimage.gaussian_filter(rough, 2.0)
    return 120 + 30 * smooth / smooth.std()


def counts(image: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.4), (1.6, 2.2)])
def test_shifts_are_those_of_a_spline(shift: tuple[float, float]) -> None:
    image = picture()
    patches = cut_patches(counts(image), PLACES, half=9)
    moved = ndimage.shift(image, shift[::-1], order=5, mode="nearest")
    found = find_patches(patches, counts(moved), PLACES, UPRIGHT, reach_px=5.0)
    np.testing.assert_allclose(found.places_px, PLACES + shift, atol=0.04)
    assert (found.likeness > 0.98).all()


def test_brightness_and_contrast_change_nothing() -> None:
    image = picture()
    patches = cut_patches(counts(image), PLACES, half=9)
    moved = 30 + 0.5 * ndimage.shift(image, (0.5, 0.7), order=5, mode="nearest")
    found = find_patches(patches, counts(moved), PLACES, UPRIGHT, reach_px=5.0)
    np.testing.assert_allclose(found.places_px, PLACES + np.array([0.7, 0.5]), atol=0.05)


def test_a_turned_patch_is_found_by_its_form() -> None:
    image = picture()
    centre = np.array([70.0, 70.0])
    angle = np.radians(25)
    form = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    # The turned picture at p is the picture at R⁻¹ (p − c) + c; ndimage counts rows first.
    back = form.T[::-1, ::-1]
    turned = ndimage.affine_transform(image, back, offset=centre[::-1] - back @ centre[::-1], order=5, mode="nearest")
    place = np.array([[60.0, 75.0]])
    expected = (place - centre) @ form.T + centre
    patches = cut_patches(counts(image), place, half=9)
    found = find_patches(patches, counts(turned), expected + 1.0, form[None], reach_px=5.0)
    np.testing.assert_allclose(found.places_px, expected, atol=0.05)
    upright = find_patches(patches, counts(turned), expected + 1.0, np.eye(2)[None], reach_px=5.0)
    assert upright.likeness[0] < found.likeness[0] - 0.1


def test_covariances_are_those_of_the_noise() -> None:
    image = picture()
    patches = cut_patches(counts(image), PLACES, half=9)
    rng = np.random.default_rng(2)
    errors = []
    expected = []
    for _ in range(60):
        noisy = counts(ndimage.gaussian_filter(image + 25 * rng.standard_normal(image.shape), 0.8))
        found = find_patches(patches, noisy, PLACES, UPRIGHT, reach_px=5.0)
        errors.append(found.places_px - PLACES)
        expected.append(np.trace(found.covariances_px2, axis1=1, axis2=2).mean())
    measured = np.mean(np.sum(np.array(errors) ** 2, axis=2))
    assert 0.4 < measured / np.mean(expected) < 2.5


@pytest.mark.parametrize("fault", ["outside", "white", "flat", "not finite"])
def test_what_cannot_be_seen_is_not_found(fault: str) -> None:
    image = picture()
    patches = cut_patches(counts(image), PLACES[:1], half=9)
    start = PLACES[:1].copy()
    if fault == "outside":
        start[:] = 3.0
    if fault == "not finite":
        start[:] = np.nan
    if fault == "white":
        image[30:50, 30:36] = 255
    if fault == "flat":
        image[:] = 80
    found = find_patches(patches, counts(image), start, UPRIGHT[:1], reach_px=5.0)
    assert found.likeness[0] == -1.0


def test_the_best_place_of_several_is_the_right_one() -> None:
    image = counts(picture())
    patches = cut_patches(image, PLACES, half=7)
    tried = PLACES[:, None, :] + np.array([[-8.0, 0.0], [0.0, 0.0], [8.0, 0.0]])
    best, likeness = best_of(patches, image, tried)
    assert (np.argmax(likeness, axis=1) == 1).all()
    np.testing.assert_allclose(best, 1.0, atol=1e-9)


def test_nothing_is_cut_of_nothing() -> None:
    patches = cut_patches(counts(picture()), np.empty((0, 2)), half=9)
    assert (
        len(find_patches(patches, counts(picture()), np.empty((0, 2)), np.empty((0, 2, 2)), reach_px=1).likeness) == 0
    )
