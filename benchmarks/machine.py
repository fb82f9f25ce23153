"""What a measurement depends on: processor, cores, load, versions, commit, date."""

from __future__ import annotations

import datetime as dt
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path

from markerseek import __version__

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "NPROC")
"""Variables by which the libraries are held to one thread; they must be set before the libraries are imported."""

PACKAGES = ("numpy", "scipy", "numba", "pymust", "esdiva", "fast-das", "vbeam", "jax")

ROOT = Path(__file__).parents[1]


def hold_to_cores(cores: int) -> None:
    """Hold this process, and all that it starts, to so many cores, and the libraries to so many threads.

    The threads that a library starts all the same (fast-das, JAX) then share those cores.
    """
    for name in ONE_THREAD:
        os.environ[name] = str(cores)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-cores:])


def describe(*, cores: int) -> dict[str, str]:
    """Circumstances of a run, each under a short name."""
    return {
        "date": dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _commit(),
        "processor": _processor(),
        "cores used": f"{cores} of {os.cpu_count()}",
        "load before": f"{os.getloadavg()[0]:.2f} (mean number of processes that ran in the last minute)",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        # markerseek's own: the metadata of an environment are those of the day on which it was installed.
        "versions": ", ".join([f"markerseek {__version__}", *(f"{name} {_version(name)}" for name in PACKAGES)]),
    }


def _commit() -> str:
    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "src", "benchmarks/*.py", "benchmarks/*.c")
    return (git("rev-parse", "--short", "HEAD") or "unknown") + (" with uncommitted changes" if changed else "")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    found = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    vectors = next((name for name in ("avx512f", "avx2") if name in found.get("flags", "").split()), "no AVX2")
    return f"{found.get('model name', 'unknown')}, {vectors}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "absent"
