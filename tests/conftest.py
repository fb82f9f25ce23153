"""Shapes and types of every public function of the pure packages are checked while the tests run."""

from __future__ import annotations

import pkgutil
import signal

import hypothesis
from jaxtyping import install_import_hook

PURE = ("core", "search", "signals", "acoustics", "calibration")

# A program started with signals ignored (by nohup, or in the background) would hand that on to those that tests strike.
for each in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    if signal.getsignal(each) is signal.SIG_IGN:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)

# No test is timed: a busy machine is no fault.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def _pure_modules() -> list[str]:
    """Modules of the pure packages but for compiled kernels, which Numba must see undecorated."""
    import markerseek

    return [
        module.name
        for module in pkgutil.walk_packages(markerseek.__path__, "markerseek.")
        if module.name.split(".")[1] in PURE
        and not module.ispkg
        and not module.name.rsplit(".", 1)[1].startswith("_")
        and not module.name.endswith("compiled")
    ]


install_import_hook(_pure_modules(), "beartype.beartype")
