"""How large the house is: lines, files, comments, rooms of a command. ``python -m benchmarks.house [COMMIT]``.

With a commit, both columns: that commit, and the working tree.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
WINGS = {
    "records with files": ("records", "files"),
    "page with shared bridges": ("bridges/page", "bridges/*.py"),
    "cli": ("cli",),
    "paper": ("studies/paper",),
}


class Weight(NamedTuple):
    """What files weigh."""

    lines: int
    code: int
    """Lines with code on them: no docstring, no comment, not empty."""
    comments: int
    files: int
    largest: int


def weight(paths: Iterable[Path]) -> Weight:
    """Weight of these files of Python."""
    lines, code, comments, largest, files = 0, 0, 0, 0, 0
    for path in paths:
        text = path.read_text(encoding="utf-8")
        count = text.count("\n")
        tokens = list(tokenize.generate_tokens(io.StringIO(text).readline))
        marks = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
        on = {row for token in tokens if token.type not in marks for row in range(token.start[0], token.end[0] + 1)}
        code += len(on - _docstring_rows(text))
        comments += sum(token.type == tokenize.COMMENT for token in tokens)
        lines, files, largest = lines + count, files + 1, max(largest, count)
    return Weight(lines, code, comments, files, largest)


def _docstring_rows(text: str) -> set[int]:
    """Rows of strings that stand alone: docstrings, of values too."""
    alone = (
        node.value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    )
    return {row for string in alone for row in range(string.lineno, (string.end_lineno or string.lineno) + 1)}


def rooms(root: Path, words: list[str]) -> int | None:
    """Modules of this package that a command has imported at its end; None if it cannot be run here."""
    asked = (
        "import sys\nfrom markerseek.cli import main\nsys.argv[0] = 'markerseek'\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print(sum(each.startswith('markerseek.') for each in sys.modules), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", asked, *words],
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": str(root / "src"), "PATH": "/usr/bin:/bin", "HOME": tempfile.gettempdir()},
    )
    last = done.stderr.strip().rpartition("\n")[2]
    return int(last) if last.isdigit() else None


def measured(root: Path) -> dict[str, str]:
    """Every row for a checkout."""
    package = root / "src" / "markerseek"
    whole = weight(package.rglob("*.py"))
    rows = {
        "src: lines; code; files; largest": f"{whole.lines}; {whole.code}; {whole.files}; {whole.largest}",
        "comments, of all lines": f"{whole.comments / whole.lines:.1%}",
    }
    for name, places in WINGS.items():
        found = {
            path
            for place in places
            for path in (package.glob(place) if "*" in place else (package / place).rglob("*.py"))
        }
        rows[name] = f"{weight(found).lines}"
    tests = weight((root / "tests").rglob("*.py"))
    rows["tests: lines; files; largest"] = f"{tests.lines}; {tests.files}; {tests.largest}"
    rows["modules imported by search --help"] = f"{rooms(root, ['search', '--help'])}"
    return rows


def main() -> None:
    """Print the rows of the working tree, those of a commit before them."""
    columns = [measured(ROOT)]
    for commit in sys.argv[1:]:
        done = subprocess.run(["git", "archive", commit, "src", "tests"], cwd=ROOT, capture_output=True, check=True)
        with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
            archive.extractall(folder, filter="data")
            columns.insert(-1, measured(Path(folder)))
    print("| |", *(f" {name} |" for name in (*sys.argv[1:], "this checkout")))
    print("|---|" + "---|" * len(columns))
    for name in columns[0]:
        print(f"| {name} |", *(f"{column[name]} |" for column in columns))


if __name__ == "__main__":
    main()
