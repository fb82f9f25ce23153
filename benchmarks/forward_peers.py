"""Other people's simulators, each as a piece of work that gives the channels of one point source.

Neither is made for sources that sound by themselves. esdiva is asked, by reciprocity, what one element sends to 128
points that lie as the source lies to each element; that is the same frame. PyMUST's `simus` only knows a pulse sent
and scattered back: it is told to send with all elements at once.
"""

from __future__ import annotations

import contextlib
import sys

import numpy as np
import scipy.fft

from benchmarks.timing import Work
from markerseek.acoustics import AcousticModel, GaussianAbsorber


def esdiva_element(model: AcousticModel, *, source_m: tuple[float, float, float]) -> Work:
    """Field by esdiva of one element at 128 points, as channels of shape (elements, samples).

    Parameters
    ----------
    model
        Model without lens and loss.
    source_m
        Lateral, elevation and axial place of the source, in metres.
    """
    import esdiva

    probe = model.probe
    with contextlib.redirect_stdout(sys.stderr):  # it announces itself
        element = esdiva.transducers.LinearArrayTransducer(
            n_elements=1,
            element_width_mm=1e3 * probe.element_width_m,
            element_height_mm=1e3 * probe.element_height_m,
            kerf_mm=1e3 * (probe.array.pitch_m - probe.element_width_m),
            no_sub_x=2,
            no_sub_y=32,
            frequency_Hz=7e6,
        )
    first, velocity = _velocity(model)
    emission = esdiva.Emission(
        element,
        c=model.medium.sound_speed_m_s,
        fs=model.sampling_hz,
        excitation=velocity,
        method="spectral",
        verbose=False,
    )
    points = np.empty((probe.array.elements + 1, 3))
    points[:-1, 0] = 1e3 * (source_m[0] - probe.array.lateral_m)
    points[:-1, 1:] = 1e3 * np.array(source_m[1:])
    # The record ends at the last arrival; one point that is farther off keeps the pulse of the others whole.
    points[-1] = (0.0, 0.0, 4.0 + np.linalg.norm(points[:-1], axis=1).max())

    def work() -> np.ndarray:
        pressure, when = emission(points)
        start = round(when["t0"] * model.sampling_hz) + first
        heard = np.zeros((probe.array.elements, model.samples))
        count = min(len(pressure), model.samples - start)
        heard[:, start : start + count] = pressure[:count, :-1].T
        return heard

    return work


def pymust_simus(model: AcousticModel, *, source_m: tuple[float, float, float]) -> Work:
    """PyMUST's channels of one scatterer, two-way, shape (samples, elements)."""
    import pymust

    probe = model.probe
    param = pymust.utils.Param()
    param.fs = model.sampling_hz
    param.c = model.medium.sound_speed_m_s
    param.fc = 7e6
    param.bandwidth = 60.0
    param.pitch = probe.array.pitch_m
    param.width = probe.element_width_m
    param.height = probe.element_height_m
    param.kerf = param.pitch - param.width
    param.focus = probe.elevation_focus_m or np.inf
    param.Nelements = probe.array.elements
    param.radius = np.inf
    options = pymust.utils.Options()
    options.ParPool = False
    options.WaitBar = False
    x, y, z = (np.array([place]) for place in source_m)
    delays = np.zeros((1, probe.array.elements))
    return lambda: pymust.simus(x, y, z, np.ones(1), delays, param, options)[0]


def _velocity(model: AcousticModel) -> tuple[int, np.ndarray]:
    """First sample, counted from the arrival, and samples of the face's velocity whose derivative is our pulse."""
    table = model.pulse(GaussianAbsorber())
    pulse = table.lines[0, 0].astype(np.float64)
    size = scipy.fft.next_fast_len(16 * len(pulse))
    spectrum = scipy.fft.rfft(pulse, size)
    omega = 2j * np.pi * scipy.fft.rfftfreq(size, 1 / model.sampling_hz)
    spectrum[1:] /= omega[1:]
    spectrum[0] = 0
    velocity = scipy.fft.irfft(spectrum, size)
    return table.first, velocity[: len(pulse)] - velocity[-1]
