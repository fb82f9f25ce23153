"""Whether a marker that was measured again has moved since it was taken."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from markerseek.core import SpotToSource
from markerseek.registration.choice import SeenMarker, chosen_pairs
from markerseek.registration.report import registered_pairs
from markerseek.registration.steps import MovedMarker, TakenMarker

_MOVED_CHI_SQUARED = 16.27
"""Chi squared of three degrees of freedom that is exceeded by chance in one of 1,000."""


def marker_movement(
    first: TakenMarker,
    again: TakenMarker,
    markers: Sequence[SeenMarker],
    *,
    chosen: Mapping[str, int],
    spot: SpotToSource,
) -> MovedMarker:
    """Return how far a marker has moved from where the registration and its spot say that it is now.

    ``first``, ``again``: the marker as it was taken, and measured again. ``markers``: all of the session, in the frame
    of the camera as it stood then. ``chosen``: those of the registration, with the number of the candidate. ``spot``:
    where the light of a spot is absorbed.
    """
    then = next(marker for marker in markers if marker.name == first.name)
    transform = registered_pairs(chosen_pairs(markers, chosen), spot=spot).transform
    spots_m = transform.apply(np.array([then.camera_m, again.camera_m]))
    was = first.candidates[chosen[first.name]].position
    now = again.candidates[0].position
    apart_m = (np.array(now.position_m) - np.array(was.position_m)) - (spots_m[1] - spots_m[0])
    camera = then.camera_covariance_m2 + np.array(again.camera_covariance_m2)
    covariance = was.covariance_m2 + now.covariance_m2 + transform.rotation @ camera @ transform.rotation.T
    moved_m = float(np.linalg.norm(apart_m))
    chi_squared = float(apart_m @ np.linalg.solve(covariance, apart_m))
    sigma_m = math.sqrt(float(np.trace(covariance)))
    moved = chi_squared > _MOVED_CHI_SQUARED
    verdict = (
        "it has moved: register again, with the tissue held still" if moved else "it has not moved by more than that"
    )
    said = f"marker {first.name} is {1e3 * moved_m:.2f} ± {1e3 * sigma_m:.2f} mm from where it was: {verdict}"
    return MovedMarker(name=first.name, moved_m=moved_m, sigma_m=sigma_m, moved=moved, said=said)
