"""Serves a class of a Python file as an entry: ``python -P -m markerseek.studies.entry_server FILE.py:Class``.

The class needs nothing of this package. It is made with the line of a search, and has ``ask()``, the next angle in
degrees or None at the end, ``tell(sample)``, and ``answer()``; all lines and samples are dictionaries.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

import msgspec


def serve(place: str) -> None:
    """Reply to each line of standard input, until it ends."""
    # What the class prints must not be taken for a reply.
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    maker = _loaded(place)
    search: Any = None
    for line in sys.stdin.buffer:
        message = msgspec.json.decode(line)
        if message["type"] == "search":
            search = maker(message)
        else:
            search.tell(message)
        angle_deg = search.ask()
        reply = search.answer() if angle_deg is None else {"angle_deg": angle_deg}
        # NumPy's numbers too; NaN becomes null, which is refused.
        replies.write(msgspec.json.encode(reply, enc_hook=float) + b"\n")
        replies.flush()


def _loaded(place: str) -> Any:
    """The class of a file, ``FILE.py:Class``."""
    file, _, name = place.rpartition(":")
    spec = importlib.util.spec_from_file_location(Path(file).stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file}: it is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return getattr(module, name)


if __name__ == "__main__":
    serve(sys.argv[1])
