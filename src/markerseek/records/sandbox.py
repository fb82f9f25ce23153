"""Reads foreign files in a child process, because libraries can crash, hang or fill the memory on damaged bytes.

The child (``python -P -m markerseek.records.sandbox``; without ``-P`` a file in the current folder could take the place
of a library) calls a reader of this package, under limits of memory and processor time, and hands plain arrays back.
A reader is a module-level function that takes a path and returns arrays by name. One child reads many files.

On Linux each file is read in a fork of the child that can read the file and the installed libraries, but open no other
file, no socket and no program: Landlock refuses the files (from Linux 5.13 on, where it is not switched off), and
seccomp the rest (on x86-64 and aarch64). Elsewhere there are only the limits of memory and time.
"""

from __future__ import annotations

import ctypes
import errno
import importlib
import math
import os
import signal
import site
import struct
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

from markerseek._closing import Closing
from markerseek.core import ConfigError, MissingExtraError, RecordError, described

Reader: TypeAlias = Callable[[Path], Mapping[str, np.ndarray]]
"""Function of a module, which the child imports by its name."""

LIMIT_S, PROCESSOR_LIMIT_S = 60.0, 5
"""Longest time for one file, and of it on the processor, in seconds."""

MAX_PER_BYTE = 32
"""Most bytes of memory for each byte of a file; a compressed file that needs more is refused."""

_ROOM_BYTES = 1 << 29
"""Memory for the libraries themselves (h5py, SciPy), which are imported with the first file."""

_LONGEST_LINE = 1 << 20

LIBRARIES = {
    "read_mat": "scipy.io",
    "read_mat73": "h5py",
    "walk_bank": "h5py",
    "zea_arrays": "h5py",
    "read_png": "cv2",
    "read_camera_png": "cv2",
    "read_dicom": "pydicom",
}
"""What the readers import, by their names: imported once, and not again in each fork."""

_SYSTEM = (
    "/usr",
    "/lib",
    "/lib64",
    "/etc/ld.so.cache",
    "/dev/null",
    "/dev/urandom",
    "/proc/self",
    "/sys/devices/system",
)
"""What the libraries of the system may have to read."""


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
    """Answer of the child for one file: descriptions of arrays, followed by their bytes, or an error."""

    arrays: tuple[_Array, ...] = ()
    error: str | None = None
    missing: str | None = None


class Sandbox(Closing):
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

        ``reader``: function of a module that the child can import. Raises `RecordError` if the reader refuses the file,
        or the child crashes, takes too long or needs too much memory.
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
            answer, arrays = _received(child.stdout, most_bytes=MAX_PER_BYTE * path.stat().st_size + _ROOM_BYTES)
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
        request = msgspec.json.decode(line, type=_Request)
        path = Path(os.fsdecode(request.path))
        reader: Reader = getattr(importlib.import_module(request.module), request.function)
        with suppress(ImportError):
            importlib.import_module(LIBRARIES.get(request.function, "numpy"))
        if sys.platform != "linux":
            _answer(answers, reader, path)
            continue
        server = os.getpid()
        fork = os.fork()
        if fork == 0:
            try:
                _confine(path, server)
                _answer(answers, reader, path)
                os._exit(0)
            finally:
                os._exit(1)
        # What broke down on its file, or was killed, ends this process too: its reader sees the end of the pipe.
        if os.waitpid(fork, 0)[1] != 0:
            sys.exit(1)


def _answer(answers: IO[bytes], reader: Reader, path: Path) -> None:
    answer, arrays = _answered(reader, path)
    answers.write(msgspec.json.encode(answer) + b"\n")
    for array in arrays:
        answers.write(array.data.cast("B") if array.size else b"")
    answers.flush()


def _answered(reader: Reader, path: Path) -> tuple[_Answer, list[np.ndarray]]:
    try:
        _limit(path.stat().st_size)
        arrays = {name: np.ascontiguousarray(each) for name, each in reader(path).items()}
    except (ModuleNotFoundError, MissingExtraError) as problem:
        return _Answer(missing=getattr(problem, "name", None) or "h5py"), []
    except (RecordError, ConfigError) as problem:
        return _Answer(error=str(problem)), []
    # A library that is there and cannot be loaded.
    except ImportError as problem:
        return _Answer(error=f"{path}: it cannot be read, because of a library: {described(problem)}"), []
    except MemoryError:
        return _Answer(error=f"{path}: reading it takes far more memory than it has bytes; it is damaged"), []
    # Damaged bytes raise errors of any kind in these libraries.
    except Exception as problem:  # noqa: BLE001
        reason = str(problem).strip("'\"") or type(problem).__name__
        return _Answer(error=f"{path}: it cannot be read: {reason}; it is damaged: fetch or save it again"), []
    listed = tuple(_Array(name=name, dtype=each.dtype.str, shape=each.shape) for name, each in arrays.items())
    return _Answer(arrays=listed), list(arrays.values())


def _confine(path: Path, server: int) -> None:
    """Let this process open one file and the libraries only, as far as the kernel can confine it."""
    libc = ctypes.CDLL(None, use_errno=True)
    # PR_SET_PDEATHSIG: a server that is killed because this process hangs takes it along.
    libc.prctl(1, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != server:
        os._exit(1)
    # PR_SET_NO_NEW_PRIVS, which both of the following need.
    libc.prctl(38, 1, 0, 0, 0)
    ours = str(Path(__file__).parents[1])
    folders = (*_SYSTEM, ours, sys.prefix, sys.base_prefix, *site.getsitepackages(), *filter(None, sys.path))
    _read_only(libc, {str(path), *folders})
    _without_calls(libc)


_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
"""Calls of Landlock, whose numbers are the same on all processors (linux/landlock.h)."""

_EXECUTE, _READ_FILE, _READ_DIR, _ALL, _TRUNCATE = 1 << 0, 1 << 2, 1 << 3, (1 << 13) - 1, 1 << 14


def _read_only(libc: ctypes.CDLL, paths: set[str]) -> None:
    """Refuse every file but those in these paths, which can be read."""
    version = libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return
    handled = struct.pack("=Q", _ALL | (_TRUNCATE if version >= 3 else 0))
    rules = libc.syscall(_CREATE_RULESET, handled, ctypes.c_size_t(len(handled)), 0)
    for path in paths:
        with suppress(OSError):
            opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
            allowed = _READ_FILE | _EXECUTE | (_READ_DIR if Path(path).is_dir() else 0)
            libc.syscall(_ADD_RULE, rules, 1, struct.pack("=Qi", allowed, opened), 0)
            os.close(opened)
    libc.syscall(_RESTRICT_SELF, rules, 0)
    os.close(rules)


_ARCHITECTURES = {
    "x86_64": (0xC000003E, (41, 42, 59, 62, 101, 200, 234, 310, 311, 321, 322, 424, 425, 438)),
    "aarch64": (0xC00000B7, (198, 203, 221, 129, 117, 130, 131, 270, 271, 280, 281, 424, 425, 438)),
}
"""Number of a processor's calls (linux/audit.h), and those refused: socket, connect, execve, kill, ptrace, tkill,
tgkill, process_vm_readv, process_vm_writev, bpf, execveat, pidfd_send_signal, io_uring_setup, pidfd_getfd."""


def _without_calls(libc: ctypes.CDLL) -> None:
    """Refuse calls of the operating system by a seccomp filter; a parser needs none of them."""
    machine = os.uname().machine
    if machine not in _ARCHITECTURES:
        return
    architecture, refused = _ARCHITECTURES[machine]
    # Struct sock_filter: code, steps where it is true and false, value. BPF_LD|W|ABS, BPF_JMP|JEQ and JGE, BPF_RET.
    load, equal, at_least, end = 0x20, 0x15, 0x35, 0x06
    kill, allow, refuse = 0x80000000, 0x7FFF0000, 0x00050000 | errno.EPERM
    count = len(refused)
    program = [
        (load, 0, 0, 4),
        (equal, 1, 0, architecture),
        (end, 0, 0, kill),
        (load, 0, 0, 0),
        # Calls of the x32 ABI have other numbers.
        (at_least, count + 1, 0, 1 << 30),
        *((equal, count - index, 0, number) for index, number in enumerate(refused)),
        (end, 0, 0, allow),
        (end, 0, 0, refuse),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *each) for each in program))
    # Struct sock_fprog; PR_SET_SECCOMP, SECCOMP_MODE_FILTER.
    libc.prctl(22, 2, struct.pack("@HP", len(program), ctypes.addressof(code)), 0, 0)


def _limit(size_bytes: int) -> None:
    """Limit memory and processor time for a file, relative to what is used already."""
    try:
        import resource

        # RLIMIT_AS limits the whole address space, so that what is mapped already must be added.
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        return
    memory_bytes = pages * resource.getpagesize() + MAX_PER_BYTE * size_bytes + _ROOM_BYTES
    seconds = int(time.process_time()) + PROCESSOR_LIMIT_S
    for kind, limit in ((resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        _, hard = resource.getrlimit(kind)
        soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        # A fork reads one file; without one, the soft limit must be raised for the next.
        resource.setrlimit(kind, (soft, soft if sys.platform == "linux" else hard))


def _main() -> None:
    # Libraries may print to standard output, which would corrupt the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
