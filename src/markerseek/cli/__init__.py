"""The command line: one file per command, `app` with all of them, and `main`, which handles every error.

Exit codes: 0 found (or all is well), 3 any other answer of a search, 1 a fault, 2 wrong usage or a file that cannot be
read, 4 the rig was not armed, 70 a defect of this program, 74 the output could not be
written, 130 stopped by the user (129, 143: by SIGHUP, SIGTERM).
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import signal
import sys
import warnings
from contextlib import suppress

from markerseek._version import __version__

TYPE_CHECKING = False
if TYPE_CHECKING:
    # Not at run time: `main` has not yet looked at the path from which it would be imported.
    from typing import NoReturn

    from _typeshed import ReadableBuffer

DEFECT = 70
"""Exit code after an unexpected error; EX_SOFTWARE of sysexits.h."""

NO_OUTPUT = 74
"""Exit code where standard output was closed by its reader, or its disk is full; EX_IOERR of sysexits.h."""

STOPPED_BY_USER = 130
"""Exit code after Ctrl-C, as shells have it."""

_OUTPUT = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of standard output, which names no file: a closed pipe, a full disk, a terminal that has gone."""

NO_MACHINE_CODE = (
    "this system forbids memory that a program writes and then executes, which the compiled kernels need; allow it for "
    "markerseek (systemd: MemoryDenyWriteExecute=no; SELinux: setsebool deny_execmem off). Simulations and recordings "
    "also run with NUMBA_DISABLE_JIT=1 in the environment, some 80 times slower"
)
"""What to do where `without_machine_code`."""


def without_machine_code(problem: OSError) -> bool:
    """Return whether this is Numba's error for a system that grants no memory for machine code."""
    return "executable memory" in str(problem)


SHOW_TRACEBACK = "MARKERSEEK_TRACEBACK"
"""Environment variable that makes the command print the traceback of an unexpected error."""


def main() -> NoReturn:
    """Run the command line and end the process with its exit code; every error becomes one line."""
    _open_standard_streams()
    _take_no_warning_as_error()
    # What a command writes may be about a patient: only its owner can read it.
    os.umask(os.umask(0o077) | 0o077)
    _heed_signals()
    # The collector would walk again and again, and once more at the end, through 160,000 objects of the libraries that
    # are no garbage: a fifth of the processor time of a search.
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)
    sys.unraisablehook = _interrupt_again
    try:
        # What blocked them is inherited; a bridge blocks SIGINT until here, so that a stop finds its handler.
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        if any(word.startswith("--heartbeat") for word in sys.argv):
            # Not above: it is for the commands that a bridge runs.
            from markerseek.cli.heartbeat import watch_heartbeat

            watch_heartbeat(sys.argv[1:])
        if sys.argv[1:] == ["--version"]:
            # For scripts that ask often: typer alone takes longer to import than this takes.
            sys.stdout.write(f"{__version__}\n")
            sys.exit(0)
        # Imported here, so that Ctrl-C during the import is handled below.
        from markerseek.cli import hung
        from markerseek.cli.app import run_command

        with hung.ended_by(_end_now):
            run_command()
    except KeyboardInterrupt:
        _end("stopped by the user", kind="KeyboardInterrupt", code=STOPPED_BY_USER)
    except OSError as problem:
        _end_of_os_error(problem)
    except MemoryError as problem:
        message = str(problem) or "the system grants no more"
        _end(f"not enough memory: {message}; close other programs, or ask for less", kind="MemoryError", code=1)
    except Exception as problem:  # noqa: BLE001  the last resort
        _end_of_defect(problem)
    sys.exit(0)


def _interrupt_again(dropped: sys.UnraisableHookArgs) -> None:
    """Raise a Ctrl-C again that Python has dropped, as it drops all exceptions of destructors; compiling runs many."""
    if isinstance(dropped.exc_value, KeyboardInterrupt):
        # By a timer: raised here it would be dropped as well.
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 1e-3)
    else:
        sys.__unraisablehook__(dropped)


def _heed_signals() -> None:
    """Ignore no signal because whoever started this process did: a search must end however it was started.

    A shell without job control starts a command with & so that it ignores Ctrl-C, a service may ignore SIGTERM, and
    where SIGCHLD is ignored the end of a child is not seen. SIGHUP stays ignored: nohup asks for that.
    """
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGALRM, signal.SIGCHLD):
        if signal.getsignal(each) is signal.SIG_IGN:
            signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)


def _take_no_warning_as_error() -> None:
    """Undo PYTHONWARNINGS and ``-W``, here and in all child processes: a library's warning must not end a command."""
    if sys.warnoptions:
        sys.warnoptions.clear()
        os.environ.pop("PYTHONWARNINGS", None)
        warnings.resetwarnings()
        for each in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", each)


def _open_standard_streams() -> None:
    """Put an empty file in the place of each standard stream that is closed, else another file would get its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name, number in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115  until the end
    before = sys.stderr
    if before is sys.__stderr__ and before is not None:
        raw = _Progress(2, "w", closefd=False)
        sys.stderr = io.TextIOWrapper(io.BufferedWriter(raw), before.encoding, "backslashreplace", line_buffering=True)


class _Progress(io.FileIO):
    """Standard error: what it does not take (a terminal that has gone, a full disk) is dropped, and the run goes on."""

    def write(self, data: ReadableBuffer) -> int:
        with suppress(OSError):
            written: int | None = super().write(data)
            if written is not None:
                return written
        return memoryview(data).nbytes


def _end_of_os_error(problem: OSError) -> NoReturn:
    """Report what the operating system refused: output, machine code, a file by its name, or something without one."""
    if problem.filename is None and problem.errno in _OUTPUT:
        # What Python still holds for it would fail again at the end.
        sys.stdout = io.StringIO()
        if problem.errno == errno.EPIPE:
            # Its reader has read enough: markerseek --help | head.
            sys.exit(NO_OUTPUT)
        _end(
            f"the output cannot be written: {problem.strerror}; a journal, if one is kept, holds the answer",
            kind="OSError",
            code=NO_OUTPUT,
        )
    if problem.filename is None:
        if without_machine_code(problem):
            _end(NO_MACHINE_CODE, kind="OSError", code=1)
        _end(f"reading or writing failed: {problem.strerror or problem}", kind="OSError", code=1)
    # Path.exists() itself fails for a name that is too long, or in a folder without permission.
    _end(f"{problem.filename}: {problem.strerror}; check the name and the rights", kind="OSError", code=2)


def _end_of_defect(problem: Exception) -> NoReturn:
    """Report an unexpected error, and how to print its traceback."""
    kind = type(problem).__name__
    if os.environ.get(SHOW_TRACEBACK) == "1":
        import traceback

        traceback.print_exception(problem)
    message = " ".join(str(problem).split())[:500] or "no message"
    _end(
        f"a defect of markerseek {__version__}: {kind}: {message}; please report it with the traceback, which the same "
        f"command shows with {SHOW_TRACEBACK}=1",
        kind=kind,
        code=DEFECT,
    )


def _end_now(message: str, code: int) -> NoReturn:
    """End the process although its main thread hangs."""
    try:
        _end(message, kind="Stopped", code=code)
    finally:
        os._exit(code)


def _end(message: str, *, kind: str, code: int) -> NoReturn:
    """Print how a command ended, with the standard library only: imports or memory may be missing."""
    sys.stderr.write(f"error: {message}\n".encode("utf-8", "backslashreplace").decode("utf-8"))
    if "--json" in sys.argv:
        import json  # not above: Ctrl-C can be handled only once this module is imported

        # Bytes of a file's name that are no Unicode come out as escapes.
        try:
            sys.stdout.write(json.dumps({"error": message, "kind": kind}) + "\n")
            sys.stdout.flush()
        except OSError:
            sys.stdout = io.StringIO()
    sys.exit(code)
