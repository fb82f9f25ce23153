"""Run by its path, without this package: the process above an entry, and the server of a class of a Python file.

``entry_child.py PIPE COMMAND…`` runs a command in its process group, and ends the group once the worker at the other
end of the pipe has ended, however that was; the programs that an entry starts end with it. ``entry_child.py
FILE.py:Class`` replies to lines for a class, which is made with the line of a search and has ``ask()`` (the next angle
in degrees, or None at the end), ``tell(sample)``, and ``answer()``; lines and samples are dictionaries.
"""

from __future__ import annotations

import json
import os
import runpy
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any


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
    # The entry's own temporary folder.
    shutil.rmtree(Path.cwd(), ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


def serve(place: str) -> None:
    """Reply to each line of standard input, until it ends."""
    # What the class prints must not be taken for a reply.
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    file, _, name = place.rpartition(":")
    made_by = runpy.run_path(file, run_name=Path(file).stem)[name]
    search: Any = None
    for line in sys.stdin:
        message = json.loads(line)
        if message["type"] == "search":
            search = made_by(message)
        else:
            search.tell(message)
        angle_deg = search.ask()
        reply = search.answer() if angle_deg is None else {"angle_deg": angle_deg}
        # NumPy's numbers too.
        replies.write(json.dumps(reply, default=float) + "\n")
        replies.flush()


if __name__ == "__main__":
    if len(sys.argv) == 2:
        serve(sys.argv[1])
    else:
        run(int(sys.argv[1]), sys.argv[2:])
