"""Fig. 9: the tip of an instrument in simulated B-mode images, and its sensitive range by the paper's protocol."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.acoustics import Probe
from markerseek.core import SearchError
from markerseek.pictures import tip_figure
from markerseek.sim import BModeSettings, BModeWorld
from markerseek.studies.paper.methods import RunOptions
from markerseek.studies.paper.printed import SENSITIVE_DEG, paper_number
from markerseek.studies.paper.section import Comparison, Section, make_section, make_table
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

SIZES_M = (3e-3, 5e-3, 8e-3)
"""Diameter of the tip: a needle driver's jaw, the tip of a larger tool, and the shaft of all."""

Tip: TypeAlias = tuple[float, float]
"""Diameter of a tip in metres, and its echo over the mean of the tissue in dB."""

_SHOWN: Tip = (BModeSettings().tip_m, BModeSettings().tip_db)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Series:
    """Images of one tip at one position, and what was found in them."""

    tip: Tip
    place: int
    images: list[np.ndarray]
    found: SensitiveRange


def fig9(options: RunOptions) -> Section:
    """Fig. 9: sensitive range of the tip at three positions."""
    # A reduced report has the size assumed beforehand only.
    sizes_m = SIZES_M if options.share > 0.2 else _SHOWN[:1]
    jobs = [((tip_m, tip_db), place) for tip_m in sizes_m for tip_db in LEVELS_DB for place in range(len(PLACES_M))]
    series = options.each(partial(_series, seed=options.seed), jobs, stage="fig9, B-mode images")
    shown = [each for each in series if each.tip == _SHOWN]
    halves: dict[Tip, list[float]] = {}
    for each in series:
        # 0 where the tip was not seen at all.
        halves.setdefault(each.tip, []).append(each.found.half_deg or 0.0)
    means = {tip: float(np.mean(halves_deg)) for tip, halves_deg in halves.items()}
    paper, (tip_m, tip_db) = paper_number("sensitive"), _SHOWN
    nearest = min(means, key=lambda tip: abs(means[tip] - SENSITIVE_DEG))
    ranges = (
        (
            1e3 * each.tip[0], each.tip[1], 1e3 * PLACES_M[each.place], each.found.half_deg, each.found.full_deg,
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
                ours=means[tip],
                sd=float(np.std(halves_deg, ddof=1)),
                condition=f"tip of {1e3 * tip[0]:g} mm, {tip[1]:g} dB over the tissue",
            )
            for tip, halves_deg in halves.items()
        ),
        tables=(
            make_table(
                "fig9_ranges",
                "Half of the sensitive range at each position",
                "tip_mm tip_over_tissue_db x_mm half_range_deg full_range_deg at_least",
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
            "tip_mm": 1e3 * tip_m,
            "tip_db": tip_db,
            "ours": means[_SHOWN],
            "paper": str(paper),
            "least": min(means.values()),
            "most": max(means.values()),
            "nearest_mm": 1e3 * nearest[0],
            "nearest_db": nearest[1],
            "nearest": means[nearest],
        },
    )


def _series(job: tuple[Tip, int], *, seed: int) -> _Series:
    tip, place = job
    x_m = PLACES_M[place]
    reference_deg = math.degrees(math.atan2(x_m, HEIGHT_M))
    # One seed for each position: the tissue is the same for all tips.
    rng = np.random.Generator(np.random.PCG64([seed, 9, place]))
    settings = BModeSettings(tip_m=tip[0], tip_db=tip[1])
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
    return _Series(tip=tip, place=place, images=images, found=found)


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
