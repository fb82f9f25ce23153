"""Runs the tests of what has changed since ``main``: ``make test-changed``, or ``python -m tests.changed REVISION``.

The tests of ``src/markerseek/a/b.py`` are ``test_b.py`` and ``test_b_*.py`` in ``a`` of ``unit`` and ``reference``;
where there are none, those of the folder ``unit/a``. A helper's tests are the files that import it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[1]
PACKAGE = PurePosixPath("src/markerseek")


def changed_since(revision: str, *, root: Path = ROOT) -> list[str]:
    """Files of a clone that differ from where its branch left a revision, also those that git does not know yet."""

    def git(*words: str) -> list[str]:
        return subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True).stdout.splitlines()

    (base,) = git("merge-base", revision, "HEAD")
    return sorted({*git("diff", "--name-only", base), *git("ls-files", "--others", "--exclude-standard")})


def chosen_for(changed: Iterable[str], *, root: Path = ROOT) -> list[str]:
    """Files and folders of tests for changed files; what was removed has none."""
    found: set[str] = set()
    for path in map(PurePosixPath, changed):
        if path.suffix != ".py":
            continue
        if path.is_relative_to(PACKAGE):
            found.update(_of_module(path.relative_to(PACKAGE), root))
        elif path.parts[0] == "tests" and path.name.startswith("test_"):
            found.update([str(path)] if (root / path).exists() else [])
        elif path.parts[0] == "tests":
            found.update(_that_import(".".join(path.with_suffix("").parts), root))
    return sorted(found)


def _of_module(module: PurePosixPath, root: Path) -> list[str]:
    stem = module.stem.strip("_")
    named = [
        file.relative_to(root).as_posix()
        for kind in ("unit", "reference")
        for file in (root / "tests" / kind / module.parent).glob("test_*.py")
        if file.stem == f"test_{stem}" or file.stem.startswith(f"test_{stem}_")
    ]
    folder = PurePosixPath("tests/unit") / module.parent
    return named or ([str(folder)] if (root / folder).is_dir() and module.parent.parts else [])


def _that_import(helper: str, root: Path) -> list[str]:
    files = (root / "tests").rglob("test_*.py")
    return [each.relative_to(root).as_posix() for each in files if f"from {helper} " in each.read_text("utf-8")]


def main() -> None:
    """Run them; the exit code is that of pytest, 0 where there are none."""
    revision = sys.argv[1] if len(sys.argv) > 1 else "main"
    tests = chosen_for(changed_since(revision))
    if not tests:
        sys.stdout.write(f"nothing has changed since {revision} that has tests of its own\n")
        return
    sys.stdout.write("\n".join([*tests, ""]))
    sys.stdout.flush()
    sys.exit(subprocess.run([sys.executable, "-m", "pytest", "-q", *tests], cwd=ROOT, check=False).returncode)


if __name__ == "__main__":
    main()
