"""An independent check of a registration: the error at a spot that took no part, beside the one that was expected."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.registration.forged_markers import ForgedScene
from markerseek.core import SpotToSource
from markerseek.registration import SpotCheck
from markerseek.registration.choice import SeenMarker
from markerseek.registration.report import registered_pairs
from markerseek.registration.spot_check import check_spot

# What the forged probe hears is the spot itself.
AT_THE_SPOT = SpotToSource(depth_m=0.0, depth_sigma_m=0.0)


def markers(seed: int, *, heard_off_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[SeenMarker]:
    """Five markers and a sixth; the probe finds the sixth beside its spot."""
    scene = ForgedScene(seed)
    spots_m = [*scene.wide(5), scene.place(10e-3, 10e-3)]
    heard_m = [*spots_m[:5], spots_m[5] + np.array(heard_off_m)]
    return [
        scene.seen(str(number), spot_m, [scene.candidate(source_m)])
        for number, (spot_m, source_m) in enumerate(zip(spots_m, heard_m, strict=True), start=1)
    ]


def check(seed: int, *, heard_off_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SpotCheck:
    *those, last = (marker.pair(0) for marker in markers(seed, heard_off_m=heard_off_m))
    return check_spot(last, those, spot=AT_THE_SPOT)


def test_the_error_is_the_distance_from_where_the_transform_puts_the_spot() -> None:
    found = check(1)
    *those, last = (marker.pair(0) for marker in markers(1))
    there_m = registered_pairs(those, spot=AT_THE_SPOT).transform.apply(last.camera_m)
    assert found.transformed_m == pytest.approx(there_m, abs=1e-12)
    assert found.trus_m == pytest.approx(last.trus_m, abs=1e-12)
    assert found.off_m == pytest.approx(np.linalg.norm(there_m - last.trus_m), rel=1e-9)
    assert 0 < found.expected_m < found.expected95_m
    assert found.said.startswith(f"off by {1e3 * found.off_m:.2f} mm at this spot; ")


def test_as_many_errors_are_below_the_expected_ones_as_is_said() -> None:
    checks = [check(seed) for seed in range(200)]
    below = np.mean([each.off_m <= each.expected95_m for each in checks])
    assert 0.93 <= below <= 1.0
    assert np.mean([each.exceeded <= 0.5 for each in checks]) == pytest.approx(0.5, abs=0.15)
    # One in 1,000 is refuted by chance.
    assert sum(not each.agrees for each in checks) <= 2
    # The errors of the transform, of both measurements and of those that are shared: not much more than there is.
    rms_m = np.sqrt(np.mean([each.off_m**2 for each in checks]))
    assert rms_m == pytest.approx(np.sqrt(np.mean([each.expected_m**2 for each in checks])), rel=0.25)


def test_a_source_five_millimetres_beside_the_spot_refutes_the_registration() -> None:
    checks = [check(seed, heard_off_m=(3e-3, 4e-3, 0.0)) for seed in range(20)]
    assert not any(each.agrees for each in checks)
    assert all("the registration does not hold there; light one more marker" in each.said for each in checks)
    assert np.mean([each.off_m for each in checks]) == pytest.approx(5e-3, rel=0.15)
