"""Post-beamformed RF of an ultrasound machine, line by line in plain NumPy; it shares no code with SPARE."""

from __future__ import annotations

import numpy as np


def post_beamformed(
    channels: np.ndarray,
    *,
    element_m: np.ndarray,
    line_m: np.ndarray,
    sampling_hz: float,
    sound_speed_m_s: float,
    f_number: float,
) -> np.ndarray:
    """Lines (lines, samples): the machine believes that it transmitted at sample 0, straight down each line.

    Its focus is dynamic: at time t the line listens to depth zb = c·t/2, and the echo from there reaches an element u
    beside the line at (zb + sqrt(zb² + u²))/c.
    """
    count = channels.shape[1]
    sample = np.arange(count)
    rf = np.zeros((len(line_m), count))
    for line, x in enumerate(line_m):
        for element, position in enumerate(element_m):
            u = position - x
            zb = sound_speed_m_s * (sample / sampling_hz) / 2
            place = (zb + np.sqrt(zb**2 + u**2)) / sound_speed_m_s * sampling_hz
            listens = 2 * f_number * abs(u) <= zb
            heard = np.interp(place, sample, channels[element], right=0.0)
            rf[line] += np.where(listens, heard, 0.0)
    return rf
