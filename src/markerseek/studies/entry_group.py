"""Runs the command of an entry in a process group of its own, which is killed once the worker has ended.

The worker has the other end of a pipe; however it ends, the system closes that. An entry need not hear the end of its
input, and a program that it has started ends with it. It is run by its path, without this package.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def run(worker: int, command: list[str]) -> None:
    """Run a command to its end. ``worker``: the end of the pipe that is read."""
    threading.Thread(target=_end_with, args=(worker,), daemon=True).start()
    try:
        # The user's own command.
        entry = subprocess.Popen(command)  # noqa: S603
    except OSError as problem:
        sys.exit(f"{command[0]}: it cannot be started: {problem.strerror}; check the command")
    # The end of these pipes is that of the entry, not of this process.
    os.closerange(0, 3)
    entry.wait()
    os._exit(0)


def _end_with(worker: int) -> None:
    os.read(worker, 1)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    run(int(sys.argv[1]), sys.argv[2:])
