"""Keypoints at known depths, by which a scene is found again after a large move of the camera, roughly.

SIFT (D. G. Lowe, Int. J. Comput. Vis. 60, 2004) in images of a quarter of the size, which have less noise, and the pose
of most matches (P3P and RANSAC, both of OpenCV).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from markerseek.core import Float32, Float64, UInt8
from markerseek.geometry import Camera, RangedPoints, RigidTransform, at_rest
from markerseek.vision.images import opencv

_PURPOSE = "finding a scene again"

MIN_MATCHES = 12
"""Fewest keypoints that must agree on a pose."""

_EDGE_PX = 32.0
"""Width of the edge of an image in which keypoints are left out."""

_KEYPOINTS = 600
_RATIO = 0.8
"""Largest distance of a match over that of the second nearest one, from Lowe's paper."""

_MISS_PX = 10.0
"""How far a keypoint may lie beside its expected place: its depth is that of the nearest patch."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Keypoints:
    """Keypoints of the reference's left image."""

    positions_m: Float64[np.ndarray, "keypoints 3"]
    """In the left camera's frame, at the depth of the nearest patch."""
    descriptors: Float32[np.ndarray, "keypoints 128"]


def ranged_keypoints(
    image: UInt8[np.ndarray, "rows columns"],
    camera: Camera,
    places_px: Float64[np.ndarray, "patches 2"],
    points: RangedPoints,
) -> Keypoints:
    """Return the keypoints of an image, with the depths of the patches nearest to them."""
    places, descriptors = _detected(image)
    if not len(places):
        return Keypoints(positions_m=np.empty((0, 3)), descriptors=descriptors)
    nearest = KDTree(places_px).query(places)[1]
    directions = np.concatenate([camera.undistort(places), np.ones((len(places), 1))], axis=1)
    return Keypoints(positions_m=directions / points.nearness_per_m[nearest][:, None], descriptors=descriptors)


def motion_of_keypoints(
    keypoints: Keypoints, image: UInt8[np.ndarray, "rows columns"], camera: Camera
) -> RigidTransform | None:
    """Return the motion since the reference on which most keypoints of the left image agree; None without any."""
    cv2 = opencv(_PURPOSE)
    places, descriptors = _detected(image)
    if min(len(places), len(keypoints.positions_m)) < MIN_MATCHES:
        return None
    matches = [
        first
        for first, second in cv2.BFMatcher(cv2.NORM_L2).knnMatch(keypoints.descriptors, descriptors, k=2)
        if first.distance < _RATIO * second.distance
    ]
    if len(matches) < MIN_MATCHES:
        return None
    then_m = keypoints.positions_m[[match.queryIdx for match in matches]]
    now = camera.undistort(places[[match.trainIdx for match in matches]])
    found, turn, shift, agreeing = cv2.solvePnPRansac(
        then_m,
        now,
        np.eye(3),
        None,
        reprojectionError=_MISS_PX / camera.focal_px[0],
        iterationsCount=200,
        flags=cv2.SOLVEPNP_P3P,
    )
    if not found or agreeing is None or len(agreeing) < MIN_MATCHES:
        return None
    rest = at_rest()
    return RigidTransform(
        source=rest.source, target=rest.target, rotation=cv2.Rodrigues(turn)[0], translation_m=shift.ravel()
    )


def _detected(
    image: UInt8[np.ndarray, "rows columns"],
) -> tuple[Float64[np.ndarray, "keypoints 2"], Float32[np.ndarray, "keypoints 128"]]:
    cv2 = opencv(_PURPOSE)
    small = cv2.pyrDown(cv2.pyrDown(image))
    found, descriptors = cv2.SIFT_create(nfeatures=_KEYPOINTS, contrastThreshold=0.01).detectAndCompute(small, None)
    if descriptors is None:
        return np.empty((0, 2)), np.empty((0, 128), dtype=np.float32)
    # pyrDown's pixel i has its middle at 2 i. At the very edge, a calibration may not hold.
    places = 4.0 * np.array([each.pt for each in found]).reshape(-1, 2)
    inner = ((places >= _EDGE_PX) & (places <= np.array(image.shape[::-1]) - _EDGE_PX)).all(axis=1)
    return places[inner], descriptors[inner]
