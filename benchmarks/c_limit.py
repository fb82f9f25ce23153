"""The shift-invariant kernel in C, compiled for this machine into a temporary folder: the limit for ours."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.timing import Work
from markerseek.signals.beamform import ImageGrid

SOURCE = Path(__file__).with_name("shift_invariant.c")
FLAGS = ("-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-fPIC", "-shared")


def compiler() -> str | None:
    """Path of gcc; None where there is none."""
    return shutil.which("gcc")


def c_kernel(signals: np.ndarray, grid: ImageGrid) -> Work:
    """The kernel in C as a piece of work that returns the image, shape (depth, lateral).

    Parameters
    ----------
    signals
        Filtered channels, shape (samples, columns), as `markerseek.signals.beamform.beamform` takes them.
    grid
        Grid with columns on the elements.
    """
    library = _library()
    table = grid.table
    distances, depths = table.first.shape
    columns = table.scale.shape[1]
    image = np.empty((depths, columns), np.float32)

    def work() -> np.ndarray:
        library.delay_and_sum(
            signals.ctypes.data,
            ctypes.c_long(signals.shape[1]),
            table.first.ctypes.data,
            table.weight.ctypes.data,
            table.scale.ctypes.data,
            distances,
            depths,
            columns,
            image.ctypes.data,
        )
        return image[:, : len(grid.lateral_m)]

    return work


def _library() -> ctypes.CDLL:
    gcc = compiler()
    if gcc is None:
        raise FileNotFoundError("gcc")
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "shift_invariant.so"
        subprocess.run([gcc, *FLAGS, str(SOURCE), "-o", str(made)], check=True)
        library = ctypes.CDLL(str(made))
    pointer = ctypes.c_void_p
    integer = ctypes.c_int
    library.delay_and_sum.argtypes = [pointer, ctypes.c_long, pointer, pointer, pointer, *[integer] * 3, pointer]
    library.delay_and_sum.restype = None
    return library
