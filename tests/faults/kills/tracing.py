"""Kills a process of its own at the n-th call that changes something on the disk, by ptrace (Linux)."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

from .processes import End, ended, forked

_TRACEME, _SYSCALL, _DETACH, _SET_OPTIONS, _GET_SYSCALL_INFO = 0, 24, 17, 0x4200, 0x420E
_MARK_SYSCALLS, _DIES_WITH_US = 0x1, 0x100000

_WRITING = {
    1: "write", 18: "pwrite64", 20: "writev", 40: "sendfile", 74: "fsync", 75: "fdatasync", 76: "truncate",
    77: "ftruncate", 82: "rename", 86: "link", 87: "unlink", 263: "unlinkat", 264: "renameat", 265: "linkat",
    285: "fallocate", 296: "pwritev", 316: "renameat2", 326: "copy_file_range",
}  # fmt: skip
"""System calls that change what is on a disk, by their numbers on x86-64."""


class _Info(ctypes.Structure):
    _fields_ = (
        ("op", ctypes.c_uint8),
        ("pad", ctypes.c_uint8 * 3),
        ("arch", ctypes.c_uint32),
        ("ip", ctypes.c_uint64),
        ("sp", ctypes.c_uint64),
        ("number", ctypes.c_uint64),
        ("arguments", ctypes.c_uint64 * 6),
    )


def _ptrace(request: int, pid: int, address: int, data: Any) -> int:
    library = ctypes.CDLL(None, use_errno=True)
    library.ptrace.restype = ctypes.c_long
    library.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    return int(library.ptrace(request, pid, address, data))


def can_trace() -> bool:
    """Whether this machine lets a process watch its child."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return False
    child = os.fork()
    if child == 0:
        os._exit(0 if _ptrace(_TRACEME, 0, 0, None) == 0 else 1)
    _, status = os.waitpid(child, 0)
    return status == 0


def around(call: Callable[..., Any]) -> Callable[..., Any]:
    """A call, in the process that is to be killed, of which every write is counted."""

    def traced(*args: Any, **named: Any) -> Any:
        _ptrace(_TRACEME, 0, 0, None)
        os.kill(os.getpid(), signal.SIGSTOP)
        try:
            return call(*args, **named)
        finally:
            os.kill(os.getpid(), signal.SIGSTOP)

    return traced


def killed_at_write(work: Callable[..., object], number: int) -> End:
    """Do work in a forked process, and kill it just before its n-th write in the call that is `around`.

    Its place is the name of the system call; a process that makes fewer lives on to its end.
    """
    child, receiving, began_s = forked(work)
    place, status = _follow(child, number)
    received = b""
    while data := os.read(receiving, 65536):
        received += data
    os.close(receiving)
    return ended(received + place.encode(), status, took_s=time.monotonic() - began_s)


def _follow(child: int, number: int) -> tuple[str, int]:
    """Count writes between the two stops that the child asks for; the place of death and the exit status come back."""
    _, status = os.waitpid(child, 0)
    if not os.WIFSTOPPED(status):
        return "", status
    _ptrace(_SET_OPTIONS, child, 0, _MARK_SYSCALLS | _DIES_WITH_US)
    writes = 0
    info = _Info()
    passed_on = 0
    while True:
        _ptrace(_SYSCALL, child, 0, passed_on)
        _, status = os.waitpid(child, 0)
        if not os.WIFSTOPPED(status):
            return "", status
        stopped_by = os.WSTOPSIG(status)
        passed_on = 0
        if stopped_by == signal.SIGSTOP:
            _ptrace(_DETACH, child, 0, 0)
            return "", os.waitpid(child, 0)[1]
        if stopped_by != signal.SIGTRAP | 0x80:
            passed_on = stopped_by
            continue
        _ptrace(_GET_SYSCALL_INFO, child, ctypes.sizeof(info), ctypes.byref(info))
        # 1: the call is entered, and has done nothing yet.
        if info.op == 1 and info.number in _WRITING:
            writes += 1
            if writes == number:
                os.kill(child, signal.SIGKILL)
                return _WRITING[info.number], os.waitpid(child, 0)[1]
