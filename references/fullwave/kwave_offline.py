# ruff: noqa: INP001 -- programs in a folder, no package
"""k-Wave's NumPy solver without its package's first import, which would download compiled programs.

Importing ``kwave`` runs its ``__init__``, which fetches the compiled solvers. Nothing of them is needed here, so the
package is entered under its name with its folder and without running that file; its modules then load as usual.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np

VERSION = "0.6.2"
"""The release that made the stored output."""


def enter_kwave() -> None:
    """Make ``import kwave.…`` work without a network; refuses another release than `VERSION`."""
    if "kwave" in sys.modules:
        return
    installed = importlib.metadata.version("k-wave-python")
    if installed != VERSION:
        message = f"k-wave-python is {installed}, the stored output is of {VERSION}; install requirements.txt"
        raise RuntimeError(message)
    spec = importlib.util.find_spec("kwave")
    if spec is None or spec.origin is None:
        message = "k-wave-python is installed without its package kwave; install it again"
        raise RuntimeError(message)
    package = types.ModuleType("kwave")
    package.__path__ = [str(Path(spec.origin).parent)]
    package.__dict__["__version__"] = installed
    sys.modules["kwave"] = package


def propagate(
    p0: np.ndarray, heard_at: np.ndarray, *, step_m: float, sample_s: float, first: int, samples: int, pml: int
) -> np.ndarray:
    """Pressure over time at the marked grid points, shape (points, samples).

    Parameters
    ----------
    p0
        Initial pressure on the whole grid, the absorbing layer (``pml`` points a side) included; two or three axes.
    heard_at
        True at the grid points that are recorded; they come in C order.
    step_m, sample_s
        Grid step in metres and time step in seconds.
    first, samples
        First time step that is kept, counted from the light, and number of steps kept.
    pml
        Points of the absorbing layer on every side.
    """
    enter_kwave()
    from kwave.kgrid import kWaveGrid
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder

    grid = kWaveGrid(list(p0.shape), [step_m] * p0.ndim)
    grid.setTime(first + samples, sample_s)
    source = kSource()
    source.p0 = p0
    sensor = kSensor(mask=heard_at, record=["p"])
    sensor.record_start_index = first + 1  # counted from 1
    options: dict[str, Any] = {"pml_size": pml, "pml_inside": True, "smooth_p0": False, "quiet": True}
    medium = kWaveMedium(sound_speed=SOUND_SPEED_M_S, density=1000.0)
    heard: np.ndarray = kspaceFirstOrder(grid, medium, source, sensor, **options)["p"]
    return heard


SOUND_SPEED_M_S = 1540.0
"""Speed of sound in m/s, that of markerseek's default medium, here without attenuation."""
