"""Horn's closed form: the rotation between two sets of points, from unit quaternions.

B. K. P. Horn, "Closed-form solution of absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4 (1987).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import Float64


def best_rotation(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    weights: Float64[np.ndarray, " points"],
) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
    """Rotation R and translation t, in metres, that minimise Σ w ‖R p + t − q‖².

    ``source_m``, ``target_m``: the points p and q, at least three that are not on a line (`register_points` checks
    that). ``weights``: weight of each point, positive.
    """
    share = weights / weights.sum()
    from_middle, to_middle = share @ source_m, share @ target_m
    s = np.einsum("n,ni,nj->ij", share, source_m - from_middle, target_m - to_middle)
    # Horn's eq. for the 4 x 4 matrix N; its eigenvector with the largest eigenvalue is the quaternion (w, x, y, z).
    cross = np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])
    n = np.empty((4, 4))
    n[0, 0] = np.trace(s)
    n[0, 1:] = n[1:, 0] = cross
    n[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    # eigh sorts the eigenvalues in rising order; SciPy has the scalar last.
    w, x, y, z = np.linalg.eigh(n)[1][:, -1]
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    return rotation, to_middle - rotation @ from_middle


def mirror_image_fre(source_m: Float64[np.ndarray, "points 3"], target_m: Float64[np.ndarray, "points 3"]) -> float:
    """Root mean square residual, in metres, of the best fit with a mirror image of the source points.

    Every improper rotation is a rotation of the points reflected through the origin. For points in a plane, as any
    three are, it is the same as that of the best fit without reflection.
    """
    even = np.ones(len(source_m))
    rotation, translation_m = best_rotation(-source_m, target_m, even)
    residual = -source_m @ rotation.T + translation_m - target_m
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
