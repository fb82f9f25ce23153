"""The compiled kernels, loaded before a search begins: from disk they take a quarter of a second."""

from __future__ import annotations

from functools import lru_cache

from markerseek.core import PAPER_RANGE, Reading
from markerseek.core.reading import Sample
from markerseek.search.floor import noise_of
from markerseek.search.posterior.choice import most_telling_deg
from markerseek.search.posterior.gathering import Evidence
from markerseek.search.posterior.shapes import Shapes


@lru_cache(maxsize=1)
def load_kernels(shapes: Shapes, *, cues: frozenset[str], floor: float) -> None:
    """Decide once on three made-up samples, so that no decision of a search waits for machine code.

    Parameters
    ----------
    shapes, cues, floor
        What the searches will use; see `Evidence` and `most_telling_deg`.
    """
    heard = [
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
    belief = Evidence(limits=PAPER_RANGE, shapes=shapes, cues=cues).belief(heard, noise_of(heard), particles=8)
    most_telling_deg(belief, shapes, [sample.angle_deg for sample in heard], limits=PAPER_RANGE, floor=floor)
