"""One run as all viewers see it: its snapshots so far and its images."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from markerseek.bridges.page.image_bytes import Picture, picture_of
from markerseek.core import NO_HEADER, ChannelFrame, Measured, ReadingFrame, RFFrame, SearchPlan
from markerseek.records.journal import Configuration, JournalEvent, RecordedRun
from markerseek.runs import RunView, rebuild_image_reader
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset
from markerseek.sim import StageMotion

SAME_ANGLE_DEG = 0.02
"""Distance of two readbacks of one angle, in degrees."""


class RunHistory:
    """The snapshots and images of one run; one thread adds events, others read.

    ``configuration``: plan and rig of the run. ``has_policy``: whether a policy decides; False where a person turns the
    probe.
    """

    def __init__(self, configuration: Configuration, *, has_policy: bool = True) -> None:
        self.configuration = configuration
        # Only ever appended to, so that another thread may read it at any time.
        self.snapshots: list[RunView] = [RunView.of(configuration)]
        self.pictures: dict[int, Picture] = {}
        self._imaging = rebuild_image_reader(configuration)
        recipe: dict[str, Any] = msgspec.json.decode(configuration.recipe) or {}
        self._motion, self._pace, self.pulse_j = _rig_settings(recipe, replayed=configuration.facts.kind == "replayed")
        self.name = _name(configuration.plan if has_policy else None, seed=recipe.get("seed"))

    def add(
        self,
        event: JournalEvent,
        *,
        clock_s: float,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        """Take one more event.

        ``on_change``: called once the event can be shown, and again once its image can.
        """
        # Kept for every event: without its counts, a frame is only its header.
        self.snapshots.append(self.snapshots[-1].add(_without_counts(event), clock_s=clock_s))
        on_change()
        if self._imaging is not None and isinstance(event, Measured) and not event.sample.dark:
            sample = event.sample
            if isinstance(sample.frame, ChannelFrame | RFFrame):
                self.pictures[self.snapshots[-1].number] = picture_of(sample, self._imaging)
                on_change()

    def cut_off(self, reason: str, *, problem: str = "") -> None:
        """Note that no more events will come, though the run has not said that it is over.

        ``problem``: what went wrong; empty where a person has stopped it.
        """
        self.snapshots.append(self.snapshots[-1].cut_off(reason, problem=problem))

    @property
    def imaged(self) -> bool:
        """Whether photoacoustic images can be made of its frames."""
        return self._imaging is not None

    @property
    def unit(self) -> str:
        """Unit of its intensities; those of a table have the one of whoever made it."""
        return "counts" if self.imaged else "as recorded"

    def picture(self, snapshot: RunView) -> Picture | None:
        """The newest image of the angle where the probe is; where there is none, the newest of another angle."""
        seen = [self.pictures[number] for number in sorted(self.pictures) if number <= snapshot.number]
        here = [each for each in seen if is_image_of(each, snapshot)]
        return next(reversed(here or seen), None)

    def move_s(self, snapshot: RunView) -> float:
        """Real time that the present move is expected to take, in seconds; 0 where nothing moves."""
        if snapshot.target_deg is None or snapshot.probe_deg is None:
            return 0.0
        return self._motion.duration_s(snapshot.target_deg - snapshot.probe_deg) * self._pace

    def lines(self, snapshot: RunView, *, most: int) -> list[str]:
        """The last lines of the log up to a snapshot, the newest first."""
        newest = snapshot.number + 1
        # A move is a line until its acquisition replaces it, and a pulse of a sweep until the next.
        passing = {"moving", "turning", "sweeping"}
        known = [each for each in self.snapshots[1:newest] if each.phase not in passing or each is snapshot]
        # The clock of a recording that is searched again does not run.
        replayed = self.configuration.facts.kind == "replayed"
        return [each.line if replayed else f"{each.elapsed_s:6.1f} s  {each.line}" for each in reversed(known[-most:])]

    @property
    def known_name(self) -> str:
        """Name of the angle that is known otherwise: the truth of a simulation, or a reference."""
        return "reference" if self.configuration.facts.truth_deg is None else "truth"


def _without_counts(event: JournalEvent) -> JournalEvent:
    sample = event.sample if isinstance(event, Measured) else None
    if not isinstance(event, Measured) or sample is None or sample.frame is None:
        return event
    frame = ReadingFrame(header=sample.frame.header, intensity=sample.reading.intensity)
    return replace(event, sample=replace(sample, frame=frame))


def is_image_of(picture: Picture, snapshot: RunView) -> bool:
    """Whether an image is of the angle where the probe is."""
    if snapshot.probe_deg is None or snapshot.target_deg is not None:
        return False
    return abs(picture.angle_deg - snapshot.probe_deg) <= SAME_ANGLE_DEG


def warm_up() -> None:
    """Load the compiled kernels of images, which takes a second, before the first search needs them."""
    preset = probe_preset(PRESET_NAMES[0])
    samples = np.zeros((preset.array.elements, 2080), dtype=np.int16)
    ImageReader(preset).picture(ChannelFrame(header=NO_HEADER, samples=samples, sampling_hz=preset.sampling_hz))
    # A page runs for days: what its updates leave behind is collected as often as usual in Python, and not as rarely as
    # in a command (decision 35). What has been loaded by now is passed over, so that this costs little.
    gc.freeze()
    gc.set_threshold(700)


def watched_journal(recorded: RecordedRun) -> RunHistory:
    """A recorded run from its beginning to its end."""
    run = RunHistory(recorded.configuration)
    for entry in recorded.entries:
        run.add(entry.event, clock_s=entry.clock_s)
    return run


def _name(plan: SearchPlan | None, *, seed: int | None) -> str:
    """Name of the run: method, form and seed; without a plan a person decides."""
    parts = ["by hand"]
    if plan is not None:
        forms = (("as published", plan.as_published), ("sweeping", plan.sweep_speed_deg_s is not None))
        parts = [plan.method, *(form for form, holds in forms if holds)]
    return ", ".join(parts if seed is None else [*parts, f"seed {seed}"])


def _rig_settings(recipe: dict[str, Any], *, replayed: bool) -> tuple[StageMotion, float, float | None]:
    """Speed of the stage, pace, and energy of a pulse in joules, as far as the recipe of the rig says."""
    settings = recipe.get("settings", {})
    stage = {name: settings.get("stage", {}).get(name) for name in ("speed_deg_s", "acceleration_deg_s2")}
    motion = StageMotion(**{name: value for name, value in stage.items() if value is not None})
    pace = recipe.get("pace", 0.0 if replayed else 1.0)
    return motion, pace, settings.get("laser", {}).get("pulse_energy_j")
