"""One run as all viewers see it: its views so far and its images, and the plain values that their browsers are sent."""

from __future__ import annotations

import base64
import gc
import math
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from msgspec import structs

from markerseek.bridges.run_images import PicturedEntry
from markerseek.core import NO_HEADER, ChannelFrame, Measured, PaImage, Sample, UInt8
from markerseek.records.journal import Configuration, RunView
from markerseek.show import RANGE_DB, DrawnCurve, event_line, grey_levels, with_minus
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset

SAME_ANGLE_DEG = 0.02
"""Distance of two readbacks of one angle, in degrees."""


class RunHistory:
    """The views and images of one run; one thread adds entries, others read.

    ``configuration``: plan and rig of the run.
    """

    def __init__(self, configuration: Configuration) -> None:
        # Only ever appended to, so that another thread may read it at any time.
        self.views: list[RunView] = [RunView.of(configuration)]
        self.pictures: dict[int, Picture] = {}
        plan = configuration.plan
        recipe = msgspec.json.decode(configuration.recipe) or {}
        self.pulse_j: float | None = recipe.get("settings", {}).get("laser", {}).get("pulse_energy_j")
        forms = (("as published", plan.as_published), ("sweeping", plan.sweep_speed_deg_s is not None))
        seed = [] if recipe.get("seed") is None else [f"seed {recipe['seed']}"]
        self.name = ", ".join([plan.method, *(form for form, holds in forms if holds), *seed])

    @property
    def last(self) -> RunView:
        """The newest view."""
        return self.views[-1]

    def add(self, item: PicturedEntry) -> None:
        """Take one more entry with its image; it can be shown before its image can."""
        event = item.entry.event
        self.views.append(self.last.add_entry(item.entry))
        if item.image is not None and isinstance(event, Measured) and not event.sample.dark:
            self.pictures[self.last.number] = picture_of(event.sample, item.image)

    def cut_off(self, reason: str, *, problem: str = "") -> None:
        """Note that no more events will come, though the run has not said that it is over; see `RunView.cut_off`."""
        self.views.append(self.last.cut_off(reason, problem=problem))

    def picture(self, view: RunView) -> Picture | None:
        """Return the newest image of the angle where the probe is; if there is none, the newest of another angle."""
        seen = [self.pictures[number] for number in sorted(self.pictures) if number <= view.number]
        here = [each for each in seen if is_image_of(each, view)]
        return next(reversed(here or seen), None)

    def lines(self, view: RunView, *, most: int) -> list[str]:
        """Return the last lines of the log up to a view, the newest first."""
        # A move is a line until its acquisition replaces it, and a pulse of a sweep until the next.
        passing = {"dark", "moving", "turning", "sweeping"}
        known = [each for each in self.views[1 : view.number + 1] if each.phase not in passing or each is view]
        return [f"{each.elapsed_s:6.1f} s  {event_line(each)}" for each in reversed(known[-most:])]


def is_image_of(picture: Picture, view: RunView) -> bool:
    """Return whether an image is of the angle where the probe is."""
    if view.probe_deg is None or view.target_deg is not None:
        return False
    return abs(picture.angle_deg - view.probe_deg) <= SAME_ANGLE_DEG


def warm_up() -> None:
    """Load the compiled kernels of images, which takes a second, before the first search needs them."""
    preset = probe_preset(PRESET_NAMES[0])
    samples = np.zeros((preset.array.elements, 2080), dtype=np.int16)
    ImageReader(preset).picture(ChannelFrame(header=NO_HEADER, samples=samples, sampling_hz=preset.sampling_hz))
    # A page runs for days: what its updates leave behind is collected as often as usual in Python, and not as rarely as
    # in a command. What has been loaded by now is passed over, so that this costs little.
    gc.freeze()
    gc.set_threshold(700)


BRIGHT_SIGMAS = 100.0
"""Brightest level over σ where the frame has nothing stronger: noise alone must look like noise."""

_MAX_ROWS = 200
"""Rows of a photoacoustic image that is sent: a screen shows no more."""


# eq=False: two images are compared often, and never equal unless they are the same.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """The image of an acquisition as it is sent."""

    angle_deg: float
    """Angle of the probe, in degrees."""
    intensity: float
    """Intensity of the reading."""
    drawn: dict[str, Any]
    """What the browser draws: ``pixels``, levels from 0 to 255, row after row, base64, where level 0 is `RANGE_DB`
    below the brightest, or less; numbers of ``rows`` and ``columns``; outer edges ``lateral_mm`` and ``depth_mm``."""
    peak_mm: tuple[float, float] | None
    """Lateral position and depth of the largest envelope; None if the reading has none."""


def picture_of(sample: Sample, image: PaImage) -> Picture:
    """Return the image of an acquisition as it is sent."""
    reading = sample.reading
    brightest = max(float(image.envelope.max()), BRIGHT_SIGMAS * (reading.noise_sigma or 0.0))
    together = _rows_together(image)
    geometry = image.geometry
    pooled = structs.replace(
        geometry,
        first_depth_m=geometry.position_m(row=(together - 1) / 2, column=0)[1],
        depth_step_m=together * geometry.depth_step_m,
    )
    levels = pooled_levels(image, brightest=brightest)
    rows, columns = levels.shape
    left, right, bottom, top = pooled.edges_mm(rows, columns)
    placed = reading.lateral_m is not None and reading.depth_m is not None
    return Picture(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        drawn={
            "pixels": base64.b64encode(levels.tobytes()).decode("ascii"),
            "rows": rows,
            "columns": columns,
            "lateral_mm": (left, right),
            "depth_mm": (top, bottom),
        },
        peak_mm=(1e3 * (reading.lateral_m or 0.0), 1e3 * (reading.depth_m or 0.0)) if placed else None,
    )


def pooled_levels(image: PaImage, *, brightest: float) -> UInt8[np.ndarray, "rows columns"]:
    """Return the levels of an image; several rows become one that holds their largest value, so that peaks are kept.

    ``brightest``: envelope of level 255, in the image's unit.
    """
    starts = np.arange(0, image.envelope.shape[0], _rows_together(image))
    return grey_levels(np.maximum.reduceat(image.envelope, starts, axis=0), brightest=brightest)


def _rows_together(image: PaImage) -> int:
    """Return how many rows of an image become one."""
    return int(-(-image.envelope.shape[0] // _MAX_ROWS))


def fan_model(view: RunView, curve: DrawnCurve) -> dict[str, Any]:
    """Return what the browser draws of the probe, seen from its end: a curve over the angle, and where the probe is."""
    belief = view.belief
    choice_deg = () if belief is None else belief.choice_deg
    sigmas_deg = () if belief is None else belief.choice_sigma_deg
    least_deg = min(sigmas_deg, default=0.0)
    return {
        "curve": msgspec.to_builtins(curve),
        "probe_deg": view.probe_deg,
        "target_deg": view.target_deg,
        "said": probe_text(view),
        "text": _fan_text(view, curve),
        "certainty": _certainty(curve),
        # Where a next acquisition was weighed up: the smaller the expected uncertainty, the larger the share.
        "choices": [(at_deg, least_deg / sigma_deg) for at_deg, sigma_deg in zip(choice_deg, sigmas_deg, strict=True)],
    }


def _fan_text(view: RunView, curve: DrawnCurve) -> str:
    """Return the fan for those who do not see it."""
    if view.probe_deg is None:
        return "probe from its end: nothing is known yet"
    goes = "" if view.target_deg is None else f", on its way to {view.target_deg:.1f}°"
    answer = f"; {curve.answer_text}" if curve.answer_text else ""
    return with_minus(f"probe from its end: at {view.probe_deg:.2f}°{goes}{answer}")


def _certainty(curve: DrawnCurve) -> float:
    """Return the certainty of the angle: 0 if the marker may be anywhere, 1 within a hundredth of the range."""
    if curve.most_per_deg <= 0:
        return 0.0
    return min(1.0, max(0.0, math.log10(curve.most_per_deg * (curve.high_deg - curve.low_deg)) / 2))


def probe_text(view: RunView) -> str:
    """Return where the probe is, and whether that was measured."""
    if view.probe_deg is None:
        return ""
    if view.target_deg is not None:
        return with_minus(f"expected, on its way to {view.target_deg:.2f}°")
    # A move that was cut short has ended anywhere.
    last = "last " if view.phase in {"stopped", "fault", "cut off", "checking"} else ""
    return with_minus(f"{last}read back: {view.probe_deg:.2f}°")


def image_model(picture: Picture | None, *, floor: float | None) -> dict[str, Any]:
    """Return the image, if there is one; its peak is marked only above the detection threshold, if that is known."""
    if picture is None:
        return {"pixels": ""}
    peak = picture.peak_mm if floor is None or picture.intensity > floor else None
    return picture.drawn | {"deg": picture.angle_deg, "peak": peak}


def image_texts(picture: Picture | None, *, elsewhere: bool) -> tuple[str, str]:
    """Return the title and note of the image: the angle of the probe, and what is drawn."""
    if picture is None:
        return "photoacoustic image", ""
    title = with_minus(f"{'last image:' if elsewhere else 'image of'} {picture.angle_deg:.2f}°")
    return title, f"photoacoustic, {RANGE_DB:g} dB; ring: its peak"
