"""Error and rotation of the paper's bracket searches without noise, for markers spread evenly over ±35°.

``python docs/validation/measure_brackets.py`` (seconds). The angles of such a search follow from the marker's angle
alone: of two angles the one nearer to the marker is the stronger, on every symmetric unimodal curve. The paper prints
4.2° (TS) and 5.89° (GSS) after 2 acquisitions, and 36° and 24° of rotation in 16; neither can be had.
"""

from __future__ import annotations

import sys

import numpy as np

from markerseek.core import PAPER_RANGE, Reading, Sample, SearchPlan
from markerseek.search import build

MARKERS, SEED = 1000, 1


def search(method: str, marker_deg: float, *, acquisitions: int) -> tuple[list[float], float]:
    """Angles of one search in order, and its answer, in degrees."""
    policy = build(SearchPlan(method=method, acquisitions=acquisitions, as_published=True), limits=PAPER_RANGE)
    angles_deg: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        angles_deg.append(angle_deg)
        # Any curve that falls with the distance: bracket searches only compare intensities.
        reading = Reading(intensity=1.0 / (1.0 + (angle_deg - marker_deg) ** 2))
        policy.tell(Sample(angle_deg=angle_deg, reading=reading))
    return angles_deg, policy.estimate().mean_deg


def shortest_deg(angles_deg: list[float]) -> float:
    """Least rotation over these pairs of angles, each pair in either order; no search can know the best order."""
    # Length of the shortest way that ends at an angle.
    ways = dict.fromkeys(angles_deg[:2], 0.0)
    for left, right in zip(angles_deg[::2], angles_deg[1::2], strict=True):
        ways = {
            last: min(way + abs(first - here) for here, way in ways.items()) + abs(last - first)
            for first, last in ((left, right), (right, left))
        }
    return min(ways.values())


def main() -> None:
    """Print the table."""
    rng = np.random.Generator(np.random.PCG64(SEED))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, MARKERS).tolist()
    for method in ("ternary", "golden-section"):
        for acquisitions in (2, 16, 28):
            found = [search(method, at, acquisitions=acquisitions) for at in markers_deg]
            error_deg = np.mean([abs(answer - at) for (_, answer), at in zip(found, markers_deg, strict=True)])
            turned_deg = np.mean([np.abs(np.diff(angles)).sum() for angles, _ in found])
            least_deg = np.mean([shortest_deg(angles) for angles, _ in found])
            sys.stdout.write(
                f"{method:15} {acquisitions:3d} acquisitions: mean error {error_deg:.3f} deg, rotation "
                f"{turned_deg:.0f} deg, in the best order of each pair {least_deg:.0f} deg\n"
            )


if __name__ == "__main__":
    main()
