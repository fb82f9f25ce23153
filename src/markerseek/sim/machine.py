"""A simulated ultrasound machine: it beamforms the channels as for pulse and echo, and hands out its lines (RF).

A photoacoustic wave travels one way only, so that these lines show it smeared; the imaging must undo that.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.acoustics import AcousticModel
from markerseek.core import FrameHeader, Int16, RFFrame
from markerseek.sim.world import Flash, World

F_NUMBER = 2.0
"""Depth over width of the machine's receive aperture."""

SOUND_SPEED_M_S = 1540.0
"""Speed of sound that the machine assumes, in m/s."""

_GAIN = 0.25
"""Counts of a line for each count summed over its channels: a full aperture of strong channels stays in 16 bits."""


class RFWorld:
    """A simulated world whose receiver is an ultrasound machine.

    ``receive_focus_m``: depth of a fixed receive focus; None: dynamic focus.
    """

    def __init__(self, *, world: World, receive_focus_m: float | None) -> None:
        self._world = world
        self._receive_focus_m = receive_focus_m
        self.angle_deg = world.angle_deg
        # The same list: flashes are added by the world behind.
        self.flashes: list[Flash] = world.flashes

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue, as the world behind."""
        self._world.flash(pulses=pulses, at_s=at_s)

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> RFFrame:
        """Lines after a flash; after none, noise alone."""
        self._world.angle_deg = self.angle_deg
        lines = post_beamformed(self._world.counts(flash), self._world.model, receive_focus_m=self._receive_focus_m)
        return RFFrame(header=header, samples=lines, sampling_hz=self._world.model.sampling_hz)


def post_beamformed(
    counts: Int16[np.ndarray, "channels samples"], model: AcousticModel, *, receive_focus_m: float | None
) -> Int16[np.ndarray, "lines samples"]:
    """Lines at the elements, as the machine beamforms them.

    Dynamic focus: at time t a line listens to the depth zb = c·t/2, whose echo reaches an element at the distance u
    after (zb + sqrt(zb² + u²))/c. Fixed focus zF: one delay for each element, (sqrt(zF² + u²) − zF)/c.

    ``counts``: channel data; sample 0 is the time of transmission. ``model``: gives pitch and sampling frequency.
    ``receive_focus_m``: depth of a fixed receive focus; None: dynamic focus.
    """
    channels, count = counts.shape
    pitch_m, per_metre = model.probe.array.pitch_m, model.sampling_hz / SOUND_SPEED_M_S
    sample = np.arange(count, dtype=np.float64)
    depth_m = sample / per_metre / 2
    lines = np.zeros((channels, count), np.float32)
    widest_m = float(depth_m[-1]) if receive_focus_m is None else receive_focus_m
    for apart in range(min(channels, math.floor(widest_m / (2 * F_NUMBER * pitch_m)) + 1)):
        u = apart * pitch_m
        if receive_focus_m is None:
            place = (depth_m + np.hypot(depth_m, u)) * per_metre
            listens = 2 * F_NUMBER * u <= depth_m
        else:
            place = sample + (math.hypot(receive_focus_m, u) - receive_focus_m) * per_metre
            listens = np.ones(count, bool)
        first = np.minimum(place.astype(np.int64), count - 2)
        late = (place - first).astype(np.float32)
        between = (1 - late) * counts[:, first] + late * counts[:, first + 1]
        delayed = np.where(listens & (place < count - 1), between, np.float32(0))
        lines[: channels - apart] += delayed[apart:]
        if apart:
            lines[apart:] += delayed[: channels - apart]
    held: Int16[np.ndarray, "lines samples"] = np.clip(np.rint(_GAIN * lines), -32767, 32767).astype(np.int16)
    return held
