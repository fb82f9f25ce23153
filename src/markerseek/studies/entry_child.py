"""Run by its path, without this package: the server of a class of a Python file.

``entry_child.py FILE.py:Class`` replies to lines for a class, which is made with the line of a search and has ``ask()``
(the next angle in degrees, or None at the end), ``tell(sample)``, and ``answer()``; lines and samples are dictionaries.
"""

from __future__ import annotations

import json
import os
import runpy
import sys
from pathlib import Path
from typing import Any


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
    serve(sys.argv[1])
