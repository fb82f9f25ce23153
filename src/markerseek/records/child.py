"""Tries files in a child process before they are read in this one: damaged HDF5 can crash or hang its library.

The child (``python -P -m markerseek.records.child``; without ``-P`` a file in the current folder could take the place
of a library) runs the reader under limits of memory and processor time, and throws its result away. An error that the
reader raises is no matter of the child: the reader raises it again in this process.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

from markerseek.core import RecordError

ReadFunction: TypeAlias = Callable[[Path], object]
"""Function of a module, which the child imports by its name."""

LIMIT_S = 60.0
PROCESSOR_LIMIT_S = 5
"""Longest time for one small file, and of it on the processor, in seconds."""

_LEAST_BYTES_PER_S = 10_000_000
"""A larger file may take longer: slowest reading of packed numbers, in bytes of the file."""

MAX_PER_BYTE = 32
"""Most bytes of memory for each byte of a file; a compressed file that needs more is refused."""

_ROOM_BYTES = 1 << 29
"""Memory for the libraries themselves, in bytes."""

_OUT_OF_MEMORY = 3
"""Exit code."""

_TIME_OVER = 24
"""Number of SIGXCPU, which Windows does not have."""

_REASONS = {
    _OUT_OF_MEMORY: "reading it takes far more memory than it has bytes",
    -_TIME_OVER: "reading it takes far more time than its size explains, or its disk does not answer",
}

_tried: set[tuple[str, Path, int, int]] = set()
"""Readers and the files that they lived through, with size in bytes and time of change in nanoseconds."""


def try_files(reader: ReadFunction, paths: Sequence[Path]) -> None:
    """Refuse files on which a reader crashes, hangs or fills the memory; one child tries them one after the other.

    Raises `RecordError` for the first such file, `OSError` for one that cannot be opened.
    """
    name = f"{reader.__module__}:{reader.__qualname__}"
    keys = [(name, path.absolute(), path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    left = [key for key in keys if key not in _tried]
    if not left:
        return
    try:
        # Our own program.
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-P", "-m", "markerseek.records.child", name],
            input=b"\0".join(os.fsencode(path) for _, path, *_ in left),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # RLIMIT_CPU does not count a read that blocks, on a network disk for example.
            timeout=sum(LIMIT_S + size // _LEAST_BYTES_PER_S for _, _, size, _ in left),
            # Each thread of the linear algebra would ask for memory, and there is nothing to compute.
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            check=False,
        )
        survived = len(done.stdout)
        code = done.returncode
    except subprocess.TimeoutExpired as problem:
        survived = len(problem.stdout or b"")
        code = -_TIME_OVER
    _tried.update(left[:survived])
    if survived < len(left):
        reason = _REASONS.get(code, "the library that reads such files breaks down on it")
        raise RecordError(f"{paths[keys.index(left[survived])]}: {reason}; it is damaged: scan, or save it, again")


def _serve(name: str) -> None:
    """Run the child: it puts out one byte for each file that the reader lived through."""
    # Libraries may print to standard output.
    answers = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # PYTHONWARNINGS of the user could turn a harmless warning of a library into an error.
    warnings.simplefilter("ignore")
    module, _, function = name.partition(":")
    reader: ReadFunction = getattr(importlib.import_module(module), function)
    for each in sys.stdin.buffer.read().split(b"\0"):
        path = Path(os.fsdecode(each))
        try:
            _limit(path.stat().st_size)
            reader(path)
        # Damaged bytes raise errors of any kind in these libraries.
        except Exception as problem:  # noqa: BLE001
            if isinstance(problem.__cause__ or problem, MemoryError):
                sys.exit(_OUT_OF_MEMORY)
        os.write(answers, b".")


def _limit(size_bytes: int) -> None:
    """Limit memory and processor time for a file, beyond what is used already."""
    try:
        import resource

        # RLIMIT_AS limits the whole address space, so that what is mapped already must be added.
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        return
    memory_bytes = pages * resource.getpagesize() + MAX_PER_BYTE * size_bytes + _ROOM_BYTES
    seconds = int(time.process_time()) + PROCESSOR_LIMIT_S + size_bytes // _LEAST_BYTES_PER_S
    for kind, limit in ((resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        _, hard = resource.getrlimit(kind)
        # The soft limit alone: it is raised for the next file.
        resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


if __name__ == "__main__":
    _serve(sys.argv[1])
