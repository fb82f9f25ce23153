"""Prints the page of licences: ``python release/licences.py > requirements/licences.md``.

They are read from the metadata of the packages that are installed in this environment, for each name in
``requirements/run.txt``. A licence that is not known to be permissive ends it with an error.
"""

from __future__ import annotations

import re
import sys
from importlib import metadata
from pathlib import Path

LOCK = Path(__file__).parents[1] / "requirements" / "run.txt"

KNOWN = r"MIT|BSD|Apache|PSF|Python Software Foundation|ISC|MPL|Mozilla|CC0|Zlib|0BSD|Public Domain|Unlicense|any-OSI"
"""Licences that allow use in any program; the MPL asks for changes of its own files only."""

REMARKS = {
    "docutils": "a mode for Emacs, which the wheel does not hold, is under the GPL",
    "opencv-python-headless": "its wheel holds FFmpeg's libraries under the LGPL 2.1, linked dynamically",
}
"""What the metadata do not say, or say of files that are not installed."""

PAGE = """# Licences

markerseek is under the MIT licence. These are the packages that its commands need, with the versions that
`requirements/run.txt` pins. `python release/licences.py` has made the table from the metadata of the packages. None of
them is under the GPL. ROS 2 is a further extra, and not in the list.

| package | version | licence | remark |
|---|---|---|---|
"""


def licence_of(name: str) -> str:
    """Licence as the package states it: the expression, else the classifiers, else the text of the field."""
    facts = metadata.metadata(name)
    if facts["License-Expression"]:
        return str(facts["License-Expression"])
    classifiers = [each.rpartition(" :: ")[2] for each in facts.get_all("Classifier") or () if "License ::" in each]
    return ", ".join(classifiers) or str(facts["License"] or "").strip().partition("\n")[0] or "not stated"


def allowed(name: str, licence: str) -> bool:
    """Whether every part of it is permissive, but for what a remark explains."""
    parts = re.split(r", | AND | OR | WITH ", licence)
    return name in REMARKS or all(re.search(KNOWN, part) or "LLVM-exception" in part for part in parts)


def rows() -> list[tuple[str, str, str, str]]:
    """Name, version, licence and remark of each package of the list."""
    names = re.findall(r"^([\w.-]+)==", LOCK.read_text(encoding="utf-8"), re.MULTILINE)
    return [(name, metadata.version(name), licence_of(name), REMARKS.get(name, "")) for name in names]


def main() -> None:
    """Print the page."""
    table = rows()
    if refused := [f"{name}: {licence}" for name, _, licence, _ in table if not allowed(name, licence)]:
        sys.exit("licences that are not known to be permissive: " + "; ".join(refused))
    sys.stdout.write(PAGE + "".join(f"| {' | '.join(row)} |\n" for row in table))


if __name__ == "__main__":
    main()
