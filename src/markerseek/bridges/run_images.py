"""The images of a run beside its entries: from the process that searches, or made of the samples in the journal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from msgspec.structs import replace

from markerseek.core import AcquisitionError, ChannelFrame, Measured, PaImage, ReadingFrame
from markerseek.records.journal import Configuration, JournalEntry, JournalItem, RunView
from markerseek.runs import ImageRing, rebuild_image_reader
from markerseek.signals import ImageReader


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PicturedEntry:
    """An entry of a journal with its image."""

    entry: JournalEntry
    """The entry, of its frame the header alone: the counts have half a megabyte."""
    image: PaImage | None = None
    """Photoacoustic image of its acquisition; None if it has none."""
    brightest: float = 0.0
    """Largest envelope of the run so far, in counts: what is white. What will come is not known."""
    problem: str = ""
    """Why the last frame gave no image; empty if it gave one."""


PicturedItem: TypeAlias = Configuration | PicturedEntry
"""What a journal holds, with the images of its acquisitions."""


def with_images(items: Iterable[JournalItem], *, handed: ImageRing | None = None) -> Iterator[PicturedItem]:
    """Return the items of a journal, each entry with its image.

    ``items``: from the configuration on. ``handed``: images of the process that writes the journal; None: each is made
    here, of its samples, as that process does it.
    """
    images: _Images | None = None
    for item in items:
        if isinstance(item, Configuration):
            images = _Images(item, handed)
            yield item
        elif images is not None:
            yield images.beside(item)


def without_images(items: Iterable[JournalItem]) -> Iterator[PicturedItem]:
    """Return the items of a journal without images."""
    for item in items:
        yield item if isinstance(item, Configuration) else PicturedEntry(entry=_without_counts(item))


class _Images:
    """The images of one run."""

    def __init__(self, configuration: Configuration, handed: ImageRing | None) -> None:
        self._configuration = configuration
        self._handed = handed
        # Made when it is needed: its tables and its compiled loops take a second.
        self._imaging: ImageReader | None = None
        self._brightest = 0.0
        self._problem = ""

    def beside(self, entry: JournalEntry) -> PicturedEntry:
        """Return an entry with its image."""
        image = None
        if isinstance(entry.event, Measured):
            image = None if self._handed is None else self._handed.get(entry.number)
            frame = entry.event.sample.frame
            if image is None and isinstance(frame, ChannelFrame):
                image = self._made(frame)
        if image is not None:
            self._brightest = max(self._brightest, float(image.envelope.max()))
            self._problem = ""
        return PicturedEntry(
            entry=_without_counts(entry), image=image, brightest=self._brightest, problem=self._problem
        )

    def _made(self, frame: ChannelFrame) -> PaImage | None:
        """Return the image of a frame; None where the rig makes no images, or not of such a frame."""
        if self._imaging is None:
            self._imaging = rebuild_image_reader(self._configuration)
        try:
            return None if self._imaging is None else self._imaging.picture(frame)
        except AcquisitionError as problem:
            self._problem = str(problem)
            return None


def _without_counts(entry: JournalEntry) -> JournalEntry:
    """Return the entry with the header of its frame alone."""
    event = entry.event
    if not isinstance(event, Measured) or (frame := event.sample.frame) is None:
        return entry
    header = ReadingFrame(header=frame.header, intensity=event.sample.reading.intensity)
    return replace(entry, event=replace(event, sample=replace(event.sample, frame=header)))


def since_fired_s(view: RunView, entry: JournalEntry) -> float:
    """Return the seconds from the first pulse of an acquisition of devices to its entry; 0 for all other entries."""
    frame = entry.event.sample.frame if isinstance(entry.event, Measured) else None
    # A simulated clock runs ahead of the time of day.
    if frame is None or view.facts.kind != "bench":
        return 0.0
    return max(0.0, entry.clock_s - frame.header.started_s)
