"""Takes out of a lock file what a package names as needed and never imports, and what only that needs.

``python requirements/without_tools.py requirements/run.txt``: `make lock` runs it. The packages are installed with
``--no-deps``, from a list that is complete without these.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

NEVER_IMPORTED = {"pacfish": ("coverage", "imageio", "myst-parser", "pytest-cov")}
"""What the tests and the documentation of a package need, which its own metadata require of everybody."""


def without_tools(lock: str) -> str:
    """The lock file of pip-compile without these packages; a package goes once nothing that is left asks for it."""
    entries = {entry.split("==")[0]: entry for entry in re.findall(r"^\S+==.*\n(?:[ ].*\n)*", lock, re.MULTILINE)}
    asked_by = {
        name: set(re.findall(r"^    #(?: via)? +(?!via|-c )(\S+)", entry, re.MULTILINE))
        for name, entry in entries.items()
    }
    for package, tools in NEVER_IMPORTED.items():
        for tool in tools:
            asked_by[tool].discard(package)
    while unasked := [name for name, askers in asked_by.items() if not askers]:
        for name in unasked:
            del asked_by[name], entries[name]
        for askers in asked_by.values():
            askers.difference_update(unasked)
    return "".join(entries.values())


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(without_tools(path.read_text()))
