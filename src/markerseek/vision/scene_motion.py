"""The rigid motion of a scene since a reference pair, followed from pair to pair with two cameras.

A motion is stated only where most of the texture that is found again moves as one rigid body; otherwise a pair is
`NotKnown`, with its cause. Whether the endoscope moved or the tissue cannot be told from one pair: see
`told_apart`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import Bool, Float64, StereoPair
from markerseek.geometry import (
    CalibrationErrors,
    RigidTransform,
    StereoMotion,
    StereoPixels,
    at_rest,
    rigid_motion,
    shift_between,
)
from markerseek.vision.keypoints import motion_of_keypoints
from markerseek.vision.patches import FoundPatches, find_patches
from markerseek.vision.texture import (
    DARK_COUNTS,
    SCALE,
    Cause,
    ExpectedView,
    Levels,
    NotKnown,
    SceneTexture,
    grain,
    predict,
    require_sizes,
)

MIN_LIKENESS = 0.75
"""Least correlation of a patch with the image in which it counts as found."""

MIN_FOUND = 24
"""Fewest patches that are found in both images."""

MIN_FOUND_SHARE = 0.3
"""Least share of the patches that should be in view and are found."""

MIN_SHARED = 0.7
"""Least share of the patches found that move as one body: with less, the picture moves in several ways."""

MAX_UNEVENNESS = 4.0
"""Largest mean square by which regions of the picture move beside each other, over the scatter of their patches."""

MAX_SIGMA_M = 0.25e-3
"""Largest standard deviation of the displacement of the scene, in any direction: a move of 0.5 mm would be missed."""

MAX_SIGMA_DEG = 0.3
"""Largest standard deviation of the rotation, about any axis."""

_COARSE_REACH_PX = 8.0
"""How far from its expected place a patch is looked for, in pixels of the coarse image."""

_FINE_REACH_PX = 4.0

_BESIDE_PX = 2.5
"""How far from the motion of the scene a patch is found in the coarse image, so that this place is the better one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneSeen:
    """A pair in which the texture of the reference was found."""

    at_s: float
    """Time of the pair."""
    texture: SceneTexture
    """The reference."""
    found: Bool[np.ndarray, " patches"]
    """Which patches of the texture were found in both images."""
    pixels: StereoPixels
    """Where those were found."""
    near: RigidTransform
    """The rigid motion since the reference that explains most patches."""
    motion: StereoMotion | NotKnown
    """The same with its errors, if the scene moved as one rigid body."""

    def displacement_near(
        self, point_m: Float64[np.ndarray, " 3"], *, within_m: float = 8e-3
    ) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]] | None:
        """Return the displacement of the tissue around a point since the reference (m), and its covariance (m²).

        ``point_m``: in the camera's frame, at the time of the reference. ``within_m``: radius of that tissue. It may
        move beside the rest of the scene; its rotation is that of most of the scene. None if fewer than five patches
        are found there, or most of them do not move alike.
        """
        points = self.texture.points[self.found]
        around = np.linalg.norm(points.positions_m - point_m, axis=1) <= within_m
        beside = shift_between(points[around], self.pixels[around], self.texture.cameras, motion=self.near)
        if beside is None:
            return None
        shift_m, covariance_m2 = beside
        return self.near.apply(point_m) - point_m + shift_m, covariance_m2


def scene_motion(
    texture: SceneTexture, pair: StereoPair, *, near: RigidTransform, rng: np.random.Generator
) -> SceneSeen | NotKnown:
    """Find the texture of a reference in a pair, near an expected motion; `NotKnown` if the picture does not show it.

    Parameters
    ----------
    texture
        The reference.
    pair
        A pair without the laser's light.
    near
        The motion that is expected, for example that of the last pair: patches are looked for within 30 pixels.
    rng
        Draws the samples of patches that are tried.
    """
    require_sizes(pair, texture.cameras)
    return _seen(texture, pair, _Both.of(pair), _Expected.of(texture, near), rng)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Both:
    """Both images of a pair at both sizes."""

    left: Levels
    right: Levels

    @classmethod
    def of(cls, pair: StereoPair) -> _Both:
        return cls(left=Levels.of(pair.left), right=Levels.of(pair.right))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Expected:
    """Where patches are expected: by a motion of the scene, and beside it by what they moved themselves."""

    near: RigidTransform
    left_px: Float64[np.ndarray, "patches 2"]
    """Displacement in the left image beside the motion."""
    right_px: Float64[np.ndarray, "patches 2"]

    @classmethod
    def of(cls, texture: SceneTexture, near: RigidTransform) -> _Expected:
        """Expect that all patches move with the scene."""
        nothing = np.zeros((len(texture.parts), 2))
        return cls(near=near, left_px=nothing, right_px=nothing)

    @classmethod
    def after(cls, seen: SceneSeen) -> _Expected:
        """Expect patches where they were last."""
        view = predict(seen.texture, seen.near)
        left_px = np.zeros((len(seen.found), 2))
        right_px = np.zeros((len(seen.found), 2))
        left_px[seen.found] = seen.pixels.left_px - view.left_px[seen.found]
        right_px[seen.found] = seen.pixels.right_px - view.right_px[seen.found]
        return cls(near=seen.near, left_px=left_px, right_px=right_px)


def _seen(
    texture: SceneTexture, pair: StereoPair, both: _Both, expected: _Expected, rng: np.random.Generator
) -> SceneSeen | NotKnown:
    """Find patches roughly in small images, then exactly: where they were found, or where their motion expects them."""
    view = predict(texture, expected.near)
    view = replace(view, left_px=view.left_px + expected.left_px, right_px=view.right_px + expected.right_px)
    found, pixels = _coarse(texture, both, view)
    rough = _motion(texture, found, pixels, expected.near, rng)
    if rough is None:
        return _problem(texture, pair, both, found)
    view = predict(texture, rough.transform)
    found, pixels = _fine(texture, both, _corrected(view, found, pixels))
    motion = _motion(texture, found, pixels, rough.transform, rng, calibration=texture.calibration)
    if motion is None or not _enough(view, found, pair):
        return _problem(texture, pair, both, found)
    doubt = _doubt(texture, found, motion)
    return SceneSeen(
        at_s=pair.at_s,
        texture=texture,
        found=found,
        pixels=pixels,
        near=motion.transform,
        motion=motion if doubt is None else NotKnown(at_s=pair.at_s, cause=doubt[0], reason=doubt[1]),
    )


def _doubt(
    texture: SceneTexture, found: Bool[np.ndarray, " patches"], motion: StereoMotion
) -> tuple[Cause, str] | None:
    """Say why a motion is not that of a rigid scene, or not known well enough; None if it is."""
    share = float(np.mean(motion.shared))
    if share < MIN_SHARED:
        return "several-motions", (
            f"{share:.0%} of the texture found moves as one rigid body, {MIN_SHARED:.0%} are needed: the tissue "
            "deforms, or an instrument fills the picture"
        )
    if motion.unevenness > MAX_UNEVENNESS:
        return "deforms", (
            f"regions of the picture move beside each other, by {motion.unevenness**0.5:.1f} times what their patches "
            f"scatter ({MAX_UNEVENNESS**0.5:g} is the limit): the scene is not rigid"
        )
    points_m = texture.points[found].positions_m
    variances_m2 = np.linalg.eigvalsh(motion.covariances_m2(points_m))[:, -1]
    sigma_m = float(np.sqrt(np.median(variances_m2)))
    sigma_deg = float(np.degrees(np.sqrt(np.linalg.eigvalsh(motion.covariance[:3, :3])[-1])))
    if sigma_m > MAX_SIGMA_M or sigma_deg > MAX_SIGMA_DEG:
        return "too-few", (
            f"the texture found fixes the scene to {1e3 * sigma_m:.2f} mm and {sigma_deg:.2f} deg only, "
            f"{1e3 * MAX_SIGMA_M:g} mm and {MAX_SIGMA_DEG:g} deg are needed"
        )
    return None


def _motion(
    texture: SceneTexture,
    found: Bool[np.ndarray, " patches"],
    pixels: StereoPixels,
    near: RigidTransform,
    rng: np.random.Generator,
    *,
    calibration: CalibrationErrors | None = None,
) -> StereoMotion | None:
    if found.sum() < MIN_FOUND:
        return None
    return rigid_motion(
        texture.points[found],
        pixels,
        texture.cameras,
        start=near,
        parts=texture.parts[found],
        regions=texture.regions[found],
        calibration=calibration,
        rng=rng,
    )


def _coarse(
    texture: SceneTexture, both: _Both, view: ExpectedView
) -> tuple[Bool[np.ndarray, " patches"], StereoPixels]:
    sides = (
        (texture.left, both.left.coarse, view.left_px, view.left_forms),
        (texture.right, both.right.coarse, view.right_px, view.right_forms),
    )
    left, right = (
        find_patches(side.coarse, image, places / SCALE, forms, reach_px=_COARSE_REACH_PX)
        for side, image, places, forms in sides
    )
    return _in_both(left, right, scale=SCALE)


def _fine(texture: SceneTexture, both: _Both, view: ExpectedView) -> tuple[Bool[np.ndarray, " patches"], StereoPixels]:
    left = find_patches(texture.left.fine, both.left.fine, view.left_px, view.left_forms, reach_px=_FINE_REACH_PX)
    right = find_patches(texture.right.fine, both.right.fine, view.right_px, view.right_forms, reach_px=_FINE_REACH_PX)
    return _in_both(left, right, scale=1)


def _corrected(view: ExpectedView, found: Bool[np.ndarray, " patches"], pixels: StereoPixels) -> ExpectedView:
    """Return a prediction with the places of patches that move beside the scene as they were found."""
    left_px = view.left_px.copy()
    right_px = view.right_px.copy()
    beside = np.linalg.norm(pixels.left_px - left_px[found], axis=1) > _BESIDE_PX
    which = np.flatnonzero(found)[beside]
    left_px[which] = pixels.left_px[beside]
    right_px[which] = pixels.right_px[beside]
    return replace(view, left_px=left_px, right_px=right_px)


def _in_both(left: FoundPatches, right: FoundPatches, *, scale: int) -> tuple[Bool[np.ndarray, " p"], StereoPixels]:
    found = (left.likeness >= MIN_LIKENESS) & (right.likeness >= MIN_LIKENESS)
    return found, StereoPixels(
        left_px=left.places_px[found] * scale,
        right_px=right.places_px[found] * scale,
        left_px2=left.covariances_px2[found] * scale**2,
        right_px2=right.covariances_px2[found] * scale**2,
    )


def _visible(view: ExpectedView, shape: tuple[int, ...]) -> Bool[np.ndarray, " patches"]:
    """Return which patches should be in the left image."""
    x, y = view.left_px.T
    return np.asarray((x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0]))


def _enough(view: ExpectedView, found: Bool[np.ndarray, " patches"], pair: StereoPair) -> bool:
    visible = int(_visible(view, pair.left.shape).sum())
    return int(found.sum()) >= max(MIN_FOUND, MIN_FOUND_SHARE * visible)


def _problem(texture: SceneTexture, pair: StereoPair, both: _Both, found: Bool[np.ndarray, " patches"]) -> NotKnown:
    """Say why too few patches are found."""
    brightness = float(np.median(pair.left))
    counted = f"{int(found.sum())} of {len(found)} patches are found"
    cause: Cause
    if brightness < DARK_COUNTS:
        cause = "dark"
        reason = f"the picture is dark: half of it is below {brightness:.0f} counts; {counted}"
    elif found.sum() >= MIN_FOUND:
        cause = "several-motions"
        reason = f"{counted}, and no motion of one rigid body explains most of them"
    elif (sharpness := grain(both.left.fine) / texture.grain) < _BLURRED:
        cause = "blurred"
        reason = f"the picture is blurred: {sharpness:.0%} of the reference's contrast; {counted}"
    else:
        cause = "hidden"
        reason = f"the picture shows another scene than the reference: {counted}"
    return NotKnown(at_s=pair.at_s, cause=cause, reason=reason)


_BLURRED = 0.5
"""Fine contrast over that of the reference, below which a picture counts as blurred."""


class SceneFollower:
    """Follows a scene from pair to pair, beginning at the reference.

    Each pair is compared with the reference itself, so that errors do not add up. Where the scene is not
    near its last place, keypoints find it wherever it may be, which takes some 60 ms more.
    """

    def __init__(self, texture: SceneTexture, *, rng: np.random.Generator) -> None:
        self._texture = texture
        self._rng = rng
        self._expected = _Expected.of(texture, at_rest())

    def follow(self, pair: StereoPair) -> SceneSeen | NotKnown:
        """Find the texture of the reference in a pair, and how it moved."""
        require_sizes(pair, self._texture.cameras)
        both = _Both.of(pair)
        seen = _seen(self._texture, pair, both, self._expected, self._rng)
        if isinstance(seen, NotKnown) and seen.cause not in ("dark", "blurred"):
            near = motion_of_keypoints(self._texture.keypoints, pair.left, self._texture.cameras.left)
            if near is not None:
                seen = _seen(self._texture, pair, both, _Expected.of(self._texture, near), self._rng)
        if isinstance(seen, SceneSeen):
            self._expected = _Expected.after(seen)
        return seen
