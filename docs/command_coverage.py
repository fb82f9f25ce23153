"""Writes what each command of the tutorials reaches of the package: ``python docs/command_coverage.py FILE``.

Each ``markerseek`` command of a tutorial's console blocks runs in the order of its page, in a folder that holds the
examples. A row has the lines that it ran, and those that no command before it did; below are the files of which the
commands together reach least. Lines that processes run which a command starts are counted too.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import coverage

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "markerseek"
LEAST = 20
"""Number of files that are listed."""

CONFIG = f"""[run]
source = {PACKAGE}
parallel = true
patch = subprocess
concurrency = thread, multiprocessing
"""


def commands_of(page: Path) -> list[str]:
    """Lines of a page's console blocks that call the command."""
    blocks = re.findall(r"^```console\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in re.findall(r"^\$ (.*)$", block, re.MULTILINE)]
    return [line for line in lines if "markerseek " in line]


def ran(command: str, folder: Path, data: Path) -> dict[str, set[int]]:
    """Run a command, and return the lines of each file that it ran."""
    data.mkdir()
    (config := data / "coveragerc").write_text(CONFIG, encoding="utf-8")
    measured = f'"{sys.executable}" -m coverage run --rcfile="{config}" --data-file="{data}/lines" -m markerseek'
    script = f'markerseek() {{ {measured} "$@"; }}\n{command}'
    environment = os.environ | {"XDG_DATA_HOME": str(folder / "data"), "COVERAGE_FILE": str(data / "lines")}
    subprocess.run(["bash", "-c", script], cwd=folder, env=environment, check=False, capture_output=True)  # noqa: S603, S607
    lines = coverage.CoverageData(basename=str(data / "joined"))
    for part in data.glob("lines*"):
        other = coverage.CoverageData(basename=str(part))
        other.read()
        lines.update(other)
    return {name: set(lines.lines(name) or ()) for name in lines.measured_files()}


def statements() -> dict[str, set[int]]:
    """Lines of each file of the package that can run."""
    analyser = coverage.Coverage(data_file=None, config_file=False)
    return {str(path): set(analyser.analysis2(str(path))[1]) for path in sorted(PACKAGE.rglob("*.py"))}


def report() -> str:
    """Return the table, as Markdown."""
    known = statements()
    reached: dict[str, set[int]] = {name: set() for name in known}
    rows = ["| page | command | lines | new |", "|---|---|---|---|"]
    with TemporaryDirectory() as name:
        for page in sorted((ROOT / "docs" / "tutorials").glob("*.md")):
            folder = Path(name, page.stem)
            folder.mkdir()
            (folder / "examples").symlink_to(ROOT / "examples")
            for number, command in enumerate(commands_of(page)):
                lines = ran(command, folder, Path(name, f"{page.stem}-{number}"))
                here = {file: lines.get(file, set()) & known[file] for file in known}
                new = sum(len(here[file] - reached[file]) for file in known)
                reached = {file: reached[file] | here[file] for file in known}
                rows.append(f"| {page.stem} | `{command}` | {sum(map(len, here.values()))} | {new} |")
    total = sum(map(len, known.values()))
    rows.append(
        f"\nTogether they reach {sum(map(len, reached.values()))} of {total} lines. The files with most others:\n"
    )
    missed = sorted(known, key=lambda file: len(reached[file]) - len(known[file]))[:LEAST]
    rows += ["| file | reached | of |", "|---|---|---|"]
    rows += [f"| {Path(file).relative_to(PACKAGE)} | {len(reached[file])} | {len(known[file])} |" for file in missed]
    return "\n".join(["# Coverage by documented command", "", *rows, ""])


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(report(), encoding="utf-8")
    sys.stdout.write(f"{path}\n")
