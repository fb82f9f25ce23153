"""Reads a file of HDF5 in a process of its own first, because the library can crash or hang on damaged bytes.

``python -m markerseek.records.careful.vetting FILE`` does what `records.ipasc` will do, or `mat73` with a ``.mat``,
under limits of time and memory. Only how the process ends counts: a file that is merely wrong is refused again, with
its reason, by the caller.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from markerseek.core import MissingExtraError, RecordError

LIMIT_S, COMPUTING_S = 60.0, 5
"""Longest time for one file, and of it for computing, in seconds."""

_ROOM_BYTES = 1 << 28

_MISSING = 3
"""Exit code of a process that lacks a library, and so has read nothing."""


def vet(path: Path) -> None:
    """Refuse a file that the HDF5 library cannot stand.

    Raises
    ------
    RecordError
        If the process that reads it dies, lacks a library, asks for far more memory than the file has bytes, or takes
        too long.
    """
    try:
        ended = subprocess.run(  # noqa: S603 - this program, with one file's name
            # -P: or a file of the current folder could pass for the library
            [sys.executable, "-P", "-m", __name__, str(path.absolute())],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as problem:
        raise RecordError(
            f"{path}: reading it takes more than {LIMIT_S:g} s; it is damaged, or on a disk that does not answer"
        ) from problem
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be vetted, no process can be started: {problem.strerror}") from problem
    if ended.returncode == _MISSING:
        missing = ended.stderr.decode(errors="replace").strip().rpartition("\n")[2][:500]
        raise RecordError(f"{path}: it cannot be vetted, the process that reads it lacks a library: {missing}")
    if ended.returncode != 0:
        raise RecordError(
            f"{path}: the HDF5 library breaks down when it reads it; it is damaged: scan, or save it, again"
        )


def _limit(size: int) -> None:
    """Let this process have little more memory and time than it had so far, where the system can do so."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        return
    from markerseek.records.careful.hdf5 import MOST_PER_BYTE

    most = pages * resource.getpagesize() + MOST_PER_BYTE * size + _ROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    seconds = int(time.process_time()) + COMPUTING_S
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def _main() -> int:
    path = Path(sys.argv[1])
    try:
        walk = _walker(path)
        _limit(path.stat().st_size)
        walk(path)
    except RecordError:
        return 0  # the caller reads it again, and says why
    except MissingExtraError as missing:
        sys.stderr.write(f"{missing}\n")
        return _MISSING
    return 0


def _walker(path: Path) -> Callable[[Path], None]:
    """What reads such a file, or as much of it as could do harm."""
    if path.suffix.lower() == ".mat":
        from markerseek.records.careful.mat73 import walk_arrays

        return walk_arrays
    from markerseek.records.ipasc.reading import read_unvetted, walk_frames

    return lambda path: walk_frames(read_unvetted(path))


if __name__ == "__main__":
    sys.exit(_main())
