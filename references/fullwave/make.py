# ruff: noqa: INP001 -- programs in a folder, no package
"""Full-wave simulation of one element and one absorber with k-Wave, stored for the comparison.

    python references/fullwave/make.py plane        # 2-D, elevation and depth, 0 to 35 degrees
    python references/fullwave/make.py volume       # 3-D, 0 and 10 degrees
    python references/fullwave/make.py plane --step-um 50 --out coarse.npz

Runs in an environment of its own, with ``requirements.txt`` of this folder; see ``kwave_offline.py``.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import math
import platform
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from element import REACH, face_points, focused_mean, interpolation, middles
from kwave_offline import SOUND_SPEED_M_S, VERSION, propagate
from scipy.fft import next_fast_len

HERE = Path(__file__).parent
SETTLE_S = 2.5e-6  # kept after the last arrival from the far edge of an element
EARLY_S = 1e-6  # kept before the first arrival from the nearest point


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One simulation: geometry in metres and degrees, grid in metres and seconds."""

    angles_deg: tuple[float, ...]
    radius_m: float
    face_radius_m: float
    source_radius_m: float
    height_m: float
    width_m: float
    focus_m: float
    across_points: int
    along_points: int
    step_m: float
    sample_s: float
    pml: int
    margin_m: float
    side_m: float


PLANE = Case(
    angles_deg=(0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0),
    radius_m=60e-3,
    face_radius_m=10e-3,
    source_radius_m=0.05e-3,
    height_m=5e-3,
    width_m=0.0,
    focus_m=30e-3,
    across_points=1000,
    along_points=0,
    step_m=40e-6,
    sample_s=10e-9,
    pml=48,
    margin_m=0.6e-3,
    side_m=0.0,
)
VOLUME = Case(
    angles_deg=(0.0, 10.0),
    radius_m=15e-3,
    face_radius_m=10e-3,
    source_radius_m=0.1e-3,
    height_m=5e-3,
    width_m=0.39e-3,
    focus_m=30e-3,
    across_points=200,
    along_points=6,
    step_m=65e-6,
    sample_s=15e-9,
    pml=20,
    margin_m=0.8e-3,
    side_m=1.5e-3,
)
CASES = {"plane": PLANE, "volume": VOLUME}


def simulate(case: Case) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    """Mean pressure over the element at each angle, with and without a lens, and the grid that gave it."""
    lateral_m = middles(case.width_m, case.along_points) if case.along_points else np.zeros(0)
    elevation_m = middles(case.height_m, case.across_points)
    faces = [
        face_points(angle_deg=angle, face_radius_m=case.face_radius_m, elevation_m=elevation_m, lateral_m=lateral_m)
        for angle in case.angles_deg
    ]
    every = np.concatenate(faces)
    absorber = np.array([0.0, case.radius_m] if every.shape[1] == 2 else [0.0, 0.0, case.radius_m])
    low, high = np.minimum(every.min(axis=0), absorber), np.maximum(every.max(axis=0), absorber)
    margin = np.full(low.size, max(case.margin_m, REACH * case.step_m))
    if low.size == 3:
        margin[1] = case.side_m
    inside = np.ceil((high - low + 2 * margin) / case.step_m).astype(int)
    shape = tuple(next_fast_len(int(n) + 2 * case.pml) for n in inside)
    origin = low - margin - case.pml * case.step_m
    axes = [o + case.step_m * np.arange(n) for o, n in zip(origin, shape, strict=True)]
    p0 = np.ones(shape)
    for axis, x in enumerate(axes):
        soft = np.exp(-(((x - absorber[axis]) / case.source_radius_m) ** 2))
        p0 = p0 * np.expand_dims(soft, tuple(a for a in range(len(shape)) if a != axis))
    matrices = [interpolation(face, origin_m=origin, step_m=case.step_m, shape=shape) for face in faces]
    used = np.unique(np.concatenate([matrix.indices for matrix in matrices]))
    heard_at = np.zeros(math.prod(shape), dtype=bool)
    heard_at[used] = True
    path_m = np.sqrt(((every - absorber) ** 2).sum(axis=1))
    first = max(0, int((path_m.min() / SOUND_SPEED_M_S - EARLY_S) / case.sample_s))
    samples = math.ceil((path_m.max() / SOUND_SPEED_M_S + SETTLE_S) / case.sample_s) - first
    sys.stdout.write(f"grid {shape}, {used.size} points heard, {first + samples} steps\n")
    sys.stdout.flush()
    began = time.perf_counter()
    around = propagate(
        p0,
        heard_at.reshape(shape),
        step_m=case.step_m,
        sample_s=case.sample_s,
        first=first,
        samples=samples,
        pml=case.pml,
    )
    took_s = time.perf_counter() - began
    focused, plain = [], []
    for matrix in matrices:
        pressure = matrix[:, used] @ around
        pressure = pressure.reshape(elevation_m.size, -1, samples).mean(axis=1)
        lens = {"elevation_m": elevation_m, "sample_s": case.sample_s, "sound_speed_m_s": SOUND_SPEED_M_S}
        focused.append(focused_mean(pressure, focus_m=case.focus_m, **lens))
        plain.append(focused_mean(pressure, focus_m=None, **lens))
    heard = {"with_lens": np.array(focused, dtype=np.float32), "without_lens": np.array(plain, dtype=np.float32)}
    return heard, {"grid_points": shape, "steps": first + samples, "first_sample": first, "solver_s": round(took_s)}


def main() -> None:
    """Simulate one case and write its ``.npz``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", choices=CASES)
    parser.add_argument("--step-um", type=float, help="another grid step, in micrometres, for the convergence study")
    parser.add_argument("--sample-ns", type=float, help="another time step, in nanoseconds")
    parser.add_argument("--pml", type=int, help="another width of the absorbing layer, in grid points")
    parser.add_argument("--radius-mm", type=float, help="another distance of the absorber from the axis")
    parser.add_argument("--out", type=Path, help="file to write; default: CASE.npz beside this program")
    asked = parser.parse_args()
    values = asdict(CASES[asked.case])
    if asked.step_um is not None:
        values["step_m"] = asked.step_um * 1e-6
    if asked.sample_ns is not None:
        values["sample_s"] = asked.sample_ns * 1e-9
    if asked.pml is not None:
        values["pml"] = asked.pml
    if asked.radius_mm is not None:
        values["radius_m"] = asked.radius_mm * 1e-3
    case = Case(**values)
    where = ["--out", str(asked.out)]  # where it went is no part of how it was made
    heard, grid = simulate(case)
    made = {
        "program": f"k-wave-python {VERSION}, backend python (NumPy {np.__version__}), float64, lossless",
        "command": " ".join(
            ["python", "references/fullwave/make.py", *(word for word in sys.argv[1:] if word not in where)]
        ),
        "date": dt.datetime.now(tz=dt.UTC).date().isoformat(),
        "python": platform.python_version(),
        "sound_speed_m_s": SOUND_SPEED_M_S,
        **asdict(case),
        **grid,
    }
    out = asked.out or HERE / f"{asked.case}.npz"
    np.savez_compressed(out, provenance=np.array(json.dumps(made, indent=1)), **heard)
    sys.stdout.write(f"{out}: {grid}\n")


if __name__ == "__main__":
    main()
