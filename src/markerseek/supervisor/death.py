"""The signal by which Linux announces a parent's death, sooner than it closes a dead process's sockets."""

from __future__ import annotations

import ctypes
import signal
import sys

_PR_SET_PDEATHSIG = 1
"""`linux/prctl.h`; see prctl(2)."""


def end_with_parent(number: signal.Signals) -> bool:
    """Ask for a signal at the death of the thread that started this process; False where the system has none.

    A killed process gives back its memory before its sockets are closed: 20 ms and more for one of 200 MB. The signal
    is sent while its threads end. Where it is not to be had, the closed socket remains.
    """
    if sys.platform != "linux":
        return False
    try:
        prctl = ctypes.CDLL(None, use_errno=True).prctl
    except (OSError, AttributeError):
        return False
    return int(prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(number), 0, 0, 0)) == 0
