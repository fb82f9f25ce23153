"""One run as all viewers see it: its views so far and its images."""

from __future__ import annotations

import gc
from dataclasses import replace

import msgspec
import numpy as np

from markerseek.bridges.page.image_bytes import Picture, picture_of
from markerseek.bridges.run_images import RunImages
from markerseek.core import NO_HEADER, ChannelFrame, Measured, ReadingFrame, Sample
from markerseek.records.journal import Configuration, JournalEvent
from markerseek.runs import RunView
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset

SAME_ANGLE_DEG = 0.02
"""Distance of two readbacks of one angle, in degrees."""


class RunHistory:
    """The views and images of one run; one thread adds events, others read.

    ``configuration``: plan and rig of the run. ``pictures``: whether its images are formed.
    """

    def __init__(self, configuration: Configuration, *, pictures: bool = True) -> None:
        # Only ever appended to, so that another thread may read it at any time.
        self.views: list[RunView] = [RunView.of(configuration)]
        self.pictures: dict[int, Picture] = {}
        self._images = RunImages(configuration) if pictures else None
        plan, recipe = configuration.plan, msgspec.json.decode(configuration.recipe) or {}
        self.pulse_j: float | None = recipe.get("settings", {}).get("laser", {}).get("pulse_energy_j")
        forms = (("as published", plan.as_published), ("sweeping", plan.sweep_speed_deg_s is not None))
        seed = [] if recipe.get("seed") is None else [f"seed {recipe['seed']}"]
        self.name = ", ".join([plan.method, *(form for form, holds in forms if holds), *seed])

    @property
    def last(self) -> RunView:
        """The newest view."""
        return self.views[-1]

    def add(self, event: JournalEvent, *, clock_s: float) -> None:
        """Take one more event; it can be shown before its image can."""
        sample = event.sample if isinstance(event, Measured) else None
        if isinstance(event, Measured) and sample is not None:
            event = replace(event, sample=_without_counts(sample))
        self.views.append(self.last.add(event, clock_s=clock_s))
        if self._images is not None and sample is not None and not sample.dark:
            image = self._images.of(sample)
            if image is not None:
                self.pictures[self.last.number] = picture_of(sample, image)

    def cut_off(self, reason: str, *, problem: str = "") -> None:
        """Note that no more events will come, though the run has not said that it is over; see `RunView.cut_off`."""
        self.views.append(self.last.cut_off(reason, problem=problem))

    def picture(self, view: RunView) -> Picture | None:
        """The newest image of the angle where the probe is; if there is none, the newest of another angle."""
        seen = [self.pictures[number] for number in sorted(self.pictures) if number <= view.number]
        here = [each for each in seen if is_image_of(each, view)]
        return next(reversed(here or seen), None)

    def lines(self, view: RunView, *, most: int) -> list[str]:
        """The last lines of the log up to a view, the newest first."""
        # A move is a line until its acquisition replaces it, and a pulse of a sweep until the next.
        passing = {"dark", "moving", "turning", "sweeping"}
        known = [each for each in self.views[1 : view.number + 1] if each.phase not in passing or each is view]
        return [f"{each.elapsed_s:6.1f} s  {each.line}" for each in reversed(known[-most:])]


def _without_counts(sample: Sample) -> Sample:
    """The sample with the header of its frame: all samples are kept, and the counts have half a megabyte."""
    if sample.frame is None:
        return sample
    return replace(sample, frame=ReadingFrame(header=sample.frame.header, intensity=sample.reading.intensity))


def is_image_of(picture: Picture, view: RunView) -> bool:
    """Whether an image is of the angle where the probe is."""
    if view.probe_deg is None or view.target_deg is not None:
        return False
    return abs(picture.angle_deg - view.probe_deg) <= SAME_ANGLE_DEG


def warm_up() -> None:
    """Load the compiled kernels of images, which takes a second, before the first search needs them."""
    preset = probe_preset(PRESET_NAMES[0])
    samples = np.zeros((preset.array.elements, 2080), dtype=np.int16)
    ImageReader(preset).picture(ChannelFrame(header=NO_HEADER, samples=samples, sampling_hz=preset.sampling_hz))
    # A page runs for days: what its updates leave behind is collected as often as usual in Python, and not as rarely as
    # in a command (decision 35). What has been loaded by now is passed over, so that this costs little.
    gc.freeze()
    gc.set_threshold(700)
