"""The images of a run, and the moment of each acquisition, for bridges that show them."""

from __future__ import annotations

from markerseek.core import AcquisitionError, ChannelFrame, Measured, PaImage, Sample
from markerseek.records.journal import Configuration, Entry
from markerseek.runs import RunView, rebuild_image_reader


class RunImages:
    """Makes the images of one run.

    Attributes
    ----------
    brightest
        Largest envelope so far, in counts: what is white. What will come is not known.
    problem
        Why the last frame gave no image; empty if it gave one.
    """

    def __init__(self, configuration: Configuration) -> None:
        self._imaging = rebuild_image_reader(configuration)
        self.brightest = 0.0
        self.problem = ""

    def of(self, sample: Sample) -> PaImage | None:
        """Photoacoustic image of an acquisition; None if it has none."""
        if self._imaging is None or not isinstance(sample.frame, ChannelFrame):
            return None
        try:
            image = self._imaging.picture(sample.frame)
        except AcquisitionError as problem:
            self.problem = str(problem)
            return None
        self.brightest = max(self.brightest, float(image.envelope.max()))
        return image


def since_fired_s(view: RunView, entry: Entry) -> float:
    """Seconds from the first pulse of an acquisition of devices to its entry; 0 for all other entries."""
    frame = entry.event.sample.frame if isinstance(entry.event, Measured) else None
    # A simulated clock runs ahead of the time of day.
    if frame is None or view.facts.kind != "bench":
        return 0.0
    return max(0.0, entry.clock_s - frame.header.started_s)
