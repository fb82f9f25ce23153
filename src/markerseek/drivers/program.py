"""Running the start command of a rig file without blocking the control loop."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence

from markerseek.core import Clock, DeviceTimeoutError, NotConnectedError

_POLL_S = 0.02


def run_to_its_end(command: Sequence[str], *, timeout_s: float, clock: Clock, what: str) -> None:
    """Run a program, waiting on the clock; it is killed if that takes too long, or if the search is interrupted.

    ``command``: program and arguments; no shell reads them. ``timeout_s``: longest time that it may take. ``what``:
    name of its device, for the messages. Raises `NotConnectedError` if it cannot be run, or ends with another code than
    0; its last line of output is in the message. Raises `DeviceTimeoutError` if it takes too long.
    """
    # A file and no pipe: a program that prints more than a pipe holds would block for ever.
    with tempfile.TemporaryFile() as output:
        try:
            # S603: the program is named by the owner of the rig file, who may run any program anyway.
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output)  # noqa: S603
        except (OSError, ValueError) as error:
            raise NotConnectedError(
                f"{what}: the start command {command[0]!r} cannot be run ({error}); check start_command in the rig file"
            ) from error
        try:
            _await_exit(process, command[0], timeout_s=timeout_s, clock=clock, what=what)
        finally:
            process.kill()
            process.wait()
        if process.returncode != 0:
            output.seek(max(0, output.seek(0, os.SEEK_END) - 500))
            last = output.read().decode("utf-8", "replace").strip().rpartition("\n")[2]
            raise NotConnectedError(
                f"{what}: the start command {command[0]!r} ended with code {process.returncode}"
                f"{': ' + last if last else ''}; try it by hand"
            )


def _await_exit(process: subprocess.Popen[bytes], program: str, *, timeout_s: float, clock: Clock, what: str) -> None:
    # Polled, since `Popen.wait` would block this thread, whose waits on the clock renew the lease.
    ends_s = clock.now_s() + timeout_s
    while process.poll() is None:
        if not clock.now_s() <= ends_s:
            raise DeviceTimeoutError(
                f"{what}: the start command {program!r} took more than {timeout_s:g} s and was ended; try it by hand "
                "or raise start_timeout_s"
            )
        clock.wait(_POLL_S)
