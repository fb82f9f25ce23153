"""Fig. 9: the tip of an instrument in simulated B-mode images, and its sensitive range by the paper's protocol."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from markerseek.acoustics import Probe
from markerseek.core import SearchError
from markerseek.show import tip_figure
from markerseek.sim import BModeSettings, BModeWorld
from markerseek.studies.paper.methods import RunOptions
from markerseek.studies.paper.section import Comparison, Section, make_section, make_table, paper_number
from markerseek.studies.summary import Mean
from markerseek.vision import SensitiveRange, published_sensitive_range

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLACES_M = (-20e-3, 0.0, 20e-3)
"""Positions of the tip across the axis of rotation, 2 cm apart as in the paper."""

HEIGHT_M = 60e-3
"""Height of the tip over the axis of rotation: 5 cm over the face of the array."""

STEPS = 11
"""Images of one position, a degree apart, from the reference on."""

LEVELS_DB = (20.0, 30.0, 40.0)
"""Echo of the tip over the mean of the tissue; unknown of the paper's set-up."""

SHOWN_DB = BModeSettings().tip_db
"""Echo in the picture: the value assumed beforehand."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Series:
    """Images of a tip at one position, and what was found in them."""

    tip_db: float
    place: int
    images: list[np.ndarray]
    found: SensitiveRange


def fig9(options: RunOptions) -> Section:
    """Fig. 9: sensitive range of the tip at three positions, for three strengths of its echo."""
    jobs = [(tip_db, place) for tip_db in LEVELS_DB for place in range(len(PLACES_M))]
    series = options.each(partial(_series, seed=options.seed), jobs, stage="fig9, B-mode images")
    shown = [each for each in series if each.tip_db == SHOWN_DB]
    # 0 where the tip was not seen at all.
    halves = {
        tip_db: Mean.of([each.found.half_deg or 0.0 for each in series if each.tip_db == tip_db])
        for tip_db in LEVELS_DB
    }
    means = [half.mean or 0.0 for half in halves.values()]
    paper = paper_number("sensitive")
    ranges = (
        (
            each.tip_db, 1e3 * PLACES_M[each.place], each.found.half_deg, each.found.full_deg,
            "yes" if each.found.open_above else "no",
        )
        for each in series
    )  # fmt: skip
    curves = (
        (
            1e3 * PLACES_M[each.place], frame.angle_deg, frame.tip.intensity, frame.tip.level, frame.tip.area_px,
            "yes" if frame.tip.visible else "no",
        )
        for each in shown
        for frame in each.found.frames
        if frame.tip is not None
    )  # fmt: skip
    return make_section(
        "fig9",
        comparisons=tuple(
            Comparison(
                paper=paper,
                ours=half.mean or 0.0,
                sd=half.sd,
                condition=f"tip {tip_db:g} dB over the tissue",
            )
            for tip_db, half in halves.items()
        ),
        tables=(
            make_table(
                "fig9_ranges",
                "Half of the sensitive range at each position",
                "tip_over_tissue_db x_mm half_range_deg full_range_deg at_least",
                ranges,
            ),
            make_table(
                "fig9",
                "Grey value of the tip over the angle from the reference",
                "x_mm angle_deg grey_value must_exceed region_px seen",
                curves,
                shown=False,
            ),
        ),
        draw=partial(_draw, shown[len(PLACES_M) // 2]),
        results={
            "last": STEPS - 1,
            "tip_mm": 1e3 * BModeSettings().tip_m,
            "tip_db": SHOWN_DB,
            "ours": halves[SHOWN_DB].mean,
            "paper": str(paper),
            "least": min(means),
            "most": max(means),
        },
    )


def _series(job: tuple[float, int], *, seed: int) -> _Series:
    tip_db, place = job
    x_m = PLACES_M[place]
    reference_deg = math.degrees(math.atan2(x_m, HEIGHT_M))
    # One seed for each position: the tissue is the same for all echoes.
    rng = np.random.Generator(np.random.PCG64([seed, 9, place]))
    settings = BModeSettings(tip_db=tip_db)
    world = BModeWorld(
        settings=settings,
        probe=Probe(),
        tip_deg=reference_deg,
        tip_radius_m=math.hypot(x_m, HEIGHT_M),
        tip_lateral_m=2e-3,
        present=True,
        start_deg=reference_deg,
        rng=rng,
    )
    images = []
    for step in range(STEPS):
        world.angle_deg = reference_deg + step
        images.append(world.pixels())
    # Angles from the reference, as the paper counts them.
    found = published_sensitive_range(
        [float(step) for step in range(STEPS)], images, pixel_m=(settings.pixel_m, settings.pixel_m)
    )
    return _Series(tip_db=tip_db, place=place, images=images, found=found)


def _draw(series: _Series) -> Figure:
    if series.found.half_deg is None:
        raise SearchError("fig9: the tip of the picture was not seen; that is a defect")
    paper = paper_number("sensitive")
    return tip_figure(
        series.found.frames,
        series.images,
        title=f"Tool tip in simulated B-mode: seen up to {series.found.half_deg:g}° off the plane (paper: {paper})",
        low_deg=0.0,
        high_deg=series.found.half_deg,
    )
