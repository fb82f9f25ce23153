"""Compile a kernel with Numba, keeping the machine code on disk where that is possible.

The only place that calls Numba's decorator. It holds no formula, so that `acoustics` (forward) and `signals` and
`search` (inverse) may all import it without sharing code of the model.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import event

_LOG = logging.getLogger(__name__)

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_REASSOCIATE = {"nsz", "arcp", "contract", "reassoc"}
"""Sums may be reordered, so that they run in vector registers; NaN and infinity keep their meaning."""


def on_compiling(say: Callable[..., object]) -> None:
    """Call ``say(kept=...)`` once, when the first kernel of this process is compiled; for none that is on the disk.

    ``kept`` says whether the machine code stays on the disk. Numba says it itself, so that it is right wherever the
    package and its machine code are.
    """
    event.register(_COMPILE, _First(say))  # type: ignore[no-untyped-call]


_COMPILE = "numba:compile"


class _First(event.Listener):
    """Calls ``say`` at the first kernel of ours that is compiled."""

    def __init__(self, say: Callable[..., object]) -> None:
        self._say: Callable[..., object] | None = say

    def on_start(self, event: event.Event) -> None:
        """Say it, unless it was said."""
        kernel = event.data["dispatcher"]
        say = self._say
        if say is not None and kernel.py_func.__module__.startswith("markerseek."):
            self._say = None
            say(kept=kernel.stats.cache_path is not None)

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""


def compiled(kernel: Kernel) -> Kernel:
    """Return the kernel as machine code, made at its first call and kept on disk.

    Where neither the package's folder nor the user's cache folder can be written, the kernel is compiled again in
    each process, and one warning says so.
    """
    # Without a home folder Numba would make one with the name ~ in the current folder.
    if os.path.expanduser("~") == "~":  # noqa: PTH111  pathlib raises an error there
        os.environ.setdefault("XDG_CACHE_HOME", os.devnull)
    try:
        machine_code = njit(cache=True, fastmath=_REASSOCIATE, nogil=True)(kernel)
    except RuntimeError:
        _warn_that_nothing_is_kept()
        machine_code = njit(fastmath=_REASSOCIATE, nogil=True)(kernel)
    return cast("Kernel", machine_code)


@cache
def _warn_that_nothing_is_kept() -> None:
    _LOG.warning(
        "no folder for compiled code can be written, so each start takes some seconds more; "
        "set NUMBA_CACHE_DIR to a folder that can be written"
    )
