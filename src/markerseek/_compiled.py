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
from numba.core.dispatcher import Dispatcher

_LOG = logging.getLogger(__name__)

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_REASSOCIATE = {"nsz", "arcp", "contract", "reassoc"}
"""Sums may be reordered, so that they run in vector registers; NaN and infinity keep their meaning."""


KERNELS: list[Dispatcher] = []
"""All kernels of the process, from which the command line sees whether they are compiled already."""


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
    # With NUMBA_DISABLE_JIT it is the function itself.
    if isinstance(machine_code, Dispatcher):
        KERNELS.append(machine_code)
    return cast("Kernel", machine_code)


@cache
def _warn_that_nothing_is_kept() -> None:
    _LOG.warning(
        "no folder for compiled code can be written, so each start takes some seconds more; "
        "set NUMBA_CACHE_DIR to a folder that can be written"
    )
