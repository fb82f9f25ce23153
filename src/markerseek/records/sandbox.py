"""Reads foreign files in a child process, because libraries can crash, hang or fill the memory on damaged bytes.

The child (``python -P -m markerseek.records.sandbox``; without ``-P`` a file in the current folder could take the place
of a library) calls a reader of this package, under limits of memory and processor time, and hands plain arrays back.
A reader is a module-level function that takes a path and returns arrays by name. One child reads many files.
"""

from __future__ import annotations

import importlib
import math
import os
import subprocess
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Self, TypeAlias

import msgspec
import numpy as np

from markerseek.core import MissingExtraError, RecordError

Reader: TypeAlias = Callable[[Path], Mapping[str, np.ndarray]]
"""Function of a module, which the child imports by its name."""

LIMIT_S, PROCESSOR_LIMIT_S = 60.0, 5
"""Longest time for one file, and of it on the processor, in seconds."""

MOST_PER_BYTE = 32
"""Most bytes of memory for each byte of a file; a compressed file that needs more is refused."""

_ROOM_BYTES = 1 << 29
"""Memory for the libraries themselves (h5py, SciPy), which are imported with the first file."""

_LONGEST_LINE = 1 << 20


class _Request(msgspec.Struct, frozen=True, kw_only=True):
    module: str
    function: str
    path: bytes
    """As bytes, because a file's name need not be Unicode."""


class _Array(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    dtype: str
    shape: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


class _Answer(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of the child for one file: descriptions of arrays, whose bytes follow, or an error."""

    arrays: tuple[_Array, ...] = ()
    error: str | None = None
    missing: str | None = None


class Sandbox:
    """A child process that reads foreign files, started with the first file and restarted after a crash.

    A context manager that ends the child; garbage collection ends it too.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._owner = 0
        # Holds the child, so that a garbage cycle cannot delete it, unended, before its sandbox.
        self._end: weakref.finalize[[subprocess.Popen[bytes], int], Sandbox] | None = None

    def read(self, reader: Reader, path: Path) -> dict[str, np.ndarray]:
        """Arrays that a reader returns for a file.

        Parameters
        ----------
        reader
            Function of a module that the child can import.
        path
            The file.

        Raises
        ------
        RecordError
            If the reader refuses the file, or the child crashes, takes too long or needs too much memory.
        MissingExtraError
            If the reader needs a package that is not installed.
        """
        request = _Request(module=reader.__module__, function=reader.__qualname__, path=os.fsencode(path.absolute()))
        child = self._running(path)
        if child.stdin is None or child.stdout is None:
            raise RuntimeError("the child of a sandbox has no pipes")
        # RLIMIT_CPU does not count a read that blocks, on a network disk for example; this timer does.
        expired = threading.Event()
        timer = threading.Timer(LIMIT_S, _expire, (child, expired))
        timer.start()
        try:
            child.stdin.write(msgspec.json.encode(request) + b"\n")
            child.stdin.flush()
            answer, arrays = _received(child.stdout, most_bytes=MOST_PER_BYTE * path.stat().st_size + _ROOM_BYTES)
        except (OSError, EOFError, ValueError, TypeError, msgspec.MsgspecError) as problem:
            self.close()
            if expired.is_set():
                raise RecordError(
                    f"{path}: reading it takes more than {LIMIT_S:g} s; it is damaged, or its disk does not answer"
                ) from problem
            raise RecordError(
                f"{path}: the library that reads such files breaks down on it; it is damaged: scan, or save it, again"
            ) from problem
        finally:
            timer.cancel()
        if answer.missing is not None:
            raise MissingExtraError(package=answer.missing, extra="records", purpose=f"{path}: it")
        if answer.error is not None:
            raise RecordError(answer.error)
        return arrays

    def close(self) -> None:
        """End the child; allowed twice."""
        self._child = None
        if self._end is not None:
            self._end()

    def __enter__(self) -> Self:
        """The sandbox itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the child."""
        self.close()

    def __reduce__(self) -> tuple[type[Self], tuple[()]]:
        """A copy in another process has a child of its own."""
        return type(self), ()

    def _running(self, path: Path) -> subprocess.Popen[bytes]:
        # After a fork the child belongs to the other process.
        if self._child is None or self._owner != os.getpid() or self._child.poll() is not None:
            self.close()
            try:
                self._child = subprocess.Popen(
                    [sys.executable, "-P", "-m", "markerseek.records.sandbox"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    # Each thread of the linear algebra would ask for memory, and there is nothing to compute.
                    env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                )
            except OSError as problem:
                raise RecordError(
                    f"{path}: it cannot be read, no process can be started: {problem.strerror}"
                ) from problem
            self._owner = os.getpid()
            self._end = weakref.finalize(self, _end, self._child, self._owner)
        return self._child


def _end(child: subprocess.Popen[bytes], owner: int) -> None:
    # After a fork the child belongs to the other process.
    if owner != os.getpid():
        return
    child.kill()
    for pipe in (child.stdin, child.stdout):
        # Unclosed pipes would keep descriptors until the garbage collector runs.
        if pipe is not None:
            # A request that the child did not take is lost with it.
            with suppress(OSError):
                pipe.close()
    child.wait()


def _expire(child: subprocess.Popen[bytes], expired: threading.Event) -> None:
    expired.set()
    child.kill()


def _received(stream: IO[bytes], *, most_bytes: int) -> tuple[_Answer, dict[str, np.ndarray]]:
    """Answer and arrays of the child, checked as untrusted input: the file may control the child."""
    line = stream.readline(_LONGEST_LINE)
    if not line.endswith(b"\n"):
        raise EOFError("the child ended")
    answer = msgspec.json.decode(line, type=_Answer)
    # No object arrays: their bytes would be pointers into our memory.
    if any(np.dtype(each.dtype).kind not in "biuf" or min(each.shape, default=0) < 0 for each in answer.arrays):
        raise ValueError("an array of another kind")
    if sum(each.nbytes for each in answer.arrays) > most_bytes:
        raise ValueError("more bytes than such a file can hold")
    arrays = {}
    for each in answer.arrays:
        array = np.empty(each.shape, each.dtype)
        # As flat bytes: an array without elements cannot be cast to them.
        if stream.readinto(array.reshape(-1).view(np.uint8)) != array.nbytes:  # type: ignore[attr-defined]
            raise EOFError("the child ended within an array")
        arrays[each.name] = array
    return answer, arrays


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Main loop of the child: one file for each request, until its input ends."""
    # PYTHONWARNINGS of the user could turn a harmless warning of a library into an error.
    warnings.simplefilter("ignore")
    while line := requests.readline(_LONGEST_LINE):
        answer, arrays = _answered(msgspec.json.decode(line, type=_Request))
        answers.write(msgspec.json.encode(answer) + b"\n")
        for array in arrays:
            answers.write(array.data.cast("B") if array.size else b"")
        answers.flush()


def _answered(request: _Request) -> tuple[_Answer, list[np.ndarray]]:
    path = Path(os.fsdecode(request.path))
    reader: Reader = getattr(importlib.import_module(request.module), request.function)
    try:
        _limit(path.stat().st_size)
        arrays = {name: np.ascontiguousarray(each) for name, each in reader(path).items()}
    except RecordError as problem:
        return _Answer(error=str(problem)), []
    except (ModuleNotFoundError, MissingExtraError) as problem:
        return _Answer(missing=getattr(problem, "name", None) or "h5py"), []
    except MemoryError:
        return _Answer(error=f"{path}: reading it takes far more memory than it has bytes; it is damaged"), []
    # Damaged bytes raise errors of any kind in these libraries.
    except Exception as problem:  # noqa: BLE001
        reason = str(problem).strip("'\"") or type(problem).__name__
        return _Answer(error=f"{path}: it cannot be read: {reason}; it is damaged: fetch or save it again"), []
    described = tuple(_Array(name=name, dtype=each.dtype.str, shape=each.shape) for name, each in arrays.items())
    return _Answer(arrays=described), list(arrays.values())


def _limit(size_bytes: int) -> None:
    """Limit memory and processor time for the next file, relative to what is used already."""
    try:
        import resource

        # RLIMIT_AS limits the whole address space, so that what is mapped already must be added.
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        return
    memory_bytes = pages * resource.getpagesize() + MOST_PER_BYTE * size_bytes + _ROOM_BYTES
    seconds = int(time.process_time()) + PROCESSOR_LIMIT_S
    for kind, limit in ((resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        _, hard = resource.getrlimit(kind)
        # The soft limit only, so that it can be raised for the next file.
        resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def _main() -> None:
    # Libraries may print to standard output, which would corrupt the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
