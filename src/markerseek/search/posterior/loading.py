"""Loads the compiled kernels and the family of curves before a search, so that no decision waits for them."""

from __future__ import annotations

from functools import lru_cache

from markerseek.core import PAPER_RANGE, Reading, Sample
from markerseek.search.floor import noise_of
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.next_angle import most_informative_deg
from markerseek.search.posterior.shapes import Shapes, family


@lru_cache(maxsize=1)
def loaded_family() -> Shapes:
    """Return the family of curves, after one decision on three synthetic samples, which loads the kernels."""
    shapes = family()
    # From disk they take a quarter of a second.
    lit = [
        Sample(
            angle_deg=angle_deg,
            reading=Reading(
                intensity=intensity,
                lateral_m=0.0,
                centroid_s=33e-6,
                spread_s=0.2e-6,
                noise_sigma=1.0,
                cells=10_000,
                coherence=0.9,
            ),
        )
        for angle_deg, intensity in ((-5.0, 20.0), (0.0, 60.0), (5.0, 20.0))
    ]
    inference = Inference(limits=PAPER_RANGE, shapes=shapes, cues=frozenset({"intensity", "arrival", "lateral"}))
    posterior = inference.posterior(lit, noise_of(lit), particles=8)
    most_informative_deg(posterior, shapes, [0.0], limits=PAPER_RANGE, floor=4.0)
    return shapes
