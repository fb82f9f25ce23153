"""An independent check: a spot that took no part in a registration shows the error at it, beside the expected one.

The error is the distance between where the probe found the source of the spot and where the transform puts it: what
anybody finds who uses the transform at that spot. Expected is the length of that distance by all that is known of it:
the errors of the transform, those that all points share, those of both measurements of the spot, and the offset
between spot and source.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.core import Float64, SpotToSource, as_vector
from markerseek.geometry import ErrorLength, Registration, effect_of_motion
from markerseek.registration.report import PointPair, SpotCheck, motion_m, registered_pairs
from markerseek.registration.shared_errors import source_shared_m, sources_m, trus_shared_m


def check_spot(pair: PointPair, pairs: Sequence[PointPair], *, spot: SpotToSource) -> SpotCheck:
    """Compare a point with where the registration of other points puts it.

    ``pair``: the point, with covariances and shared errors, seen where the camera stands now. ``pairs``: those that are
    registered, as of `register_pairs`, in the frame of the camera as it stands now. ``spot``: where the light of a spot
    is absorbed.
    """
    found = registered_pairs(pairs, spot=spot)
    source_m = sources_m(pair.camera_m[None], spot)[0]
    transformed_m = found.transform.apply(source_m)
    shared_m = _shared_m(pair, found, spot, motions=motion_m(pairs).shape[2])
    error = _expected(pair, found, transformed_m, shared_m)
    off_m = float(np.linalg.norm(transformed_m - pair.trus_m))
    return SpotCheck(
        name=pair.name,
        trus_m=as_vector(pair.trus_m),
        camera_m=as_vector(pair.camera_m),
        transformed_m=as_vector(transformed_m),
        off_m=off_m,
        expected_m=error.rms_m,
        expected95_m=error.quantile_m(0.95),
        exceeded=error.exceeded(off_m),
    )


def _shared_m(
    pair: PointPair, found: Registration, spot: SpotToSource, *, motions: int
) -> Float64[np.ndarray, "3 errors"]:
    """Return the change of the distance by one standard deviation of each error that all points share.

    In the order of `registered_pairs`. No motion of the endoscope displaces a spot that is seen where it stands now.
    """
    camera_m = pair.camera_m[None]
    seen = None if pair.camera_shared_m is None else pair.camera_shared_m[None]
    from_camera = np.concatenate([source_shared_m(camera_m, seen, spot)[0], np.zeros((3, motions))], axis=1)
    return np.concatenate([-found.transform.rotation @ from_camera, trus_shared_m(pair.trus_m[None])[0]], axis=1)


def _expected(
    pair: PointPair,
    found: Registration,
    transformed_m: Float64[np.ndarray, " 3"],
    shared_m: Float64[np.ndarray, "3 errors"],
) -> ErrorLength:
    """Return the distribution of the distance.

    With the estimate of the shared errors s, their displacement B of this point, the displacement J by an error of the
    transform, and the covariance C of both errors, the distance is a vector of mean −B s and covariance
    (J B) C (J B)ᵀ + N, where N is that of both measurements and of the offset.
    """
    assert pair.camera_covariance_m2 is not None and pair.trus_covariance_m2 is not None  # noqa: S101, PT018  of a search
    rotation = found.transform.rotation
    motion = effect_of_motion((transformed_m - found.errors.middle_m)[None])[0]
    effect = np.concatenate([motion, shared_m], axis=1)
    own = rotation @ pair.camera_covariance_m2 @ rotation.T + pair.trus_covariance_m2
    offset_m2 = (found.offset_sigma_m or 0.0) ** 2 * np.eye(3)
    return ErrorLength.of(
        found.errors.weights,
        effect @ found.errors.covariances @ effect.T + own + offset_m2,
        mean_m=-shared_m @ found.shared,
    )
